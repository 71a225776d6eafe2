"""Maps of flexibility and accuracy over the half-plane y = 0, x ≥ 0, rotated by joint 1."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, Index, Mask, chunks, spread_angles, vector, whole
from aacmm_pin._support.display import Note, Shown, report
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.plausible import SMALLEST_ARM
from aacmm_pin._support.progress import bar
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin._support.workers import Workers, results
from aacmm_pin.accuracy.comprehensive_accuracy import configuration_weights
from aacmm_pin.accuracy.tip_sensitivity import caveats, omission
from aacmm_pin.accuracy.volume import METHODS, Method, accuracy_volume
from aacmm_pin.arm import AT_LIMIT, Arm
from aacmm_pin.effects import Conditions, ErrorModel, GivenModel, loaded
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError
from aacmm_pin.postures import (
    WRIST,
    WRIST_ROW,
    Wrist,
    box_of_wrist,
    directed_stylus,
    reach_of_points,
    sector_centres,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

CELLS_AT_ONCE = 768
TIP_CELLS_AT_ONCE = 48
"""A cell of the tip takes a hundred times as long as one of the wrist."""
MAP = "a map of the workspace"
PROBES = 64
"""Postures whose accuracy identifies a model with its causes and conditions."""
UNITS = {"1": 1.0, "mm": MM, "mm3": MM3, "degree": DEG}

Quantity = Literal[
    "comprehensive_mm3",
    "best_mm3",
    "worst_mm3",
    "smallest_u_mm",
    "largest_u_mm",
    "flexibility",
    "arc_fraction",
    "working_sectors",
]
"""Names of the :data:`VARIABLES` that figures and pages show."""
MARGIN = 1e-3
"""Of the default box beyond the reach, in parts of its size."""

MAP_AXES = {"x_mm": "distance from joint axis 1, x", "z_mm": "z of the base"}
"""Axes of cells, with long names."""
NEGLIGIBLE_SHIFT = 1e-6
"""Shorter distances do not count [m]."""
OUTWARDS_OF_BOX = np.array([-1.0, 1.0, -1.0, 1.0])
"""Of the least and largest x and z."""


class Variable(NamedTuple):
    """A variable of a map.

    Attributes:
        name: in the file, and in the results of :func:`_cells`.
        unit: key of :data:`UNITS`.
        text: long name, also of figures and pages.
        kind: type of its numbers.
        more: dimensions after those of the cells.
        greatest: largest possible value, at which the colours of a figure end; None for any.
    """

    name: str
    unit: str
    text: str
    kind: type = float
    more: tuple[str, ...] = ()
    greatest: float | None = None


VARIABLES = (
    Variable("reachable", "1", "1 if within reach (limits ignored)", np.int8),
    Variable("complete", "1", "0 if postures are missing", np.int8),
    Variable("sector_works", "1", "1 if within the limits", np.int8, ("sector",)),
    Variable("working_sectors", "1", "working sectors", np.int32),
    Variable("flexibility", "1", "flexibility ζ", greatest=1.0),
    Variable("arc_fraction", "1", "flexibility by arc", greatest=1.0),
    Variable("comprehensive_mm3", "mm3", "comprehensive accuracy volume"),
    Variable("best_mm3", "mm3", "smallest accuracy volume"),
    Variable("worst_mm3", "mm3", "largest accuracy volume"),
    Variable("smallest_u_mm", "mm", "smallest standard uncertainty u"),
    Variable("largest_u_mm", "mm", "largest standard uncertainty u"),
    Variable("smallest_u_theta_deg", "degree", "posture with the smallest u", more=("joint",)),
    Variable("best_theta_deg", "degree", "posture with the smallest volume", more=("joint",)),
    Variable("worst_theta_deg", "degree", "posture with the largest volume", more=("joint",)),
)
QUANTITIES = {
    variable.name: variable for variable in VARIABLES if variable.name in get_args(Quantity)
}
"""Variables to plot, by name."""


@dataclass(frozen=True, eq=False)
class WorkspaceMap(Shown):
    """A map of flexibility and accuracy over a half-plane through joint axis 1.

    Attributes:
        data: arrays over the cell centres ``x_mm`` and ``z_mm``: ``reachable``,
            ``working_sectors``, ``flexibility``, ``arc_fraction``, ``comprehensive_mm3``,
            ``best_mm3``, ``worst_mm3``, ``best_theta_deg``, ``worst_theta_deg`` (by volume),
            ``smallest_u_mm``, ``largest_u_mm``, ``smallest_u_theta_deg`` (by standard uncertainty),
            ``sector_works``. Cells out of reach have NaN or 0. Volume and uncertainty may rank
            postures differently.
        seconds: of the computation [s].
    """

    data: xr.Dataset
    seconds: float

    @property
    def axes(self) -> tuple[xr.DataArray, ...]:
        """Cell centres along x and z [mm]."""
        return tuple(self.data[name] for name in MAP_AXES)

    @property
    def sectors(self) -> int:
        """Number of sectors of the swivel angle."""
        return int(self.data.sizes["sector"])

    @property
    def caveats(self) -> tuple[Note, ...]:
        """A note on reachable cells without sectors, if any."""
        no_sectors = np.isnan(self.data["flexibility"].values)
        without = int(np.sum(self._reachable & no_sectors))
        return (Note("cells_without_sectors", {"cells": without}),) if without else ()

    def working_sectors(self) -> dict[int, int]:
        """Return the number of reachable cells by number of working sectors."""
        working = self.data["working_sectors"].values[self._reachable]
        counts = np.bincount(working, minlength=self.sectors + 1)
        return dict(enumerate(counts.tolist()))

    @property
    def _reachable(self) -> Mask:
        return self.data["reachable"].values.astype(bool)

    @property
    def unreachable(self) -> int:
        """Number of cells out of reach, even without joint limits."""
        return int(np.sum(~self._reachable))

    @property
    def incomplete(self) -> int:
        """Number of cells whose search did not find all postures."""
        return int((self.data["complete"] == 0).sum())

    @property
    def not_included(self) -> tuple[str, ...]:
        """Labels of causes that the accuracies do not include."""
        labels = str(self.data.attrs["not_included"])
        return tuple(labels.split("; ")) if labels else ()

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save as netCDF (classic, 64-bit offsets), whole or not at all, for xarray, MATLAB, R,
        ncdump.

        Raises:
            OutputError: ``path`` exists and ``force`` is False, or the file cannot be written.
        """
        with whole_file(path, force) as temporary:
            self.data.to_netcdf(temporary, engine="scipy", format="NETCDF3_64BIT")

    def plot(self, quantity: Quantity = "comprehensive_mm3", ax: Axes | None = None) -> Axes:
        """Plot one quantity; see :func:`aacmm_pin.report.plots.plot_map`.

        Raises:
            UnknownNameError: the quantity is unknown.
        """
        return cast("Axes", report().plots.plot_map(self, quantity, ax))

    def __str__(self) -> str:
        x, z = (axis.size for axis in self.axes)
        full = self.working_sectors()[self.sectors]
        arm = f"{self.data.attrs['arm']} at {self.data.attrs['working_point']}"
        where = f"The map of {arm} has {x} × {z} cells of {self.sectors} sectors"
        unknown = f"; postures may be missing in {self.incomplete} cells" if self.incomplete else ""
        if self.unreachable == x * z:
            return f"{where}, all out of reach{unknown}"
        mean = float(self.data["flexibility"].mean())
        flexibility = f"; the mean flexibility is {mean:.3f}" if np.isfinite(mean) else ""
        return (
            f"{where}, of which {self.unreachable} are out of reach and {full} have postures in "
            f"all sectors{flexibility}{unknown}{omission(self.not_included)}"
        )


