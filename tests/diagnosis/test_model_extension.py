"""Nonlinear parameters of an extended arm."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.diagnosis import nonlinear_parameters
from aacmm_pin.effects import JointPeriodicError
from aacmm_pin.measurements import Measurements

pytestmark = pytest.mark.fast


def test_the_top_of_a_parabola():
    """Between the neighbours of the best; no further, and nowhere where there is no top."""
    tried = [JointPeriodicError(3, order) for order in (2.1, 2.5, 3.5)]
    for top in (2.3, 2.9):
        evidences = -np.array([(2.1 - top) ** 2, (2.5 - top) ** 2, (3.5 - top) ** 2])
        evidences[1] += 1e-3 * (top == 2.3)  # of two equal ones, the middle
        assert nonlinear_parameters.likeliest(tried, evidences).order == pytest.approx(
            top, abs=0.02
        )
    at_the_end = np.array([0.0, -1.0, -2.0])
    assert nonlinear_parameters.likeliest(tried, at_the_end) == tried[0]


def test_nonlinear_parameters_by_their_evidence():
    """A whole order unless another is far better."""
    for far, expected in ((1.0, 4.0), (3.0, 4.11)):
        wave = JointPeriodicError(3, 4.0)
        tried = wave.nonlinear.refine(wave, Measurements.of(np.zeros((4, 6))))
        peak = far / 0.11**2  # so much better than the whole order
        refined = nonlinear_parameters.likeliest(
            tried, np.array([-peak * (e.order - 4.11) ** 2 for e in tried])
        )
        assert refined.order == pytest.approx(expected, abs=1e-3)
