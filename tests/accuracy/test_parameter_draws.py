"""Draws of what is uncertain: their covariance, and what they do to the tip, draw by draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.accuracy.volume import accuracy_volume
from aacmm_pin.arm.file import Covariance
from aacmm_pin.effects import (
    EncoderEccentricity,
)
from aacmm_pin.effects.error_model import ErrorModel
from tests.arm_files import changed
from tests.oracle import close

pytestmark = pytest.mark.fast

DRAWS = 30_000
WITHIN = 5 * np.sqrt(2.0 / DRAWS)
"""Five standard uncertainties of a variance from as many normal draws, relative; bounded draws
scatter less.
"""


def test_what_is_known_together_is_drawn_together(sino6, rng):
    """d2 and d4 are known nearly as their sum alone, and the eccentricity together with d3."""
    assert sino6.file is not None
    known = Covariance(
        parameters=("d2", "d4", "d3", "encoder_eccentricity:3.cos"),
        standard_uncertainty_si=(5e-4, 5e-4, 1e-5, 2e-5),
        correlation=((), (-0.999,), (0.0, 0.0), (0.0, 0.0, 0.8)),
    )
    calibrated = ErrorModel(
        changed("sino6", covariance=known), (EncoderEccentricity(joint=3, values=(1e-4, 0.0)),)
    )
    errors = parameter_errors(calibrated, rng, DRAWS)
    expected, scale = calibrated.covariance(), np.sqrt(np.diag(calibrated.covariance()))
    uncertain = scale > 0
    assert (errors[:, ~uncertain] == 0).all()
    whitened = errors[:, uncertain] / scale[uncertain]
    correlation = (
        expected / np.where(uncertain, scale, 1.0) / np.where(uncertain, scale, 1.0)[:, None]
    )[np.ix_(uncertain, uncertain)]
    close(np.cov(whitened.T), correlation, WITHIN)
    names = [p.name for p, k in zip(calibrated.parameters, uncertain, strict=True) if k]
    largest = dict(zip(names, np.abs(whitened).max(axis=0), strict=True))
    assert largest["d2"] > 3.5  # normal
    assert largest["a3"] <= np.sqrt(3.0)  # rectangular


@pytest.mark.parametrize(
    "bounds", [{"theta_offset1": 1e-5}, {"a2": 1e-5, "d4": 2e-5}, {"a2": 1e-23, "alpha1": 1e-20}]
)
def test_a_cloud_that_is_flat_has_no_volume(sino6, bounds):
    known = [
        replace(p, half_width=bounds.get(p.name, 0.0), u=bounds.get(p.name, 0.0) / 3**0.5)
        for p in sino6.parameters
    ]
    q, few = sino6.limits.mean(axis=1)[None] + 0.3, np.random.default_rng(1)
    found = accuracy_volume(
        replace(sino6, parameters=tuple(known)), q, method="monte-carlo", rng=few, draws=200
    )
    assert found.volume.tolist() == [0.0]
