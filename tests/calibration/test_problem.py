"""An arm that is turned bends otherwise: the derivative that a search which creeps adds, against
whole arms displaced.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, Problem
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import (
    Effect,
    ErrorModel,
    JointCompliance,
    JointDistance,
    JointZeroOffset,
    LinkTwist,
)
from aacmm_pin.measurements import Measurements

pytestmark = pytest.mark.fast

SOFT = 2e-3
"""A hundred times softer than an arm is, so that what is tested stands out [rad/(N·m)]."""
DISPLACED: dict[str, Effect] = {
    "theta_offset2": JointZeroOffset(2),
    "alpha3": LinkTwist(3),
    "d5": JointDistance(5),
}
STEP = 1e-4


@pytest.fixture
def problem(sino6, rng) -> Problem:
    q = rng.uniform(*sino6.limits.T, (20, 6))
    records = Measurements.of(q, sino6.poses(q).position)
    return problem_of(
        ErrorModel(sino6), records, ["geometry", JointCompliance(2)], Setup("external")
    )


def test_it_completes_the_derivative(problem, sino6):
    assert not problem.bends(problem.start)
    x, frame = problem.start.copy(), Frame(np.eye(3)[[1, 2, 0]], np.array([1.0, -2.0, 3.0]))
    x[problem.names.index("joint_compliance:2")] = SOFT
    assert problem.bends(x)
    prediction = problem.predict(x, frame)
    answer, soft = (
        problem.elastic_jacobian_correction(x, frame, prediction),
        JointCompliance(2, values=(SOFT,)),
    )
    for name, cause in DISPLACED.items():
        k = problem.names.index(name)
        without = prediction.jacobian[:, :, k]
        ahead, behind = (
            ErrorModel(sino6, (soft, replace(cause, values=(step,)))).predict(
                problem.measurements.q
            )
            for step in (STEP, -STEP)
        )
        truth = (ahead - behind) / (2 * STEP) @ frame.rotation.T
        size = np.abs(truth).max()
        assert np.abs(without + answer[:, :, k] - truth).max() < 1e-6 * size
        assert np.abs(without - truth).max() > 1e-4 * size
