"""An arm with its causes of error: prediction, sensitivity, covariance, and the arm file that holds
all of it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import ArmFile, arm_text, load_arm_file
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointCompliance,
    JointDistance,
    JointPeriodicError,
    JointPlacement,
    JointZeroOffset,
    LinkBending,
    LinkLength,
    LinkTwist,
    SeatError,
    StylusOffset,
    ThermalExpansion,
    effect_from,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import (
    AacmmError,
    ArmFileError,
    MissingConditionError,
    OutputError,
    ShapeError,
    UnknownNameError,
    UnsupportedArmError,
)

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


def postures(arm: Arm, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(*arm.limits.T, (n, arm.nq))


def write(tmp_path: Path, *parts: str, arm: str = "sino6") -> Path:
    path = tmp_path / "extended.toml"
    path.write_text(arm_text(load_arm_file(arm)) + "".join(parts), encoding="utf-8")
    return path


def effect_text(*lines: str) -> str:
    return "\n".join(["", "[[effects]]", *lines, ""])


# --- prediction ---


def test_without_effects_it_is_the_arm(arm_file: ArmFile, rng: np.random.Generator) -> None:
    arm = Arm.from_file(arm_file)
    model, q = ErrorModel.of(arm), postures(arm, rng, 20)
    assert ErrorModel.of(model) is model
    assert model.parameters == arm.parameters
    assert repr(model) == f"ErrorModel('{arm.name}', no effects)"
    for at in (None, "tip", "frame1", "frame5"):
        np.testing.assert_allclose(
            model.predict(q, at=at), arm.positions(q, at), rtol=0, atol=1e-14
        )
        np.testing.assert_array_equal(model.sensitivity(q, at=at), arm.sensitivity(q, at))


def test_corrected_readings_are_predicted_tips(sino6: Arm, rng: np.random.Generator) -> None:
    """What an extended arm corrects is what the plain arm gets wrong."""
    q, gain = postures(sino6, rng, 20), 1e-3
    turned = q.copy()
    turned[:, 2] *= 1 + gain
    model = ErrorModel(sino6, (EncoderGain(joint=3, values=(gain,)),))
    np.testing.assert_allclose(model.correct(q), sino6.positions(turned), rtol=0, atol=1e-14)
    assert repr(model) == "ErrorModel('SINO6', encoder_gain:3)"


def test_conditions_are_used_and_needed_only_by_effects_that_act(
    sino6: Arm, rng: np.random.Generator
) -> None:
    q = postures(sino6, rng, 4)
    warm = Conditions(4, temperature=np.full(4, 30.0))
    model = ErrorModel(sino6, (ThermalExpansion(values=(1e-4,)),))
    np.testing.assert_allclose(
        model.correct(q, warm), 1.001 * sino6.positions(q), rtol=0, atol=1e-14
    )
    with pytest.raises(
        MissingConditionError, match="thermal_expansion needs the column temperature_c"
    ):
        model.predict(q)
    idle = ErrorModel(sino6, (ThermalExpansion(),))
    np.testing.assert_allclose(idle.predict(q), sino6.positions(q), rtol=0, atol=1e-14)
    with pytest.raises(MissingConditionError):
        idle.sensitivity(q)


def test_what_cannot_be_asked_for(sino6: Arm) -> None:
    model = ErrorModel(sino6, (EncoderGain(joint=3, values=(1e-4,)),))
    for q, words in [
        (np.zeros(6), r"pass q\[None, :\]"),
        (np.zeros((2, 5)), r"q has shape \(2, 5\), expected \(n, 6\) \[rad\]"),
        (np.full((2, 6), np.nan), r"q\[0, 0\] is nan, expected a finite number"),
        (np.full((2, 6), np.inf), r"q\[0, 0\] is inf"),
        ([["a"] * 6], "not an array of numbers"),
    ]:
        for ask in (model.predict, model.correct, model.sensitivity):
            with pytest.raises(ShapeError, match=words):
                ask(q)
    with pytest.raises(ShapeError, match="conditions are of 3 records, expected 2 as q has"):
        model.predict(np.zeros((2, 6)), Conditions(3))
    with pytest.raises(ShapeError, match="approach has 5 columns, expected 6"):
        model.predict(np.zeros((2, 6)), Conditions(2, approach=np.ones((2, 5))))
    with pytest.raises(UnknownNameError, match="frame9"):
        model.predict(np.zeros((1, 6)), at="frame9")
    with pytest.raises(UnsupportedArmError, match="base_link"):
        model.sensitivity(np.zeros((1, 6)), at="base_link")


# --- sensitivity ---

GEOMETRY = {
    "a": LinkLength,
    "d": JointDistance,
    "alpha": LinkTwist,
    "theta_offset": JointZeroOffset,
}


@pytest.mark.parametrize("arm_name", ["sino6", "zero6"])
def test_columns_are_those_of_the_displaced_arm(arm_name: str, rng: np.random.Generator) -> None:
    """With a target 0.1 m from the tip, and a joint 0.05 rad off, the geometry has other levers
    than the plain arm.
    """
    arm = Arm.load(arm_name)
    q, h = postures(arm, rng, 10), 1e-6
    model = ErrorModel(
        arm, (StylusOffset(values=(0.1, -0.05, 0.02)), JointZeroOffset(joint=4, values=(0.05,)))
    )
    columns, parameters = model.sensitivity(q), model.parameters
    assert columns.shape == (10, 3, len(parameters))
    for number, parameter in enumerate(arm.parameters):
        assert parameter.joint is not None
        shifted = []
        for step in (h, -h):
            errors = step * np.eye(len(arm.parameters))[number].reshape(-1, 4)
            rows = [
                row.model_copy(
                    update={
                        "a_mm": row.a_mm + a / MM,
                        "d_mm": row.d_mm + d / MM,
                        "alpha_rad": row.alpha_rad + alpha,
                        "theta_offset_rad": row.theta_offset_rad + theta,
                    }
                )
                for row, (a, d, alpha, theta) in zip(
                    arm.file.joints if arm.file else [], errors, strict=True
                )
            ]
            assert arm.file is not None
            other = Arm.from_file(arm.file.model_copy(update={"joints": rows}))
            shifted.append(ErrorModel(other, model.effects).predict(q))
        numeric = (shifted[0] - shifted[1]) / (2 * h)
        np.testing.assert_allclose(
            columns[:, :, number], numeric, rtol=0, atol=2e-9, err_msg=parameter.name
        )
    assert np.abs(columns[:, :, : len(arm.parameters)] - arm.sensitivity(q)).max() > 0.05


def test_columns_of_a_displaced_robot(robot_file, rng: np.random.Generator) -> None:  # type: ignore[no-untyped-def]
    arm = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    q = rng.uniform(-3, 3, (5, 6))
    target = StylusOffset(values=(0.1, -0.05, 0.02))
    columns, h = ErrorModel(arm, (target,)).sensitivity(q), 1e-6
    assert [p.name for p in ErrorModel(arm, (target,)).parameters[:6]] == [
        "x1",
        "y1",
        "z1",
        "rx1",
        "ry1",
        "rz1",
    ]
    for number in range(36):
        steps = [
            JointPlacement(joint=number // 6 + 1, values=tuple(s * h * np.eye(6)[number % 6]))
            for s in (1.0, -1.0)
        ]
        there, back = (ErrorModel(arm, (target, step)).predict(q) for step in steps)
        np.testing.assert_allclose(
            columns[:, :, number], (there - back) / (2 * h), rtol=0, atol=2e-9
        )


def test_parameters_are_the_columns(sino6: Arm, rng: np.random.Generator) -> None:
    effects = (
        LinkBending(link=3),
        EncoderEccentricity(joint=2, values=(1e-4, 2e-4), u=(1e-6, 2e-6)),
    )
    model = ErrorModel(sino6, effects)
    names = [p.name for p in model.parameters]
    assert names[:24] == [p.name for p in sino6.parameters]
    assert names[24:] == [
        "link_bending:3",
        "encoder_eccentricity:2.cos",
        "encoder_eccentricity:2.sin",
    ]
    assert [(p.kind, p.joint, p.unit, p.value, p.u) for p in model.parameters[25:]] == [
        ("encoder_eccentricity", 2, "rad", 1e-4, 1e-6),
        ("encoder_eccentricity", 2, "rad", 2e-4, 2e-6),
    ]
    assert model.sensitivity(postures(sino6, rng, 3)).shape == (3, 3, 27)


# --- changing a model ---


def test_with_effects_is_a_new_model(sino6: Arm) -> None:
    first = ErrorModel(
        sino6, (EncoderGain(joint=3, values=(1e-4,)), JointCompliance(joint=2, values=(1e-5,)))
    )
    gain = EncoderGain(joint=3, values=(3e-4,))
    second = first.with_effects(gain, EncoderGain(joint=4))
    assert first.effects == (
        EncoderGain(joint=3, values=(1e-4,)),
        JointCompliance(joint=2, values=(1e-5,)),
    )
    assert second.effects == (JointCompliance(joint=2, values=(1e-5,)), gain, EncoderGain(joint=4))
    assert second.with_effects() == second or second.with_effects().effects == second.effects


def test_the_same_parameter_twice(sino6: Arm) -> None:
    with pytest.raises(AacmmError, match="SINO6: the parameter encoder_gain:3 is there twice"):
        ErrorModel(sino6, (EncoderGain(joint=3), EncoderGain(joint=3, values=(1e-4,))))
    compliance = JointCompliance(joint=2)
    with pytest.raises(AacmmError, match="joint_compliance:2 is there twice"):
        ErrorModel(sino6, (compliance,)).with_effects(replace(compliance, torque="measured"))


# --- covariance ---


def test_independent_parameters_have_a_diagonal_covariance(sino6: Arm) -> None:
    model = ErrorModel(
        sino6, (EncoderGain(joint=3, u=(1e-6,)), SeatError(seat="A", u=(1e-5, 0.0, 2e-5)))
    )
    np.testing.assert_array_equal(model.covariance(), np.diag([p.u**2 for p in model.parameters]))
    assert model.covariance()[24, 24] == 1e-12


def test_covariance_of_the_file(tmp_path: Path, sino6: Arm) -> None:
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


def test_covariance_survives_saving(tmp_path: Path) -> None:
    model = ErrorModel.load(write(tmp_path, GAIN, COVARIANCE))
    model.save(tmp_path / "again.toml")
    again = ErrorModel.load(tmp_path / "again.toml")
    assert again.file() == model.file()
    np.testing.assert_array_equal(again.covariance(), model.covariance())


BAD_COVARIANCE = [
    # what is replaced in COVARIANCE, by what, the key that is named, words of the reason
    ('"d2"]', '"d9"]', "covariance.parameters", ["unknown parameter", "'d9'", "encoder_gain:3"]),
    ('"d2"]', '"theta_offset3"]', "covariance", ["names one of them twice"]),
    ("2e-6, 3e-6]", "2e-6]", "covariance", ["standard_uncertainty_si has 2 numbers, expected 3"]),
    (
        "2e-6, 3e-6]",
        "2e-6, -3e-6]",
        "covariance.standard_uncertainty_si[3]",
        ["-3e-06", "greater than"],
    ),
    ("2e-6, 3e-6]", "2e-6, inf]", "covariance.standard_uncertainty_si[3]", ["inf", "finite"]),
    ("2e-6, 3e-6]", '2e-6, "3"]', "covariance.standard_uncertainty_si[3]", ["'3'", "valid number"]),
    (
        "[[], [0.5], [-0.25, 0.1]]",
        "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        "covariance",
        ["expected 3 rows of 0, 1"],
    ),
    (", [-0.25, 0.1]]", "]", "covariance", ["expected 3 rows"]),
    ("[0.5]", "[1.5]", "covariance", ["not a correlation matrix"]),
    ("[0.5], [-0.25, 0.1]", "[0.9], [0.9, -0.9]", "covariance", ["negative eigenvalue"]),
    ("[0.5]", "[nan]", "covariance.correlation[2][1]", ["nan", "finite"]),
    ("[0.5]", "0.5", "covariance.correlation[2]", ["0.5", "an array"]),
    (
        "2e-6, 3e-6]",
        "2e-6, 1e300]",
        "covariance.standard_uncertainty_si[3]",
        ["or equal to 1e+100"],
    ),
    (
        '["theta_offset3", "encoder_gain:3", "d2"]',
        "[]",
        "covariance.parameters",
        ["at least 1 item"],
    ),
    ("correlation = [[], [0.5], [-0.25, 0.1]]", "", "covariance.correlation", ["missing"]),
    (
        "correlation",
        "matrix = 1\ncorrelation",
        "covariance.matrix",
        ["unknown key", "standard_uncertainty_si"],
    ),
]


def test_bad_covariance_is_named(tmp_path: Path) -> None:
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


def test_bundled_arm_has_no_effects(sino6: Arm) -> None:
    model = ErrorModel.load("sino6")
    assert model.effects == ()
    assert model.file() == sino6.file
    with pytest.raises(UnknownNameError, match="unknown arm 'sino7'"):
        ErrorModel.load("sino7")


def test_file_states_the_effects_as_people_do(tmp_path: Path, sino6: Arm) -> None:
    """Amplitude and phase, millimetres: what the file says is what a reader knows from data
    sheets.
    """
    eccentricity = effect_from(
        EncoderEccentricity, {"joint": 3}, {"amplitude_rad": 1.1e-4, "phase_rad": 0.4}
    )
    bodies = JointCompliance(joint=4, bodies=(4, 5, 6), values=tuple(np.arange(9.0) * 1e-6))
    model = ErrorModel(
        sino6, (eccentricity, LinkLength(joint=3, values=(2e-5,), u=(1e-6,)), bodies)
    )
    model.save(tmp_path / "x.toml", comment="Found by hand.\nTwice.")
    text = (tmp_path / "x.toml").read_text(encoding="utf-8")
    assert text.startswith("# Found by hand.\n# Twice.\n\nschema = ")
    assert 'cause = "encoder_eccentricity"' in text
    first, second, third = model.file().effects
    assert first.parameters == pytest.approx({"amplitude_rad": 1.1e-4, "phase_rad": 0.4}, rel=1e-14)
    assert (second.parameters, second.uncertainty) == (
        pytest.approx({"a_mm": 0.02}),
        pytest.approx({"a_mm": 0.001}),
    )
    assert third.structure == {"joint": 4, "torque": "gravity", "bodies": (4, 5, 6)}
    assert ErrorModel.load(tmp_path / "x.toml").effects[2] == bodies


def test_file_written_by_hand(tmp_path: Path) -> None:
    text = effect_text(
        'cause = "encoder_eccentricity"',
        "joint = 3",
        "parameters = { cos_rad = 1e-4, sin_rad = -2e-4 }",
    )
    phase = effect_text(
        'cause = "encoder_ellipticity"',
        "joint = 3",
        "parameters = { amplitude_rad = 1e-4, phase_rad = 0 }",
    )
    none = effect_text('cause = "thermal_expansion"')
    model = ErrorModel.load(write(tmp_path, text, phase, none, GAIN))
    assert [e.values for e in model.effects] == [(1e-4, -2e-4), (1e-4, 0.0), (0.0,), (2e-4,)]
    assert [e.u for e in model.effects] == [(0.0, 0.0), (0.0, 0.0), (0.0,), (1e-6,)]


def test_saving_replaces_only_when_told(tmp_path: Path, sino6: Arm) -> None:
    path = tmp_path / "x.toml"
    path.write_text("mine", encoding="utf-8")
    model = ErrorModel(sino6)
    with pytest.raises(OutputError, match="exists already"):
        model.save(path)
    assert path.read_text(encoding="utf-8") == "mine"
    model.save(path, force=True)
    assert load_arm_file(path) == sino6.file


def test_an_arm_that_is_from_no_file(sino6: Arm) -> None:
    with pytest.raises(AacmmError, match="SINO6: was made from no file"):
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
    (["cause = 3"], "effects[1].cause", ["is 3", "valid string"]),
    (['cause = ""'], "effects[1].cause", ["at least 1 character"]),
    ([CAUSE], "effects[1]", ["encoder_gain: missing joint"]),
    (['cause = "joint_periodic_error"'], "effects[1]", ["missing joint, order"]),
    (
        [CAUSE, "joint = 3", "order = 2"],
        "effects[1]",
        ["unknown field of encoder_gain 'order'", "joint"],
    ),
    ([CAUSE, "joint = 3", "values = [1.0]"], "effects[1]", ["unknown field", "'values'"]),
    (
        [CAUSE, "joint = 3", "parameters = { a = 1 }"],
        "effects[1]",
        ["unknown parameter of encoder_gain:3 'a'", "known: gain"],
    ),
    (
        [
            'cause = "encoder_ellipticity"',
            "joint = 3",
            "parameters = { amplitude_rad = 1e-4, cos_rad = 1e-4 }",
        ],
        "effects[1]",
        ["unknown parameter of encoder_ellipticity:3 'cos_rad'", "amplitude_rad, phase_rad"],
    ),
    (
        [CAUSE, "joint = 3", "uncertainty = { gian = 1e-6 }"],
        "effects[1]",
        ["unknown uncertainty of encoder_gain:3 'gian'"],
    ),
    (
        [WAVE, "joint = 3", "parameters = { amplitude_rad = 1e-4 }"],
        "effects[1]",
        ["parameters: missing phase_rad"],
    ),
    (
        [WAVE, "joint = 3", "parameters = { sin_rad = 1e-4 }"],
        "effects[1]",
        ["parameters: missing cos_rad"],
    ),
    (
        [WAVE, "joint = 3", "uncertainty = { cos_rad = 1e-4 }"],
        "effects[1]",
        ["uncertainty: missing sin_rad"],
    ),
    (
        [CAUSE, "joint = 3", "uncertainty = { gain = -1e-6 }"],
        "effects[1]",
        ["encoder_gain:3: u is (-1e-06,)"],
    ),
    (
        [CAUSE, "joint = 3", 'parameters = { gain = "1" }'],
        "effects[1].parameters.gain",
        ["is '1'", "valid number"],
    ),
    (
        [CAUSE, "joint = 3", "parameters = { gain = true }"],
        "effects[1].parameters.gain",
        ["is True"],
    ),
    ([CAUSE, "joint = 3", "parameters = { gain = nan }"], "effects[1].parameters.gain", ["finite"]),
    ([CAUSE, "joint = 3", "parameters = [1.0]"], "effects[1].parameters", ["dictionary"]),
    ([CAUSE, "joint = 7"], "effects[1]", ["encoder_gain:7: SINO6 has rows 1 to 6"]),
    (['cause = "link_bending"', "link = 9"], "effects[1]", ["SINO6 has rows 1 to 6"]),
    ([CAUSE, "joint = 2.5"], "effects[1]", ["joint is 2.5", "expected a valid integer"]),
]


def test_bad_effect_is_named(tmp_path: Path) -> None:
    for lines, key, words in BAD_EFFECTS:
        refused(write(tmp_path, effect_text(*lines)), key, words)
    refused(
        write(tmp_path, GAIN, effect_text(CAUSE, "joint = 4"), effect_text(CAUSE, "joint = 9")),
        "effects[3]",
        [":9"],
    )
    refused(write(tmp_path, GAIN, GAIN), "effects", ["the parameter encoder_gain:3 is there twice"])


def test_effects_that_are_no_tables(tmp_path: Path) -> None:
    path, whole = tmp_path / "odd.toml", arm_text(load_arm_file("sino6"))
    for text in ("effects = 3\n", 'effects = ["encoder_gain"]\n', "[effects]\ncause = 1\n"):
        path.write_text(
            text + whole if text.startswith("effects") else whole + text, encoding="utf-8"
        )
        with pytest.raises(ArmFileError, match=r"odd.toml: effects"):
            ErrorModel.load(path)


def test_an_order_may_be_whole_or_not(tmp_path: Path, sino6: Arm) -> None:
    for order in (7, 7.5):
        ErrorModel(sino6, (JointPeriodicError(joint=3, order=order),)).save(
            tmp_path / "x.toml", force=True
        )
        assert ErrorModel.load(tmp_path / "x.toml").effects == (
            JointPeriodicError(joint=3, order=order),
        )
