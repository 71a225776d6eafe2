"""An arm with its causes of error: prediction, sensitivity, covariance, and the arm file that holds
all of it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import arm_text, load_arm_file
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointCompliance,
    JointPlacement,
    JointZeroOffset,
    LinkLength,
    StylusOffset,
    ThermalExpansion,
    effect_from,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import (
    AacmmError,
    ArmFileError,
    MissingConditionError,
    ShapeError,
)
from tests.oracle import close, derivative, postures, with_dh_errors

pytestmark = pytest.mark.fast

GAIN = """
[[effects]]
cause = "encoder_gain"
joint = 3
parameters = { gain = 2e-4 }
uncertainty = { gain = 1e-6 }
"""

COVARIANCE = """
[covariance]
parameters = ["theta_offset3", "encoder_gain:3", "d2"]
standard_uncertainty_si = [1e-5, 2e-6, 3e-6]
correlation = [[], [0.5], [-0.25, 0.1]]
"""


def write(tmp_path: Path, *parts: str, arm: str = "sino6") -> Path:
    path = tmp_path / "extended.toml"
    path.write_text(arm_text(load_arm_file(arm)) + "".join(parts), encoding="utf-8")
    return path


def effect_text(*lines: str) -> str:
    return "\n".join(["", "[[effects]]", *lines, ""])


# --- prediction ---


def test_without_effects_it_is_the_arm(arm_file, rng):
    arm = Arm.from_file(arm_file)
    model, q = ErrorModel.of(arm), postures(arm, rng, 20)
    assert ErrorModel.of(model) is model
    assert model.parameters == arm.parameters
    assert repr(model) == f"ErrorModel('{arm.name}', no effects)"
    for at in (None, "tip", "frame1", "frame5"):
        close(model.predict(q, at=at), arm.positions(q, at), 1e-14)
        np.testing.assert_array_equal(model.sensitivity(q, at=at), arm.sensitivity(q, at))


def test_predict_uses_conditions_of_effects_that_act(sino6, rng):
    q = postures(sino6, rng, 4)
    warm = Conditions(4, temperature=np.full(4, 30.0))
    model = ErrorModel(sino6, (ThermalExpansion(values=(1e-4,)),))
    close(model.correct(q, warm), 1.001 * sino6.positions(q), 1e-14)
    with pytest.raises(MissingConditionError, match=r"the column .temperature_c"):
        model.predict(q)
    idle = ErrorModel(sino6, (ThermalExpansion(),))
    close(idle.predict(q), sino6.positions(q), 1e-14)
    with pytest.raises(MissingConditionError):
        idle.sensitivity(q)


def test_what_cannot_be_predicted(sino6):
    model, q = ErrorModel(sino6, (EncoderGain(joint=3, values=(1e-4,)),)), np.zeros((2, 6))
    with pytest.raises(ShapeError, match="conditions have 3 records; expected 2, as many as q"):
        model.predict(q, Conditions(3))
    with pytest.raises(ShapeError, match="approach has 5 columns; expected 6"):
        model.predict(q, Conditions(2, approach=np.ones((2, 5))))


# --- sensitivity ---


@pytest.mark.parametrize("arm_name", ["sino6", "zero6"])
def test_sensitivity_of_the_displaced_arm(arm_name, rng):
    """With a target 0.1 m from the tip, and a joint 0.05 rad off, the geometry has other levers
    than the plain arm.
    """
    arm = Arm.load(arm_name)
    q = postures(arm, rng, 10)
    target, off = StylusOffset(values=(0.1, -0.05, 0.02)), JointZeroOffset(4, values=(0.05,))
    model = ErrorModel(arm, (target, off))
    numeric = derivative(
        lambda errors: ErrorModel(with_dh_errors(arm.file, errors), model.effects).predict(q),
        np.zeros(len(arm.parameters)),
    )
    columns = model.sensitivity(q)
    assert columns.shape == (10, 3, len(model.parameters))
    close(columns[:, :, : len(arm.parameters)], numeric, 2e-9)
    assert np.abs(numeric - arm.sensitivity(q)).max() > 0.05


def test_sensitivity_of_a_displaced_robot(rng):
    arm = Arm.from_urdf("ur5")
    q, target = postures(arm, rng, 5), StylusOffset(values=(0.1, -0.05, 0.02))

    def moved(errors: Array) -> Array:
        twists = enumerate(errors.reshape(6, 6), start=1)
        placements = [JointPlacement(joint, values=tuple(twist)) for joint, twist in twists]
        return ErrorModel(arm, (target, *placements)).predict(q)

    columns = ErrorModel(arm, (target,)).sensitivity(q)[:, :, :36]
    close(columns, derivative(moved, np.zeros(36)), 2e-9)


# --- changing a model ---


def test_with_effects_is_a_new_model(sino6):
    gain, compliance = EncoderGain(3, values=(1e-4,)), JointCompliance(2, values=(1e-5,))
    first, other = ErrorModel(sino6, (gain, compliance)), EncoderGain(3, values=(3e-4,))
    second = first.with_effects(other, EncoderGain(joint=4))
    assert first.effects == (gain, compliance)
    assert second.effects == (compliance, other, EncoderGain(joint=4))
    with pytest.raises(AacmmError, match="parameter encoder_gain:3"):
        ErrorModel(sino6, (gain, other))
    with pytest.raises(AacmmError, match="parameter joint_compliance:2"):
        first.with_effects(JointCompliance(2, torque="measured"))


# --- covariance ---


def test_covariance_of_the_file(tmp_path, sino6):
    model = ErrorModel.load(write(tmp_path, GAIN, COVARIANCE))
    names = [p.name for p in model.parameters]
    where = [names.index(name) for name in ("theta_offset3", "encoder_gain:3", "d2")]
    u, r = np.array([1e-5, 2e-6, 3e-6]), np.array([[1, 0.5, -0.25], [0.5, 1, 0.1], [-0.25, 0.1, 1]])
    covariance = model.covariance()
    np.testing.assert_allclose(covariance[np.ix_(where, where)], r * np.outer(u, u), rtol=1e-14)
    others = [i for i in range(len(names)) if i not in where]
    known = [p.u**2 for p in sino6.parameters if p.name not in ("theta_offset3", "d2")]
    np.testing.assert_array_equal(covariance[np.ix_(others, others)], np.diag(known))
    assert not covariance[np.ix_(where, others)].any()
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-20
    of_arm = {p.name: (p.u, p.half_width) for p in model.arm.parameters}
    assert of_arm["theta_offset3"] == (1e-5, 2e-5)
    np.testing.assert_allclose(
        np.sqrt(np.diag(covariance)), [p.u for p in model.parameters], rtol=1e-14
    )


BAD_COVARIANCE = [
    # what is replaced in COVARIANCE, by what, the key that is named, words of the reason
    ('"d2"]', '"d9"]', "covariance.parameters", ["unknown parameter", "'d9'", "encoder_gain:3"]),
    ('"d2"]', '"theta_offset3"]', "covariance", ["twice"]),
    ("2e-6, 3e-6]", "2e-6]", "covariance", ["standard_uncertainty_si has 2 numbers; expected 3"]),
    (
        "[[], [0.5], [-0.25, 0.1]]",
        "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        "covariance",
        ["3 rows of 0, 1"],
    ),
    ("[0.5]", "[1.5]", "covariance", ["negative eigenvalue"]),
]


def test_bad_covariance_is_named(tmp_path):
    for old, new, key, words in BAD_COVARIANCE:
        assert COVARIANCE.count(old) == 1
        refused(write(tmp_path, GAIN, COVARIANCE.replace(old, new)), key, words)


def refused(path: Path, key: str, words: list[str]) -> None:
    """With file, key and the words of a reason."""
    with pytest.raises(ArmFileError) as caught:
        ErrorModel.load(path)
    assert (caught.value.path, caught.value.key) == (str(path), key)
    for word in [str(path), key, *words]:
        assert word in str(caught.value)


# --- the arm file ---


def test_file_states_the_effects_as_people_do(tmp_path, sino6):
    """Amplitude and phase, millimetres: what the file says is what a reader knows from data
    sheets.
    """
    wave = {"amplitude_rad": 1.1e-4, "phase_rad": 0.4}
    eccentricity = effect_from(EncoderEccentricity, {"joint": 3}, wave)
    bodies = JointCompliance(joint=4, bodies=(4, 5, 6), values=tuple(np.arange(9.0) * 1e-6))
    length = LinkLength(joint=3, values=(2e-5,), u=(1e-6,))
    first, second, third = ErrorModel(sino6, (eccentricity, length, bodies)).file().effects
    assert first.parameters == pytest.approx(wave, rel=1e-14)
    assert second.parameters == pytest.approx({"a_mm": 0.02})
    assert second.uncertainty == pytest.approx({"a_mm": 0.001})
    assert third.structure == {"joint": 4, "torque": "gravity", "bodies": (4, 5, 6)}


def test_file_written_by_hand(tmp_path):
    text = effect_text(
        'cause = "encoder_eccentricity"',
        "joint = 3",
        "parameters = { amplitude_rad = 1e-4, phase_rad = 3.141592653589793 }",
    )
    phase = effect_text(
        'cause = "encoder_ellipticity"',
        "joint = 3",
        "parameters = { amplitude_rad = 1e-4, phase_rad = 0 }",
    )
    none = effect_text('cause = "thermal_expansion"')
    model = ErrorModel.load(write(tmp_path, text, phase, none, GAIN))
    assert model.effects[0].values == pytest.approx((-1e-4, 0.0), abs=1e-19)
    assert [e.values for e in model.effects[1:]] == [(1e-4, 0.0), (0.0,), (2e-4,)]
    assert [e.u for e in model.effects] == [(0.0, 0.0), (0.0, 0.0), (0.0,), (1e-6,)]


def test_an_arm_that_is_from_no_file(sino6):
    with pytest.raises(AacmmError, match="SINO6: this arm has no file"):
        ErrorModel(replace(sino6, file=None)).file()


CAUSE = 'cause = "encoder_gain"'
WAVE = 'cause = "encoder_eccentricity"'
BAD_EFFECTS = [
    # lines of an effect, the key that is named, words of the reason; what a field may not be is in
    # test_effects.py
    (["joint = 3"], "effects[1].cause", ["missing"]),
    (
        ['cause = "gremlins"', "joint = 3"],
        "effects[1].cause",
        ["unknown cause 'gremlins'", "encoder_gain"],
    ),
    ([CAUSE], "effects[1]", ["encoder_gain: joint is missing"]),
    (
        [CAUSE, "joint = 3", "order = 2"],
        "effects[1]",
        ["unknown field 'order' of encoder_gain", "joint"],
    ),
    (
        [CAUSE, "joint = 3", "parameters = { a = 1 }"],
        "effects[1]",
        ["unknown parameter 'a' of encoder_gain:3", "gain"],
    ),
    (
        [WAVE, "joint = 3", "parameters = { amplitude_rad = 1e-4 }"],
        "effects[1]",
        ["expected also phase_rad"],
    ),
]


def test_bad_effect_is_named(tmp_path):
    for lines, key, words in BAD_EFFECTS:
        refused(write(tmp_path, effect_text(*lines)), key, words)
    refused(
        write(tmp_path, GAIN, effect_text(CAUSE, "joint = 4"), effect_text(CAUSE, "joint = 9")),
        "effects[3]",
        [":9"],
    )
    refused(write(tmp_path, GAIN, GAIN), "effects", ["parameter encoder_gain:3"])
