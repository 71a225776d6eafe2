"""Results as plain dictionaries for JSON: what ``aacmm-pin accuracy --json`` and ``aacmm-pin map
--json`` write.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import notes_in_json
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy.comprehensive_accuracy import comprehensive_accuracy
from aacmm_pin.accuracy.length import LengthUncertainty
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.postures.general_ik import ReachingPostures
from aacmm_pin.postures.postures_at_point import PosturesAtPoint

ACCURACY_SCHEMA = "aacmm-pin/accuracy/1"
LENGTH_SCHEMA = "aacmm-pin/length/1"
MAP_SCHEMA = "aacmm-pin/map/1"
DIGITS = 9
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
    inside = paired(circle, accuracy)
    flexibility = circle.flexibility(sectors)
    summary: dict[str, Any] = {
        "schema": ACCURACY_SCHEMA,
        "arm": circle.arm.name,
        "point_mm": _rounded(circle.point / MM),
        "at": circle.at,
        "method": accuracy.method,
        "configurations": len(inside),
        "flexibility": {
            "zeta": _number(flexibility.zeta),
            "sectors": list(flexibility.sectors),
            "arc_fraction": _number(flexibility.arc_fraction),
        },
        "volume_mm3": _volumes(circle, accuracy),
        "u_mm": _spread(accuracy.u / MM),
        "largest_deviation_mm": _spread(accuracy.largest_deviation / MM)
        if accuracy.sources.bounded
        else None,
        **_postures(circle, accuracy),
        "budget": _budget(accuracy) if len(inside) else [],
        "taken_as_exact": list(accuracy.sources.taken_as_exact),
        "not_included": list(accuracy.not_included),
        "unexplained": accuracy.sources.arm.unexplained,
    }
    summary |= {"complete": circle.complete} | notes_in_json(circle.notes)
    if isinstance(circle, ReachingPostures):
        summary |= _search(circle)
    if not len(inside):
        summary["reason"] = circle.reason or "no configuration is within the joint limits"
    return summary


def length_summary(
    a: PosturesAtPoint, b: PosturesAtPoint, length: LengthUncertainty
) -> dict[str, Any]:
    """Schema ``aacmm-pin/length/1``: uncertainty of the distance of two points over the pairs of
    postures within limits.
    """
    ends = {}
    for name, number in (("best", length.u.argmin()), ("worst", length.u.argmax())):
        i, j = length.pair(int(number))
        angles = {
            "from_theta_deg": _rounded(length.q_a[i] / DEG),
            "to_theta_deg": _rounded(length.q_b[j] / DEG),
        }
        ends[name] = {**angles, "u_mm": float(length.u[i, j] / MM)}
    return {
        "schema": LENGTH_SCHEMA,
        "arm": a.arm.name,
        "from_mm": _rounded(a.point / MM),
        "to_mm": _rounded(b.point / MM),
        "at": a.at,
        "length_mm": float(length.length / MM),
        "pairs": length.u.size,
        "u_mm": _spread(length.u.ravel() / MM),
        **ends,
        "budget": _budget(length),
        "taken_as_exact": list(length.sources.taken_as_exact),
        "not_included": list(length.sources.not_included),
        "unexplained": length.sources.arm.unexplained,
    }


def map_summary(map_: WorkspaceMap) -> dict[str, Any]:
    """Schema ``aacmm-pin/map/1``: sizes of a map and how many reachable cells have how many working
    sectors.

    ``not_included``, only where there are some, names the causes of error that are left out of the
    accuracies.
    """
    data = map_.data
    box = np.asarray(data.attrs["extent_mm"])
    summary = {
        "schema": MAP_SCHEMA,
        "arm": str(data.attrs["arm"]),
        "cells": [int(data.sizes["x_mm"]), int(data.sizes["z_mm"])],
        "sectors": map_.sectors,
        "extent_mm": {"x": _rounded(box[:2]), "z": _rounded(box[2:])},
        "working_sectors": {str(count): cells for count, cells in map_.working_sectors().items()},
        "unreachable": map_.unreachable,
        "seconds": round(map_.seconds, 3),
    }
    if map_.incomplete:
        summary["incomplete"] = map_.incomplete
    return summary | ({"not_included": list(map_.not_included)} if map_.not_included else {})


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
    return {
        "conditions": postures.conditions.count,
        "components": int(postures.component.max(initial=0)),
        "search": {
            "starts": search.starts,
            "arrived": search.arrived,
            "unseen_at_most": search.unseen,
        },
    }


def _volumes(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> dict[str, float | None]:
    volume = accuracy.volume / MM3
    weighted = circle.arm.dh is not None  # by the θ3 of an arm built like SINO6
    comprehensive = (
        comprehensive_accuracy(volume, accuracy.q[:, 2], circle.point) if weighted else math.nan
    )
    return _spread(volume) | {"comprehensive": _number(comprehensive)}


def _spread(values: Array) -> dict[str, float | None]:
    found = (values.min(), np.median(values), values.max()) if len(values) else [math.nan] * 3
    return dict(zip(("min", "median", "max"), map(_number, found), strict=True))


def _postures(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> dict[str, dict[str, Any]]:
    """The postures with the smallest and largest volume and u."""
    if not len(accuracy.q):
        nothing = dict.fromkeys(("theta_deg", "swivel_deg", "volume_mm3", "u_mm"))
        return {name: dict(nothing) for name in ("best", "worst", "smallest_u", "largest_u")}
    volume, u = accuracy.volume, accuracy.u
    numbers = {
        "best": volume.argmin(),
        "worst": volume.argmax(),
        "smallest_u": u.argmin(),
        "largest_u": u.argmax(),
    }
    swivel = circle.swivel[circle.within_limits] / DEG
    return {
        name: {
            "theta_deg": _rounded(accuracy.q[number] / DEG),
            "swivel_deg": _rounded(swivel[[number]])[0] if math.isfinite(swivel[number]) else None,
            "volume_mm3": float(volume[number] / MM3),
            "u_mm": float(u[number] / MM),
        }
        for name, number in numbers.items()
    }


def _budget(accuracy: AccuracyVolume | LengthUncertainty) -> list[dict[str, Any]]:
    table = accuracy.budget("parameter")[["parameter", "joint", "share", "u_mm"]].astype(object)
    return [
        {str(k): v for k, v in row.items()}
        for row in table.where(table.notna(), None).to_dict("records")
    ]


def _rounded(values: Array) -> list[float]:
    return [round(float(value), DIGITS) + 0.0 for value in values]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
