"""Every cause of error: one contract that all of them keep, then the physics of each against
something that shares no code.

A new cause needs one line in ``EXAMPLES``.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import date
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import tomli_w
from numpy.typing import ArrayLike
from scipy.interpolate import make_lsq_spline
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, Arm, ArmFile, axis, end
from aacmm_pin.effects import (
    CAUSES,
    BaseCompliance,
    BearingTilt,
    Counterbalance,
    Effect,
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    EncoderSlip,
    ErrorModel,
    FrameShift,
    JointCompliance,
    JointCoupling,
    JointDistance,
    JointErrorCurve,
    JointHysteresis,
    JointPeriodicError,
    JointPlacement,
    JointZeroOffset,
    LinkBending,
    LinkLength,
    LinkTilt,
    LinkTwist,
    ProbeBending,
    ReferenceFrame,
    SeatError,
    SeatShift,
    SecondPeriodicError,
    SlideAngle,
    State,
    StylusBending,
    StylusOffset,
    StylusShift,
    ThermalExpansion,
    TorsionalWindup,
    ZeroDrift,
    effect_from,
    fields_of,
    of_geometry,
    strongest_waves,
)
from aacmm_pin.effects.compliance import GravityEffect
from aacmm_pin.effects.conditions import CONDITION_COLUMNS, Conditions
from aacmm_pin.errors import (
    AacmmError,
    ArmFileError,
    MissingConditionError,
    UnsupportedArmError,
)
from aacmm_pin.measurements import Measurements
from tests.again import again
from tests.arm_files import changed
from tests.oracle import (
    close,
    gravity_moments,
    gravity_torques,
    jacobian_of,
    perturbed_positions,
    placements,
    postures,
    twist_matrix,
)

ALL_BODIES = (1, 2, 3, 4, 5, 6)

EXAMPLES: list[Effect] = [
    JointZeroOffset(joint=2),
    LinkLength(joint=3),
    JointDistance(joint=5),
    LinkTwist(joint=2),
    LinkTilt(joint=2),
    SlideAngle(joint=2),
    JointPlacement(joint=3),
    EncoderEccentricity(joint=3),
    EncoderEllipticity(joint=4),
    JointPeriodicError(joint=2, order=16.5),
    SecondPeriodicError(joint=2, order=4.5),
    JointErrorCurve(joint=3, lower_rad=-7.0, upper_rad=7.0, coefficients=8),
    EncoderGain(joint=5),
    JointCoupling(joint=3, of=1),
    EncoderSlip(joint=1, time_s=3000.0),
    FrameShift(time_s=3000.0),
    StylusShift(time_s=3000.0),
    SeatShift(seat="A", time_s=3000.0),
    JointCompliance(joint=2),
    JointCompliance(joint=2, bodies=ALL_BODIES[1:]),
    JointCompliance(joint=2, torque="measured"),
    BearingTilt(joint=1),
    BearingTilt(joint=2, bodies=ALL_BODIES[1:]),
    JointHysteresis(joint=3),
    ZeroDrift(joint=2, time_constant_s=1800.0),
    TorsionalWindup(link=5),
    LinkBending(link=5),
    BaseCompliance(),
    BaseCompliance(bodies=ALL_BODIES),
    ThermalExpansion(),
    ThermalExpansion(link=3),
    Counterbalance(joint=2),
    StylusOffset(),
    StylusOffset(marker="m1"),
    StylusBending(),
    ProbeBending(),
    SeatError(seat="A"),
    ReferenceFrame(),
]

ROBOTS = {"ur5": ("ur5_robot.urdf", "tool0"), "panda": ("panda.urdf", "panda_hand")}
DH_ARMS = ("sino6", "sino6-modified", "zero6")

NO_MASSES = (
    "joint_compliance",
    "bearing_tilt",
    "torsional_windup",
    "link_bending",
    "base_compliance",
)
NO_TABLE = dict.fromkeys(("link_length", "link_twist", "link_tilt"), "needs a DH table") | {
    "stylus_bending": "no axis of the stylus",
    "probe_bending": "no axis of the stylus",
}
NO_TUBE = {
    "link_bending": "expected a tube",
    "torsional_windup": "expected a tube",
}
REFUSED: dict[str, dict[str, str]] = {
    "sino6": {},
    "sino6-modified": {},
    "zero6": dict.fromkeys(NO_MASSES, "no masses"),
    "ur5": NO_TABLE,
    "panda": NO_TABLE | NO_TUBE,  # joints 5 and 6 have one origin
}
"""What an arm cannot have, and words of the reason."""


def refusal(effect: Effect, arm_name: str) -> str | None:
    known_load = getattr(effect, "bodies", ()) or getattr(effect, "torque", "gravity") == "measured"
    return None if known_load else REFUSED[arm_name].get(effect.cause)


@pytest.fixture(scope="module")
def arms(robot_file) -> dict[str, Arm]:
    # A lump at the very end of a tube would be on a kink of the share that is spread over it.
    inside = {0: {"com_mm": (0.0, 0.0, 10.0)}}
    tables = {
        "sino6": Arm.load("sino6"),
        "sino6-modified": changed("sino6", inside, convention="modified-dh"),
        "zero6": Arm.load("zero6"),
        "sino6-wall": changed("sino6", gravity_m_s2=(6.0, -5.0, 6.0)),
    }
    return tables | {
        name: Arm.from_urdf(robot_file(file), frame) for name, (file, frame) in ROBOTS.items()
    }


def cases(arms: dict[str, Arm], *names: str) -> Iterator[tuple[Arm, Effect]]:
    """Every example, with as many bodies as the arm has, in each of the arms that can have it."""
    for name in names or (*DH_ARMS, *ROBOTS):
        for effect in EXAMPLES:
            if refusal(effect, name) is None:
                some = isinstance(effect, GravityEffect) and effect.bodies
                bodies = {"bodies": tuple(range(some[0], arms[name].nq + 1))} if some else {}
                yield arms[name], replace(effect, values=(), u=(), **bodies)


def known(arm: Arm, n: int, rng: np.random.Generator) -> Conditions:
    """Every condition that can be known, but for the temperatures of single links."""
    return Conditions(
        n,
        time=rng.uniform(0.0, 7200.0, n),
        temperature=rng.uniform(15.0, 30.0, n),
        approach=rng.integers(-1, 2, (n, arm.nq)).astype(float),
        torque=rng.normal(scale=5.0, size=(n, arm.nq)),
        seat=np.array(["A", "B", ""] * n, dtype=object)[:n],
        marker=np.array(["m1", "m2"] * n, dtype=object)[:n],
        session=np.array(["1"] * n, dtype=object),
        probe_direction=directions(n, rng),
    )


def directions(n: int, rng: np.random.Generator) -> Array:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def typical(effect: Effect) -> Array:
    return np.array([term.typical for term in effect.terms])


def positions(
    arm: Arm,
    effect: Effect,
    values: ArrayLike,
    q: Array,
    conditions: Conditions,
    at: str | None = None,
) -> Array:
    model = ErrorModel(arm, (effect.at(tuple(np.asarray(values, dtype=float))),))
    return model.predict(q, conditions, at, as_referenced=True)


def columns(
    arm: Arm, effect: Effect, q: Array, conditions: Conditions, at: str | None = None
) -> Array:
    return ErrorModel(arm, (effect,)).sensitivity(q, conditions, at)[:, :, len(arm.parameters) :]


# --- the contract ---


def test_every_cause_has_an_example():
    assert {effect.cause for effect in EXAMPLES} == set(CAUSES)
    assert {type(effect) for effect in EXAMPLES} == set(CAUSES.values())


def test_columns_are_the_derivatives(arms, rng):
    """Central differences: 2e-6 m of motion leave some 1e-10 of truncation and of rounding."""
    for arm, effect in cases(arms):
        q = postures(arm, rng, 10)
        conditions = known(arm, 10, rng)
        for at in (None, "frame3") if arm.name == "SINO6" else (None,):
            stated = columns(arm, effect, q, conditions, at)
            for k, unit in enumerate(np.eye(len(effect.terms))):
                size = np.abs(stated[:, :, k]).max()
                h = min(2e-6 / max(size, 1e-300), 0.03 * effect.terms[k].typical)
                there, back = (
                    positions(arm, effect, s * h * unit, q, conditions, at) for s in (1, -1)
                )
                rounding = 1e-15 / h
                close(stated[:, :, k], (there - back) / (2 * h), 1e-9 * size + rounding)


def test_arm_file_brings_an_effect_back(arms, rng, tmp_path):
    for arm, example in cases(arms, "sino6"):
        q, conditions = postures(arm, rng, 10), known(arm, 10, rng)
        values = typical(example) * rng.uniform(-1.0, 1.0, len(example.terms))
        model = ErrorModel(arm, (example.at(tuple(values), tuple(0.1 * typical(example))),))
        model.save(tmp_path / "extended.toml", force=True)
        loaded = ErrorModel.load(tmp_path / "extended.toml")
        (back,) = loaded.effects
        assert type(back) is type(example)
        for name in fields_of(type(back)):
            assert getattr(back, name) == getattr(example, name)
        close(loaded.predict(q, conditions), model.predict(q, conditions), 1e-15)
        u = [[p.u for p in one.parameters] for one in (loaded, model)]
        np.testing.assert_allclose(*u, rtol=1e-14)


NONSENSE: list[Any] = [[1.5], {"a": 1}, "x", True, np.nan, -1, date(2019, 4, 27)]


@pytest.mark.parametrize("of_every_cause", [False, again(True)])
def test_nonsense_in_the_arm_file_is_named(arms, tmp_path, of_every_cause):
    """Whatever stands in a field, the file loads to an effect with that value or is refused with
    file and key.
    """
    path, refused, tried = tmp_path / "odd.toml", [], set()
    for example in {effect.cause: effect for effect in EXAMPLES}.values():
        effect = example.at(tuple(typical(example)), tuple(typical(example)))
        file = ErrorModel(arms["sino6"], (effect,)).file()
        content = file.model_dump(mode="json", by_alias=True, exclude_none=True)
        (entry,) = content.pop("effects")
        of_all = ["parameters", "uncertainty", "new_field"] if example is EXAMPLES[0] else []
        own = [name for name in fields_of(type(example)) if of_every_cause or name not in tried]
        tried.update(own)
        for key, odd in itertools.product([*own, *of_all], NONSENSE):
            changed = content | {"effects": [entry | {key: odd}]}
            path.write_text(tomli_w.dumps(changed), encoding="utf-8")
            try:
                (loaded,) = ErrorModel.load(path).effects
            except ArmFileError as error:
                refused.append(f"{error.path}: {error.key}")
            else:
                assert key not in of_all
                assert getattr(loaded, key) == (tuple(odd) if isinstance(odd, list) else odd)
    assert all(place.startswith(f"{path}: effects[1]") for place in refused)


def test_missing_condition_names_the_column(arms, rng):
    for arm, effect in cases(arms):
        model = ErrorModel(arm, (effect.at(tuple(typical(effect))),))
        q, nothing = postures(arm, rng, 5), Conditions(5)
        if not effect.needs:
            assert model.predict(q, as_referenced=True).shape == (5, 3)
            continue
        needed, *_ = effect.needs
        for ask in (
            partial(model.predict, q, nothing, as_referenced=True),
            partial(model.sensitivity, q),
        ):
            with pytest.raises(MissingConditionError, match=effect.label) as caught:
                ask()
            assert caught.value.column == CONDITION_COLUMNS[needed]
            assert CONDITION_COLUMNS[needed] in str(caught.value)


def test_what_an_arm_cannot_have_is_refused(arms, rng):
    for name, example in itertools.product((*DH_ARMS, *ROBOTS), EXAMPLES):
        words, arm = refusal(example, name), arms[name]
        if words is None:
            continue
        q, conditions = postures(arm, rng, 2), known(arm, 2, rng)
        error = AacmmError if "tube" in words else UnsupportedArmError
        with pytest.raises(error, match=words):
            columns(arm, example, q, conditions)
        with pytest.raises(error, match=words):
            positions(arm, example, typical(example), q, conditions)


def test_rows_that_are_not_there(arms, rng):
    arm = arms["sino6"]
    q, conditions = postures(arm, rng, 2), known(arm, 2, rng)
    for example in EXAMPLES:
        if example.row is None:
            continue
        field = str(example.location_field())
        with pytest.raises(AacmmError, match="has no row 7; expected 1 to 6"):
            columns(arm, replace(example, **{field: 7}), q, conditions)
        with pytest.raises(AacmmError, match=rf"{example.cause}: {field} is 0; expected"):
            replace(example, **{field: 0})


def test_fields_that_make_no_sense():
    curve = partial(JointErrorCurve, joint=2, lower_rad=0)
    refused: list[tuple[Callable[[], Effect], str]] = [
        (partial(EncoderGain, 2, values=(np.nan,)), "encoder_gain:2: values is .* 1 finite"),
        (partial(EncoderGain, 2, u=(-1e-6,)), "0 or more"),
        (partial(ZeroDrift, 2, time_constant_s=0.0), "time_constant_s is 0.0"),
        (partial(curve, upper_rad=0, coefficients=4), "lower_rad < upper_rad"),
        (partial(curve, upper_rad=1, coefficients=3), "4 to 1000 coefficients"),
        (partial(JointCompliance, 2, torque="spring"), "expected 'gravity' or 'measured'"),
        (
            partial(JointCompliance, 2, torque="measured", bodies=(2, 3)),
            "expected only one of bodies",
        ),
    ]
    for make, words in refused:
        with pytest.raises(AacmmError, match=words):
            make()


def test_bodies_are_those_beyond(sino6, rng):
    q = postures(sino6, rng, 3)
    assert BearingTilt(joint=4, bodies=[4, 5, 6]) == BearingTilt(joint=4, bodies=(4, 5, 6))
    every = columns(sino6, BearingTilt(joint=4, bodies=(4, 5, 6)), q, Conditions(3))
    some = columns(sino6, BearingTilt(joint=4, bodies=(4, 5)), q, Conditions(3))
    close(some, every[:, :, : some.shape[2]], 1e-15)
    with pytest.raises(AacmmError, match=r"bearing_tilt:4: bodies is .*; expected \(4, 5, 6\)"):
        columns(sino6, BearingTilt(joint=4, bodies=(5, 6)), q, Conditions(3))


def test_a_rigid_row_has_no_encoder(zero6, rng):
    q = postures(zero6, rng, 2)
    for effect in EXAMPLES:
        if hasattr(effect, "joint") and effect.cause.startswith("encoder"):
            with pytest.raises(AacmmError, match="row 7 of zero6 is rigid"):
                columns(zero6, replace(effect, joint=7), q, known(zero6, 2, rng))
    turned = positions(zero6, JointZeroOffset(joint=7), [0.1], q, Conditions(2))
    close(turned, zero6.positions(q), atol=1e-15)  # a stylus turned about itself


def test_an_arm_that_cannot_stand(sino6, rng):
    with pytest.raises(AacmmError, match="joint_compliance:2: no static equilibrium"):
        positions(sino6, JointCompliance(joint=2), [1.0], postures(sino6, rng, 20), Conditions(20))


# --- the physics of each cause; tests/blind/test_blind_plant.py holds more of them, such as the
# bending and the wind-up of tubes, against the plant ---


def turned(arm: Arm, q: Array, joint: int, delta: ArrayLike) -> Array:
    """Where the tip is when a joint has another angle than its encoder says."""
    q = q.copy()
    q[:, joint - 1] += delta
    return arm.positions(q)


class Bodies:
    """Weights of an arm by brute force: the numbers of its file and the placements of its table."""

    def __init__(self, file: ArmFile, frames: Array) -> None:
        """``frames`` are the placements of frame 0 and of all rows (n, rows + 1, 4, 4)."""
        self.masses = np.array([row.mass_kg for row in file.joints])
        centres = np.array([[*(c * MM for c in row.com_mm or ()), 1.0] for row in file.joints])
        self.centres = np.einsum("nrij,rj->nri", frames[:, 1:], centres)[..., :3]
        self.gravity = np.array(file.gravity_m_s2)

    def moment(self, first: int, about: Array) -> Array:
        """Moment of the weights of body ``first`` and all beyond about points (n, 3)."""
        total = np.zeros_like(about)
        for k in range(first - 1, len(self.masses)):
            total += np.cross(self.centres[:, k] - about, self.masses[k] * self.gravity)
        return total


@pytest.fixture
def q(sino6, rng) -> Array:
    return postures(sino6, rng, 30)


def test_geometry_is_the_arm_with_other_values(arm_file, rng):
    arm = Arm.from_file(arm_file)
    q, errors = postures(arm, rng, 1), rng.normal(scale=0.05, size=(1, len(arm.parameters)))
    effects = [
        effect.at((error,)) for effect, error in zip(of_geometry(arm), errors[0], strict=True)
    ]
    close(ErrorModel(arm, tuple(effects)).predict(q), perturbed_positions(arm, q, errors))


def test_tilt_is_the_hayati_angle(arm_file, rng):
    """Ry(β) behind Rx(α), with the placements of the table around it."""
    arm, row, beta = Arm.from_file(arm_file), 3, 0.2
    q = postures(arm, rng, 5)
    frames = placements(arm, q)
    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_euler("y", beta).as_matrix()
    if arm_file.dh.standard:
        before = frames[:, row]
    else:
        values = arm_file.dh.values()[row - 1]
        screw = np.eye(4)
        screw[:3, :3], screw[0, 3] = Rotation.from_euler("x", values[2]).as_matrix(), values[0]
        before = frames[:, row - 1] @ screw
    expected = before @ tilt @ np.linalg.inv(before) @ frames[:, -1]
    close(positions(arm, LinkTilt(joint=row), [beta], q, Conditions(5)), expected[:, :3, 3])


def test_placement_is_the_model_with_another_placement(arms, rng):
    for name in ROBOTS:
        arm = arms[name]
        q, errors = postures(arm, rng, 1), rng.normal(scale=0.1, size=(arm.nq, 6))
        effects = [JointPlacement(j, values=tuple(e)) for j, e in enumerate(errors, start=1)]
        expected = perturbed_positions(arm, q, errors.reshape(1, -1))
        close(ErrorModel(arm, tuple(effects)).predict(q), expected)


def test_eccentricity_is_that_of_a_disc(sino6, rng):
    """Rays: the head at (1, 0), the disc's centre on a circle about the axis, the radial line that
    the head sees.
    """
    gamma, joint = 0.7, 3
    q = postures(sino6, rng, 20)

    def indication(angle: float, eccentricity: float) -> float:
        centre = eccentricity * np.array([np.cos(gamma + angle), np.sin(gamma + angle)])
        ray = np.array([1.0, 0.0]) - centre
        return float(angle - np.arctan2(ray[1], ray[0]))

    def angle_of(seen: float, eccentricity: float) -> float:
        return float(
            brentq(lambda a: indication(a, eccentricity) - seen, seen - 0.5, seen + 0.5, xtol=1e-15)
        )

    for eccentricity in (1e-4, 0.03, 0.1):
        angles = np.array([angle_of(seen, eccentricity) for seen in q[:, joint - 1]])
        told = {"amplitude_rad": eccentricity, "phase_rad": -gamma - np.pi / 2}
        disc = effect_from(EncoderEccentricity, {"joint": joint}, told)
        assert np.hypot(*disc.values) == pytest.approx(eccentricity, rel=1e-14)
        close(
            ErrorModel(sino6, (disc,)).predict(q), turned(sino6, q, joint, angles - q[:, joint - 1])
        )


def test_periodic_errors_turn_the_joint(sino6, q):
    amplitude, phase, step = 3e-3, -2.0, 1e-7
    for effect, order in (
        (EncoderEllipticity(joint=4), 2.0),
        (JointPeriodicError(joint=4, order=16.5), 16.5),
    ):
        values = effect.from_file({"amplitude_rad": amplitude, "phase_rad": phase})
        expected = turned(sino6, q, 4, amplitude * np.cos(order * q[:, 3] - phase))
        close(positions(sino6, effect, values, q, Conditions(len(q))), expected)
        polar = {"amplitude_rad": amplitude, "phase_rad": phase}
        assert effect.at(values).file_values() == pytest.approx(polar, rel=1e-12)
        moved = [
            [*effect.at(np.array(values) + step * unit).file_values().values()]
            for unit in np.eye(2)
        ]
        numeric = (np.array(moved).T - np.array([[amplitude], [phase]])) / step
        np.testing.assert_allclose(effect.at(values).file_jacobian(), numeric, rtol=1e-3)


def test_error_curve_has_linear_precision(sino6, q):
    """Equal coefficients are a constant; coefficients at the means of three neighbouring knots are
    the angle itself.
    """
    curve = JointErrorCurve(joint=3, lower_rad=-0.5, upper_rad=7.0, coefficients=9)
    knots = np.concatenate([[-0.5] * 3, np.linspace(-0.5, 7.0, 7), [7.0] * 3])
    means = np.array([knots[i + 1 : i + 4].mean() for i in range(9)])
    n = len(q)
    close(positions(sino6, curve, np.full(9, 2e-3), q, Conditions(n)), turned(sino6, q, 3, 2e-3))
    close(
        positions(sino6, curve, 1e-3 * means, q, Conditions(n)), turned(sino6, q, 3, 1e-3 * q[:, 2])
    )
    close(
        positions(sino6, EncoderGain(joint=3), [1e-3], q, Conditions(n)),
        turned(sino6, q, 3, 1e-3 * q[:, 2]),
    )


def test_what_depends_on_time_and_approach(sino6, rng):
    q = postures(sino6, rng, 4)
    time, approach = np.array([-1e9, 600.0, 601.0, 1e9]), np.zeros((4, 6))
    approach[:, 2] = -1, 0, 1, 1
    conditions = Conditions(4, time=time, approach=approach)
    expected = {
        EncoderSlip(joint=3, time_s=600.0): [0.0, 1e-3, 1e-3, 1e-3],
        ZeroDrift(joint=3, time_constant_s=600.0): [
            0.0,
            1e-3 * (1 - np.exp(-1)),
            1e-3 * (1 - np.exp(-601 / 600)),
            1e-3,
        ],
        JointHysteresis(joint=3): [-1e-3, 0.0, 1e-3, 1e-3],
    }
    for effect, delta in expected.items():
        close(positions(sino6, effect, [1e-3], q, conditions), turned(sino6, q, 3, delta))


def test_encoder_causes_shift_a_joint_that_slides(robot_file, rng):
    arm = Arm.from_urdf(robot_file("tiago.urdf"), "arm_tool_link")
    q = postures(arm, rng, 5)
    conditions = known(arm, 5, rng)
    for effect, delta in (
        (JointZeroOffset(joint=1), 0.01),
        (EncoderGain(joint=1), 0.01 * q[:, 0]),
        (EncoderGain(joint=2), 0.01 * q[:, 1]),
    ):
        found = positions(arm, effect, [0.01], q, conditions)
        close(found, turned(arm, q, effect.row, delta))
    with pytest.raises(UnsupportedArmError, match="joint 1 of tiago"):
        columns(arm, JointCompliance(joint=1), q, conditions)
    finger = Arm.from_urdf(robot_file("panda.urdf"), "panda_leftfinger")
    unknown = JointCompliance(joint=2, bodies=tuple(range(2, 9)))
    with pytest.raises(UnsupportedArmError, match="joint 8 is prismatic"):
        columns(finger, unknown, postures(finger, rng, 2), known(finger, 2, rng))


@pytest.mark.parametrize("name", ["sino6", "sino6-modified", "sino6-wall", "ur5", "panda"])
def test_weights_are_those_of_pinocchio(name, arms, rng):
    """Generalized gravity is the torque that holds the arm, the weight's is minus that; the stand
    tilts under the centre of mass; a bearing tilts under the moment across its axis.
    """
    arm, data, still = arms[name], arms[name].model.createData(), Conditions(20)
    q = postures(arm, rng, 20)
    poses, moments = arm.poses(q), gravity_moments(arm, q)
    holding = -gravity_torques(arm, q)
    centre = np.array([pin.centerOfMass(arm.model, data, each).copy() for each in q])
    assert np.abs(holding).max() > 1.0
    of_stand = np.cross(np.cross(centre, data.mass[0] * arm.gravity), poses.position)
    close(columns(arm, BaseCompliance(), q, still)[:, :, 0], of_stand)
    for joint in range(1, arm.nq + 1):
        expected = -holding[:, None, [joint - 1]] * jacobian_of(poses)[:, :3, [joint - 1]]
        close(columns(arm, JointCompliance(joint=joint), q, still), expected)
        measured = columns(
            arm, JointCompliance(joint=joint, torque="measured"), q, Conditions(20, torque=holding)
        )
        close(measured, expected)
        if name == "sino6-modified":  # Pinocchio's joint has another origin on the axis there
            continue
        tilted = np.empty((20, 3))
        for k, each in enumerate(q):
            z = pin.computeJointJacobians(arm.model, data, each)[3:, joint - 1]
            across = moments[k, joint - 1] - z * (z @ moments[k, joint - 1])
            tilted[k] = np.cross(across, poses.position[k] - data.oMi[joint].translation)
        close(columns(arm, BearingTilt(joint=joint), q, still)[:, :, 0], tilted)


@pytest.mark.parametrize("of_links", [False, True], ids=["whole", "links"])
def test_warmth_is_an_arm_with_longer_lengths(of_links, arm_file, rng):
    """In modified DH a of the next row belongs to the body before it, the first a to the stand."""
    arm = Arm.from_file(arm_file)
    rows = len(arm_file.joints)
    q, alpha = postures(arm, rng, 3), 1e-3
    warm = (
        rng.uniform(15.0, 30.0, (3, rows))
        if of_links
        else np.repeat(rng.uniform(15.0, 30.0, (3, 1)), rows, axis=1)
    )
    conditions = (
        Conditions(3, link_temperature=warm) if of_links else Conditions(3, temperature=warm[:, 0])
    )
    found = positions(arm, ThermalExpansion(), [alpha], q, conditions)
    for k in range(3):
        grown = 1 + alpha * (warm[k] - arm_file.reference_temperature_c)
        stand = 1 + alpha * (warm[k].mean() - arm_file.reference_temperature_c)
        of_a = (
            grown if arm_file.convention == "standard-dh" else np.concatenate([[stand], grown[:-1]])
        )
        longer = {
            n: {"a_mm": row.a_mm * a, "d_mm": row.d_mm * d}
            for n, (row, a, d) in enumerate(zip(arm_file.joints, of_a, grown, strict=True), start=1)
        }
        close(found[k], changed(arm_file, longer).positions(q[[k]])[0])


def test_stylus_is_a_shift_in_the_last_frame(sino6, q):
    frames, shift = sino6.poses(q).placement, np.array([0.1, -0.02, 0.05])
    expected = (frames @ np.append(shift, 1.0))[:, :3]
    n = len(q)
    close(positions(sino6, StylusOffset(), shift, q, Conditions(n)), expected)
    marker = np.array(["m1", "m2"] * n, dtype=object)[:n]
    found = positions(sino6, StylusOffset(marker="m1"), shift, q, Conditions(n, marker=marker))
    close(found, np.where((marker == "m1")[:, None], expected, frames[:, :3, 3]))


def test_stylus_bends_across_itself(arms, rng):
    """Under gravity, and against the motion of the probe."""
    sag = 0.01
    for name, axis_of_file in (("sino6", 0), ("sino6-wall", 0), ("zero6", 2)):
        arm = arms[name]
        q = postures(arm, rng, 20)
        frames = arm.poses(q).placement
        stylus, down = frames[:, :3, axis_of_file], arm.gravity / np.linalg.norm(arm.gravity)
        across = down - stylus * (stylus @ down)[:, None]
        close(
            positions(arm, StylusBending(), [sag], q, Conditions(20)),
            frames[:, :3, 3] + sag * across,
        )
        moved = directions(20, rng)
        across = moved - stylus * np.sum(stylus * moved, axis=1)[:, None]
        close(
            positions(arm, ProbeBending(), [sag], q, Conditions(20, probe_direction=moved)),
            frames[:, :3, 3] - sag * across,
        )


def test_counterbalance_is_a_weight_on_the_upper_tube(sino6, q):
    """The torque at joint 2 of a mass on axis 3, one metre out; the small offset between the two
    axes is left out.
    """
    none = {"mass_kg": None, "com_mm": None}
    weight = {"a_mm": 0.0, "d_mm": 0.0, "mass_kg": 1 / 9.81, "com_mm": (0.0, 0.0, 1000.0)}
    weighted = changed("sino6", {0: none, 2: weight})
    expected = gravity_torques(weighted, q)[:, [1]] * jacobian_of(sino6.poses(q))[:, :3, 1]
    close(columns(sino6, Counterbalance(joint=2), q, Conditions(len(q)))[:, :, 0], expected)


def test_counterbalance_before_a_parallel_axis(arms, rng):
    """Joints 2 and 3 of a UR5 are parallel: the body is the way from one axis to the next."""
    arm = arms["ur5"]
    q = postures(arm, rng, 10)
    z, start, end = (np.empty((10, 3)) for _ in range(3))
    data = arm.model.createData()
    for k, each in enumerate(q):
        pin.forwardKinematics(arm.model, data, each)
        z[k], start[k], end[k] = (
            data.oMi[2].rotation[:, 1],
            data.oMi[2].translation,
            data.oMi[3].translation,
        )
    along = end - start
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = np.einsum("ni,ni->n", z, np.cross(along, [0.0, 0.0, -1.0]))
    expected = turn[:, None] * jacobian_of(arm.poses(q))[:, :3, 1]
    assert np.abs(expected).max() > 0.1
    close(columns(arm, Counterbalance(joint=2), q, Conditions(10))[:, :, 0], expected)


def test_a_seat_that_is_off(sino6, q):
    n, e = len(q), np.array([1e-3, 2e-3, 3e-3])
    seat = np.array(["A", "B", ""] * n, dtype=object)[:n]
    model = ErrorModel(sino6, (SeatError(seat="A", values=tuple(e)),))
    conditions = Conditions(n, seat=seat)
    stated = model.predict(q, conditions, as_referenced=True)
    close(stated, sino6.positions(q) - np.where((seat == "A")[:, None], e, 0.0))
    close(model.predict(q, conditions), sino6.positions(q))
    close(model.predict(q), sino6.positions(q))


def test_reference_frame_is_a_rigid_motion_of_the_settled_arm(sino6, q):
    """However far the references are turned, the weight pulls as it did."""
    twist = np.array([0.3, -0.2, 0.1, 0.8, -1.1, 0.4])
    motion = expm(twist_matrix(twist))
    sagging = JointCompliance(joint=2, values=(1e-3,)), LinkBending(link=3, values=(1e-3,))
    model = ErrorModel(sino6, (*sagging, ReferenceFrame(values=tuple(twist))))
    there = ErrorModel(sino6, sagging).predict(q)
    assert np.abs(there - sino6.positions(q)).max() > 1e-3
    close(model.predict(q), there)
    close(model.predict(q, as_referenced=True), there @ motion[:3, :3].T + motion[:3, 3])


# --- unknown masses, equilibrium, several causes ---


@pytest.mark.parametrize(
    "known_masses",
    [JointCompliance(joint=2), BearingTilt(joint=1), BearingTilt(joint=3), BaseCompliance()],
)
def test_unknown_masses_can_be_those_of_the_file(known_masses, sino6, rng):
    """First moment of a body about its axis, the weights beyond gathered at its end, in standard DH
    at (a, 0, d).
    """
    assert sino6.file is not None
    first = known_masses.row or 1
    values, beyond = [], 0.0
    for row in reversed(sino6.file.joints[first - 1 :]):
        stop = np.array([row.a_mm, 0.0, row.d_mm]) * MM
        centre = stop + Rotation.from_euler("x", row.alpha_rad).apply(np.array(row.com_mm) * MM)
        values.insert(0, 9.81 * ((row.mass_kg or 0.0) * centre + beyond * stop))
        beyond += row.mass_kg or 0.0
    moments = np.concatenate(values)
    q, still = postures(sino6, rng, 200), Conditions(200)
    unknown = replace(known_masses, bodies=tuple(range(first, 7)), values=(), u=())
    stated = columns(sino6, known_masses, q, still)[:, :, 0]
    close(columns(sino6, unknown, q, still) @ moments, stated)
    assert np.abs(stated).max() > 1.0
    exact = positions(sino6, known_masses, [1e-3], q, still)
    close(exact, positions(sino6, unknown, 1e-3 * moments, q, still))


def tilts(n: int, rng: np.random.Generator) -> tuple[Conditions, Array]:
    """Mounts that are tilted at random, and the rotation of each from level: (n, 3, 3)."""
    angles = rng.uniform(-1.5, 1.5, (n, 2))
    cross = np.zeros((n, 3, 3))
    cross[:, 2, 1], cross[:, 0, 2] = angles.T
    tilted = Conditions(n, tilt_x=angles[:, 0], tilt_y=angles[:, 1])
    return tilted, expm(cross - cross.transpose(0, 2, 1))


@pytest.mark.parametrize("name", ["sino6", "sino6-wall", "ur5"])
def test_moments_of_a_tilted_mount_are_those_of_pinocchio(arms, rng, name):
    arm = arms[name]
    q = postures(arm, rng, 20)
    conditions, rotation = tilts(20, rng)
    state = State(arm, q, conditions, arm.chain.tip)
    rows = arm.chain.moving_rows()
    moments = [state.along_axis(row, state.moment_at_axis(row)) for row in rows]
    model = arm.model.copy()
    torques = []
    for posture, base in zip(q, rotation, strict=True):
        model.gravity.linear = base.T @ arm.gravity
        torques.append(-pin.computeGeneralizedGravity(model, model.createData(), posture))
    close(np.stack(moments, axis=1), np.array(torques), 1e-12 * np.abs(torques).max())
    level = gravity_torques(arm, q)
    assert np.abs(level - torques).max() > 1.0


@pytest.mark.parametrize("name", ["sino6", "zero6"])
def test_a_tilt_turns_gravity_for_every_cause(arms, rng, name):
    """As an arm file that states the gravity of the tilted mount; without masses, only the sags of
    stylus and spring turn.
    """
    q = postures(arms[name], rng, 3)
    conditions, rotation = tilts(3, rng)
    everything = known(arms[name], 3, rng)
    tilted = replace(everything, tilt_x=conditions.tilt_x, tilt_y=conditions.tilt_y)
    turned = [changed(name, gravity_m_s2=tuple(base.T @ arms[name].gravity)) for base in rotation]
    sagging = set()
    for arm, effect in cases(arms, name):
        values = typical(effect)
        stated = positions(arm, effect, values, q, tilted)
        for k, other in enumerate(turned):
            expected = positions(other, effect, values, q[k : k + 1], everything.take([k]))
            close(stated[k : k + 1], expected, 1e-13)
        if np.abs(stated - positions(arm, effect, values, q, everything)).max() > 1e-9:
            sagging.add(effect.cause)
    of_masses = NO_MASSES if name == "sino6" else ("joint_compliance", "bearing_tilt")
    assert sagging >= {*of_masses, "counterbalance", "stylus_bending"}
    assert not sagging & {"encoder_gain", "thermal_expansion", "reference_frame"}


def test_a_tilt_gives_a_vertical_first_joint_a_moment(sino6):
    """A level mount gives it none, and so no candidate."""
    for angle, first in ((0.0, 2), (1e-3, 2), (0.1, 1)):
        data = Measurements.of(np.zeros((2, 6)), conditions=Conditions(2, tilt_x=[0.0, angle]))
        assert min(row.joint for (row,) in JointCompliance.candidates(sino6, data)) == first


def test_settled_arm_carries_itself(sino6, q):
    """Every spring has the moment that the weights have in the arm as all of them together have
    bent it.
    """
    assert sino6.file is not None
    joint, tilt, base = 4e-4, 2e-4, 1e-4
    effects = (
        JointCompliance(joint=2, values=(joint,)),
        BearingTilt(joint=4, values=(tilt,)),
        BaseCompliance(values=(base,)),
        EncoderEccentricity(joint=3, values=(1e-2, 0.0)),
    )
    state = ErrorModel(sino6, effects).state(q)
    frames = np.zeros((len(q), 7, 4, 4))
    frames[:, 0] = np.eye(4)
    for row in range(1, 7):
        frames[:, row, :3, :3] = state.rotation[end(row)]
        frames[:, row, :3, 3] = state.origin[end(row)]
        frames[:, row, 3, 3] = 1.0
    weights = Bodies(sino6.file, frames)

    def moment(place: int, first: int) -> Array:
        """In the axes of the place."""
        about = weights.moment(first, state.origin[place])
        return np.asarray(np.einsum("nji,nj->ni", state.rotation[place], about))

    about_axis = moment(axis(2), 2)[:, 2:] * np.eye(6)[5]
    close(state.twists[axis(2)], joint * about_axis, 1e-14)
    close(state.twists[axis(4)][:, 3:], tilt * moment(axis(4), 4) * [1, 1, 0], 1e-14)
    close(state.twists[BASE][:, 3:], base * moment(BASE, 1), 1e-14)
    assert max(np.abs(twist).max() for twist in state.twists.values()) > 5e-3


def test_a_curve_tells_its_waves():
    """Three cosines on a spline come back with order and amplitude; what makes less than one period
    is not told.
    """
    x = np.linspace(-3.0, 3.1, 4000)
    inner = np.linspace(-3.0, 3.1, 118)
    knots = np.concatenate([np.full(3, -3.0), inner, np.full(3, 3.1)])
    wanted = {17.0: 1e-4, 3.5: 4e-5, 21.0: 2e-5}
    y = sum(size * np.cos(order * x + order) for order, size in wanted.items()) + 3e-4 * np.cos(
        0.4 * x
    )
    curve = JointErrorCurve(2, -3.0, 3.1, 120, values=tuple(make_lsq_spline(x, y, knots, 3).c))
    found = {order: size for order, size in strongest_waves(curve) or [] if order > 2.0}
    for (order, size), (true, amplitude) in zip(found.items(), wanted.items(), strict=False):
        assert order == pytest.approx(true, abs=0.15)
        assert size == pytest.approx(amplitude, rel=0.1)
