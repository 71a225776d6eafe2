"""The plant of the blind tests: it obeys statics and contract, hides what it says, and shares nothing with the package."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aacmm_pin.effects as library
import blind
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.conditions import Conditions as PackageConditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from blind import Hidden, draw, workshop
from blind.conditions import Conditions
from blind.kinematics import Arm as BlindArm
from blind.kinematics import placements, read_arm
from blind.machine import Machine
from blind.oracle import Oracle
from blind.plans import PLANS
from blind.plant import ENCODER_NOISE, REFERENCE_NOISE
from blind.regimes import regime_file
from blind.statics import Elastic, settle, share_of_tube

ARM = read_arm()
FELT = {
    # cause: micrometres at the tip that a fault of size 1 stays between
    "encoder_eccentricity": (5, 300),
    "encoder_ellipticity": (5, 300),
    "joint_periodic_error": (3, 200),
    "joint_error_curve": (3, 200),
    "encoder_gain": (5, 400),
    "encoder_slip": (4, 300),
    "joint_hysteresis": (5, 300),
    "zero_drift": (4, 300),
    "joint_compliance": (5, 300),
    "bearing_tilt": (5, 400),
    "link_bending": (4, 300),
    "torsional_windup": (3, 100),
    "counterbalance": (20, 200),
    "base_compliance": (20, 300),
    "thermal_expansion": (5, 60),
    "stylus_bending": (4, 40),
    "stylus_offset": (90, 310),
    "joint_zero_offset": (8, 300),
    "link_length": (49, 151),
    "joint_distance": (49, 151),
    "link_twist": (5, 300),
    "seat_error": (20, 120),
    "unexplained:joint_product": (5, 250),
    "unexplained:humidity": (10, 300),
    "unexplained:operator": (40, 200),
    "unexplained:frame_walk": (50, 300),
    "unexplained:tip_field": (3, 200),
}


def conditions(n: int) -> Conditions:
    """Some conditions that leave a sound arm as it is."""
    nothing = np.zeros(n)
    none = np.zeros(n, dtype=int)
    return Conditions(nothing, nothing + 20.0, nothing + 20.0, np.ones((n, ARM.rows)), none - 1, none, none, nothing)


def postures(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.uniform(ARM.limits[:, 0], ARM.limits[:, 1], (n, ARM.rows))


# --- the physics


def cantilever(com: float, beyond: float) -> BlindArm:
    """A tube of 0.8 m along z, 1.3 kg, laid level by the mount, and a weight beyond at its end."""
    return BlindArm(
        values=np.array([[0.0, 0.8, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]),
        half_width=np.zeros((2, 4)),
        moving=np.array([True, True]),
        limits=np.array([[-3.0, 3.0]] * 2),
        mass=np.array([1.3, beyond]),
        com=np.array([[0.0, 0.0, com - 0.8], [0.0, 0.0, 0.0]]),
        gravity=np.array([9.81, 0.0, 0.0]),
        reference_temperature=20.0,
        stylus=np.array([1.0, 0.0, 0.0]),
    )


@pytest.mark.parametrize(("com", "beyond"), [(0.4, 0.0), (0.4, 2.0), (0.8, 0.0), (0.55, 1.0)])
def test_a_tube_bends_as_the_textbook_says(com: float, beyond: float) -> None:
    arm, flexibility, length = cantilever(com, beyond), 1e-7, 0.8
    elastic = replace(Elastic.rigid(2), bend=np.array([flexibility, 0.0]))
    frames = settle(arm, arm.values[None], np.zeros((1, 2)), elastic).frames
    share, _ = share_of_tube(arm, 0)
    spread, point = share * 1.3 * 9.81, ((1.0 - share) * 1.3 + beyond) * 9.81
    sag = flexibility * (point * length**3 / 3.0 + spread * length**3 / 8.0)
    slope = flexibility * (point * length**2 / 2.0 + spread * length**2 / 6.0)
    assert frames[0, -1, 0, 3] == pytest.approx(sag, rel=1e-6)
    assert frames[0, -1, 0, 2] == pytest.approx(slope, rel=1e-6)


def test_tube_and_lump_have_the_stated_centre_of_mass() -> None:
    for row in ARM.tubes():
        share, lump = share_of_tube(ARM, row - 1)
        a, d, alpha, _ = ARM.values[row - 1]
        middle = np.array([-a, 0.0, 0.0]) - 0.5 * d * np.array([0.0, np.sin(alpha), np.cos(alpha)])
        assert 0.5 < share < 1.0
        np.testing.assert_allclose(share * middle + (1.0 - share) * lump, ARM.com[row - 1], atol=1e-15)


def test_joints_rest_where_the_energy_is_least(rng: np.random.Generator) -> None:
    """Energy of springs and heights, differentiated numerically: no moment is computed here."""
    soft = np.array([0.0, 3e-3, 4e-3, 5e-3, 0.0, 0.0])
    q = postures(rng, 20)
    rest = settle(ARM, np.repeat(ARM.values[None], 20, axis=0), q, replace(Elastic.rigid(6), joint=soft))
    turns = np.einsum("rni,nri->nr", rest.shape.joint, rest.frames[:, :-1, :3, 2])

    def energy(turns: np.ndarray) -> np.ndarray:
        frames = placements(ARM.values, q + turns)[:, 1:]
        places = frames[..., :3, 3] + np.einsum("nrij,rj->nri", frames[..., :3, :3], ARM.com)
        springs = 0.5 * (turns[:, [1, 2, 3]] ** 2 / soft[[1, 2, 3]]).sum(axis=1)
        return np.asarray(springs - np.einsum("r,nri,i->n", ARM.mass, places, ARM.gravity))

    assert np.abs(turns).max() > 1e-3
    for joint in (1, 2, 3):
        step = np.zeros(6)
        step[joint] = 1e-5
        torque = (energy(turns + step) - energy(turns - step)) / 2e-5
        np.testing.assert_allclose(torque, 0.0, atol=2e-8)


@pytest.mark.parametrize(
    "key", ["joint_compliance:2", "bearing_tilt:3", "link_bending:3", "base_compliance", "counterbalance:2"]
)
def test_equilibrium_is_that_of_the_deflected_arm(key: str, rng: np.random.Generator) -> None:
    """Ten times the fault moves the tip by more or less than ten times, by second order: the pose is the deflected one."""
    cause, _, joint = key.partition(":")
    q, c = postures(rng, 50), conditions(50)
    fault = workshop.hide(np.random.default_rng(1), ARM, cause, int(joint) if joint else None, 1.0, (0.0, 1.0))
    sound = Machine(ARM, ARM.values)
    scaled = {f: {name: f * value for name, value in fault.parameters.items()} for f in (1e-2, 10.0)}
    small, large = (sound.shift_by(replace(fault, parameters=parameters), q, c) for parameters in scaled.values())
    left = np.linalg.norm(large - 1e3 * small) / np.linalg.norm(large)
    assert 1e-5 < left < 2e-2
    assert sound.with_faults([fault]).rest(q, c).rounds < 20


def test_kinematics_are_those_of_the_package(sino6: Arm, rng: np.random.Generator) -> None:
    q = postures(rng, 50)
    np.testing.assert_allclose(placements(ARM.values, q)[:, -1, :3, 3], sino6.positions(q), atol=1e-13)
    step = 1e-6
    for joint, column in enumerate(np.eye(6) * step):
        ahead, behind = (placements(ARM.values, q + side * column)[:, -1, :3, 3] for side in (1, -1))
        np.testing.assert_allclose(ARM.jacobian(q)[:, :, joint], (ahead - behind) / (2 * step), atol=1e-8)


@pytest.mark.parametrize(("cause", "order"), [("encoder_eccentricity", 1), ("encoder_ellipticity", 2)])
def test_discs_err_once_and_twice_a_turn_with_the_phase_of_the_contract(cause: str, order: int) -> None:
    indication = np.linspace(0.0, 6.2, 400)
    for amplitude in (1e-3, 1e-2):
        fault = Hidden(cause, 1, {"amplitude_rad": amplitude, "phase_rad": 0.7})
        q = np.zeros((400, 6))
        q[:, 0] = indication
        error = Machine(ARM, ARM.values, (fault,)).joint_angles(q, conditions(400))[:, 0] - indication
        beside = error - amplitude * np.cos(order * indication - 0.7)
        assert np.abs(beside).max() < 2.0 * amplitude**2
        if cause == "encoder_ellipticity":  # first order is not all of it
            assert np.abs(beside).max() > 0.3 * amplitude**2


# --- beside the package


SHARED = [
    *((cause, joint, 3e-4) for cause in workshop.PER_JOINT if cause != "joint_error_curve" for joint in (2, 4)),
    ("base_compliance", None, 1e-6),
    ("thermal_expansion", None, 1e-6),
    ("thermal_expansion", 3, 1e-6),
    ("stylus_bending", None, 1e-6),
    ("stylus_offset", None, 1e-6),
    ("seat_error", None, 1e-6),
    *((cause, 3, 1e-6) for cause in workshop.GEOMETRY),
    ("counterbalance", 2, 0.05),  # a strut with an anchor, not a constant force
    ("link_bending", 3, 0.10),  # weight spread along the tube; a tube along the joint's axis, with the elbow beside it
    ("link_bending", 5, 0.12),
    ("torsional_windup", 5, 0.02),
]


def test_parameters_mean_what_they_mean_in_the_package(sino6: Arm) -> None:
    """Two derivations of each cause; ``apart`` is what they may differ by, relative to what the cause does."""
    runs = {plan: draw(11, plan=plan, records=100) for plan in ("free", "seats")}
    for cause, joint, apart in SHARED:
        drawn = runs["seats" if cause == "seat_error" else "free"]
        q, c = drawn.read, drawn.conditions
        fault = workshop.hide(np.random.default_rng(3), ARM, cause, joint, 1.0, (c.time[0], c.time[-1]))
        here = Machine(ARM, ARM.values).shift_by(fault, q, c)
        there = by_package(sino6, fault, q, c, c.approach)
        assert np.linalg.norm(here - there) < apart * np.linalg.norm(here), fault.key


def by_package(arm: Arm, fault: Hidden, q: np.ndarray, c: Conditions, approach: np.ndarray) -> np.ndarray:
    """What the package says that the fault does."""
    cause, parameters = library.CAUSES[fault.cause], dict(fault.parameters)
    structure = {name: parameters.pop(name) for name in cause.structure() if name in parameters}
    structure |= {name: fault.joint for name in ("joint", "link") if name in cause.structure() and fault.joint is not None}
    seat = np.array([f"P{s + 1}" for s in c.seat], dtype=object)
    known = PackageConditions(len(q), time=c.time, temperature=c.temperature, approach=approach, seat=seat)
    sound = ErrorModel(arm)
    faulty = sound.with_effects(cause.from_description(structure, parameters))
    return faulty.predict(q, known, as_referenced=True) - sound.predict(q, known, as_referenced=True)


def test_no_line_of_the_package_in_the_plant() -> None:
    for path in (p for p in Path(blind.__file__).parent.glob("*.py") if not p.name.startswith("test_")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not any(name.split(".")[0] in ("aacmm_pin", "pinocchio", "plant") for name in names), path.name


# --- the files


@pytest.mark.parametrize("plan", PLANS)
def test_files_are_of_the_contract(plan: str, tmp_path: Path) -> None:
    drawn = draw(3, "any", plan=plan, records=120, outliers=0.1)
    read = Measurements.read(drawn.write(tmp_path / "data.csv"), nq=6)
    assert read.n == 120
    assert list(read.extra.columns) == ["humidity_pct"]
    assert read.known.all() == (plan != "unknown-seats")
    assert len(read.seats()) == (0 if plan == "free" else 10)
    assert len(read.bars()) == (5 if plan == "unknown-seats" else 0)
    np.testing.assert_allclose(read.q, drawn.read, atol=1e-9)
    np.testing.assert_allclose(read.conditions.temperature, 20.0, atol=4.0)
    assert len(set(read.conditions.session)) == 3


def test_a_seed_says_everything() -> None:
    once, again, other = (draw(seed, "any", records=50).csv_text for seed in (5, 5, 6))
    assert once == again != other


@pytest.mark.parametrize("plan", PLANS)
@pytest.mark.parametrize("cause", ["encoder_eccentricity", "link_bending", "encoder_slip", "unexplained:frame_walk"])
def test_nothing_hidden_is_the_twin(plan: str, cause: str) -> None:
    faulty, twin = draw(8, cause, plan=plan, records=60), draw(8, cause, plan=plan, records=60, twin=True)
    assert draw(8, cause, plan=plan, records=60, size=0.0).csv_text == twin.csv_text != faulty.csv_text
    assert twin.truth.cause is None
    assert faulty.truth.cause == cause.partition(":")[0]
    np.testing.assert_array_equal(faulty.truth.geometry, twin.truth.geometry)
    np.testing.assert_allclose(faulty.read, twin.read, atol=3e-3)


def test_faults_have_the_size_of_workshops() -> None:
    for cause, (low, high) in FELT.items():
        plan = "seats" if cause == "seat_error" else "free"
        for seed in range(3):
            fault = draw(seed, cause, plan=plan, records=60).truth.hidden[0]
            assert low < fault.size_um < high, (fault.key, fault.size_um)
        tenth = draw(2, cause, plan=plan, records=60, size=0.1).truth.hidden[0]
        assert tenth.size_um == pytest.approx(0.1 * fault.size_um, rel=0.02)
        assert tenth.joint == fault.joint


@pytest.mark.parametrize("plan", ["free", "seats"])
def test_what_remains_is_the_stated_noise_and_little_more(plan: str) -> None:
    drawn = draw(4, "bearing_tilt", 3, plan=plan, records=300, outliers=0.1)
    machine, bad = drawn.machine, list(drawn.truth.outliers)
    expected = np.sqrt(3.0 * REFERENCE_NOISE**2 + ENCODER_NOISE**2 * (machine.jacobian(drawn.read) ** 2).sum() / 300)
    assert drawn.oracle_rms == pytest.approx(expected, rel=0.1)
    without = replace(machine, small=None).observed(drawn.read, drawn.conditions)
    gap = machine.observed(drawn.read, drawn.conditions) - without
    assert 0.7e-6 < np.sqrt((gap**2).sum(axis=1).mean()) < 2.5e-6
    distance = np.linalg.norm(drawn.reference - drawn.touched, axis=1)
    assert len(bad) == 30
    assert 0.1e-3 < distance[bad].min() < distance[bad].max() < 60e-3
    assert np.delete(distance, bad).max() < 0.12e-3


@pytest.mark.parametrize("plan", PLANS)
def test_fresh_data_come_from_the_same_arm(plan: str, tmp_path: Path) -> None:
    drawn = draw(2, "encoder_slip", 2, plan=plan, records=100)
    fresh, other = drawn.fresh(200), drawn.fresh(200, index=2)
    assert Measurements.read(fresh.write(tmp_path / "fresh.csv"), nq=6).n == 200
    assert fresh.oracle_rms == pytest.approx(drawn.oracle_rms, rel=0.2)
    assert not np.array_equal(fresh.read, other.read)
    slip = drawn.truth.parameters["time_s"]
    assert all(0.1 < np.mean(run.conditions.time < slip) < 0.9 for run in (drawn, fresh))
    if plan != "free":
        assert set(map(tuple, fresh.noted)) == set(map(tuple, drawn.noted))


def test_two_faults_at_once() -> None:
    for seed in range(3):
        first, second = draw(seed, "any", count=2, records=60).truth.hidden
        assert first.cause != second.cause
        assert first.joint is None or first.joint != second.joint
        assert first.size_um >= second.size_um > 0.0


def test_what_cannot_be_drawn_is_said() -> None:
    with pytest.raises(ValueError, match="expected one of"):
        draw(1, "gremlins")
    with pytest.raises(ValueError, match="expected one of free, seats"):
        draw(1, plan="outdoors")


def test_shifts_and_frames_go_into_the_file() -> None:
    plain, shifted = draw(1, records=50), draw(1, records=50, shifts={(4, "theta_offset"): 9.0})
    change = shifted.truth.geometry - plain.truth.geometry
    assert change[3, 3] == pytest.approx(9.0 * 8.74044e-6 / np.sqrt(3.0))
    assert np.count_nonzero(change) == 1
    away = draw(1, records=50, external=True)
    np.testing.assert_array_equal(away.read, plain.read)
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(away.noted, axis=0), axis=1), np.linalg.norm(np.diff(plain.noted, axis=0), axis=1)
    )
    assert np.abs(away.noted - plain.noted).max() > 0.1


# --- the oracle


@pytest.mark.parametrize("plan", PLANS)
def test_the_oracle_names_the_fault_and_is_silent_without(plan: str) -> None:
    drawn, twin = (draw(21, "encoder_eccentricity", 2, plan=plan, records=60, twin=twin) for twin in (False, True))
    oracle, sound = Oracle(drawn), Oracle(twin)
    assert oracle.visible(drawn.truth.hidden[0]) > 30.0
    assert next(iter(oracle.probabilities())) == "encoder_eccentricity:2"
    assert next(iter(sound.probabilities())) == "none"
    freedom = 3 * 60 + sound.extra - sound.basis.shape[1]
    assert float(sound.residual() @ sound.residual()) == pytest.approx(freedom, rel=0.3)


def test_the_oracle_knows_what_nobody_can_tell_apart() -> None:
    file = regime_file(2, arm="sino6", evidence="free", records=100, external=False, cause="base_compliance", faults=1)
    for oracle in (Oracle(file), Oracle(draw(2, "base_compliance", records=100))):
        fault = oracle.file.hidden[0]
        assert oracle.cosine(fault, {"cause": "bearing_tilt", "joint": 1}) > 0.95
        assert oracle.cosine(fault, {"cause": "base_compliance", "joint": None}) > 0.999
        assert oracle.cosine(fault, {"cause": "encoder_gain", "joint": 4}) < 0.5
        assert oracle.cosine(fault, {"cause": "gremlins", "joint": 4}) == 0.0
        assert oracle.visible(Hidden("encoder_gain", 4, {"gain": 0.0})) == pytest.approx(0.0)