def map_workspace(
    model: GivenModel,
    cells: tuple[int, int] = (48, 48),
    sectors: int = 12,
    *,
    extent: ArrayLike | None = None,
    conditions: Conditions | None = None,
    method: Method = "zonotope",
    workers: Workers = 1,
    progress: bool = True,
    axis: ArrayLike | None = None,
) -> WorkspaceMap:
    """Compute flexibility, comprehensive accuracy, and best and worst posture over the half-plane.

    The map is for the wrist, with joints after joint 4 as near to 0 as limits permit, or with
    ``axis`` for the tip.

    Args:
        model: arm, perhaps with causes of error; its first five DH rows are joints.
        cells: number along x and z.
        sectors: number, each represented by its centre. If several postures within
            limits have this swivel angle, the most accurate counts.
        extent: minimum and maximum of x, then of z, ``(4,)`` [m]; default the reach without joint
            limits.
        conditions: one record for the map; see :func:`accuracy_volume`.
        method: of the volumes; not ``monte-carlo``.
        workers: processes, or a ``concurrent.futures.Executor``.
        progress: show a bar in a notebook or on stderr.
        axis: direction of the stylus in the half-plane y = 0 of the base ``(3,)``, of any length;
            rotated about z in others. The arm must have six joints and a stylus axis.

    Raises:
        AacmmError: a size below 1, ``extent`` in wrong order or with negative x, or no uncertainty.
        ShapeError: more than one record of ``conditions``.
        UnknownNameError: not a method of a map.
        UnsupportedArmError: no DH table with the required joints; see :func:`accuracy_volume`.
    """
    started = time.perf_counter()
    if min(cells) < 1:
        raise AacmmError(f"cells are {cells}; expected at least 1 along x and along z")
    whole(cells[0] * cells[1], 1, "cells")
    sectors = whole(sectors, 1, "sectors")
    model = loaded(model)
    model = model.restricted_to_known_range() if isinstance(model, ErrorModel) else model
    arm = ErrorModel.arm_of(model)
    direction = None
    if axis is not None:
        _, direction = directed_stylus(arm, axis)
    box = _extent(arm, extent, direction)
    methods: list[str] = [name for name in METHODS if name != "monte-carlo"]
    if method not in methods:
        raise UnknownNameError("method of a map", method, methods)
    if conditions is not None and conditions.n != 1:
        raise ShapeError(f"conditions have {conditions.n} records; expected 1, for all cells")
    # What the first cell would refuse is refused early.
    q = np.clip(spread_angles(PROBES, arm.nq), *arm.limits.T)
    at = WRIST if axis is None else arm.tip
    probe = accuracy_volume(model, q, conditions=conditions, at=at, method=method)
    x = _middles(box[0], box[1], cells[0])
    z = _middles(box[2], box[3], cells[1])
    points = np.stack(np.meshgrid(x, 0.0, z, indexing="ij"), axis=-1).reshape(-1, 3)
    parts = chunks(len(points), CELLS_AT_ONCE if axis is None else TIP_CELLS_AT_ONCE)
    work = partial(_cells, model, conditions, sectors, method, direction)
    arrays_of_part = dict[int, dict[str, Array]]()
    cells_bar = bar(progress, f"map of {arm.name}", "cell", total=len(points))
    jobs = (points[part] for part in parts)
    with cells_bar as progress_bar, results(work, jobs, workers) as numbered_results:
        for number, arrays in numbered_results:
            arrays_of_part[number] = arrays
            progress_bar.update(len(arrays["reachable"]))
    in_order = [arrays_of_part[number] for number in range(len(parts))]
    merged = {name: np.concatenate([arrays[name] for arrays in in_order]) for name in in_order[0]}
    seconds = time.perf_counter() - started
    data = _dataset(merged, x, z, arm.nq)
    working_point: dict[str, Any] = {"working_point": probe.sources.at}
    if direction is None:
        working_point["rest_deg"] = (Wrist.of_arm(arm, MAP).rest / DEG).tolist()
    else:
        working_point["stylus_axis"] = direction.tolist()
    all_caveats = (*WorkspaceMap(data, seconds).caveats, *map_caveats(arm, axis))
    attributes = {
        "schema": "aacmm-pin/map/1",
        "arm": arm.name,
        "source": arm.source,
        "method": method,
        "extent_mm": (box / MM).tolist(),
        "seconds": seconds,
        **working_point,
        "caveats": "; ".join(map(str, all_caveats)),
        "not_included": "; ".join(probe.not_included),
    }
    return WorkspaceMap(data.assign_attrs(attributes), seconds)


