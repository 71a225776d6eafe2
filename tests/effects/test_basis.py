"""Causes of one place as combinations of the functions of one basis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.effects import (
    BearingTilt,
    Conditions,
    EncoderEccentricity,
    EncoderGain,
    JointPeriodicError,
    OfAngle,
    State,
    Term,
    all_candidates,
    sensitivity,
)
from aacmm_pin.measurements import Measurements
from tests.oracle import close, postures

pytestmark = pytest.mark.fast


def records_of(arm: Arm, rng: np.random.Generator, n: int = 700) -> Measurements:
    q = postures(arm, rng, n)
    return Measurements.of(q, arm.positions(q))


@pytest.mark.parametrize("name", ["sino6", "ur5", "zero6"])
def test_columns_of_every_candidate_in_its_basis(name, rng):
    """Displacements of an arm by the parameters, and by the combinations of those of the basis."""
    arm = Arm.from_urdf(name) if name == "ur5" else Arm.load(name)
    records = records_of(arm, rng)
    state = State(arm, records.q, records.conditions, arm.chain.tip)
    moved: dict[tuple[object, ...], Array] = {}
    seen = set()
    for variants in all_candidates(arm, records):
        for effect in (variants[0], variants[len(variants) // 2], variants[-1]):
            basis = effect.basis(arm, records)
            if basis is None:
                continue
            seen.add(effect.cause)
            if basis.identity not in moved:
                moved[basis.identity] = sensitivity(basis, state)
            found = moved[basis.identity] @ effect.in_basis(basis)
            wanted = sensitivity(effect, state)
            size = np.sqrt(np.square(wanted).mean(axis=(0, 1)))
            left = np.sqrt(np.square(found - wanted).mean(axis=(0, 1)))
            # A spline of four intervals for each period, of the highest orders, leaves 1.6 %.
            most = 0.02 if getattr(effect, "order", 0.0) > 45.0 else 0.01
            assert (left <= most * size + 1e-15).all(), effect
    assert {"joint_periodic_error", "joint_error_curve", "encoder_gain"} <= seen
    assert ("joint_compliance" in seen) == (arm.masses is None)


def test_an_error_that_moves_several_joints_has_no_basis(sino6, rng):
    coupled = sino6.with_couplings((3, 2, -1.0))
    records = records_of(sino6, rng)
    alone = {joint: EncoderGain(joint).basis(coupled, records) is None for joint in range(1, 7)}
    assert [joint for joint, none in alone.items() if none] == [2]
    assert EncoderEccentricity(2).basis(coupled, records) is None
    assert JointPeriodicError(2, 3.0).basis(coupled, records) is not None  # of the joint itself
    assert BearingTilt(3).basis(sino6, records) is None  # with the masses of the arm


@dataclass(frozen=True)
class Step(OfAngle):
    """A cause of one's own that states its function alone."""

    cause = "rounded_step"
    terms = (Term("", "rad", 1e-4, "step_rad"),)

    def function(self, angle: Array) -> Array:
        return np.tanh(5.0 * angle)[:, None]


def test_an_own_function_of_the_angle(sino6, rng):
    records = records_of(sino6, rng)
    step = Step(4)
    basis = step.basis(sino6, records)
    state = State(sino6, records.q, Conditions(len(records.q)), sino6.chain.tip)
    wanted = sino6.jacobian(records.q)[:, :, 3] * np.tanh(5.0 * records.q[:, 3:4])
    close(sensitivity(step, state)[:, :, 0], wanted, 1e-12)
    close(sensitivity(basis, state) @ step.in_basis(basis), wanted[:, :, None], 1e-3)
    assert [variants[0].joint for variants in Step.candidates(sino6, records)] == list(range(1, 7))
