"""Records as text of a measurement file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from blind.conditions import Conditions
from blind.kinematics import Array


def csv(columns: Mapping[str, Sequence[str]]) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n"


def fixed(values: Array, digits: int, factor: float = 1.0) -> list[str]:
    """Numbers with so many digits behind the point."""
    return [f"{value:.{digits}f}" for value in (values * factor).tolist()]


def angles(q: Array) -> dict[str, list[str]]:
    return {f"theta{k + 1}_deg": fixed(np.degrees(column), 8) for k, column in enumerate(q.T)}


def coordinates(places: Array) -> dict[str, list[str]]:
    return {
        name: fixed(column, 6, 1e3)
        for name, column in zip(("x_mm", "y_mm", "z_mm"), places.T, strict=True)
    }


def approaches(conditions: Conditions, moving: NDArray[np.bool_]) -> dict[str, list[str]]:
    return {
        f"approach{k + 1}": fixed(column, 0)
        for k, column in enumerate(conditions.approach[:, moving].T)
    }


def bars(seat: NDArray[np.int_], ends: NDArray[np.int_], length: Array) -> dict[str, list[str]]:
    """Columns of bars between pairs of seats ``ends`` (B, 2), each seat at one bar, of the stated
    ``length`` (B,) [m].
    """
    bar, end = np.nonzero(ends[None] == seat[:, None, None])[1:]
    return {
        "bar": [f"B{b + 1}" for b in bar],
        "bar_end": ["AB"[e] for e in end],
        "bar_length_mm": [f"{1e3 * length[b]:.6f}" for b in bar],
    }