def _cells(
    model: Arm | ErrorModel,
    conditions: Conditions | None,
    sectors: int,
    method: Method,
    axis: Array | None,
    points: Array,
) -> dict[str, Array]:
    """Values of cells with centres at ``points`` (n, 3) [m], by the names of :data:`VARIABLES`, in
    m, m³ and rad.
    """
    arm = ErrorModel.arm_of(model)
    reach = reach_of_points(arm, points, sectors, MAP, axis)
    working = reach.sectors
    q = working.q
    arrays: dict[str, Any] = {
        "reachable": reach.reachable,
        "complete": reach.complete,
        "sector_works": working.working,
        "working_sectors": working.working.sum(axis=1),
        "flexibility": working.zeta,
        "arc_fraction": reach.arc_fraction,
    }
    for variable in VARIABLES:
        shape = (len(points), arm.nq) if variable.more else len(points)
        arrays.setdefault(variable.name, np.full(shape, np.nan))
    if not len(q):
        return arrays
    at = WRIST if axis is None else arm.tip
    accuracy = accuracy_volume(model, q, conditions=conditions, at=at, method=method)
    volume, u = accuracy.volume, accuracy.u
    best = _smallest(working.point * sectors + working.sector, volume)
    cell = working.point[best]
    weights = configuration_weights(q[best, 2], points[cell], cell)
    arrays["comprehensive_mm3"][cell] = np.bincount(cell, weights * volume[best])[cell]
    for name, posture, values in (
        ("best_mm3", "best_theta_deg", volume),
        ("worst_mm3", "worst_theta_deg", -volume),
        ("smallest_u_mm", "smallest_u_theta_deg", u),
        ("largest_u_mm", None, -u),
    ):
        smallest = _smallest(working.point, values)
        cells = working.point[smallest]
        arrays[name][cells] = np.abs(values[smallest])
        if posture is not None:
            arrays[posture][cells] = q[smallest]
    return arrays


