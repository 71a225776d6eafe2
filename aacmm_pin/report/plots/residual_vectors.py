"""Residuals of a calibration or diagnosis by model, for scenes."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Calibration, Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.plots.style import (
    round_down,
)

LONGEST_VECTOR = 0.08
"""Length of nearly all residuals, as part of the picture."""
MOST_VECTORS = 400
"""Residuals to draw; evenly selected from more."""


def models(result: Calibration | Diagnosis) -> dict[str, Fit]:
    """The fits by the names of their models; the last determines the used records."""
    if isinstance(result, Calibration):
        return {"before": result.before, "after": result.fit}
    return {
        "nominal": result.before,
        "recalibrated": result.recalibrated,
        "extended": result.extended,
    }


def model_named(result: Calibration | Diagnosis, name: str) -> Fit:
    """One of :func:`models`.

    Raises:
        UnknownNameError: no such model.
    """
    if name not in models(result):
        raise UnknownNameError("model", name, list(models(result)))
    return models(result)[name]


def deviations_of(result: Calibration | Diagnosis, fit: Fit) -> Array:
    """Residuals (n, 3) [m]; of a diagnosis from the stated, else the estimated place of the
    seat.
    """
    if isinstance(result, Calibration):
        return fit.system.deviation
    records = fit.problem.measurements
    from_reference = fit.point.prediction.tips - records.reference
    return np.where(records.known[:, None], from_reference, fit.system.deviation)


def magnification_of(place: Array, deviation: Array) -> float:
    """Magnification of residuals (n, 3) at places (n, 3) [m] that fits their picture."""
    size = float(np.ptp(place, axis=0).max()) or 1.0
    usual = float(np.quantile(np.linalg.norm(deviation, axis=1), 0.95)) or 1e-12
    return round_down(LONGEST_VECTOR * size / usual)
