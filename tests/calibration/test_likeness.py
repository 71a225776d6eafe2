"""Files with a wrong unit, exchanged columns or the angles of other records are refused, and the
likely mistake is named.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin import perturbed_model
from aacmm_pin.arm import Arm, ArmFile
from aacmm_pin.calibration import calibrate, input_mistakes
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointZeroOffset,
    StylusOffset,
)
from aacmm_pin.errors import AacmmError, MistakenFileError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.arm_files import by_table

Change = Callable[[Measurements], Measurements]

XYZ = ["x_mm", "y_mm", "z_mm"]
THETA = [f"theta{j}_deg" for j in range(1, 7)]


def counted(*joints: int) -> Change:
    return lambda d: replace(d, q=d.q * np.where(np.isin(np.arange(d.nq), joints), -1.0, 1.0))


def turned(joint: int, degrees: float) -> Change:
    """Indications that lack ``degrees``."""
    return lambda d: replace(d, q=d.q - np.deg2rad(degrees) * np.eye(d.nq)[joint])


def in_radians(joint: int) -> Change:
    """Indications of one joint, taken for degrees."""
    return lambda d: replace(d, q=d.q * np.where(np.arange(d.nq) == joint, np.pi / 180, 1.0))


def in_degrees(joint: int) -> Change:
    """Indications of one joint, taken for radians."""
    return lambda d: replace(d, q=d.q * np.where(np.arange(d.nq) == joint, 180 / np.pi, 1.0))


def swapped(one: int, other: int) -> Change:
    order = np.arange(6)
    order[[one, other]] = other, one
    return lambda d: replace(d, q=d.q[:, order])


def along(order: list[int], signs: list[int]) -> Change:
    return lambda d: replace(d, reference=d.reference[:, order] * np.array(signs))


def in_unit(factor: float) -> Change:
    return lambda d: replace(d, reference=factor * d.reference)


def as_angles(factor: float) -> Change:
    return lambda d: replace(d, q=factor * d.q)


def of_columns(*factors: float) -> Change:
    return lambda d: replace(d, reference=np.array(factors) * d.reference)


def bars_in(factor: float) -> Change:
    return lambda d: replace(d, bar_length=None if d.bar_length is None else factor * d.bar_length)


def other_frame(d: Measurements) -> Measurements:
    return replace(
        d,
        reference=Rotation.from_rotvec([0.3, -1.0, 0.5]).apply(d.reference)
        + np.array([0.5, 0.02, 0.9]),
    )


def first_and_second(d: Measurements) -> Measurements:
    return turned(1, 90.0)(counted(2)(d))


OF_ANGLES: list[tuple[Change, str]] = [
    (counted(0), "joint 1 is counted"),
    (counted(2), "joint 3 is counted"),
    (counted(4), "joint 5 is counted"),
    (counted(1, 2), "joints 2 and 3 are counted"),
    (turned(1, 90.0), "zero of joint 2 is turned: 90°"),
    (turned(2, 180.0), "zero of joint 3 is turned: 180°"),
    (turned(4, -90.0), "zero of joint 5 is turned: -90°"),
    (swapped(1, 2), "joints 2 and 3 are exchanged"),
    (as_angles(1 / 0.9), "angles are in gon"),
    (in_radians(2), "joint 3 alone are in radians, in the column theta3_deg"),
    (
        lambda d: replace(d, q=d.q / [1, 0.9, 1, 1, 1, 1]),
        "joint 2 alone are in gon, in the column theta2_deg",
    ),
    (in_degrees(3), "joint 4 alone are in degrees, in the column theta4_rad"),
    (first_and_second, "joint 3 is counted the other way, and the zero of joint 2"),
]
OF_COORDINATES: list[tuple[Change, str]] = [
    (along([1, 0, 2], [1, 1, 1]), "x, y, z should be y, x, z"),
    (along([0, 1, 2], [1, 1, -1]), "x, y, z should be x, y, -z"),
    (in_unit(1e-3), "coordinates are in metres"),
    (in_unit(1 / 25.4), "coordinates are in inches"),
    (of_columns(1.0, 1.0, 1e-3), "z alone is in metres, in the column z_mm"),
    (other_frame, "--reference-frame external"),
]


@pytest.fixture(scope="module", params=["sino6", "zero6", "ur5"])
def arm(request: pytest.FixtureRequest) -> Arm:
    if request.param != "ur5":
        return Arm.load(request.param)
    (urdf,) = (
        f
        for f in importlib.metadata.files("example-robot-data") or []
        if f.name == "ur5_robot.urdf"
    )
    return Arm.from_urdf(str(urdf.locate()), "tool0")


def with_gross_errors(d: Measurements, rng: np.random.Generator) -> Measurements:
    """One record in ten is far off."""
    bad = (np.arange(d.n) % 10 == 3)[:, None]
    return replace(
        d,
        q=d.q + bad * rng.normal(0.0, 0.05, d.q.shape),
        reference=d.reference + bad * rng.normal(0.0, 0.05, (d.n, 3)),
    )


SETUPS = [
    ("sino6", "base", 1),
    ("sino6", "external", 3),
    ("sino6", "seats", 1),
    ("sino6", "bars", 1),
]
SETUPS += [("zero6", "external", 6), ("ur5", "base", 4), ("ur5", "seats", 4)]


@pytest.mark.parametrize(("arm", "setup", "every"), SETUPS, indirect=["arm"])
def test_every_mistake_is_named(arm, setup, every, rng):
    """All of them on one arm with coordinates in its base and without; every third or fourth
    elsewhere.
    """
    options: dict[str, Any] = {"parameters": "zero-offsets" if setup == "seats" else "geometry"}
    if setup in ("base", "external"):
        data = simulate_measurements(arm, "free", 60, rng=rng)
    elif setup == "seats":
        data = simulate_measurements(arm, "seats", 60, rng=rng, seats=6, known=False)
    else:
        data = simulate_measurements(arm, "ball-bar", 60, rng=rng, seats=6, bar_length=0.3)
    mistakes = {
        "base": [
            *OF_ANGLES,
            *OF_COORDINATES,
            (as_angles(60.0), "minutes of arc"),
            (as_angles(1 / 360), "in turns"),
        ],
        "external": [*OF_ANGLES, (OF_COORDINATES[1][0], "mirror image"), *OF_COORDINATES[2:4]],
        "seats": OF_ANGLES,
        "bars": [
            OF_ANGLES[2],
            OF_ANGLES[4],
            (bars_in(1e-3), "bars are in metres"),
        ],  # bars are slower to fit
    }[setup]
    if setup == "external":
        turn = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
        data = replace(data, reference=data.reference @ turn.T + [0.5, 0.2, 0.9])
        options["reference_frame"] = "external"
    data = with_gross_errors(data, rng)
    for mistake, name in mistakes[::every]:
        with pytest.raises(MistakenFileError) as caught:
            calibrate(arm, mistake(data), **options, hold_out=False, progress=False)
        found = caught.value
        assert any(name in said for said in (found.mistake, *found.others)), f"{name}: {found}"
        assert 0.05 < found.before < 3.0
        assert 0.0 < found.after < 1e-4
        assert f"{found.before * 1e3:.4g}" in str(found)


def test_with_stated_noise_an_unknown_target_and_in_a_diagnosis(sino6, rng):
    data = counted(3)(with_gross_errors(simulate_measurements(sino6, "free", 60, rng=rng), rng))
    stated: dict[str, Any] = {
        "encoder_noise": 8e-6,
        "reference_noise": 1.2e-5,
        "probe_noise": 0.0,
        "hold_out": False,
    }
    for options in (stated, {"target": "unknown", "hold_out": False}):
        for run in (calibrate, diagnose):
            with pytest.raises(MistakenFileError) as caught:
                run(sino6, data, **options, progress=False)  # type: ignore[operator]
            assert caught.value.mistake.startswith("joint 4 is counted")


def test_sound_files_pass(arm):
    causes = [
        (),
        (EncoderEccentricity(3, values=(2e-4, 1e-4)),),
        (JointZeroOffset(2, values=(2e-3,)),)
        if arm.dh is not None
        else (EncoderGain(2, values=(4e-4,)),),
    ]
    for seed in range(6):  # each with both plans
        rng = np.random.default_rng(seed)
        model = ErrorModel(arm).with_effects(*causes[seed % 3])
        plan: Any = ("free", "seats")[seed % 2]
        data = with_gross_errors(simulate_measurements(model, plan, 60, rng=rng, seats=6), rng)
        assert calibrate(arm, data, "geometry", hold_out=False, progress=False).rms < 2e-3
    far = simulate_measurements(arm, "free", 60, rng=rng)  # zeros that nobody has calibrated yet
    far = replace(far, q=far.q + np.deg2rad([3.0, -2.0, 2.5, -3.0, 2.0, 1.0]))
    assert calibrate(arm, far, "zero-offsets", hold_out=False, progress=False).rms < 2e-3


# --- when a mistake is named, by numbers


@dataclass(frozen=True)
class Named:
    """A mistake, and a problem without it: no more than a name."""

    name: str
    kind: str
    of_arm = True
    free = 0

    def undone(self, problem: object) -> str:
        return (f"{problem}+" if isinstance(problem, str) else "") + self.name


LEFT = {"a": (0.010, 1e-3), "b": (0.5, 0.4)}
"""Of each mistake: what the arm as it is described is off by without it, over its travel; what a
fit leaves then [m].
"""
TAKEN_UP = {"before": 0.1, "fitted": 1e-3}
"""A fit that follows the mistake."""
NAMED: list[tuple[dict[str, tuple[float, float]], dict[str, Any], tuple[str, ...]]] = [
    (LEFT, {}, ("a",)),
    (LEFT, {"n": 9}, ()),
    (LEFT, {"n": 10}, ("a",)),
    (LEFT, {"before": np.inf}, ()),
    # An arm that is near, however it is described, is right; unless the fit is far off.
    ({"a": (1e-3, 1e-4)}, {"before": 1.9e-3, "fitted": 1.9e-3}, ()),
    ({"a": (1e-3, 1e-4)}, {"as_given": 0.029, "fitted": 1.9e-3}, ()),
    ({"a": (0.01, 4e-4)}, {"before": 1.9e-3, "fitted": 2.1e-3}, ("a",)),
    (LEFT, {"before": 6e-3, "as_given": 0.0501, "fitted": 1.9e-3}, ("a",)),
    (LEFT, TAKEN_UP, ("a",)),
    (LEFT, {"before": 0.1, "fitted": np.inf}, ("a",)),
    # The arm as it is described has to be nearer without it, and by far where the fit has taken it
    # up.
    ({"a": (0.49, 1e-3)}, {}, ("a",)),
    ({"a": (0.51, 1e-3)}, {}, ()),
    ({"a": (0.099, 1e-3)}, TAKEN_UP, ("a",)),
    ({"a": (0.101, 1e-3)}, TAKEN_UP, ()),
    # And so does a fit: a fifth of what it was, and like the arm.
    ({"a": (0.01, 0.029)}, {}, ("a",)),
    ({"a": (0.01, 0.031)}, {}, ()),
    ({"a": (0.01, 0.019)}, {"fitted": 0.1}, ("a",)),
    ({"a": (0.01, 0.021)}, {"fitted": 0.1}, ()),
    ({"a": (0.01, 0.019)}, TAKEN_UP, ("a",)),
    ({"a": (0.01, 0.021)}, TAKEN_UP, ()),
    (LEFT, {"absorbed": "a"}, ()),
    # Alike is what leaves less than half as much again.
    ({"a": (0.010, 1e-3), "b": (0.0149, 1e-3), "c": (0.0151, 1e-3)}, {}, ("a", "b")),
    # What a fit does not confirm is not named beside the others, nor what leaves more than they.
    ({"b": (0.0149, 1e-3), "a": (0.010, 1e-3)}, {"absorbed": "b"}, ("a",)),
    ({"a": (0.010, 1.5e-3), "b": (0.0149, 9e-4)}, {}, ("b",)),
    # The best three are fitted, the next where one cannot be.
    ({"a": (0.02, 0.1), "b": (0.03, 0.1), "c": (0.04, 1e-3)}, {}, ("c",)),
    ({"a": (0.02, np.inf), "b": (0.031, 1e-3)}, {}, ("b",)),
    ({"a": (0.02, 0.1), "b": (0.03, 0.1), "c": (0.04, 0.1), "d": (0.05, 1e-3)}, {}, ()),
    # Two at once where the file is thoroughly wrong, of two kinds.
    ({"a": (0.4, 0.4), "b": (0.4, 0.4), "a+b": (0.01, 1e-3)}, {}, ()),
    ({"a": (0.4, 0.4), "b": (0.4, 0.4), "a+b": (0.01, 1e-3)}, {"thorough": True}, ("a, and b",)),
    (
        {"a": (0.4, 0.4), "A": (0.4, 0.4), "b": (0.4, 0.4), "a+A": (0.01, 1e-3)},
        {"thorough": True},
        (),
    ),
]


@pytest.mark.parametrize(("off", "told", "named"), NAMED)
def test_when_a_mistake_is_named(off, told, named, monkeypatch):
    case = {
        "n": 50,
        "before": 0.5,
        "as_given": 0.5,
        "fitted": 0.4,
        "absorbed": None,
        "thorough": False,
    } | told
    records = SimpleNamespace(n=case["n"], nq=1, source="data.csv", take=lambda _: None)
    problem: Any = SimpleNamespace(measurements=records, of=lambda _: SimpleNamespace())

    def fitted(without: str, **_: object) -> object:
        if off.get(without, (1.0, 1.0))[1] == np.inf:
            raise AacmmError("too soft to stand")
        system = SimpleNamespace(deviation=off.get(without, (1.0, 1.0))[1])
        return SimpleNamespace(problem=without, unmodelled=0.0, system=system)

    def misfit(of: object, _: object) -> tuple[float, float]:
        return (
            (0.0, off.get(of, (1.0, 1.0))[0])
            if isinstance(of, str)
            else (case["before"], case["as_given"])
        )

    single = [Named(name, name.lower()) for name in off if "+" not in name]
    fakes = {
        "fit": fitted,
        "_misfit": misfit,
        "_mistakes": lambda _: single,
        "_few": lambda _: None,
    }
    fakes |= {
        "_described": lambda of: of,
        "_touched": lambda _: None,
        "_median": float,
        "_travel": lambda _: 1.0,
        "_absorbs": lambda after: after.problem == case["absorbed"],
    }
    for name, fake in fakes.items():
        monkeypatch.setattr(input_mistakes, name, fake)
    if not named:
        input_mistakes._require_no_mistake(
            problem, case["fitted"], thorough=case["thorough"], options=True
        )
        return
    with pytest.raises(MistakenFileError) as caught:
        input_mistakes._require_no_mistake(
            problem, case["fitted"], thorough=case["thorough"], options=True
        )
    assert (caught.value.mistake, *caught.value.others) == named
    taken_up = case["fitted"] < 2e-3 or case["fitted"] == np.inf
    assert caught.value.before == (case["before"] if taken_up else case["fitted"])
    assert caught.value.after == off[named[0].replace(", and ", "+")][1]


@pytest.mark.parametrize(("unit", "far"), [("m", 0.05), ("rad", 0.5)])
@pytest.mark.parametrize(("lever", "moves"), [(1.02, True), (1e-3, False)])
def test_geometry_that_took_up_a_mistake(sino6, rng, unit, far, lever, moves):
    """A length farther off than 50 mm or an angle than half a radian, to either side; causes may be
    what they are.

    The zero of a joint that hardly moves the tip may be anything.
    """
    data = simulate_measurements(sino6, "free", 12, rng=rng)
    problem = problem_of(ErrorModel(sino6), data, ["geometry", EncoderGain(2)], Setup.of(sino6))
    units = [parameter.unit for parameter in problem.vector.parameters]
    jacobian = np.full((12, 3, len(units)), lever / np.sqrt(3.0))
    prediction = SimpleNamespace(jacobian=jacobian)
    gain = next(own.start for effect, own in problem.vector if isinstance(effect, EncoderGain))
    for place, step, taken_up in ((units.index(unit), far, moves), (gain, 100.0 * far, False)):
        for sign in (1.0, -1.0):
            for part in (0.99, 1.01):
                x = problem.start.copy()
                x[place] += sign * part * step
                point = SimpleNamespace(x=x, prediction=prediction)
                after: Any = SimpleNamespace(problem=problem, point=point)
                assert input_mistakes._absorbs(after) == (taken_up and part > 1.0)


# --- options, and the arm's numbers


def table(*rows: tuple[float, float, float, float]) -> Arm:
    return by_table("robot", rows, 150.0)


ROBOT = table(
    (0, 290, -90, 0),
    (270, 0, 0, -90),
    (70, 0, -90, 0),
    (0, 302, 90, 0),
    (0, 0, -90, 0),
    (0, 72, 0, 180),
)
"""Its last axis goes through the tip, which the last joint does not move."""
SEVEN = table(
    (0, 340, -90, 0),
    (0, 0, 90, 0),
    (0, 400, 90, 0),
    (0, 0, -90, 0),
    (0, 400, -90, 0),
    (0, 0, 90, 0),
    (30, 126, 0, 0),
)
FRAME_OPTION, TARGET_OPTION = "--reference-frame external", "--target unknown"


def assembled(arm: Arm, rng: np.random.Generator) -> Arm:
    """An arm whose geometry is off as that of a robot."""
    assert arm.dh is not None
    values = arm.dh.values()
    values += rng.normal(0.0, [3e-4, 3e-4, 1e-3, 1e-3], values.shape)
    return table(*(values * [1e3, 1e3, 180 / np.pi, 180 / np.pi]).tolist())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("target", "away", "named"),
    [
        ((0.0, 0.0, 0.0), True, {FRAME_OPTION}),
        ((0.0, -0.03, 0.118), True, {FRAME_OPTION, TARGET_OPTION}),
        ((0.0, 0.0, 0.122), False, {TARGET_OPTION}),
    ],
)
def test_an_option_that_was_left_out_is_named(target, away, named, seed):
    """Not a sign of the last joint, which hardly moves the tip."""
    rng = np.random.default_rng(seed)
    model = ErrorModel(assembled(ROBOT, rng), (StylusOffset(values=target),))
    data = simulate_measurements(model, "free", 90, rng=rng, reference_noise=5e-5)
    with pytest.raises(MistakenFileError) as caught:
        calibrate(ROBOT, other_frame(data) if away else data, hold_out=False, progress=False)
    assert {
        option for option in (FRAME_OPTION, TARGET_OPTION) if option in caught.value.mistake
    } == named
    assert "joint" not in caught.value.mistake
    options: dict[str, Any] = {"reference_frame": "external" if away else "base"}
    options["target"] = "unknown" if TARGET_OPTION in named else "tip"
    found = calibrate(
        ROBOT, other_frame(data) if away else data, **options, hold_out=False, progress=False
    )
    assert found.rms < 2e-4


@pytest.mark.parametrize("seed", range(3))
def test_a_tip_that_geometry_takes_up_is_no_mistake(seed):
    """15 mm beyond the stated one, as of a robot's tool of which the length is known roughly."""
    rng = np.random.default_rng(seed)
    model = ErrorModel(assembled(ROBOT, rng), (StylusOffset(values=(0.003, 0.0, 0.014)),))
    data = simulate_measurements(model, "free", 90, rng=rng, reference_noise=5e-5)
    assert calibrate(ROBOT, data, hold_out=False, progress=False).rms < 2e-4


