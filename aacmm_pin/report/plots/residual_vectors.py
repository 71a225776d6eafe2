"""Residuals of a calibration or diagnosis as arrows; views of an arm with places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
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
from aacmm_pin.report.numbers import length
from aacmm_pin.report.plots.partial_residuals import state_of
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    evenly_selected,
    figure_of,
    panels_of,
    plain,
    round_down,
)

VIEWS = {(0, 1): "plan (xy)", (0, 2): "side (xz)"}
"""Axes of the reference frame in each view."""
LONGEST_VECTOR = 0.08
"""Length of nearly all residuals, as part of the picture."""
POSTURES_DRAWN = 3
"""Postures of the arm to draw."""
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


def rms_of(result: Calibration | Diagnosis) -> dict[str, float]:
    """RMS residual of the used records by :func:`models` [m]."""
    if isinstance(result, Calibration):
        return {"before": result.rms_before, "after": result.rms}
    return {name: result.rms[name] for name in models(result)}


def two_models(result: Calibration | Diagnosis) -> tuple[str, str]:
    """The two models to compare: without and with the causes; without causes, geometry."""
    if isinstance(result, Calibration):
        return "before", "after"
    return ("recalibrated", "extended") if result.findings else ("nominal", "recalibrated")


Groups = Mapping[str, tuple[str, Sequence[tuple[str, Array]]]]
"""By name: colour, and places, each with a label, or "", and points (k, 3) [m] joined by lines."""
MANY_PLACES = 8
"""Places of one kind that are drawn large."""


@plain
def plot_residual_views(result: Calibration | Diagnosis, ax: Axes | None = None) -> Figure:
    """Plot residuals of :func:`two_models` as arrows from each target towards the tip, equally
    magnified, in top and side view with the arm in some postures, in the area of ``ax``.

    For a diagnosis, a target is the stated place, or without one the estimate from all records of
    the seat.
    """
    panels = panels_of(ax, (4.3, 4.0), 4, 2)
    fits, last_fit = models(result), [*models(result).values()][-1]
    names, used = two_models(result), last_fit.used
    shown = evenly_selected(np.flatnonzero(used), MOST_VECTORS)
    first = fits[names[0]]
    deviation = deviations_of(result, first)[used]
    factor = magnification_of(first.point.prediction.tips[used] - deviation, deviation)
    for panel, (plane, name) in zip(panels, product(VIEWS, names), strict=True):
        for posture in postures_of(last_fit):
            line = posture[:, plane].T / MM
            panel.plot(*line, color=GREY, lw=3, alpha=0.5, solid_capstyle="round", zorder=1)
        fit = fits[name]
        deviations = deviations_of(result, fit)[shown]
        start = fit.point.prediction.tips[shown] - deviations
        _draw_vectors(panel, start[:, plane] / MM, deviations[:, plane] / MM, factor)
        horizontal, vertical = ("xyz"[axis] for axis in plane)
        panel.set(xlabel=f"{horizontal} [mm]", ylabel=f"{vertical} [mm]", aspect="equal")
        panel.set_title(f"{name}, {VIEWS[plane]}, residuals × {factor:g}")
    return figure_of(panels)


def _draw_vectors(ax: Axes, start: Array, deviation: Array, factor: float) -> None:
    """Draw magnified arrows from ``start`` (n, 2) [mm], and above them one for the scale."""
    units: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "units": "inches"}
    scale = 1 / factor
    arrows = ax.quiver(
        *start.T, *deviation.T, color=BLUE, scale=scale, width=0.014, zorder=2, **units
    )
    size = float(np.ptp(start, axis=0).max()) or 1.0
    key_length = round_down(0.12 * size / factor)
    ax.update_datalim(start + factor * deviation)
    ax.quiverkey(arrows, 0.1, 0.95, key_length, length(key_length * MM), labelpos="E")
    ax.margins(0.08)


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


def postures_of(fit: Fit) -> Array:
    """The arm from base to tip in distant postures, in the references' frame (k, places, 3) [m]."""
    tips, frame = fit.point.prediction.tips, fit.point.frame
    records = fit.problem.measurements
    chosen: list[int] = []  # each is the farthest from the base and those before
    to_nearest_chosen = np.linalg.norm(tips - frame.shift, axis=1)
    for _ in range(min(POSTURES_DRAWN, int(fit.used.sum()))):
        farthest = int(np.argmax(np.where(fit.used, to_nearest_chosen, -1.0)))
        chosen.append(farthest)
        to_nearest_chosen = np.minimum(
            to_nearest_chosen, np.linalg.norm(tips - tips[farthest], axis=1)
        )
    state = state_of(fit, records.q[chosen], records.conditions.take(chosen))
    return np.stack([frame.apply(points) for points in state.origin.transpose(1, 0, 2)])


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
