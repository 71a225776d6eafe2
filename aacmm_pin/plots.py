"""Pictures of configurations, accuracy and maps, with matplotlib.

Every function draws on ``ax`` and returns it; ``ax.figure`` is the picture. Without ``ax`` a new pyplot figure is made,
which a notebook shows by itself and a program should close; axes of your own ``matplotlib.figure.Figure`` leave pyplot
alone. Lengths are in mm, volumes in mm³, uncertainties in µm, angles in degrees.
"""

from __future__ import annotations

from typing import Any, Literal

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from aacmm_pin.accuracy import AccuracyVolume
from aacmm_pin.checks import Array, Index
from aacmm_pin.configurations import ConfigurationCircle
from aacmm_pin.errors import AacmmError
from aacmm_pin.pairing import paired
from aacmm_pin.units import DEG, MM, MM3, UM
from aacmm_pin.workspace import WorkspaceMap

BLUE, VERMILLION, GREY, INK = "#0072b2", "#d55e00", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
UNREACHABLE, OUTSIDE_LIMITS = "#d9d9d9", "#cc79a7"
VOLUME_COLOURS, FLEXIBILITY_COLOURS = "viridis", "cividis"
VOLUME_NAME, U_NAME = "accuracy volume", "standard uncertainty u"
VOLUME_LABEL = f"{VOLUME_NAME} [mm³]"
COMPONENT_MARKERS = "os^DvP*h"
"""Shapes of the components that one picture shows."""
MARKERS = 18
"""Number of these markers along a component."""
TUBE_WIDTH = 4.5
"""Width at which tubes of the arm are drawn [points]."""
TUBE_COLOURS = colormaps["Blues"]
BASE_LINE = 0.4
"""Half the length at which joint axis 1 is drawn, in lengths of the longest tube."""

# The arm at a point -----------------------------------------------------------------------------------------------------


def plot_circle(
    circle: ConfigurationCircle, accuracy: AccuracyVolume | None = None, postures: int = 5, ax: Axes3D | None = None
) -> Axes3D:
    """The path of the elbow round the working point, and the arm in a few of its postures.

    Args:
        circle: every configuration at the point.
        accuracy: colours the path; for the configurations within limits.
        postures: number of postures drawn, evenly among the configurations within limits (or among all, where none is).
        ax: three-dimensional axes.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
        AacmmError: ``ax`` is not three-dimensional.
    """
    ax = _axes_3d(ax)
    ax.computed_zorder = False
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    pool = inside if len(inside) else np.arange(len(circle))
    chosen = pool[np.unique(np.linspace(0, len(pool), postures, endpoint=False, dtype=np.intp))] if len(pool) else pool
    drawn = _draw_base(ax, circle)
    if len(circle):
        volume = None if accuracy is None else accuracy.volume / MM3
        drawn += [_draw_postures(ax, circle, chosen), *_draw_elbow(ax, circle, inside, volume)]
    drawn.append(_draw_point(ax, circle))
    _frame(ax, circle, chosen)
    ax.set_title(_title(circle), fontsize=10, pad=-6)
    ax.legend(handles=drawn, loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3, fontsize=8, frameon=False)
    return ax


def _title(circle: ConfigurationCircle) -> str:
    x, y, z = circle.point / MM
    where = f"{circle.arm.name}: {circle.at} at ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    if not len(circle):
        return f"{where}\nout of reach"
    return f"{where}\n{circle.within_limits.sum()} of {len(circle)} configurations within limits"