def _smallest(groups: Index, values: Array) -> Index:
    """The row of the smallest value (n,) of each group (n,)."""
    order = np.lexsort((values, groups))
    _, first = np.unique(groups[order], return_index=True)
    return order[first]


def _extent(arm: Arm, extent: ArrayLike | None, axis: Array | None) -> Array:
    """As stated, else around the reach, in round numbers (4,) [m]."""
    wrist = Wrist.of_arm(arm, MAP) if axis is None else Wrist.of(arm.require_dh(MAP, revolute=True))
    if extent is None:
        reached = box_of_wrist(wrist)
        if axis is not None:
            q = spread_angles(PROBES, arm.nq)
            wrist_to_tip = np.linalg.norm(arm.positions(q) - arm.positions(q, WRIST), axis=1)
            reached += OUTWARDS_OF_BOX * (wrist_to_tip.max() + 2.0 * wrist.lever)
        _, farthest, lowest, highest = reached.tolist()
        size = max(farthest, highest - lowest)
        if size < SMALLEST_ARM:
            raise AacmmError(
                f"{arm.name}: no joint moves the wrist; expected an arm with a wrist that moves"
            )
        step = 10.0 ** (math.floor(math.log10(size)) - 2)
        margin = MARGIN * size
        right = math.ceil((farthest + margin) / step)
        bottom = math.floor((lowest - margin) / step)
        top = math.ceil((highest + margin) / step)
        return np.array([0.0, right, bottom, top]) * step
    box = vector(extent, 4, "extent", "m")
    if not (0 <= box[0] < box[1] and box[2] < box[3]):
        raise AacmmError(f"extent is {(box / MM).tolist()} mm; expected 0 ≤ X0 < X1 and Z0 < Z1")
    return box


def map_caveats(arm: Arm, axis: ArrayLike | None = None) -> tuple[Note, ...]:
    """Notes on why the half-plane is not the whole workspace, and on what uncertainties do not
    include; ``axis`` as in :func:`map_workspace`.
    """
    notes: list[Note] = []
    if axis is None:
        wrist = Wrist.of_arm(arm, MAP)
        notes += wrist.notes
        angles = enumerate(wrist.rest / DEG, start=WRIST_ROW)
        held = [f"joint {number} at {angle:.4g}°" for number, angle in angles if angle]
        if held:
            notes.append(Note("joints_held", {"joints": " and ".join(held)}))
    lower, upper = arm.limits[0]
    if upper - lower < 2 * np.pi - AT_LIMIT:
        notes.append(Note("first_joint_limited"))
    first = arm.require_dh(MAP, WRIST_ROW, revolute=True).chain.links()[0]
    if np.abs(first[:2, 2:]).max() > NEGLIGIBLE_SHIFT:
        notes.append(Note("first_axis_off_z"))
    if abs(arm.up[2]) < 1 - 1e-12:
        notes.append(Note("gravity_off_first_axis"))
    return (*notes, *caveats(arm, arm.without_uncertainty))


def _middles(low: float, high: float, count: int) -> Array:
    return np.linspace(low, high, 2 * count + 1)[1::2]


def _dataset(merged: dict[str, Array], x: Array, z: Array, joints: int) -> xr.Dataset:
    import xarray as xr

    axes = zip(MAP_AXES.items(), (x, z), strict=True)
    variables = {}
    for variable in VARIABLES:
        values: Array = merged[variable.name].astype(variable.kind)
        if variable.unit != "1":
            values = values / UNITS[variable.unit]
        dims = (*MAP_AXES, *variable.more)
        attrs = {"units": variable.unit, "long_name": variable.text}
        shaped = values.reshape(len(x), len(z), *values.shape[1:])
        variables[variable.name] = (dims, shaped, attrs)
    swivel = {"units": "degree", "long_name": "swivel of the sector's centre"}
    coordinates = {
        **{name: (name, at / MM, {"units": "mm", "long_name": text}) for (name, text), at in axes},
        "sector_deg": ("sector", sector_centres(merged["sector_works"].shape[1]) / DEG, swivel),
        "joint": ("joint", np.arange(1, joints + 1, dtype=np.int32)),
    }
    return xr.Dataset(variables, coordinates)
