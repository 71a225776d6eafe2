"""Arm files: what the bundled ones say, what each mistake is answered with, and that as text they
come back as they were.
"""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest

from aacmm_pin.arm import EXAMPLE_ROBOTS, ArmFile, arm_text, bundled_arms, load_arm_file
from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import ArmFileError, UnknownNameError

pytestmark = pytest.mark.fast

GOOD = """\
schema = "aacmm-pin/arm/1"
name = "two rows"
convention = "modified-dh"

[[joints]]
a_mm = 100
d_mm = 20.0
alpha_rad = 1.5
theta_offset_rad = 0.1
limits_rad = [-1.0, 2]
uncertainty = { a_mm = 0.01, d_mm = 0.02, alpha_rad = 1e-5, theta_offset_rad = 3e-5 }
encoder_noise_rad = 1e-5
mass_kg = 0.5
com_mm = [1, 2.0, 3.0]

[[joints]]
a_mm = 0.0
d_mm = 50.0
alpha_rad = 0.0
theta_offset_rad = 0.0
fixed = true

[stylus]
axis = [0, 0.0, 1.0]
"""


def test_angles_in_degrees_by_the_suffix_of_their_keys():
    pairs = {
        "alpha_rad = 1.5": f"alpha_deg = {math.degrees(1.5)!r}",
        "theta_offset_rad = 0.1": f"theta_offset_deg = {math.degrees(0.1)!r}",
        "alpha_rad = 1e-5": f"alpha_deg = {math.degrees(1e-5)!r}",
        "encoder_noise_rad = 1e-5": f"encoder_noise_deg = {math.degrees(1e-5)!r}",
        "limits_rad = [-1.0, 2]": f"limits_deg = [{math.degrees(-1)!r}, {math.degrees(2)!r}]",
    }
    in_degrees = GOOD
    for radians, degrees in pairs.items():
        in_degrees = in_degrees.replace(radians, degrees)
    known, read = (parse_arm_file(text.encode(), "arm.toml") for text in (GOOD, in_degrees))
    np.testing.assert_allclose(read.limits, known.limits, rtol=1e-15)
    for one, other in zip(read.dh_parameters(), known.dh_parameters(), strict=True):
        np.testing.assert_allclose([one.value, one.u], [other.value, other.u], rtol=1e-15)
    np.testing.assert_allclose(read.encoder_noise, known.encoder_noise, rtol=1e-15)
    for bad in ("alpha_deg = 90\nalpha_rad = 1.5", 'alpha_deg = "90"', "alpha_deg = [true]"):
        with pytest.raises(ArmFileError, match="alpha_deg"):
            parse_arm_file(GOOD.replace("alpha_rad = 1.5", bad).encode(), "arm.toml")


