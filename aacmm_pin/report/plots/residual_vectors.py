"""Residuals of a calibration or diagnosis by model, for scenes; views of an arm with places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration, Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import (
    INK,
    plain,
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


Groups = Mapping[str, tuple[str, Sequence[tuple[str, Array]]]]
"""By name: colour, and places, each with a label, or "", and points (k, 3) [m] joined by lines."""
MANY_PLACES = 8
"""Places of one kind that are drawn large."""


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


@plain
def two_views(arm: Arm, q: Array, groups: Groups) -> Figure:
    """The arm in the posture ``q`` (1, nq) [rad], and places in its base, from above and the
    side.
    """
    figure = Figure(figsize=(10.0, 5.6), layout="constrained")
    lines = ArmLines(arm).corners(q)[0] / MM
    from_above, from_the_side = figure.subplots(1, 2)
    _draw_view(from_above, lines, groups, [0, 1])
    _draw_view(from_the_side, lines, groups, [0, 2])
    from_above.set(xlabel="x [mm]", ylabel="y [mm]", title="View from above (along -z)")
    from_the_side.set(xlabel="x [mm]", ylabel="z [mm]", title="View from the side (along y)")
    handles, names = from_above.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_view(axes: Axes, lines: Array, groups: Groups, plane: list[int]) -> None:
    """Draw lines (corners, 3) [mm] and groups in the ``plane`` of two axes."""
    for name, (colour, places) in groups.items():
        size = 4 if len(places) > MANY_PLACES else 6
        style: dict[str, Any] = {"ms": size, "lw": size / 4, "color": colour}
        axes.plot([], [], "o-", label=name, **style)
        for label, points in places:
            projected = points[:, plane] / MM
            axes.plot(*projected.T, "o-", **style)
            axes.annotate(
                label, projected[0], (5, 4), textcoords="offset points", color=colour, fontsize=8
            )
    axes.plot(*lines[:, plane].T, color=INK, lw=2.5, solid_capstyle="round")
    axes.plot(0, 0, "s", color=INK, ms=7)
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.margins(0.08)