def _frame(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> None:
    """Labels, one scale for all axes, and room for all that is drawn; the camera looks past the point to the shoulder."""
    shoulder = circle.components.swivel.shoulder
    points = [circle.components.swivel.elbow(circle.q), circle.point[None, :], _base_line(circle)]
    points += [_skeleton(circle, q)[1] for q in circle.q[chosen]]
    low, high = (extreme(np.concatenate(points) / MM, axis=0) for extreme in (np.min, np.max))
    half = np.maximum((high - low) / 2, 0.3 * (high - low).max()) + 10.0
    middle, step = (low + high) / 2, _round_step(2 * float(half.max()) / 4)
    for name, m, h in zip("xyz", middle, half, strict=True):
        getattr(ax, f"set_{name}lim")(m - h, m + h)
        getattr(ax, f"{name}axis").set_major_locator(MultipleLocator(step))
        getattr(ax, f"set_{name}label")(f"{name} [mm]", labelpad=8)
    ax.set_box_aspect(half, zoom=0.98)
    ax.tick_params(labelsize=8)
    x, y, _ = circle.point - shoulder
    ax.view_init(elev=18, azim=float(np.arctan2(y, x)) / DEG + 35)


def _round_step(step: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``step``."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(power * max(f for f in (1.0, 2.0, 2.5, 5.0) if f * power <= step))


def _base_line(circle: ConfigurationCircle) -> Array:
    """Two points of joint axis 1, about the shoulder, (2, 3) [m]."""
    dh = circle.components.swivel.dh
    _, _, z, _ = dh.axes(np.zeros((1, dh.nq)), row=1)
    length = BASE_LINE * max(float(np.abs(dh.a).max()), float(np.abs(dh.d).max()))
    along = z[0 if dh.standard else 1, :, 0]
    return np.asarray(circle.components.swivel.shoulder + np.array([[-length], [length]]) * along)


def _draw_base(ax: Axes3D, circle: ConfigurationCircle) -> list[Line2D]:
    """Joint axis 1 and the shoulder on it."""
    axis: Line2D
    shoulder: Line2D
    (axis,) = ax.plot(*_base_line(circle).T / MM, color=INK, lw=1.0, ls="-.", zorder=3, label="joint axis 1")
    place = circle.components.swivel.shoulder[:, None] / MM
    (shoulder,) = ax.plot(*place, marker="s", ms=7, color=INK, ls="none", zorder=5, label="base (shoulder)")
    return [axis, shoulder]


def _draw_point(ax: Axes3D, circle: ConfigurationCircle) -> Line2D:
    style: dict[str, Any] = {"marker": "*", "ms": 16, "mfc": VERMILLION, "mec": "white", "ls": "none"}
    point: Line2D
    (point,) = ax.plot(*circle.point[:, None] / MM, **style, zorder=10, label="working point")
    return point


def _draw_postures(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> Line2D:
    """Tubes from light to dark, so that each posture can be followed; the artist of the legend."""
    round_: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
    shades = TUBE_COLOURS(np.linspace(0.3, 0.75, len(chosen)))
    for q, shade in zip(circle.q[chosen], shades, strict=True):
        joints, corners = _skeleton(circle, q)
        ax.plot(*corners.T / MM, color=shade, lw=TUBE_WIDTH, zorder=4, **round_)
        ax.plot(*joints.T / MM, color=INK, marker="o", ms=3.5, ls="none", zorder=5)
    middle = shades[len(shades) // 2]
    return Line2D([], [], color=middle, lw=TUBE_WIDTH, marker="o", ms=3.5, mfc=INK, mec=INK, label="arm to the point")


def _skeleton(circle: ConfigurationCircle, q: Array) -> tuple[Array, Array]:
    """Origins of the frames from the base to the working point, and the corners of the line along every d and a [m]."""
    dh = circle.components.swivel.dh
    row = circle.arm.dh_row(circle.at) or dh.rows
    x, _, z, o = (axis[:, :, 0] for axis in dh.axes(q[None, :], row=row))
    corners = [o[0]]
    for i in range(row):
        corners += [o[i] + (dh.d[i] * z[i] if dh.standard else dh.a[i] * x[i]), o[i + 1]]
    return o, np.array(corners)


def _draw_elbow(ax: Axes3D, circle: ConfigurationCircle, inside: Index, volume: Array | None) -> list[Line2D]:
    """The elbow's path: coloured by ``volume`` (n,) [mm³] between configurations within limits, elsewhere grey."""
    elbow = circle.components.swivel.elbow(circle.q) / MM
    start, end = _neighbours(circle)
    pieces = np.stack([elbow[start], elbow[end]], axis=1)
    values = np.full(len(circle), np.nan)
    values[inside] = 0.0 if volume is None else volume
    value = (values[start] + values[end]) / 2
    works = np.isfinite(value)
    legend = []
    if works.any():
        style: dict[str, Any] = {"colors": BLUE} if volume is None else {"cmap": VOLUME_COLOURS, "array": value[works]}
        path = Line3DCollection(pieces[works], linewidths=3.5, zorder=6, **style)
        ax.add_collection3d(path)
        colour = BLUE if volume is None else path.get_cmap()(0.5)
        legend.append(Line2D([], [], color=colour, lw=3.5, label="elbow, within limits"))
        if volume is not None:
            ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
    if not works.all():
        ax.add_collection3d(Line3DCollection(pieces[~works], colors=GREY, linewidths=1.0, zorder=2))
        legend.append(Line2D([], [], color=GREY, lw=1.0, label="elbow, outside limits"))
    return legend


def _neighbours(circle: ConfigurationCircle) -> tuple[Index, Index]:
    """Numbers of the configurations at both ends of every piece of the components, closed or open."""
    start, end = [], []
    for number, curve in enumerate(circle.components.curves, start=1):
        mine = np.flatnonzero(circle.component == number)
        pieces = len(mine) if curve.closed else len(mine) - 1
        start.append(mine[:pieces])
        end.append(np.roll(mine, -1)[:pieces])
    return np.concatenate(start), np.concatenate(end)


# Accuracy at a point ----------------------------------------------------------------------------------------------------


def plot_accuracy_over_theta3(circle: ConfigurationCircle, accuracy: AccuracyVolume, ax: Axes | None = None) -> Axes:
    """Accuracy volume round the circle of θ3, each configuration at (cos θ3, sin θ3), as the source paper draws it.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = paired(circle, accuracy)
    ax = _axes(ax, (6.0, 5.0))
    theta3, component = circle.theta3[inside], circle.component[inside]
    volume = accuracy.volume / MM3
    rank = np.unique(component, return_inverse=True)[1] + 1.0
    size = 60.0 / rank  # several components at one θ3 stay visible as rings within each other
    order = np.argsort(component, kind="stable")
    points = ax.scatter(
        np.cos(theta3)[order], np.sin(theta3)[order], s=size[order], c=volume[order], cmap=VOLUME_COLOURS, zorder=3
    )
    ax.figure.colorbar(points, ax=ax, label=VOLUME_LABEL)
    for angle in range(0, 360, 45):
        c, s = np.cos(angle * DEG), np.sin(angle * DEG)
        ax.plot([0.0, 0.92 * c], [0.0, 0.92 * s], color="#e6e6e6", lw=0.8, zorder=1)
        ax.text(
            0.82 * c, 0.82 * s, f"{angle}°", ha="center", va="center", fontsize=8, color="#5a5a5a", backgroundcolor="white"
        )
    if len(volume):
        _mark_extremes(ax, theta3, volume)
    ax.set(xlabel="cos θ3 [1]", ylabel="sin θ3 [1]", xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), aspect="equal")
    ax.set_title(f"{circle.arm.name}: accuracy over θ3, {accuracy.method}", fontsize=10)
    return ax


def _mark_extremes(ax: Axes, theta3: Array, volume: Array) -> None:
    best, worst = int(np.argmin(volume)), int(np.argmax(volume))
    for k, marker, name in ((best, "v", "smallest"), (worst, "^", "largest")):
        label = f"{name} {volume[k]:.3g} mm³\nat θ3 = {theta3[k] / DEG % 360:.0f}°"
        ax.plot(1.13 * np.cos(theta3[k]), 1.13 * np.sin(theta3[k]), marker, color=VERMILLION, ms=8, ls="none", label=label)
    ax.legend(loc="center", fontsize=8, framealpha=0.9, edgecolor="#e6e6e6")


def plot_accuracy_over_swivel(circle: ConfigurationCircle, accuracy: AccuracyVolume, ax: Axes | None = None) -> Axes:
    """Accuracy volume (left scale) and standard uncertainty of the position (right scale) over the swivel angle.

    Where several components have configurations within limits, each has markers of its own shape.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = paired(circle, accuracy)
    ax = _axes(ax, (7.5, 4.2))
    right_axes = ax.twinx()
    swivel, component = circle.swivel[inside] / DEG, circle.component[inside]
    volume, u = accuracy.volume / MM3, accuracy.u / UM
    if len(np.unique(component)) > 1:
        legend = _draw_components(ax, right_axes, swivel, component, volume, u)
    else:
        legend = [
            *ax.plot(swivel, volume, "o", ms=3.5, color=BLUE, label=VOLUME_NAME),
            *right_axes.plot(swivel, u, "x", ms=3.5, mew=0.9, color=VERMILLION, label=U_NAME),
        ]
    ax.set(xlabel="swivel angle of the elbow, 0 = highest [deg]", xlim=(-180, 180), xticks=range(-180, 181, 60))
    ax.set_ylabel(VOLUME_LABEL, color=BLUE)
    right_axes.set_ylabel(f"{U_NAME} [µm]", color=VERMILLION)
    for axes in (ax, right_axes):
        axes.margins(y=0.12)
        axes.spines["top"].set_visible(False)
    ax.grid(alpha=0.3)
    columns = min(len(legend), 4)
    height = 24 + 14 * ((len(legend) - 1) // columns)
    ax.set_title(f"{circle.arm.name}: accuracy over the swivel angle, {accuracy.method}", fontsize=10, pad=height)
    ax.legend(handles=legend, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, fontsize=9, frameon=False)
    return ax


def _draw_components(ax: Axes, right: Axes, swivel: Array, component: Index, volume: Array, u: Array) -> list[Line2D]:
    """Both quantities with small points throughout and, now and then, a marker of the component; handles for the legend."""
    for axes, values, colour in ((ax, volume, BLUE), (right, u, VERMILLION)):
        axes.plot(swivel, values, ".", ms=1.5, color=colour)
    legend = [Line2D([], [], color=colour, lw=3, label=name) for colour, name in ((BLUE, VOLUME_NAME), (VERMILLION, U_NAME))]
    numbers = np.unique(component)
    for place, number in enumerate(numbers):
        mine = np.flatnonzero(component == number)
        mine = mine[np.argsort(swivel[mine], kind="stable")]
        step = max(1, len(mine) // MARKERS)
        some = mine[place * step // len(numbers) :: step]  # shifted, so that coincident components do not hide each other
        marker = COMPONENT_MARKERS[place % len(COMPONENT_MARKERS)]
        ax.plot(swivel[some], volume[some], marker, ms=6, color=BLUE)
        right.plot(swivel[some], u[some], marker, ms=6, mfc="none", color=VERMILLION)
        label = f"component {number}"
        legend.append(Line2D([], [], marker=marker, ms=6, color=GREY, mec=INK, ls="none", label=label))
    return legend


def plot_budget(
    accuracy: AccuracyVolume,
    by: Literal["parameter", "joint", "kind"] = "parameter",
    ax: Axes | None = None,
    most: int = 12,
) -> Axes:
    """Uncertainty budget as bars: share of the variance, with the standard uncertainty at the end of each.

    Args:
        accuracy: at one configuration or more.
        by: what the bars stand for.
        ax: axes.
        most: at most this many bars, those of the largest size (correlated parameters may have negative shares); what is
            left is one bar "rest".

    Raises:
        AacmmError: ``most`` is below 1, or ``accuracy`` has no configuration.
    """
    if most < 1 or not len(accuracy.q):
        raise AacmmError(f"most is {most} and accuracy has {len(accuracy.q)} configurations; expected at least 1 of each")
    table = _shortened(accuracy.budget(by), by, most, accuracy.sources.correlation is None)
    ax = _axes(ax, (7.0, 0.9 + 0.32 * len(table)))
    share = 100 * table["share"].to_numpy()
    colours = [GREY if name.startswith("rest") else BLUE for name in table["name"]]
    bars = ax.barh(table["name"], share, color=colours, height=0.7)
    own = ["" if np.isnan(u) else f",  {_length_um(u * MM / UM)}" for u in table["u_mm"]]
    labels = [f"{s:.1f} %{u}" for s, u in zip(share, own, strict=True)]
    ax.bar_label(bars, labels, padding=4, fontsize=8)
    ax.invert_yaxis()
    room = 0.28 * (share.max() - min(share.min(), 0.0))  # for the labels
    ax.set_xlim(share.min() - 1.5 * room if share.min() < 0 else 0, share.max() + room)
    ax.set_xlabel("share of the variance of the position [%]; at the bars also u [µm]")
    ax.set_title(f"{accuracy.sources.arm.name} at {accuracy.sources.at}: uncertainty budget by {by}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _shortened(budget: pd.DataFrame, by: str, most: int, independent: bool) -> pd.DataFrame:
    """Columns name, share, u_mm: the largest ``most`` rows, without those that have no part; the rest as one, without u
    (nan) where it is not the root of a sum of squares.
    """
    budget = budget[budget["share"] != 0].sort_values("share", ascending=False, key=abs, ignore_index=True, kind="stable")
    names = [("joint " if by == "joint" else "") + str(name) if pd.notna(name) else "whole arm" for name in budget[by]]
    table = pd.DataFrame({"name": names, "share": budget["share"], "u_mm": budget["u_mm"]})
    if len(table) <= most:
        return table
    kept, left = table.head(most - 1), table.iloc[most - 1 :]
    u = float(np.sqrt((left["u_mm"] ** 2).sum())) if independent else np.nan
    rest = {"name": f"rest ({len(left)})", "share": left["share"].sum(), "u_mm": u}
    return pd.concat([kept, pd.DataFrame([rest])], ignore_index=True)


def _length_um(value: float) -> str:
    return f"{value:.1f} µm" if value >= 0.1 else f"{value:.1g} µm"


# Maps -------------------------------------------------------------------------------------------------------------------


def plot_flexibility(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Flexibility ζ over the half-plane through joint axis 1; unreachable cells are grey."""
    ax = _draw_map(map_, "flexibility", FLEXIBILITY_COLOURS, "flexibility ζ [1]", ax, Normalize(0.0, 1.0))
    ax.set_title(f"{map_.data.attrs['arm']}: flexibility, {map_.sectors} sectors", fontsize=10)
    return ax


def plot_comprehensive(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Comprehensive accuracy (eq. 15 of Xu You et al. 2019) over the half-plane through joint axis 1."""
    ax = _draw_map(map_, "comprehensive_mm3", VOLUME_COLOURS, "comprehensive accuracy volume [mm³]", ax, None)
    ax.set_title(f"{map_.data.attrs['arm']}: comprehensive accuracy, {map_.data.attrs['method']}", fontsize=10)
    return ax


def plot_uncertainty(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Smallest standard uncertainty of the position [µm] that a posture gives, over the half-plane through joint axis 1."""
    label = f"smallest {U_NAME} [µm]"
    ax = _draw_map(map_, "smallest_u_mm", VOLUME_COLOURS, label, ax, None, scale=MM / UM)
    ax.set_title(f"{map_.data.attrs['arm']}: standard uncertainty in the best posture", fontsize=10)
    return ax


def _draw_map(
    map_: WorkspaceMap,
    name: str,
    colours: str,
    label: str,
    ax: Axes | None,
    norm: Normalize | None,
    scale: float = 1.0,
) -> Axes:
    ax = _axes(ax, (5.4, 6.6))
    x, z = _edges(map_.data["x_mm"].values), _edges(map_.data["z_mm"].values)
    reachable = map_.data["reachable"].values.astype(bool)
    values = np.where(reachable, scale * map_.data[name].values, np.nan)
    image = ax.pcolormesh(x, z, np.ma.masked_invalid(values).T, cmap=colours, norm=norm)
    legend = []
    for mask, colour, text in (
        (~reachable, UNREACHABLE, "out of reach"),
        (reachable & np.isnan(values), OUTSIDE_LIMITS, "in reach, no sector within limits"),
    ):
        if mask.any():
            _fill(ax, x, z, mask, ListedColormap([colour]))
            legend.append(Patch(color=colour, label=text))
    ax.figure.colorbar(image, ax=ax, label=label)
    ax.set(xlabel="distance from joint axis 1, x [mm]", ylabel="z of the base [mm]", aspect="equal")
    if legend:
        ax.legend(handles=legend, loc="upper center", bbox_to_anchor=(0.5, -0.09), fontsize=8, frameon=False)
    return ax


def _fill(ax: Axes, x: Array, z: Array, mask: NDArray[np.bool_], colour: Colormap) -> None:
    ax.pcolormesh(x, z, np.ma.masked_array(np.zeros(mask.shape), ~mask).T, cmap=colour)


def _edges(centres: Array) -> Array:
    """Edges of equal cells from their centres [mm]; a single cell is drawn 1 mm wide."""
    step = (centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else 1.0
    return np.asarray(centres[0] + (np.arange(len(centres) + 1) - 0.5) * step)


# Axes -------------------------------------------------------------------------------------------------------------------


def _axes(ax: Axes | None, size: tuple[float, float]) -> Axes:
    return ax if ax is not None else plt.figure(figsize=size, layout="constrained").add_subplot()


def _axes_3d(ax: Axes3D | None) -> Axes3D:
    if ax is None:
        return plt.figure(figsize=(7.2, 6.6), layout="constrained").add_subplot(projection="3d")
    if not isinstance(ax, Axes3D):
        raise AacmmError(f"ax is {type(ax).__name__}, expected three-dimensional axes: add_subplot(projection='3d')")
    return ax


__all__ = [
    "plot_accuracy_over_swivel",
    "plot_accuracy_over_theta3",
    "plot_budget",
    "plot_circle",
    "plot_comprehensive",
    "plot_flexibility",
    "plot_uncertainty",
]
