"""χ² and F beside scipy.stats, far into their tails."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from aacmm_pin._support.distributions import chi2_cdf, chi2_isf, chi2_sf, f_isf, f_sf

pytestmark = pytest.mark.fast

DOF = np.array([1.0, 2.0, 3.0, 7.5, 120.0, 4500.0])
P = np.array([0.9, 0.5, 1e-3, 1e-9, 1e-30])[:, None]


def test_chi_squared():
    value = stats.chi2.isf(P, DOF)
    np.testing.assert_allclose(chi2_isf(P, DOF), value, rtol=1e-9)
    np.testing.assert_allclose(chi2_sf(value, DOF), P * np.ones(len(DOF)), rtol=1e-9)
    np.testing.assert_allclose(chi2_cdf(value, DOF), stats.chi2.cdf(value, DOF), rtol=1e-12)
    assert chi2_sf(2000.0, 3) == pytest.approx(stats.chi2.sf(2000.0, 3), rel=1e-9)


def test_f():
    for other in (4.0, 33.3, 2000.0):
        value = stats.f.isf(P[:3], DOF, other)
        np.testing.assert_allclose(f_isf(P[:3], DOF, other), value, rtol=1e-9)
        np.testing.assert_allclose(f_sf(value, DOF, other), P[:3] * np.ones(len(DOF)), rtol=1e-9)
        there_and_back = f_sf(f_isf(P, DOF, other), DOF, other)  # where stats says infinite
        np.testing.assert_allclose(there_and_back, P * np.ones(len(DOF)), rtol=1e-9)
