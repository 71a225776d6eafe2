"""How far an arm reaches."""

from __future__ import annotations

import numpy as np
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin.postures.wrist_ik import POSITIONING, Wrist


def reach_of_wrist(wrist: Wrist, shoulder: Array) -> tuple[float, float]:
    """Least and largest distance of the wrist from ``shoulder`` (3,) [m] over all configurations, limits apart [m].

    A coarse grid of the joints 2 to 4 (joint 1 turns about the shoulder's axis), then a local search from its best.
    """
    angles = np.linspace(-np.pi, np.pi, 25)[:-1]
    grid = np.stack(np.meshgrid(*[angles] * (POSITIONING - 1), indexing="ij"), axis=-1).reshape(-1, POSITIONING - 1)

    def distance(q: Array) -> Array:
        q = np.atleast_2d(q)
        return np.asarray(np.linalg.norm(wrist.table.positions(np.column_stack([np.zeros(len(q)), q])) - shoulder, axis=1))

    values = distance(grid)
    extremes = []
    for sign, start in ((1.0, grid[np.argmin(values)]), (-1.0, grid[np.argmax(values)])):
        best = scipy.optimize.minimize(
            lambda q, s=sign: s * distance(q)[0], start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
        )
        extremes.append(sign * float(best.fun))
    return extremes[0], extremes[1]