def shown_with(other: int, joint: int, sign: float) -> Change:
    """The angle that is shown of a joint has that of another in it."""
    return lambda d: replace(d, q=d.q + sign * np.outer(d.q[:, other], np.eye(d.nq)[joint]))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["sino6", "robot", "seven"])
def test_convention_and_sums_of_angles_are_named(name, sino6, seed):
    rng = np.random.default_rng(seed)
    arm = {"sino6": sino6, "robot": ROBOT, "seven": SEVEN}[name]
    truth = perturbed_model(arm, rng).arm if name == "sino6" else assembled(arm, rng)
    data = simulate_measurements(truth, "free", 60, rng=rng, reference_noise=5e-5)
    assert isinstance(arm.file, ArmFile)
    misread = Arm.from_file(arm.file.model_copy(update={"convention": "modified-dh"}))
    mistakes: list[tuple[Arm, Change, str]] = [
        (misread, lambda d: d, "standard-dh"),
        (arm, shown_with(1, 2, 1.0), "joint 3 is shown as the sum"),
        (arm, shown_with(1, 2, -1.0), "joint 3 is shown as the difference"),
    ]
    for given, mistake, words in mistakes:
        with pytest.raises(MistakenFileError) as caught:
            calibrate(given, mistake(data), hold_out=False, progress=False)
        assert words in caught.value.mistake
        assert caught.value.after < 1e-3
