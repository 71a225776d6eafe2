"""Blind files of many arms: their kinematics and causes are those of the package, and the package reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import aacmm_pin.effects as library
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.conditions import Conditions as PackageConditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from blind import chains, workshop
from blind.chains import Chain
from blind.conditions import run
from blind.likeness import Likeness
from blind.regimes import ARMS, EVIDENCE, SIZES, draw_regime, regime_file
from blind.rig import Loaded, Rig, strength
from blind.study.regimes import count, outcome
from blind.truth import Hidden


@pytest.fixture(params=ARMS)
def both(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Chain, Arm]:
    """The chain of the plant and the arm of the package."""
    name = request.param
    if name == "sino6":
        return chains.sino6(), Arm.load(name)
    if name in chains.SEVEN:
        (tmp_path / "arm.toml").write_text(chains.seven_text(name, stated=True, masses=True), encoding="utf-8")
        return chains.seven(name, stated=True), Arm.load(str(tmp_path / "arm.toml"))
    return chains.robot(name, 0.0, 0.0), Arm.from_urdf(str(chains.robot_file(name)), chains.ROBOTS[name][1])


def test_chains_are_those_of_the_package(both: tuple[Chain, Arm], rng: np.random.Generator) -> None:
    chain, arm = both
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (20, len(chain.limits)))
    np.testing.assert_allclose(chain.walk(q)[1][:, :3, 3], arm.positions(q), atol=1e-13)
    step = 1e-6
    for joint, column in enumerate(np.eye(len(chain.limits)) * step):
        ahead, behind = (chain.walk(q + side * column)[1][:, :3, 3] for side in (1, -1))
        np.testing.assert_allclose(chain.jacobian(q)[:, :, joint], (ahead - behind) / (2 * step), atol=1e-8)


SHARED = [
    *((cause, 2, 3e-4) for cause in workshop.PER_JOINT if cause not in ("joint_error_curve", "encoder_slip")),
    ("base_compliance", None, 1e-6),
    ("thermal_expansion", None, 1e-6),
    ("counterbalance", 2, 0.05),  # a strut with an anchor, not a constant force
    ("link_bending", 0, 1e-4),  # sections where the straight tube has them; 0 stands for the first tube
    ("torsional_windup", 0, 1e-4),
]


@pytest.mark.parametrize(("cause", "joint", "apart"), SHARED)
def test_causes_mean_what_they_mean_in_the_package(
    both: tuple[Chain, Arm], rng: np.random.Generator, cause: str, joint: int | None, apart: float
) -> None:
    chain, arm = both
    if joint == 0 and not chain.tubes():
        pytest.skip("no body of this arm is a tube")
    row, n = chain.tubes()[0] if joint == 0 else joint, 30
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (n, len(chain.limits)))
    weather = run(rng, chain, np.full(n, -1), np.arange(n) * 3 // n, 1.0, False)
    c = Loaded(**vars(weather), payload=np.zeros(n), marker=np.zeros(n))
    fault = workshop.hide(rng, chain, cause, row, 0.1, (float(c.time[0]), float(c.time[-1])))
    sound = Rig(chain, chain.exact)
    here = sound.with_faults([fault]).observed(q, c) - sound.observed(q, c)
    parameters, kind = dict(fault.parameters), library.CAUSES[cause]
    structure = {name: parameters.pop(name) for name in kind.structure() if name in parameters}
    structure |= {name: row for name in ("joint", "link") if name in kind.structure() and row is not None}
    faulty = ErrorModel(arm).with_effects(kind.from_description(structure, parameters))
    known = PackageConditions(n, time=c.time, temperature=c.temperature, approach=c.approach[:, chain.moving])
    there = faulty.predict(q, known, as_referenced=True) - ErrorModel(arm).predict(q, known, as_referenced=True)
    assert np.linalg.norm(here - there) < apart * np.linalg.norm(here)


def test_drives_hold_the_payload(rng: np.random.Generator) -> None:
    """Torques are those of the package's masses, and of a weight at the tip by virtual work."""
    chain = chains.robot("panda", 0.0, 0.0)
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (10, 7))
    weather = run(rng, chain, np.full(10, -1), np.arange(10) * 3 // 10, 1.0, False)
    empty = Loaded(**vars(weather), payload=np.zeros(10), marker=np.zeros(10))
    loaded = Loaded(**vars(weather), payload=np.full(10, 2.0), marker=np.zeros(10))
    rig = Rig(chain, chain.exact)
    work = -2.0 * np.einsum("nkj,k->nj", chain.jacobian(q), chain.gravity)
    np.testing.assert_allclose(rig.torque(q, loaded) - rig.torque(q, empty), work, atol=1e-9)


@pytest.mark.parametrize("evidence", EVIDENCE)
@pytest.mark.parametrize("arm", ARMS)
def test_the_package_reads_the_files(arm: str, evidence: str, tmp_path: Path) -> None:
    file = regime_file(3, arm=arm, evidence=evidence, records=24, faults=1, torque=arm != "sino6", environment=True)
    file.write(tmp_path)
    read = Measurements.read(tmp_path / "data.csv", nq=len(file.rig.arm.limits))
    np.testing.assert_allclose(read.q, file.q, atol=1e-9)
    assert read.n == 24
    assert not len(read.extra.columns)
    assert len(read.seats()) == len(file.seats)
    assert len(read.bars()) == (len(file.seats) // 2 if evidence == "bars" else 0)
    assert (read.conditions.torque is not None) == file.regime.torque


def test_a_seed_says_everything() -> None:
    assert regime_file(5, most_records=60).files == regime_file(5, most_records=60).files
    assert regime_file(5, most_records=60).files != regime_file(6, most_records=60).files
    regimes = [draw_regime(seed) for seed in range(300)]
    assert {r.arm for r in regimes} == set(ARMS)
    assert {r.evidence for r in regimes} == set(EVIDENCE)
    assert {r.faults for r in regimes} == {0, 1, 2}
    assert all(any(low <= r.records <= high for r in regimes) for low, high in SIZES)


def test_what_was_asked_for_is_hidden() -> None:
    asked = {"arm": "standard-dh", "evidence": "seats", "seats": 3, "records": 15, "cause": "encoder_eccentricity"}
    file = regime_file(1, joint=4, value=1.1e-4, faults=1, **asked)
    assert [(h.key, h.parameters["amplitude_rad"]) for h in file.hidden] == [("encoder_eccentricity:4", 1.1e-4)]
    assert file.hidden[0].size_um == pytest.approx(1e6 * strength(file.rig, file.hidden[0], file.q, file.conditions))


def test_likeness_knows_what_nobody_can_tell_apart() -> None:
    file = regime_file(2, arm="sino6", evidence="free", records=100, external=False, cause="base_compliance", faults=1)
    likeness = Likeness(file)
    assert likeness.cosine(file.hidden[0], {"cause": "bearing_tilt", "joint": 1}) > 0.95
    assert likeness.cosine(file.hidden[0], {"cause": "base_compliance", "joint": None}) > 0.999
    assert likeness.cosine(file.hidden[0], {"cause": "encoder_gain", "joint": 4}) < 0.5
    assert likeness.cosine(file.hidden[0], {"cause": "gremlins", "joint": 4}) == 0.0
    assert likeness.visible(Hidden("encoder_gain", 4, {"gain": 0.0})) == pytest.approx(0.0)


def test_wrong_names_are_counted_where_the_verdict_is_sure() -> None:
    def row(verdict: str, *names: str, hidden: str = "encoder_gain:3", alike: tuple[str, ...] = ()) -> dict[str, object]:
        findings = [{"cause": n.split(":")[0], "joint": int(n.split(":")[1]), "probability": 0.9} for n in names]
        faults = [{"key": hidden, "aliases": dict.fromkeys(alike, 0.99)}] if hidden else []
        made = {"experiment": "regimes", "kind": "regime", "seed": 1, "error": None, "seconds": 1.0}
        made |= {"regime": {"arm": "sino6", "evidence": "free", "records": 50}}
        return made | {"said": {"verdict": verdict, "findings": findings}, "truth": {"hidden": faults, "outliers": []}}

    wrong = row("explained", "encoder_slip:3")
    assert outcome(wrong)["wrong"]
    assert not outcome(row("ambiguous", "encoder_slip:3"))["wrong"]
    assert not outcome(row("inconclusive", "encoder_slip:3"))["wrong"]
    assert not outcome(row("explained", "encoder_slip:3", alike=("encoder_slip:3",)))["wrong"]
    assert outcome(row("explained", "joint_error_curve:3", alike=("joint_error_curve:3",)))["wrong"]
    assert outcome(row("explained", "encoder_gain:3", "encoder_slip:1"))["wrong"]
    nothing = row("explained", "encoder_slip:1", hidden="")
    assert outcome(nothing)["named"]
    figures, _ = count([wrong, row("explained", "encoder_gain:3"), nothing, row("inconclusive", hidden="")])
    assert [f["records"] for f in figures] == ["20 to 60", "all"]
    assert figures[0]["sure_and_wrong"]["k"] == 2
    assert figures[0]["sure_and_wrong"]["n"] == 3
    assert figures[0]["mean_stated_minus_true"] == pytest.approx(0.9 - 1 / 3)
