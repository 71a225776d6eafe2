"""A diagnosis at a glance: sizes of residuals by the three models, and the arm with its residuals."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import MM
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report.numbers import length_unit, lengths
from aacmm_pin.report.plots.causes import geometric, plot_cause, plot_unexplained
from aacmm_pin.report.plots.groups import MODELS, plot_groups, plot_held_out
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.style import (
    GREY,
    VERMILLION,
    Plane,
    axes_of,
    draw_vectors,
    magnification,
    panels_of,
    plane_axes,
    whole,
)

POSTURES = 3
"""So many postures of the arm are drawn."""
MOST_VECTORS = 400
"""Residuals that are drawn; of more, every so-manieth."""


def models(result: Diagnosis) -> dict[str, Fit]:
    """The three fits by their names."""
    return {"simulation": result.before, "recalibrated": result.recalibrated, "extended": result.extended}


def plot_rms(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """RMS distance of tip and target by the three models, and what the noise alone would give."""
    unit, scale = length_unit(max(result.rms.values()))
    ax, sizes = axes_of(ax, (6.8, 2.2)), {name: value / scale for name, value in result.rms.items()}
    names, words = list(MODELS), dict(zip(sizes, lengths(result.rms.values()), strict=True))
    ax.barh(names, [sizes[name] for name in names], color=[MODELS[name] for name in names], height=0.6)
    for place, name in enumerate(names):
        ax.annotate(
            words[name],
            (sizes[name], place),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            bbox={"fc": "white", "ec": "none", "pad": 1},
        )
    ax.axvline(sizes["noise"], color=VERMILLION, ls="--", lw=1.4, label=f"noise alone, {words['noise']}")
    ax.invert_yaxis()
    ax.set_xlim(0, 1.15 * max(sizes.values()))
    ax.set_xlabel(f"RMS distance of tip and target [{unit}]")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    return ax


def shown_models(result: Diagnosis) -> tuple[str, str]:
    """The two models worth comparing on the arm: without and with the causes, or where none was found with geometry."""
    more = result.extended.problem.vector.size > result.recalibrated.problem.vector.size
    return ("recalibrated", "extended") if more else ("simulation", "recalibrated")


def plot_arm_residuals(result: Diagnosis, ax: Axes | None = None) -> Figure:
    """Residual vectors on the arm by two models, see :func:`shown_models`, in plan and from the side, all magnified alike.

    Lines go from each stated place towards the tip, in the frame of the references; behind them the arm in a few of its
    postures.

    Args:
        result: the diagnosis.
        ax: axes whose place is divided.

    Returns:
        the figure of the four panels: in plan without and with, from the side without and with.
    """
    panels, names = panels_of(ax, (8.6, 8.0), 4, 2), shown_models(result)
    factor = magnification_of(models(result)[names[0]], result.extended.used)
    planes: tuple[Plane, ...] = ("xy", "xz")
    for panel, (plane, name) in zip(panels, product(planes, names), strict=True):
        plot_arm_residual_vectors(result, name, plane, factor, panel)
    return whole(panels)


def plot_arm_residual_vectors(
    result: Diagnosis, name: str = "extended", plane: Plane = "xz", factor: float | None = None, ax: Axes | None = None
) -> Axes:
    """Residuals by one of the models as lines from each stated place towards the tip, projected, behind them the arm.

    Where nobody states a place, lines begin where the records of the seat together put it.

    Args:
        result: the diagnosis.
        name: ``simulation``, ``recalibrated`` or ``extended``.
        plane: axes of the frame of the references that are drawn.
        factor: magnification of the residuals; by default one that suits this model.
        ax: axes.

    Raises:
        AacmmError: no such model or plane.
    """
    if name not in MODELS:
        raise AacmmError(f"name is {name!r}, expected one of {', '.join(MODELS)}")
    fit, axes, ax = models(result)[name], plane_axes(plane), axes_of(ax, (6.0, 5.6))
    factor = factor or magnification_of(fit, result.extended.used)
    used = some_of(np.flatnonzero(result.extended.used))
    deviation = off_stated(fit)[used]
    for posture in postures_of(result.recalibrated):
        ax.plot(*posture[:, axes].T, "-", color=GREY, lw=3, alpha=0.45, solid_capstyle="round", zorder=1)
        ax.plot(*posture[:, axes].T, "o", color=GREY, ms=4, alpha=0.6, zorder=1)
    draw_vectors(ax, fit.solution.point.prediction.tips[used] - deviation, deviation, plane, factor)
    view = {"xy": "plan (xy)", "xz": "side (xz)", "yz": "side (yz)"}[plane]
    ax.set_title(f"{name}, {view}, residuals magnified {factor:g}×", fontsize=10)
    return ax


def some_of(records: Index) -> Index:
    """At most ``MOST_VECTORS`` of the records, every so-manieth."""
    return records[:: -(-len(records) // MOST_VECTORS)] if len(records) else records


def off_stated(fit: Fit) -> Array:
    """Tip minus stated place, or minus the place that a seat seems to have where nobody states it (n, 3) [m]."""
    records, tips = fit.problem.measurements, fit.solution.point.prediction.tips
    return np.where(records.known[:, None], tips - records.reference, fit.solution.system.deviation)


def magnification_of(fit: Fit, used: NDArray[np.bool_]) -> float:
    """The magnification that suits the ``used`` residuals of a fit."""
    deviation = off_stated(fit)[used]
    return magnification(fit.solution.point.prediction.tips[used] - deviation, deviation)


def postures_of(fit: Fit) -> Array:
    """The arm from foot to tip in postures whose tips are far apart, in the frame of the references (k, places, 3) [mm]."""
    tips = fit.solution.point.prediction.tips
    foot = fit.solution.point.frame.shift
    chosen, near = [], np.linalg.norm(tips - foot, axis=1)
    candidates = fit.used
    for _ in range(min(POSTURES, int(candidates.sum()))):
        chosen.append(int(np.argmax(np.where(candidates, near, -1.0))))
        near = np.minimum(near, np.linalg.norm(tips - tips[chosen[-1]], axis=1))
    records = fit.problem.measurements
    state = state_of(fit, records.q[chosen], records.conditions.take(chosen))
    frame = fit.solution.point.frame
    return np.stack([frame.apply(points) for points in state.origin.transpose(1, 0, 2)]) / MM


OVERVIEWS: dict[str, Callable[[Diagnosis, Axes | None], Axes | Figure]] = {
    "rms": plot_rms,
    "groups": plot_groups,
    "arm": plot_arm_residuals,
    "held_out": plot_held_out,
}
"""Pictures of a whole diagnosis, by name."""


def plot_diagnosis(result: Diagnosis, what: Finding | int | str | None = None, ax: Axes | None = None) -> Axes | Figure:
    """The strongest cause through what the records say of it; where none was found, what the residuals depend on; where
    they depend on nothing, their size by the three models.

    Args:
        result: the diagnosis.
        what: something else: a finding, or its number from 0; a name in ``unexplained.shapes``, for what no cause explains
            over it; or ``rms``, ``groups``, ``arm``, ``held_out``.
        ax: axes; a picture of several panels divides their place.

    Returns:
        the axes; of ``groups`` and ``arm``, which have several panels, their figure.

    Raises:
        UnknownNameError: a name that stands for nothing.
        AacmmError: there is no such finding, or nothing was held out.
    """
    shapes = result.unexplained.shapes
    if isinstance(what, str):
        if what in shapes:
            return plot_unexplained(result, what, ax)
        if what not in OVERVIEWS:
            raise UnknownNameError("picture", what, [*shapes, *OVERVIEWS], "or one of the findings")
        return OVERVIEWS[what](result, ax)
    if isinstance(what, Finding):
        return _finding(result, what, ax)
    if what is None and not result.findings:
        return plot_unexplained(result, next(iter(shapes)), ax) if shapes else plot_rms(result, ax)
    number = what or 0
    if not 0 <= number < len(result.findings):
        raise AacmmError(f"finding {number} was asked for, this diagnosis has {len(result.findings)}, counted from 0")
    return _finding(result, result.findings[number], ax)


def _finding(result: Diagnosis, finding: Finding, ax: Axes | None) -> Axes:
    """:func:`plot_cause`; sizes of the residuals for a cause that moves every record alike, and so depends on nothing."""
    of_its_own = finding.effect.corrects_seat or geometric(result, finding)
    if not of_its_own and is_constant(finding.effect, state_of(result.extended)):
        return plot_rms(result, ax)
    return plot_cause(result, finding, ax)
