"""Places round an arm, from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import INK, plain

Groups = Mapping[str, tuple[str, Sequence[tuple[str, Array]]]]
"""By name: a colour, and places, each with a label, or "", and points (k, 3) [m] that are joined by lines."""
MANY = 8
"""Places of one kind that are drawn large; more are drawn small."""


@plain
def two_views(arm: Arm, q: Array, groups: Groups) -> Figure:
    """The arm in the posture ``q`` (1, nq) [rad], and places in the axes of its base."""
    figure = Figure(figsize=(10.0, 5.6), layout="constrained")
    lines = ArmLines(arm).corners(q)[0] / MM
    for axes, across, along, title in zip(
        figure.subplots(1, 2), (0, 0), (1, 2), ("against z (from above)", "along y (from the side)"), strict=True
    ):
        for name, (colour, places) in groups.items():
            many = len(places) > MANY
            style = {"color": colour, "ms": 4 if many else 6, "lw": 0.8 if many else 2, "alpha": 0.7 if many else 1}
            for number, (label, points) in enumerate(places):
                u, v = points[:, across] / MM, points[:, along] / MM
                axes.plot(u, v, "o-", label=None if number else name, **style)
                axes.annotate(label, (u[0], v[0]), textcoords="offset points", xytext=(5, 4), fontsize=8, color=colour)
        axes.plot(lines[:, across], lines[:, along], color=INK, lw=2.5, solid_capstyle="round")
        axes.plot(0, 0, "s", color=INK, ms=7)
        axes.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[along]} [mm]", title=f"Seen {title}", aspect="equal")
        axes.grid(color="#eeeeee")
        axes.margins(0.08)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure
