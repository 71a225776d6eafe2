"""A diagnosis at a glance: sizes of residuals by the three models, and the arm with its residuals."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import MM
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.groups import MODELS
from aacmm_pin.report.plots.partial_residuals import state_of
from aacmm_pin.report.plots.residuals import LONGEST, Plane, scale_bar
from aacmm_pin.report.plots.style import BLUE, GREY, VERMILLION, Panels, axes_of, panels_of, round_down

POSTURES = 3
"""So many postures of the arm are drawn."""
MOST_VECTORS = 400
"""Residuals that are drawn; of more, every so-manieth."""


def models(result: Diagnosis) -> dict[str, Fit]:
    """The three fits by their names."""
    return {"simulation": result.before, "recalibrated": result.recalibrated, "extended": result.extended}


def plot_rms(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """RMS distance of tip and target by the three models, and what the noise alone would give."""
    ax, sizes = axes_of(ax, (6.8, 2.2)), {name: value / MM for name, value in result.rms.items()}
    names = list(MODELS)
    ax.barh(names, [sizes[name] for name in names], color=[MODELS[name] for name in names], height=0.6)
    for place, name in enumerate(names):
        ax.annotate(
            f"{sizes[name]:.4f}",
            (sizes[name], place),
            (5, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            bbox={"fc": "white", "ec": "none", "pad": 1},
        )
    ax.axvline(sizes["noise"], color=VERMILLION, ls="--", lw=1.4, label=f"noise alone, {sizes['noise']:.4f} mm")
    ax.invert_yaxis()
    ax.set_xlim(0, 1.15 * max(sizes.values()))
    ax.set_xlabel("RMS distance of tip and target [mm]")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    return ax


def shown_models(result: Diagnosis) -> tuple[str, str]:
    """The two models worth comparing on the arm: without and with the causes, or where none was found with geometry."""
    more = len(result.extended.problem.estimated) > len(result.recalibrated.problem.estimated)
    return ("recalibrated", "extended") if more else ("simulation", "recalibrated")


def plot_arm_residuals(result: Diagnosis, ax: Axes | Panels | None = None) -> Panels:
    """Residual vectors on the arm by two models, see :func:`shown_models`, in plan and from the side, all magnified alike.

    Lines go from each stated place towards the tip, in the frame of the references; behind them the arm in a few of its
    postures.

    Args:
        result: the diagnosis.
        ax: axes whose place is divided, or four axes.

    Returns:
        axes of the four panels: in plan without and with, from the side without and with.
    """
    panels, names = panels_of(ax, (8.6, 8.0), 4, 2), shown_models(result)
    factor = _magnification(result, names[0])
    planes: tuple[Plane, ...] = ("xy", "xz")
    for panel, (plane, name) in zip(panels, product(planes, names), strict=True):
        plot_arm_residual_vectors(result, name, plane, factor, panel)
    return panels


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
    if plane not in ("xy", "xz", "yz"):
        raise AacmmError(f"plane is {plane!r}, expected 'xy', 'xz' or 'yz'")
    fit, ax = models(result)[name], axes_of(ax, (6.0, 5.6))
    axes, factor = ["xyz".index(axis) for axis in plane], factor or _magnification(result, name)
    used = some_of(np.flatnonzero(result.extended.used))
    deviation = off_stated(fit)[used] / MM
    target = fit.solution.point.prediction.tips[used] / MM - deviation
    for posture in postures_of(result.recalibrated):
        ax.plot(*posture[:, axes].T, "-", color=GREY, lw=3, alpha=0.45, solid_capstyle="round", zorder=1)
        ax.plot(*posture[:, axes].T, "o", color=GREY, ms=4, alpha=0.6, zorder=1)
    lines = np.stack([target, target + factor * deviation], axis=1)[:, :, axes]
    ax.add_collection(LineCollection(list(lines), colors=BLUE, linewidths=0.9, alpha=0.8, zorder=2))
    ax.plot(*lines[:, 1].T, ".", ms=2, color=BLUE, zorder=2)
    low, high = target[:, axes].min(axis=0), target[:, axes].max(axis=0)
    length = round_down(0.12 * float((high - low).max()) / factor)
    scale_bar(ax, low - np.array([0.0, 0.1 * (high - low).max()]), factor, length)
    ax.set(xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]", aspect="equal")
    ax.margins(0.05)
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


def _magnification(result: Diagnosis, name: str) -> float:
    return magnification(models(result)[name], result.extended.used)


def magnification(fit: Fit, used: NDArray[np.bool_]) -> float:
    """With which the ``used`` residuals of a fit are nearly all shorter than a fixed part of the picture."""
    deviation = off_stated(fit)[used]
    target = fit.solution.point.prediction.tips[used] - deviation
    size = float(np.ptp(target, axis=0).max()) or 1.0
    return round_down(LONGEST * size / (float(np.quantile(np.linalg.norm(deviation, axis=1), 0.95)) or 1e-12))


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
