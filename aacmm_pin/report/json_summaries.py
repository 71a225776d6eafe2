"""Results as plain dictionaries for JSON: what ``aacmm-pin accuracy --json`` and ``aacmm-pin map
--json`` write.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import notes_in_json
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy import AccuracyVolume, ErrorSources, LengthUncertainty, WorkspaceMap, paired
from aacmm_pin.accuracy.comprehensive_accuracy import comprehensive_accuracy
from aacmm_pin.postures import Flexibility, PosturesAtPoint, ReachingPostures

ACCURACY_SCHEMA = "aacmm-pin/accuracy/1"
LENGTH_SCHEMA = "aacmm-pin/length/1"
MAP_SCHEMA = "aacmm-pin/map/1"
JSON_DECIMALS = 9
"""Decimals kept of lengths and angles [mm, deg]: hides what binary fractions do to decimal input,
and nothing else.
"""


def accuracy_summary(
    circle: PosturesAtPoint, accuracy: AccuracyVolume, sectors: int = 12
) -> dict[str, Any]:
    """Schema ``aacmm-pin/accuracy/1``: accuracy over the configurations of ``circle`` that are
    within limits.

    ``best`` and ``worst`` are by accuracy volume, ``smallest_u`` and ``largest_u`` by standard
    uncertainty; the budget is the mean over the configurations; ``taken_as_exact`` names the
    parameters for which no uncertainty is stated, ``not_included`` the causes of error that are
    left out, see :class:`aacmm_pin.accuracy.tip_sensitivity.ErrorSources`, ``unexplained`` what the
    arm's calibration left, "" where nothing.
    Numbers that do not exist are None: without a configuration all of them, and ``reason`` says
    why; for an arm that came as URDF swivel angles, sectors (an empty list) and the comprehensive
    accuracy, whose weights are those of SINO6. ``arc_fraction`` of
    :func:`aacmm_pin.postures.general_ik` is of the way along the curves, and None for single
    postures; what was asked for, how it was searched, and what is to be known besides, stand in
    ``conditions``, ``search``, ``notes``.

    Args:
        circle: every configuration at the point.
        accuracy: ``circle_accuracy(circle)``, or that of an extended model of the circle's arm.
        sectors: number of sectors for the flexibility.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside, sources = paired(circle, accuracy), accuracy.sources
    summary: dict[str, Any] = {"schema": ACCURACY_SCHEMA, "arm": circle.arm.name}
    summary |= {"point_mm": _rounded(circle.point / MM), "at": circle.at}
    summary |= {"method": accuracy.method, "configurations": len(inside)}
    summary["flexibility"] = _flexibility(circle.flexibility(sectors))
    summary["volume_mm3"] = _volumes(circle, accuracy)
    summary["u_mm"] = _spread(accuracy.u / MM)
    summary["largest_deviation_mm"] = None
    if sources.bounded:
        summary["largest_deviation_mm"] = _spread(accuracy.largest_deviation / MM)
    summary |= _postures(circle, accuracy)
    summary["budget"] = _budget(accuracy) if len(inside) else []
    summary |= _left_out(sources) | {"complete": circle.complete} | notes_in_json(circle.notes)
    if isinstance(circle, ReachingPostures):
        summary |= _search(circle)
    if not len(inside):
        summary["reason"] = circle.reason or "no posture is within the joint limits"
    return summary


def _flexibility(flexibility: Flexibility) -> dict[str, Any]:
    fraction = _number(flexibility.arc_fraction)
    sectors = list(flexibility.sectors)
    return {"zeta": _number(flexibility.zeta), "sectors": sectors, "arc_fraction": fraction}


def _left_out(sources: ErrorSources) -> dict[str, Any]:
    """What an accuracy does not contain."""
    names = {"taken_as_exact": sources.taken_as_exact, "not_included": sources.not_included}
    lists: dict[str, Any] = {name: list(some) for name, some in names.items()}
    return lists | {"unexplained": sources.arm.unexplained}


def length_summary(
    a: PosturesAtPoint, b: PosturesAtPoint, length: LengthUncertainty
) -> dict[str, Any]:
    """Schema ``aacmm-pin/length/1``: uncertainty of the distance of two points over the pairs of
    postures within limits.
    """
    summary: dict[str, Any] = {"schema": LENGTH_SCHEMA, "arm": a.arm.name}
    summary |= {"from_mm": _rounded(a.point / MM), "to_mm": _rounded(b.point / MM), "at": a.at}
    summary |= {"length_mm": float(length.length / MM), "pairs": length.u.size}
    summary["u_mm"] = _spread(length.u.ravel() / MM)
    summary["best"] = _pair(length, int(length.u.argmin()))
    summary["worst"] = _pair(length, int(length.u.argmax()))
    return summary | {"budget": _budget(length)} | _left_out(length.sources)


