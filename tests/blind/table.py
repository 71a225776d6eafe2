"""The records of a run as text of a measurement file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.conditions import Conditions
from blind.kinematics import Array
from blind.plans import Seats


def text(read: Array, noted: Array, conditions: Conditions, seats: Seats | None, unknown: bool) -> str:
    """CSV; ``unknown`` leaves the coordinates out and states the bars instead."""
    n, nq = read.shape
    columns: dict[str, NDArray[np.str_] | list[str]] = {
        "record": [str(i) for i in range(n)],
        "session": [f"S{i + 1}" for i in conditions.session],
        "operator": ["AB"[i] for i in conditions.operator],
        "time_s": fixed(conditions.time, 1),
    }
    columns |= {f"theta{k + 1}_deg": fixed(np.degrees(read[:, k]), 8) for k in range(nq)}
    if not unknown:
        columns |= {name: fixed(noted[:, k], 6, 1e3) for k, name in enumerate(("x_mm", "y_mm", "z_mm"))}
    if seats is not None:
        columns["seat"] = [f"P{i + 1}" for i in conditions.seat]
    if seats is not None and unknown:
        columns |= _bars(conditions.seat, seats)
    columns["temperature_c"] = fixed(conditions.temperature_reading, 2)
    columns |= {f"approach{k + 1}": [str(int(v)) for v in conditions.approach[:, k]] for k in range(nq)}
    columns["humidity_pct"] = fixed(conditions.humidity, 1)
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(row) for row in rows)]) + "\n"


def fixed(values: Array, digits: int, factor: float = 1.0) -> list[str]:
    """Numbers with so many digits behind the point."""
    return [f"{value:.{digits}f}" for value in (values * factor).tolist()]


def _bars(seat: NDArray[np.int_], seats: Seats) -> dict[str, list[str]]:
    bar, end = np.empty(len(seats.points), dtype=int), np.empty(len(seats.points), dtype=int)
    for number, pair in enumerate(seats.bars):
        bar[pair], end[pair] = number, (0, 1)
    length = np.linalg.norm(seats.points[seats.bars[:, 0]] - seats.points[seats.bars[:, 1]], axis=1)
    return {
        "bar": [f"B{bar[i] + 1}" for i in seat],
        "bar_end": ["AB"[end[i]] for i in seat],
        "bar_length_mm": [f"{1e3 * length[bar[i]]:.6f}" for i in seat],
    }
