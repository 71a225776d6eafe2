"""Results as plain dictionaries for JSON: what ``aacmm-pin accuracy --json`` and ``aacmm-pin map --json`` write."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aacmm_pin.accuracy import AccuracyVolume
from aacmm_pin.checks import Array
from aacmm_pin.comprehensive import comprehensive_accuracy
from aacmm_pin.configurations import ConfigurationCircle
from aacmm_pin.pairing import paired
from aacmm_pin.units import DEG, MM, MM3
from aacmm_pin.workspace import WorkspaceMap

ACCURACY_SCHEMA = "aacmm-pin/accuracy/1"
MAP_SCHEMA = "aacmm-pin/map/1"
DIGITS = 9
"""Decimals kept of lengths and angles [mm, deg]: hides what binary fractions do to decimal input, and nothing else."""


def accuracy_summary(circle: ConfigurationCircle, accuracy: AccuracyVolume, sectors: int = 12) -> dict[str, Any]:
    """Schema ``aacmm-pin/accuracy/1``: accuracy over the configurations of ``circle`` that are within limits.

    Numbers that do not exist, because there is no such configuration, are None, and ``reason`` says why.

    Args:
        circle: every configuration at the point.
        accuracy: ``accuracy_volume(arm, circle.q[circle.within_limits], at=circle.at)``.
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
        "best": _posture(accuracy, int(np.argmin(accuracy.volume)) if len(inside) else None),
        "worst": _posture(accuracy, int(np.argmax(accuracy.volume)) if len(inside) else None),
        "budget": _budget(accuracy),
    }
    if not len(inside):
        summary["reason"] = circle.reason or "no configuration is within the joint limits"
    return summary


def map_summary(map_: WorkspaceMap) -> dict[str, Any]:
    """Schema ``aacmm-pin/map/1``: sizes of a map and how many reachable cells have how many working sectors."""
    data = map_.data
    box = np.asarray(data.attrs["extent_mm"])
    return {
        "schema": MAP_SCHEMA,
        "arm": str(data.attrs["arm"]),
        "cells": [int(data.sizes["x_mm"]), int(data.sizes["z_mm"])],
        "sectors": map_.sectors,
        "extent_mm": {"x": _rounded(box[:2]), "z": _rounded(box[2:])},
        "working_sectors": {str(count): cells for count, cells in map_.working_sectors().items()},
        "unreachable": map_.unreachable,
        "seconds": round(map_.seconds, 3),
    }


def _volumes(circle: ConfigurationCircle, accuracy: AccuracyVolume) -> dict[str, float | None]:
    volume = accuracy.volume / MM3
    if not len(volume):
        return {"min": None, "median": None, "max": None, "comprehensive": None}
    return {
        "min": _number(volume.min()),
        "median": _number(np.median(volume)),
        "max": _number(volume.max()),
        "comprehensive": _number(comprehensive_accuracy(volume, accuracy.q[:, 2], circle.point)),
    }


def _posture(accuracy: AccuracyVolume, number: int | None) -> dict[str, Any]:
    if number is None:
        return {"theta_deg": None, "volume_mm3": None, "u_mm": None}
    return {
        "theta_deg": _rounded(accuracy.q[number] / DEG),
        "volume_mm3": _number(accuracy.volume[number] / MM3),
        "u_mm": _number(accuracy.u[number] / MM),
    }


def _budget(accuracy: AccuracyVolume) -> list[dict[str, Any]]:
    if not len(accuracy.q):
        return []
    rows = accuracy.budget("parameter").to_dict("records")
    return [
        {
            "parameter": str(r["parameter"]),
            "joint": int(r["joint"]),
            "share": _number(r["share"]),
            "u_mm": _number(r["u_mm"]),
        }
        for r in rows
    ]


def _rounded(values: Array) -> list[float]:
    return [round(float(value), DIGITS) + 0.0 for value in values]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
