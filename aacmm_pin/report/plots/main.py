"""The picture of a diagnosis that says most."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import SeatError
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report.diagnosis_findings import geometric
from aacmm_pin.report.plots.causes import plot_cause, plot_unexplained
from aacmm_pin.report.plots.diagnosis import plot_arm_residuals, plot_rms
from aacmm_pin.report.plots.groups import plot_groups, plot_held_out
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.style import Panels

OVERVIEWS: dict[str, Callable[[Diagnosis, Any], Axes | Panels]] = {
    "rms": plot_rms,
    "groups": plot_groups,
    "arm": plot_arm_residuals,
    "held_out": plot_held_out,
}
"""Pictures of a whole diagnosis, by name."""


def plot_diagnosis(
    result: Diagnosis, what: Finding | int | str | None = None, ax: Axes | Panels | None = None
) -> Axes | Panels:
    """The strongest cause through what the records say of it; where none was found, what the residuals depend on; where
    they depend on nothing, their size by the three models.

    Args:
        result: the diagnosis.
        what: something else: a finding, or its number from 0; a name in ``unexplained.shapes``, for what no cause explains
            over it; or ``rms``, ``groups``, ``arm``, ``held_out``.
        ax: axes, or, for a picture of several panels, an array of them.

    Raises:
        UnknownNameError: a name that stands for nothing.
        AacmmError: there is no such finding, or nothing was held out.
    """
    shapes = result.unexplained.shapes
    if isinstance(what, str):
        if what in shapes:
            return plot_unexplained(result, what, _single(ax))
        if what not in OVERVIEWS:
            raise UnknownNameError("picture", what, [*shapes, *OVERVIEWS], "or one of the findings")
        return OVERVIEWS[what](result, ax)
    if isinstance(what, Finding):
        return _finding(result, what, _single(ax))
    if what is None and not result.findings:
        return plot_unexplained(result, next(iter(shapes)), _single(ax)) if shapes else plot_rms(result, _single(ax))
    number = what or 0
    if not 0 <= number < len(result.findings):
        raise AacmmError(f"finding {number} was asked for, this diagnosis has {len(result.findings)}, counted from 0")
    return _finding(result, result.findings[number], _single(ax))


def _single(ax: Axes | Panels | None) -> Axes | None:
    if isinstance(ax, np.ndarray):
        raise AacmmError(f"ax is an array of {ax.size} axes, expected axes: this picture has one panel")
    return ax


def _finding(result: Diagnosis, finding: Finding, ax: Axes | None) -> Axes:
    """:func:`plot_cause`; sizes of the residuals for a cause that moves every record alike, and so depends on nothing."""
    of_its_own = isinstance(finding.effect, SeatError) or geometric(result, finding)
    if not of_its_own and is_constant(finding.effect, state_of(result.extended)):
        return plot_rms(result, ax)
    return plot_cause(result, finding, ax)
