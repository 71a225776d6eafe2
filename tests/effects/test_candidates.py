"""Where a cause could sit, with these records: places and nonlinear parameters that each cause
offers to the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.effects import (
    Effect,
    EncoderEccentricity,
    EncoderSlip,
    JointCompliance,
    JointErrorCurve,
    JointHysteresis,
    JointPeriodicError,
    SeatError,
    SeatShift,
    ThermalExpansion,
    ZeroDrift,
    load_variants,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.encoder import LEAST_SPREAD, ORDERS_NEAR, PER_COEFFICIENT
from aacmm_pin.effects.time_dependent import GAPS_NEAR
from tests.arm_files import by_table, changed
from tests.oracle import close

pytestmark = pytest.mark.fast

N = 200


@dataclass
class Taken:
    """Records as a cause sees them."""

    q: Array
    conditions: Conditions
    known: NDArray[np.bool_]


def taken(rng: np.random.Generator, **known: object) -> Taken:
    """Joint 4 hardly turns, joint 5 by a third of a turn, the others all round."""
    q = rng.uniform(-np.pi, np.pi, (N, 6))
    q[:, 3] = np.linspace(0.0, 0.9 * LEAST_SPREAD, N)
    q[:, 4] = np.linspace(0.0, 2 * np.pi / 3 + 1e-9, N)
    return Taken(q, Conditions(N, **known), np.ones(N, dtype=bool))  # type: ignore[arg-type]


def places(cause: type[Effect], arm: Arm, records: Taken | None) -> list[object]:
    return [variants[0].place for variants in cause.candidates(arm, records)]


def test_places(sino6, zero6, robot_file, rng):
    bare = taken(rng)
    every, without = list(range(1, 7)), [1, 2, 3, 5, 6]
    approach = np.zeros((N, 6))
    approach[::2, [1, 4]] = 1.0
    approach[:, 2] = -1.0
    seat, two = (np.array([f"s{k % n}" for k in range(N)], dtype=object) for n in (6, 2))
    some: list[tuple[type[Effect], Taken | None, list[object]]] = [
        (EncoderEccentricity, bare, without),
        (JointErrorCurve, bare, without),
        (JointErrorCurve, None, []),
        (JointHysteresis, bare, []),
        (JointHysteresis, taken(rng, approach=approach), [2, 5]),
        (EncoderSlip, bare, []),
        (EncoderSlip, taken(rng, time=np.full(N, 7.0)), []),
        (EncoderSlip, taken(rng, time=np.arange(N) * 1.0), every),
        (ThermalExpansion, bare, []),
        (ThermalExpansion, taken(rng, temperature=np.full(N, 20.0)), [None, 3, 5, 6]),
        (SeatError, bare, []),
        (SeatError, taken(rng, seat=seat), [f"s{k}" for k in range(6)]),
        (SeatShift, taken(rng, seat=seat, time=np.arange(N) * 1.0), [f"s{k}" for k in range(6)]),
        (SeatShift, taken(rng, seat=two, time=np.arange(N) * 1.0), []),
    ]
    for cause, records, wanted in some:
        assert places(cause, sino6, records) == wanted, (cause.cause, records)
    unknown = taken(rng, seat=seat)
    unknown.known[:] = False
    assert places(SeatError, sino6, unknown) == []
    on_a_wall = changed(sino6.file, gravity_m_s2=(9.81, 0.0, 0.0))
    for arm, records, torque, joints in (
        (sino6, bare, "gravity", every[1:]),  # no weight has a moment about a vertical axis
        (on_a_wall, bare, "gravity", every),
        (sino6, taken(rng, torque=approach), "measured", every),
        (zero6, bare, "gravity", every[1:]),
    ):
        found = list(JointCompliance.candidates(arm, records))
        assert [variants[0].joint for variants in found] == joints
        assert {variants[0].torque for variants in found} == {torque}
        for joint, variants in zip(joints, found, strict=True):
            assert {e.joint for e in variants} == {joint}
            # Of unknown masses the first bodies from the joint on, one more in each.
            beyond = tuple(range(joint, 7))
            counts = range(1, len(beyond) + 1) if arm is zero6 else [0]
            bodies = [e.bodies for e in variants if e.torque == "gravity"]
            if bodies or torque == "gravity":
                assert bodies == [beyond[:count] for count in counts]
    finger = Arm.from_urdf(robot_file("panda.urdf"), "panda_leftfinger")
    vars(finger)["masses"] = None  # where the property keeps it
    # A joint slides beyond all others.
    assert places(JointCompliance, finger, replace(bare, q=np.zeros((N, 8)))) == []
    assert places(JointCompliance, zero6, None) == []


def test_loads_hang_where_the_joint_carries_them(zero6):
    ends = {e.load_at for e in load_variants(JointCompliance(1), zero6)}
    assert max(ends) == zero6.chain.rows
    for joint in range(1, 7):
        carried = {e.load_at for e in load_variants(JointCompliance(joint), zero6)}
        assert carried == {row for row in ends if row >= joint}
    # A measured torque has the load already; masses that nobody stated have none beside them.
    for effect in (JointCompliance(2, torque="measured"), JointCompliance(2, bodies=(4, 5))):
        assert load_variants(effect, zero6) == ()


def refined(effect: Effect, records: Taken) -> list[Any]:
    return effect.nonlinear.refine(effect, records)


def test_nonlinear_parameters(sino6, rng):
    """Orders from a period over the covered range on, curves that the records can tell, times
    between records.
    """
    pause = np.arange(N) + np.where(np.arange(N) >= 50, 1000.0, 0.0)
    records = taken(rng, time=pause)
    for variants in JointPeriodicError.candidates(sino6, records):
        turns = np.ptp(records.q[:, variants[0].joint - 1]) / (2 * np.pi)
        # A tenth of a period over the range apart, up to 50 in a turn, and all whole orders;
        # once and twice per turn are causes of their own.
        tenths = np.arange(10, int(np.ceil(500 * turns)))
        own = np.min([np.abs(tenths - 10 * k * turns) for k in (1, 2)], axis=0) < 2.0
        whole = np.arange(3.0, 50.0)
        orders = np.union1d(tenths[~own] / (10 * turns), whole[whole * turns >= 1.0])
        close([e.order for e in variants], orders, 1e-4)
    fine = [e.order for e in refined(JointPeriodicError(1, 4), records)]
    assert [len(fine), min(fine), max(fine)] == [2 * ORDERS_NEAR + 1, 3.5, 4.5]
    assert 4 in fine
    assert min(e.order for e in refined(JointPeriodicError(1, 0.5), records)) > 0.3
    long = replace(records, q=rng.uniform(-np.pi, np.pi, (500, 6)))
    for arm_at in (records, long):
        for curves in JointErrorCurve.candidates(sino6, arm_at):
            angle = arm_at.q[:, curves[0].joint - 1]
            counts = [curve.coefficients for curve in curves]
            assert min(counts) >= 8
            assert max(counts) <= len(angle) / PER_COEFFICIENT
            # Each has intervals half as long as the one before it.
            intervals = [count - 3 for count in counts]
            assert intervals == [2**k * intervals[0] for k in range(len(counts))]
            for curve in curves:
                assert curve.lower_rad < angle.min() < angle.max() < curve.upper_rad
    times = [e.time_s for e in next(EncoderSlip.candidates(sino6, records))]
    assert 549.5 in times  # the middle of the pause
    assert 0.0 < min(times) < 12.0 < 1180.0 < max(times) < pause[-1]
    assert not np.isin(times, pause).any()
    near = [e.time_s for e in refined(EncoderSlip(1, 549.0), records)]
    assert len(near) == GAPS_NEAR
    assert {48.5, 549.5, 1050.5} <= set(near)
    assert near == sorted(near)
    assert min(e.time_s for e in refined(EncoderSlip(1, 0.0), records)) == 0.0  # before the first
    assert min(e.time_s for e in refined(EncoderSlip(1, 1150.0), records)) > 1100.0
    slow = [e.time_constant_s for e in refined(ZeroDrift(1, 600.0), records)]
    assert [min(slow), max(slow)] == [200.0, 1800.0]


def test_bodies_that_grow_are_tried_in_either_convention():
    """A long d stands before its joint's axis in modified DH, and is of the body behind it all the
    same.
    """
    lengths = ((0, 0), (0, 0), (20, 610), (300, 0), (0, 480), (0, 0))
    rows = [(a, d, 86.0, 0.0) for a, d in lengths]
    for convention, links in (("standard-dh", [None, 3, 4, 5]), ("modified-dh", [None, 3, 5])):
        grown = ThermalExpansion.candidates(by_table("a", rows, 170.0, convention))
        assert [variants[0].link for variants in grown] == links
