"""Results as dictionaries for ``aacmm-pin accuracy --json`` and ``aacmm-pin map --json``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import notes_in_json
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy import AccuracyVolume, ErrorSources, LengthUncertainty, WorkspaceMap, paired
from aacmm_pin.accuracy.comprehensive_accuracy import comprehensive_accuracy
from aacmm_pin.postures import PosturesAtPoint, ReachingPostures

ACCURACY_SCHEMA = "aacmm-pin/accuracy/1"
LENGTH_SCHEMA = "aacmm-pin/length/1"
MAP_SCHEMA = "aacmm-pin/map/1"
JSON_DECIMALS = 9
"""Decimals of lengths and angles [mm, deg], without the noise of binary fractions."""


def accuracy_summary(
    circle: PosturesAtPoint, accuracy: AccuracyVolume, sectors: int = 12
) -> dict[str, Any]:
    """Schema ``aacmm-pin/accuracy/1``: accuracy over the postures of ``circle`` within limits.

    ``best`` and ``worst`` are by volume, ``smallest_u`` and ``largest_u`` by u; the budget is the
    mean over postures. Missing numbers are None: all without a posture (``reason`` states why), and
    for an arm from a URDF swivel angles and comprehensive accuracy; its ``arc_fraction`` is of the
    way along the curves. ``sectors`` are for the flexibility.

    Raises:
        ShapeError: ``accuracy`` is for other postures.
    """
    inside, flexibility = paired(circle, accuracy), circle.flexibility(sectors)
    volume, u = accuracy.volume / MM3, accuracy.u / MM
    comprehensive, deviation = None, None
    if circle.arm.dh is not None:  # weighted by the θ3 of an arm built like SINO6
        comprehensive = comprehensive_accuracy(volume, accuracy.q[:, 2], circle.point)
    if accuracy.sources.bounded:
        deviation = _spread(accuracy.largest_deviation / MM)
    summary = {
        "schema": ACCURACY_SCHEMA,
        "arm": circle.arm.name,
        "point_mm": _rounded(circle.point / MM),
        "at": circle.at,
        "method": accuracy.method,
        "configurations": len(inside),
        "flexibility": {
            "zeta": flexibility.zeta,
            "sectors": flexibility.sectors,
            "arc_fraction": flexibility.arc_fraction,
        },
        "volume_mm3": _spread(volume) | {"comprehensive": comprehensive},
        "u_mm": _spread(u),
        "largest_deviation_mm": deviation,
        "best": _posture(circle, accuracy, volume),
        "worst": _posture(circle, accuracy, -volume),
        "smallest_u": _posture(circle, accuracy, u),
        "largest_u": _posture(circle, accuracy, -u),
        "budget": _budget(accuracy) if len(inside) else [],
        **_left_out(accuracy.sources),
        "complete": circle.complete,
        **notes_in_json(circle.notes),
    }
    if isinstance(circle, ReachingPostures):
        search = circle.search
        summary["conditions"] = circle.conditions
        summary["components"] = circle.component.max(initial=0)
        summary["search"] = {
            "starts": search.starts,
            "arrived": search.arrived,
            "unseen_at_most": search.unseen,
        }
    if not len(inside):
        summary["reason"] = circle.reason or "no posture is within the joint limits"
    return dict(plain(summary))


def length_summary(
    a: PosturesAtPoint, b: PosturesAtPoint, length: LengthUncertainty
) -> dict[str, Any]:
    """Schema ``aacmm-pin/length/1``: uncertainty of a length over pairs of postures within
    limits.
    """
    summary = {
        "schema": LENGTH_SCHEMA,
        "arm": a.arm.name,
        "from_mm": _rounded(a.point / MM),
        "to_mm": _rounded(b.point / MM),
        "at": a.at,
        "length_mm": length.length / MM,
        "pairs": length.u.size,
        "u_mm": _spread(length.u.ravel() / MM),
        "best": _pair(length, int(length.u.argmin())),
        "worst": _pair(length, int(length.u.argmax())),
        "budget": _budget(length),
        **_left_out(length.sources),
    }
    return dict(plain(summary))


def map_summary(map_: WorkspaceMap) -> dict[str, Any]:
    """Schema ``aacmm-pin/map/1``: size of a map, and reachable cells by working sectors."""
    data = map_.data
    box = np.asarray(data.attrs["extent_mm"])
    optional = {"incomplete": map_.incomplete, "not_included": map_.not_included}
    if "stylus_axis" in data.attrs:
        optional["stylus_axis"] = _rounded(data.attrs["stylus_axis"])
    summary = {
        "schema": MAP_SCHEMA,
        "arm": data.attrs["arm"],
        "at": data.attrs["working_point"],
        "cells": [axis.size for axis in map_.axes],
        "sectors": map_.sectors,
        "extent_mm": {"x": _rounded(box[:2]), "z": _rounded(box[2:])},
        "working_sectors": map_.working_sectors(),
        "unreachable": map_.unreachable,
        "seconds": round(map_.seconds, 3),
        **{name: value for name, value in optional.items() if value},
    }
    return dict(plain(summary))


def accuracy_table(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> pd.DataFrame:
    """The postures within limits as in :meth:`PosturesAtPoint.to_frame`, with their accuracy.

    Raises:
        ShapeError: ``accuracy`` is for other postures.
    """
    inside = circle.to_frame().iloc[paired(circle, accuracy)].reset_index(drop=True)
    return inside.join(accuracy.to_frame().filter(regex="_mm"))


def _left_out(sources: ErrorSources) -> dict[str, Any]:
    return {
        "taken_as_exact": sources.taken_as_exact,
        "not_included": sources.not_included,
        "unexplained": sources.arm.unexplained,
    }


def _pair(length: LengthUncertainty, number: int) -> dict[str, Any]:
    i, j = length.pair(number)
    return {
        "from_theta_deg": _rounded(length.q_a[i] / DEG),
        "to_theta_deg": _rounded(length.q_b[j] / DEG),
        "u_mm": length.u[i, j] / MM,
    }


def _spread(values: Array) -> dict[str, Any]:
    if not len(values):
        return dict.fromkeys(("min", "median", "max"))
    return {"min": values.min(), "median": np.median(values), "max": values.max()}


def _posture(circle: PosturesAtPoint, accuracy: AccuracyVolume, by: Array) -> dict[str, Any]:
    """The posture within limits with the least ``by`` (n,)."""
    if not len(by):
        return dict.fromkeys(("theta_deg", "swivel_deg", "volume_mm3", "u_mm"))
    number = by.argmin()
    swivel = circle.swivel[circle.within_limits][number]
    return {
        "theta_deg": _rounded(accuracy.q[number] / DEG),
        "swivel_deg": round(float(swivel / DEG), JSON_DECIMALS) + 0.0,
        "volume_mm3": accuracy.volume[number] / MM3,
        "u_mm": accuracy.u[number] / MM,
    }


def _budget(accuracy: AccuracyVolume | LengthUncertainty) -> pd.DataFrame:
    return accuracy.budget("parameter")[["parameter", "joint", "share", "u_mm"]].astype(object)


def _rounded(values: Array) -> list[float]:
    return [round(float(value), JSON_DECIMALS) + 0.0 for value in values]