def _pair(length: LengthUncertainty, number: int) -> dict[str, Any]:
    i, j = length.pair(number)
    angles = {"from_theta_deg": _rounded(length.q_a[i] / DEG)}
    angles["to_theta_deg"] = _rounded(length.q_b[j] / DEG)
    return {**angles, "u_mm": float(length.u[i, j] / MM)}


def map_summary(map_: WorkspaceMap) -> dict[str, Any]:
    """Schema ``aacmm-pin/map/1``: sizes of a map and how many reachable cells have how many working
    sectors.

    ``not_included``, only where there are some, names the causes of error that are left out of the
    accuracies.
    """
    data = map_.data
    box = np.asarray(data.attrs["extent_mm"])
    cells = [int(data.sizes[axis]) for axis in ("x_mm", "z_mm")]
    summary: dict[str, Any] = {"schema": MAP_SCHEMA, "arm": str(data.attrs["arm"])}
    summary |= {"at": str(data.attrs["working_point"])}
    if "stylus_axis" in data.attrs:
        summary["stylus_axis"] = _rounded(np.asarray(data.attrs["stylus_axis"]))
    summary |= {"cells": cells, "sectors": map_.sectors}
    summary["extent_mm"] = {"x": _rounded(box[:2]), "z": _rounded(box[2:])}
    by_sectors = map_.working_sectors()
    summary["working_sectors"] = {str(count): number for count, number in by_sectors.items()}
    summary |= {"unreachable": map_.unreachable, "seconds": round(map_.seconds, 3)}
    if map_.incomplete:
        summary["incomplete"] = map_.incomplete
    if map_.not_included:
        summary["not_included"] = list(map_.not_included)
    return summary


def accuracy_table(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> pd.DataFrame:
    """The configurations within limits as in :meth:`PosturesAtPoint.to_frame`, with their accuracy
    behind.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = circle.to_frame().iloc[paired(circle, accuracy)].reset_index(drop=True)
    return inside.join(accuracy.to_frame().filter(regex="_mm"))


def _search(postures: ReachingPostures) -> dict[str, Any]:
    search = postures.search
    starts = {"starts": search.starts, "arrived": search.arrived}
    summary: dict[str, Any] = {"conditions": postures.conditions.count}
    summary["components"] = int(postures.component.max(initial=0))
    return summary | {"search": {**starts, "unseen_at_most": search.unseen}}


def _volumes(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> dict[str, float | None]:
    volume = accuracy.volume / MM3
    weighted = circle.arm.dh is not None  # by the θ3 of an arm built like SINO6
    comprehensive = (
        comprehensive_accuracy(volume, accuracy.q[:, 2], circle.point) if weighted else math.nan
    )
    return _spread(volume) | {"comprehensive": _number(comprehensive)}


def _spread(values: Array) -> dict[str, float | None]:
    found = [math.nan] * 3
    if len(values):
        found = [values.min(), np.median(values), values.max()]
    least, median, most = map(_number, found)
    return {"min": least, "median": median, "max": most}


def _postures(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> dict[str, dict[str, Any]]:
    """The postures with the smallest and largest volume and u."""
    volume, u = accuracy.volume, accuracy.u
    ends = {"best": volume, "worst": -volume, "smallest_u": u, "largest_u": -u}
    if not len(accuracy.q):
        nothing = dict.fromkeys(("theta_deg", "swivel_deg", "volume_mm3", "u_mm"))
        return {name: dict(nothing) for name in ends}
    swivel = circle.swivel[circle.within_limits] / DEG
    return {name: _posture(accuracy, swivel, int(of.argmin())) for name, of in ends.items()}


def _posture(accuracy: AccuracyVolume, swivel: Array, number: int) -> dict[str, Any]:
    """A posture with its accuracy; ``swivel`` of all postures [deg]."""
    own = _number(swivel[number])
    posture: dict[str, Any] = {"theta_deg": _rounded(accuracy.q[number] / DEG)}
    posture["swivel_deg"] = None if own is None else round(own, JSON_DECIMALS) + 0.0
    posture["volume_mm3"] = float(accuracy.volume[number] / MM3)
    return posture | {"u_mm": float(accuracy.u[number] / MM)}


def _budget(accuracy: AccuracyVolume | LengthUncertainty) -> list[dict[str, Any]]:
    columns = ["parameter", "joint", "share", "u_mm"]
    table = accuracy.budget("parameter")[columns].astype(object)
    return cast("list[dict[str, Any]]", table.where(table.notna(), None).to_dict("records"))


def _rounded(values: Array) -> list[float]:
    return [round(float(value), JSON_DECIMALS) + 0.0 for value in values]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
