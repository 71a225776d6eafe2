"""The plant of the blind tests: it obeys statics and contract, hides what it says, and shares
nothing with the package.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aacmm_pin.effects as library
import blind
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects import effect_from, fields_of
from aacmm_pin.effects.conditions import Conditions as PackageConditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from blind import Hidden, chains, draw, workshop
from blind.chains import Chain
from blind.conditions import Conditions, run
from blind.families import FAMILIES, family_file
from blind.kinematics import Array
from blind.machine import Machine
from blind.oracle import Oracle
from blind.plans import PLANS
from blind.plant import ENCODER_NOISE, REFERENCE_NOISE
from blind.regimes import ARMS, EVIDENCE, SIZES, RegimeFile, draw_regime, regime_file
from blind.statics import Elastic, settle
from blind.structures import AMPLITUDES
from tests.again import again
from tests.oracle import close

ARM = chains.read()
FELT_UM = (3, 410)
"""A fault of size 1 displaces the tip by so much."""
FELT = (
    *(cause for cause in workshop.CAUSES if cause != "unexplained"),
    *(f"unexplained:{kind}" for kind in workshop.DEPENDS_ON),
)


def postures(rng: np.random.Generator, n: int, chain: Chain = ARM) -> Array:
    return rng.uniform(*chain.limits.T, (n, len(chain.limits)))


def settled(chain: Chain, q: Array, **elastic: Array) -> tuple[Array, Array]:
    """The last frame and by how much joints have yielded, of an arm of the stated geometry."""
    n, flexible = len(q), replace(Elastic.rigid(chain.rows), **elastic)
    rest = settle(
        chain, chain.pieces(chain.exact), q, np.zeros((n, chain.rows)), flexible, np.zeros(n)
    )
    return rest.last, np.einsum("rni,nri->nr", rest.yielded, rest.axes[..., :3, 2])


# --- the physics


def test_a_tube_bends_as_the_textbook_says():
    """A tube of 0.8 m along z, 1.3 kg, laid level by the mount, and a weight beyond at its end."""
    for com, beyond in ((0.4, 0.0), (0.4, 2.0), (0.8, 0.0), (0.55, 1.0)):
        rows = [
            {"d_mm": 800.0, "mass_kg": 1.3, "com_mm": [0.0, 0.0, 1e3 * (com - 0.8)]},
            {"mass_kg": beyond},
        ]
        mount = {"name": "level", "convention": "standard-dh", "gravity_m_s2": [9.81, 0.0, 0.0]}
        arm, flexibility, length = chains.of_table(mount | {"joints": rows}), 1e-7, 0.8
        last, _ = settled(arm, np.zeros((1, 2)), bend=np.array([flexibility, 0.0]))
        share = 2.0 * (1.0 - com / length)
        spread, point = share * 1.3 * 9.81, ((1.0 - share) * 1.3 + beyond) * 9.81
        sag = flexibility * (point * length**3 / 3.0 + spread * length**3 / 8.0)
        slope = flexibility * (point * length**2 / 2.0 + spread * length**2 / 6.0)
        assert last[0, 0, 3] == pytest.approx(sag, rel=1e-6)
        assert last[0, 0, 2] == pytest.approx(slope, rel=1e-6)


def test_joints_rest_where_the_energy_is_least(rng):
    """Energy of springs and heights, differentiated numerically: no moment is computed here."""
    soft, q = np.array([0.0, 3e-3, 4e-3, 5e-3, 0.0, 0.0]), postures(rng, 20)
    _, turns = settled(ARM, q, joint=soft)

    def energy(turns: Array) -> Array:
        axes = ARM.walk(q + turns)[0]
        places = axes[..., :3, 3] + np.einsum("nrij,rj->nri", axes[..., :3, :3], ARM.com)
        springs = 0.5 * (turns[:, [1, 2, 3]] ** 2 / soft[[1, 2, 3]]).sum(axis=1)
        return np.asarray(springs - np.einsum("r,nri,i->n", ARM.mass, places, ARM.gravity))

    assert np.abs(turns).max() > 1e-3
    for joint in (1, 2, 3):
        step = np.zeros(6)
        step[joint] = 1e-5
        torque = (energy(turns + step) - energy(turns - step)) / 2e-5
        close(torque, 0.0, 2e-8)


def test_drives_hold_the_payload(rng):
    """By virtual work of a weight at the tip."""
    chain = chains.robot("panda", 0.0, 0.0)
    q, empty = postures(rng, 10, chain), Conditions.still(10, chain.rows)
    loaded, machine = replace(empty, payload=np.full(10, 2.0)), Machine(chain, chain.exact)
    work = -2.0 * np.einsum("nkj,k->nj", chain.jacobian(q), chain.gravity)
    close(machine.torque(q, loaded) - machine.torque(q, empty), work, 1e-9)


# --- beside the package


@pytest.fixture(params=["sino6", "modified-dh", "panda", again("standard-dh"), again("ur5")])
def both(request, tmp_path) -> tuple[Chain, Arm]:
    """The chain of the plant and the arm of the package."""
    name = request.param
    if name == "sino6":
        return ARM, Arm.load(name)
    if name in chains.SEVEN:
        (tmp_path / "arm.toml").write_text(
            chains.seven_text(name, stated=True, masses=True), encoding="utf-8"
        )
        return chains.seven(name, stated=True), Arm.load(str(tmp_path / "arm.toml"))
    return chains.robot(name, 0.0, 0.0), Arm.from_urdf(
        str(chains.robot_file(name)), chains.ROBOTS[name][1]
    )


def test_chains_are_those_of_the_package(both, rng):
    chain, arm = both
    q = postures(rng, 20, chain)
    close(chain.tips(q), arm.positions(q), 1e-13)
    step = 1e-6
    for joint, column in enumerate(np.eye(len(chain.limits)) * step):
        numeric = (chain.tips(q + column) - chain.tips(q - column)) / (2 * step)
        close(chain.jacobian(q)[:, :, joint], numeric, 1e-8)


SHARED = [
    *(
        (cause, j, 3e-4)
        for cause in workshop.PER_JOINT
        if cause != "joint_error_curve"
        for j in (2, 4)
    ),
    ("base_compliance", None, 1e-6),
    ("thermal_expansion", None, 1e-6),
    ("seat_error", None, 1e-6),
    ("stylus_offset", None, 1e-6),
    ("counterbalance", 2, 0.05),  # a strut with an anchor, not a constant force
    (
        "link_bending",
        0,
        1e-4,
    ),  # sections where the straight tube has them; 0 stands for the first tube
    ("torsional_windup", 0, 1e-4),
]
OF_TABLES = [
    ("stylus_bending", None, 1e-6),
    ("thermal_expansion", 3, 1e-6),
    *((c, 3, 1e-6) for c in workshop.GEOMETRY),
]


def test_parameters_mean_what_they_mean_in_the_package(both, rng):
    """Two derivations of each cause; ``apart`` is what they may differ by, relative to what the
    cause does.
    """
    chain, arm = both
    q, n = postures(rng, 30, chain), 30
    c = run(rng, chain, np.arange(n) % 10, np.arange(n) * 3 // n, 1.0, False)
    for cause, joint, apart in SHARED + (OF_TABLES if arm.dh is not None else []):
        if joint != 0 or chain.tubes():
            row = chain.tubes()[0] if joint == 0 else joint
            fault = workshop.hide(
                rng, chain, cause, row, 0.1, (float(c.time[0]), float(c.time[-1]))
            )
            here = Machine(chain, chain.exact).shift_by(fault, q, c)
            there = by_package(arm, fault, q, c, c.approach[:, chain.moving])
            assert np.linalg.norm(here - there) <= apart * np.linalg.norm(here), fault.key


def by_package(arm: Arm, fault: Hidden, q: Array, c: Conditions, approach: Array) -> Array:
    """What the package says that the fault does."""
    cause, parameters = library.CAUSES[fault.cause], dict(fault.parameters)
    structure = {name: parameters.pop(name) for name in fields_of(cause) if name in parameters}
    structure |= {
        name: fault.joint
        for name in ("joint", "link")
        if name in fields_of(cause) and fault.joint is not None
    }
    seat = np.array([f"P{s + 1}" for s in c.seat], dtype=object)
    known = PackageConditions(
        len(q), time=c.time, temperature=c.temperature, approach=approach, seat=seat
    )
    sound = ErrorModel(arm)
    faulty = sound.with_effects(effect_from(cause, structure, parameters))
    return faulty.predict(q, known, as_referenced=True) - sound.predict(
        q, known, as_referenced=True
    )


def test_no_line_of_the_package_in_the_plant():
    for path in (
        p for p in Path(blind.__file__).parent.glob("*.py") if not p.name.startswith("test_")
    ):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            assert not any(
                name.split(".")[0] in ("aacmm_pin", "pinocchio", "plant") for name in names
            ), path.name


# --- the files


def test_files_are_of_the_contract(tmp_path):
    for plan in PLANS:
        drawn = draw(3, "any", plan=plan, records=120, outliers=0.1)
        read = Measurements.read(drawn.write(tmp_path / "data.csv"), nq=6)
        assert read.n == 120
        assert list(read.extra.columns) == ["humidity_pct"]
        assert read.known.all() == (plan != "unknown-seats")
        assert len(read.seats()) == (0 if plan == "free" else 10)
        assert len(read.bars()) == (5 if plan == "unknown-seats" else 0)
        close(read.q, drawn.read, 1e-9)
        close(read.conditions.temperature, 20.0, 4.0)
        assert len(set(read.conditions.session)) == 3
    for arm, evidence in zip(ARMS, EVIDENCE, strict=True):
        given = {"records": 24, "faults": 1, "torque": arm != "sino6", "environment": True}
        file = regime_file(3, arm=arm, evidence=evidence, **given)
        file.write(tmp_path)
        read = Measurements.read(tmp_path / "data.csv", nq=len(file.machine.arm.limits))
        close(read.q, file.read, 1e-9)
        assert read.n == 24
        assert not len(read.extra.columns)
        assert len(read.seats()) == len(file.seats)
        bars = len(file.seats) // 2 if evidence == "bars" else 0
        assert len(read.bars()) == len(file.bars) == bars
        assert (read.conditions.torque is not None) == file.regime.torque


def test_a_seed_says_everything():
    made: list[Callable[[int], object]] = [
        lambda seed: draw(seed, "any", records=50).csv_text,
        lambda seed: regime_file(seed, most_records=40).files,
        *(
            lambda seed, family=family: family_file(family, seed, records=60).files
            for family in FAMILIES
            if family != "regimes"
        ),
    ]
    for make in made:
        assert make(5) == make(5) != make(6)
    regimes = [draw_regime(seed) for seed in range(300)]
    assert {r.arm for r in regimes} == set(ARMS)
    assert {r.evidence for r in regimes} == set(EVIDENCE)
    assert {r.faults for r in regimes} == {0, 1, 2}
    assert all(any(low <= r.records <= high for r in regimes) for low, high in SIZES)


def test_what_was_asked_for_is_hidden():
    asked = {
        "arm": "standard-dh",
        "evidence": "seats",
        "seats": 3,
        "records": 15,
        "cause": "encoder_eccentricity",
    }
    file = regime_file(1, joint=4, value=1.1e-4, faults=1, **asked)
    assert [(h.key, h.parameters["amplitude_rad"]) for h in file.hidden] == [
        ("encoder_eccentricity:4", 1.1e-4)
    ]
    assert file.hidden[0].size_um == pytest.approx(
        1e6 * file.machine.moves(file.hidden[0], file.read, file.conditions)
    )
    for seed in range(3):
        first, second = draw(seed, "any", count=2, records=60).hidden
        assert first.cause != second.cause
        assert first.joint is None or first.joint != second.joint
        assert first.size_um >= second.size_um > 0.0
    with pytest.raises(ValueError, match="expected one of"):
        draw(1, "gremlins")
    with pytest.raises(ValueError, match="expected one of free, seats"):
        draw(1, plan="outdoors")


@pytest.mark.parametrize("seed", [2, *(again(k) for k in (0, 1))])
def test_faults_have_the_size_of_workshops(seed):
    low, high = FELT_UM
    for cause in FELT:
        plan = "seats" if cause == "seat_error" else "free"
        fault = draw(seed, cause, plan=plan, records=60).hidden[0]
        assert low < fault.size_um < high, (fault.key, fault.size_um)
        tenth = draw(seed, cause, plan=plan, records=60, size=0.1).hidden[0]
        assert tenth.size_um == pytest.approx(0.1 * fault.size_um, rel=0.02)
        assert tenth.joint == fault.joint


@pytest.mark.parametrize("plan", ["free", "seats"])
def test_what_remains_is_the_stated_noise_and_little_more(plan):
    drawn = draw(4, "bearing_tilt", 3, plan=plan, records=300, outliers=0.1)
    machine, bad = drawn.plant.machine, list(drawn.outliers)
    expected = np.sqrt(
        3.0 * REFERENCE_NOISE**2
        + ENCODER_NOISE**2 * (machine.jacobian(drawn.read) ** 2).sum() / 300
    )
    assert drawn.oracle_rms == pytest.approx(expected, rel=0.1)
    without = replace(machine, small=None).observed(drawn.read, drawn.conditions)
    gap = machine.observed(drawn.read, drawn.conditions) - without
    assert 0.7e-6 < np.sqrt((gap**2).sum(axis=1).mean()) < 2.5e-6
    distance = np.linalg.norm(drawn.reference - drawn.touched, axis=1)
    assert len(bad) == 30
    assert 0.1e-3 < distance[bad].min() < distance[bad].max() < 60e-3
    assert np.delete(distance, bad).max() < 0.12e-3


@pytest.mark.parametrize("plan", PLANS)
def test_fresh_data_come_from_the_same_arm(plan, tmp_path):
    drawn = draw(2, "encoder_slip", 2, plan=plan, records=100)
    fresh = drawn.plant.sample(1, 200)
    assert Measurements.read(fresh.write(tmp_path / "fresh.csv"), nq=6).n == 200
    assert fresh.oracle_rms == pytest.approx(drawn.oracle_rms, rel=0.2)
    slip = drawn.hidden[0].parameters["time_s"]
    assert all(0.1 < np.mean(run.conditions.time < slip) < 0.9 for run in (drawn, fresh))
    if plan != "free":
        assert set(map(tuple, fresh.noted)) == set(map(tuple, drawn.noted))


def test_the_oracle_knows_what_nobody_can_tell_apart():
    file = regime_file(
        2,
        arm="sino6",
        evidence="free",
        records=100,
        external=False,
        cause="base_compliance",
        faults=1,
    )
    oracle, (fault,) = Oracle(file), file.hidden
    assert oracle.visible(fault) > 30.0
    assert oracle.cosine(fault, {"cause": "bearing_tilt", "joint": 1}) > 0.95
    assert oracle.cosine(fault, {"cause": "base_compliance", "joint": None}) > 0.999
    assert oracle.cosine(fault, {"cause": "encoder_gain", "joint": 4}) < 0.5
    assert oracle.cosine(fault, {"cause": "gremlins", "joint": 4}) == 0.0
    assert oracle.visible(Hidden("encoder_gain", 4, {"gain": 0.0})) == pytest.approx(0.0)


# --- structure outside the library


@pytest.mark.parametrize("kind", AMPLITUDES)
def test_structure_has_the_size_that_was_asked_for(kind):
    for size in (0.5, 2.0):
        file = family_file("outside", 7, structure=kind, structure_size=size, records=120)
        assert file.structure is not None
        assert file.structure.size_um == pytest.approx(1e6 * size * file.noise_rms, rel=0.03)
        assert [h.cause for h in file.hidden] == [
            h.cause for h in file.machine.faults if h is not file.structure
        ]


def test_structure_of_joints_depends_on_what_names_it(rng):
    """Other joints move, and nothing changes; nor does it without weights, or by the other
    direction of approach.
    """
    for kind in ("joint_product", "other_joint", "loaded_gear", "branch"):
        file = family_file("outside", 7, structure=kind, records=120, arm="ur5", evidence="free")
        assert file.structure is not None
        alone = replace(file.machine, faults=(file.structure,), small=None)
        joint = file.structure.parameters["joints"][0] - 1
        named = [int(name.removeprefix("joint ")) - 1 for name in file.structure.depends_on]
        q, c = file.read, file.conditions

        def term(q: Array, c: Conditions, machine: Machine = alone) -> Array:
            return machine.joint_angles(q, c) - machine.with_faults([]).joint_angles(q, c)

        assert np.flatnonzero(np.abs(term(q, c)).max(axis=0)).tolist() == [joint]
        elsewhere = postures(rng, len(q), alone.arm)
        elsewhere[:, named] = q[:, named]
        if kind != "loaded_gear":
            close(term(elsewhere, c), term(q, c), 1e-15)
        weightless = replace(alone, arm=replace(alone.arm, gravity=np.zeros(3)))
        assert np.allclose(term(q, c, weightless), term(q, c), atol=1e-9) == (kind != "loaded_gear")
        back = term(q, replace(c, approach=-c.approach))
        close(back, term(q, c) * (-1.0 if kind == "branch" else 1.0), 1e-15)


def test_structure_at_the_tip_is_where_and_when_it_says():
    def of(kind: str, **changed: Array) -> tuple[Array, RegimeFile]:
        """How far the tip is shifted (n,) [m], in changed conditions."""
        file = family_file("outside", 7, structure=kind, arm="sino6", evidence="free")
        assert file.structure is not None
        alone = replace(file.machine, faults=(), small=None)
        moved = alone.shift_by(file.structure, file.read, replace(file.conditions, **changed))
        return np.linalg.norm(moved, axis=1), file

    field, file = of("tip_field")
    assert file.structure is not None
    away = np.linalg.norm(
        file.machine.arm.tips(file.read) - file.structure.parameters["centre_m"], axis=1
    )
    assert (np.diff(field[np.argsort(away)]) < 1e-7).all()
    shifted, file = of("operator")
    assert np.ptp(shifted[file.conditions.operator == 1]) < 1e-12
    assert shifted[file.conditions.operator == 0].max() == 0.0
    for kind in ("column", "humidity"):
        plain, file = of(kind)
        away_from_48 = file.conditions.humidity - 48.0
        np.testing.assert_allclose(
            of(kind, humidity=48.0 + 2.0 * away_from_48)[0], 2.0 * plain, rtol=1e-3
        )


def test_held_postures_share_readings_and_one_error():
    for seed in range(4):
        file = family_file("held-postures", seed)
        held, posture = file.regime.held, file.conditions.posture
        assert set(np.bincount(posture)) == {held}
        assert (np.diff(posture) >= 0).all() == (not file.regime.scattered)
        order = np.argsort(posture, kind="stable")
        apart = np.ptp(file.read[order].reshape(-1, held, file.read.shape[1]), axis=1)
        reading = 0.0 if file.regime.commanded else file.encoder_u
        assert apart.max() < 1e-14 + 10.0 * np.hypot(reading, file.regime.wobble)
        assert file.structure is not None
        error = file.machine.shift_by(file.structure, file.read, file.conditions)[order].reshape(
            -1, held, 3
        )
        close(error, error[:, :1].repeat(held, axis=1), 1e-12)
        assert error[:, 0].std() == pytest.approx(file.posture_u, rel=0.1)


def test_an_error_common_to_a_posture_hides_more_than_noise_does():
    """Held postures count once: what the oracle sees of a constant cause of one joint falls as the
    error grows.
    """
    seen = [
        Oracle(file).visible(file.hidden[0])
        for size in (0.01, 2.0)
        for file in [
            family_file(
                "held-postures", 1, structure_size=size, held=4, records=200, arm="sino6", size=1.0
            )
        ]
    ]
    assert seen[1] < 0.2 * seen[0]


def test_values_of_others_that_are_fitted_take_from_a_cause():
    file = family_file("imitated", 4, arm="sino6", records=100)
    stand = next(h for h in file.hidden if h.cause == "base_compliance")
    others = [h for h in file.hidden if h is not stand]
    oracle = Oracle(file)
    assert oracle.visible(stand, others) < 0.1 * oracle.visible(stand)
    assert oracle.power(stand) > 0.99 > oracle.power(stand, others)
