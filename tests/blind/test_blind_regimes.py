"""Blind files of many arms: their kinematics and causes are those of the package, and the package reads them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin.arm.arm import Arm
from aacmm_pin.measurements.records import Measurements
from blind import chains, workshop
from blind.chains import Chain
from blind.conditions import run
from blind.regimes import ARMS, EVIDENCE, SIZES, draw_regime, regime_file
from blind.rig import Loaded, Rig
from blind.test_blind_plant import by_package


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


def test_causes_mean_what_they_mean_in_the_package(both: tuple[Chain, Arm], rng: np.random.Generator) -> None:
    chain, arm = both
    q, c = somewhere(rng, chain, 30)
    for cause, joint, apart in SHARED:
        if joint != 0 or chain.tubes():
            row = chain.tubes()[0] if joint == 0 else joint
            fault = workshop.hide(rng, chain, cause, row, 0.1, (float(c.time[0]), float(c.time[-1])))
            here = Rig(chain, chain.exact).shift_by(fault, q, c)
            there = by_package(arm, fault, q, c, c.approach[:, chain.moving])
            assert np.linalg.norm(here - there) < apart * np.linalg.norm(here), fault.key


def somewhere(rng: np.random.Generator, chain: Chain, n: int) -> tuple[np.ndarray, Loaded]:
    """Random postures, and conditions without a payload."""
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (n, len(chain.limits)))
    weather = run(rng, chain, np.full(n, -1), np.arange(n) * 3 // n, 1.0, False)
    return q, Loaded(**vars(weather), payload=np.zeros(n), marker=np.zeros(n))


def test_drives_hold_the_payload(rng: np.random.Generator) -> None:
    """By virtual work of a weight at the tip."""
    chain = chains.robot("panda", 0.0, 0.0)
    q, empty = somewhere(rng, chain, 10)
    loaded, rig = replace(empty, payload=np.full(10, 2.0)), Rig(chain, chain.exact)
    work = -2.0 * np.einsum("nkj,k->nj", chain.jacobian(q), chain.gravity)
    np.testing.assert_allclose(rig.torque(q, loaded) - rig.torque(q, empty), work, atol=1e-9)


@pytest.mark.parametrize("arm", ARMS)
def test_the_package_reads_the_files(arm: str, tmp_path: Path) -> None:
    for evidence in EVIDENCE:
        file = regime_file(3, arm=arm, evidence=evidence, records=24, faults=1, torque=arm != "sino6", environment=True)
        file.write(tmp_path)
        read = Measurements.read(tmp_path / "data.csv", nq=len(file.machine.arm.limits))
        np.testing.assert_allclose(read.q, file.read, atol=1e-9)
        assert read.n == 24
        assert not len(read.extra.columns)
        assert len(read.seats()) == len(file.seats)
        assert len(read.bars()) == len(file.bars) == (len(file.seats) // 2 if evidence == "bars" else 0)
        assert (read.conditions.torque is not None) == file.regime.torque


def test_a_seed_says_everything() -> None:
    once, again, other = (regime_file(seed, most_records=60).files for seed in (5, 5, 6))
    assert once == again != other
    regimes = [draw_regime(seed) for seed in range(300)]
    assert {r.arm for r in regimes} == set(ARMS)
    assert {r.evidence for r in regimes} == set(EVIDENCE)
    assert {r.faults for r in regimes} == {0, 1, 2}
    assert all(any(low <= r.records <= high for r in regimes) for low, high in SIZES)


def test_what_was_asked_for_is_hidden() -> None:
    asked = {"arm": "standard-dh", "evidence": "seats", "seats": 3, "records": 15, "cause": "encoder_eccentricity"}
    file = regime_file(1, joint=4, value=1.1e-4, faults=1, **asked)
    assert [(h.key, h.parameters["amplitude_rad"]) for h in file.hidden] == [("encoder_eccentricity:4", 1.1e-4)]
    assert file.hidden[0].size_um == pytest.approx(1e6 * file.machine.moves(file.hidden[0], file.read, file.conditions))