def test_every_key_is_read_in_its_unit(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(GOOD, encoding="utf-8")
    arm = load_arm_file(path)
    assert arm == load_arm_file(str(path))
    np.testing.assert_allclose(arm.dh.values(), [[0.1, 0.02, 1.5, 0.1], [0, 0.05, 0, 0]])
    assert (arm.dh.convention, arm.dh.moving.tolist()) == ("modified-dh", [True, False])
    np.testing.assert_array_equal(arm.limits, [[-1, 2]])
    np.testing.assert_array_equal(arm.encoder_noise, [1e-5])
    assert [p.half_width for p in arm.dh_parameters()[:4]] == pytest.approx(
        [1e-5, 2e-5, 1e-5, 3e-5]
    )
    assert [p.half_width for p in arm.dh_parameters()[4:]] == [
        None
    ] * 4  # not stated, which is not the same as zero
    assert (arm.joints[0].mass_kg, arm.joints[0].com_mm) == (0.5, (1, 2, 3))
    assert (arm.reference_temperature_c, arm.gravity_m_s2) == (20, (0, 0, -9.81))
    assert arm.stylus is not None
    assert arm.stylus.axis == (0, 0, 1)


ROWS = "[[joints]]\na_mm = 0\nd_mm = 0\nalpha_rad = 0\ntheta_offset_rad = 0\nfixed = true\n"
JOINTS = GOOD[GOOD.index("[[joints]]") :]
# what is replaced, by what, the key that the answer names, and a word or number of it
MISTAKES = [
    ("a_mm = 100", "a_mm = 100\nb_mm = 1", "joints[1].b_mm", "limits_rad"),
    ('schema = "aacmm-pin/arm/1"', "", "schema", "missing"),
    ("arm/1", "arm/9", "schema", "'aacmm-pin/arm/1'"),
    ("modified-dh", "dh", "convention", "'standard-dh' or 'modified-dh'"),
    ("d_mm = 20.0", "", "joints[1].d_mm", "missing"),
    ("limits_rad = [-1.0, 2]", "", "joints[1]", "limits_rad is missing"),
    ("d_mm = 20.0", 'd_mm = "20"', "joints[1].d_mm", "'20'"),
    ("fixed = true", "fixed = true\nlimits_rad = [0, 1]", "joints[2]", "without this key"),
    (
        "fixed = true",
        'kind = "prismatic"\nlimits_rad = [0, 1]',
        "joints[2]",
        "a prismatic row has limits_rad",
    ),
    ("fixed = true", 'kind = "prismatic"', "joints[2]", "limits_mm is missing"),
    (
        GOOD[GOOD.index("limits_rad") : GOOD.index("mass_kg")],
        "fixed = true\n",
        "",
        "fixed; expected",
    ),
    ("mass_kg = 0.5", "", "joints[1]", "mass_kg; expected both"),
    ("axis = [0, 0.0, 1.0]", "axis = [0, 0, 0]", "stylus", "axis is [0, 0, 0]"),
    ("a_mm = 100", "a_mm = -90,004", "", "line "),
    ("a_mm = 100", "a_mm = -90,004", "", "expected TOML, with a decimal point"),
    # what no arm has
    ("d_mm = 20.0", "d_mm = -1e6", "", "joints[1].d_mm is -1e+06 mm"),
    ("fixed = true", "limits_rad = [0, 1]", "", "joints[2].encoder_noise_rad is missing"),
    ('"two rows"', '"two\\u0000rows"', "name", "NUL at place 4"),
    (
        "[stylus]",
        ROWS.replace("fixed = true", "limits_rad = [-1, 1]") * 64 + "[stylus]",
        "",
        "65 rows have a joint",
    ),
]


def test_each_mistake_is_named(tmp_path):
    path = tmp_path / "bad.toml"
    for old, new, key, word in MISTAKES:
        assert old in GOOD
        path.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(ArmFileError) as caught:
            load_arm_file(path)
        assert (caught.value.path, caught.value.key) == (str(path), key)
        assert all(part in str(caught.value) for part in (str(path), key, word))


EFFECT = '\n[[effects]]\ncause = "{}"\n{}\nparameters = {{ {} }}\n'
# cause, its fields, its parameters, and what the answer names
EFFECTS = [
    ("encoder_gain", "joint = 1", "gain = 1e300", "gain is 1e+300"),
    (
        "zero_drift",
        "joint = 1\ntime_constant_s = 1e-300",
        "drift_rad = 1e-4",
        "time_constant_s is 1e-300",
    ),
    ("thermal_expansion", "", "expansion_per_k = -2e-5", "-2e-05"),
]


def test_implausible_effects_are_named(tmp_path):
    path = tmp_path / "bad.toml"
    for cause, fields, parameters, word in EFFECTS:
        path.write_text(GOOD + EFFECT.format(cause, fields, parameters), encoding="utf-8")
        with pytest.raises(ArmFileError) as caught:
            ErrorModel.load(path)
        assert (caught.value.key, word in str(caught.value)) == ("effects[1]", True), str(
            caught.value
        )
    estimate = "uncertainty = { expansion_per_k = 1e-6 }"  # of zero: negative every other time
    text = EFFECT.format("thermal_expansion", estimate, "expansion_per_k = -1e-6")
    path.write_text(GOOD + text, encoding="utf-8")
    assert ErrorModel.load(path).effects[0].values == (-1e-6,)


def test_what_is_no_arm_file(tmp_path):
    with pytest.raises(ArmFileError, match=r"bad.toml: byte 8"):
        parse_arm_file('name = "Ä"'.encode("latin-1"), "bad.toml")
    with pytest.raises(ArmFileError, match=r"data.csv: this is a table \(CSV\)"):
        parse_arm_file(b"theta1_deg,x_mm\n1,2\n", "data.csv")
    with pytest.raises(ArmFileError, match=r"none.toml: no such file"):
        load_arm_file(tmp_path / "none.toml")
    with pytest.raises(ArmFileError, match=r"/dev/zero: .*larger than 32 MB"):
        load_arm_file("/dev/zero")
    with pytest.raises(ArmFileError, match="folder"):
        load_arm_file(tmp_path)
    with pytest.raises(
        UnknownNameError, match="unknown arm 'sino7'; expected one of sino6"
    ) as caught:
        load_arm_file("sino7")
    assert caught.value.known == [*bundled_arms(), *EXAMPLE_ROBOTS]


# --- as text


def read(text: str) -> ArmFile:
    return parse_arm_file(text.encode("utf-8"), "again.toml")


def test_arms_come_back(arm_file):
    text = arm_text(arm_file)
    assert read(text) == arm_file
    assert arm_text(read(text)) == text
    assert text.startswith(f'schema = "aacmm-pin/arm/1"\nname = "{arm_file.name}"\n')


def test_optional_parts_names_and_comments_come_back():
    zero = load_arm_file("zero6")
    bare = zero.model_copy(update={"source": "", "stylus": None})
    named = [
        zero.model_copy(update={"name": text.replace("\n", " "), "source": text})
        for text in ('Ä "quoted" \\ #', "two\nlines\x07", "'''", '"""')
    ]
    for each in (bare, *named):
        assert read(arm_text(each)) == each
    assert "stylus" not in tomllib.loads(arm_text(bare))
    for comment in ("two\nlines", "\n\n", 'schema = "x"', "a\x00b\x07c\rd\t\u2028 Ä"):
        text = arm_text(zero, comment)
        assert read(text) == zero
        assert text.startswith("#")
