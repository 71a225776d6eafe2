"""Probed points of acceptance tests, whose errors are known."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from tests.tables import PLACES

DIRECTIONS = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0], [0, -0.6, 0.8], [0.8, 0, -0.6]]])


def rows(points: Array, **cells: Any) -> pd.DataFrame:
    """Touches at ``points`` (n, 3) [mm]."""
    return pd.DataFrame(points, columns=PLACES).assign(**cells)


def sphere(count: int, center: Array, diameter: float, **cells: Any) -> pd.DataFrame:
    """Touches all over a sphere of 25 mm with a probe of 6 mm, whose centres lie on one of
    ``diameter`` [mm].
    """
    rng = np.random.default_rng(count)
    directions = np.vstack([DIRECTIONS, rng.normal(size=(count, 3))])[:count]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    known = {"feature_diameter_mm": 25.0, "probe_diameter_mm": 6.0, "u_length_mm": 0.001}
    return rows(center + diameter / 2 * directions, **(known | cells))


def lengths(
    count: int, positions: int, repeats: int, probe: float, error: float, **cells: Any
) -> pd.DataFrame:
    """Lengths of 300 mm and more that are all right, but for the last one."""
    tables, rng = [], np.random.default_rng(1)
    for number in range(count):
        length = 300.0 + 200.0 * number
        for position in range(positions):
            a, direction = rng.uniform(-500, 500, size=3), rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            for repeat in range(repeats):
                last = (number, position, repeat) == (count - 1, positions - 1, repeats - 1)
                labels = {
                    "length_id": f"L{number}",
                    "position": position,
                    "repeat": repeat,
                    "length_mm": length,
                }
                ends = np.array([a, a + (length + probe + error * last) * direction])
                tables.append(
                    rows(
                        ends,
                        feature=["A", "B"],
                        u_length_mm=0.002,
                        probe_diameter_mm=probe,
                        **labels,
                        **cells,
                    )
                )
    return pd.concat(tables)


def everything(*tests: str) -> pd.DataFrame:
    """All tests in one table, or these."""
    table = _table()
    return table[table["test"].isin(tests or table["test"])].reset_index(drop=True)


@cache
def _table() -> pd.DataFrame:
    tables = [
        sphere(
            25, np.array([500.0 * k, 0, 0]), 31.0 + 0.02 * k, test="sphere", feature="S", position=k
        )
        for k in (0, 1)
    ]
    corners = np.array([[0, 0, 0], [0.03, 0, 0], [0.01, 0.001, 0], [0.02, 0, 0.001], [0.015, 0, 0]])
    tables += [
        sphere(5, corner, 31.0, test="location", feature="S", position=0, repeat=k)
        for k, corner in enumerate(corners)
    ]
    tables += [
        lengths(5, 7, 3, 0.0, -0.04, test="length-uni"),
        lengths(5, 7, 3, 6.0, 0.05, test="length-bi"),
    ]
    tables += [
        sphere(9, np.zeros(3), 31.0 - 0.01 * k, test="effective-diameter", feature="S", repeat=k)
        for k in range(3)
    ]
    tables.append(lengths(2, 10, 1, 0.0, 0.06, test="volumetric"))
    for place in range(3):
        offsets = np.zeros((10, 3))
        offsets[0, 2], offsets[1, 2] = 0.01 * place, -0.01 * place
        tables.append(
            rows(np.array([100.0 * place, 0, 0]) + offsets, test="single-point", position=place)
        )
    return pd.concat(tables, ignore_index=True).astype({"position": "Int64", "repeat": "Int64"})
