"""A diagnosis at a glance: sizes of residuals by the three models; and its pictures by name."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report.numbers import length_unit, lengths
from aacmm_pin.report.plots.causes import plot_cause, plot_unexplained
from aacmm_pin.report.plots.groups import MODELS, plot_groups, plot_held_out
from aacmm_pin.report.plots.parameter_changes import geometric
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.residual_vectors import plot_residual_views
from aacmm_pin.report.plots.style import VERMILLION, axes_of


def plot_rms(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """RMS distance of tip and target by the three models, and what the noise alone would give."""
    unit, scale = length_unit(max(result.rms.values()))
    words = dict(zip(result.rms, lengths(result.rms.values()), strict=True))
    ax = axes_of(ax, (6.8, 2.2))
    bars = ax.barh(list(MODELS), [result.rms[name] / scale for name in MODELS], color=list(MODELS.values()), height=0.6)
    box = {"fc": "white", "ec": "none", "pad": 1}
    ax.bar_label(bars, [words[name] for name in MODELS], padding=5, fontsize=9, bbox=box)
    ax.axvline(result.rms["noise"] / scale, color=VERMILLION, ls="--", lw=1.4, label=f"noise alone, {words['noise']}")
    ax.invert_yaxis()
    ax.set_xlim(0, 1.15 * max(result.rms.values()) / scale)
    ax.set_xlabel(f"RMS distance of tip and target [{unit}]")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.97))
    return ax


OVERVIEWS: dict[str, Callable[[Diagnosis, Axes | None], Axes | Figure]] = {
    "rms": plot_rms,
    "groups": plot_groups,
    "arm": plot_residual_views,
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
    if what is None and not result.findings:
        what = next(iter(shapes), "rms")
    if isinstance(what, str):
        if what in shapes:
            return plot_unexplained(result, what, ax)
        if what not in OVERVIEWS:
            raise UnknownNameError("picture", what, [*shapes, *OVERVIEWS], "or one of the findings")
        return OVERVIEWS[what](result, ax)
    if not isinstance(what, Finding):
        number = what or 0
        if not 0 <= number < len(result.findings):
            raise AacmmError(f"finding {number} was asked for, this diagnosis has {len(result.findings)}, counted from 0")
        what = result.findings[number]
    over_something = what.effect.corrects_seat or geometric(result, what)
    if not over_something and is_constant(what.effect, state_of(result.extended)):
        return plot_rms(result, ax)  # it moves every record alike
    return plot_cause(result, what, ax)
