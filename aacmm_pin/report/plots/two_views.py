"""Places round an arm, from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import INK, plain

Groups = Mapping[str, tuple[str, Sequence[tuple[str, Array]]]]
"""By name: a colour, and places, each with a label, or "", and points (k, 3) [m] that are joined by
lines.
"""
MANY_PLACES = 8
"""Places of one kind that are drawn large; more are drawn small."""
LARGE_STYLE: dict[str, Any] = {"ms": 6, "lw": 2, "alpha": 1}
SMALL_STYLE: dict[str, Any] = {"ms": 4, "lw": 0.8, "alpha": 0.7}


@plain
def two_views(arm: Arm, q: Array, groups: Groups) -> Figure:
    """The arm in the posture ``q`` (1, nq) [rad], and places in the axes of its base."""
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
    """The arm and the places, projected on the two axes of the ``plane``."""
    text: dict[str, Any] = {"textcoords": "offset points", "xytext": (5, 4), "fontsize": 8}
    for name, (colour, places) in groups.items():
        style = SMALL_STYLE if len(places) > MANY_PLACES else LARGE_STYLE
        axes.plot([], [], "o-", color=colour, label=name, **style)
        for label, points in places:
            projected = points[:, plane] / MM
            axes.plot(*projected.T, "o-", color=colour, **style)
            axes.annotate(label, projected[0], color=colour, **text)
    axes.plot(*lines[:, plane].T, color=INK, lw=2.5, solid_capstyle="round")
    axes.plot(0, 0, "s", color=INK, ms=7)
    axes.set_aspect("equal")
    axes.grid(color="#eeeeee")
    axes.margins(0.08)
