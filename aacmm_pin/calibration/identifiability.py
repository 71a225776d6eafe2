"""What the data can determine: combinations of parameters that they cannot, in words, and observability indices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.effects.labels import listed

NEGLIGIBLE = 0.02
"""Parts of a combination smaller than this, beside the largest, are not mentioned."""


@dataclass(frozen=True)
class Observability(Shown):
    """Observability indices of a data set (Sun, Hollerbach 2008), of the directions that the data determine.

    From the singular values σ of the tips' sensitivity, each parameter in units of its typical error, n records:
    O1 = (Πσ)^(1/m)/√n (Borm, Menq), O2 = σ_min/σ_max, O3 = σ_min, O4 = σ_min²/σ_max, O5 = 1/Σ(1/σ). Larger is better.
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float
    directions: int

    @staticmethod
    def of(jacobian: Array, records: int) -> Observability:
        """From the sensitivity (rows, p), nuisances projected out, columns in units of typical errors [m]."""
        values = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.empty(0)
        values = values[values > 1e-9 * values[0]] if values.size else values
        if not values.size:
            return Observability(0.0, 0.0, 0.0, 0.0, 0.0, 0)
        low, high = float(values[-1]), float(values[0])
        o1 = float(np.exp(np.mean(np.log(values))) / np.sqrt(records))
        return Observability(o1, low / high, low, low**2 / high, float(1.0 / np.sum(1.0 / values)), values.size)


def undetermined(problem: Problem, unknown: Array) -> list[str]:
    """Combinations of parameters that neither the data nor a stated uncertainty determine, one sentence each.

    They are of the ``unknown`` directions, in units of the scales (p, k).
    """
    if not unknown.size:
        return []
    combinations = _sparse((unknown * problem.scales[:, None] / _typical(problem)[:, None]).T)
    return [_words(row * _typical(problem), problem.names) for row in combinations]


def _typical(problem: Problem) -> Array:
    """1 mm for lengths, 1 mrad for angles, so that parts of a combination can be compared; others by their widths."""
    usual = {"m": 1e-3, "rad": 1e-3}
    of_parameters = [
        usual.get(p.unit, float(width)) for p, width in zip(problem.vector.parameters, problem.widths, strict=True)
    ]
    return np.array(of_parameters + [1e-3] * (len(problem.names) - len(of_parameters)))


def _sparse(rows: Array) -> Array:
    """The same span with as many zeros as elimination gives; small parts left out."""
    rows = rows.copy()
    for k in range(len(rows)):
        open_rows = np.abs(rows[k:])
        i, j = divmod(int(np.argmax(open_rows)), open_rows.shape[1])
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= rows[others, j][:, None] * rows[k]
    small = np.abs(rows) < NEGLIGIBLE * np.abs(rows).max(axis=1, keepdims=True, initial=1e-300)
    return np.where(small, 0.0, rows)


def _words(combination: Array, names: list[str]) -> str:
    parts = np.flatnonzero(combination)
    members = [names[i] for i in parts]
    if len(members) == 1:
        return f"{members[0]}: not at all"
    if len(members) == 2:
        ratio = combination[parts[1]] / combination[parts[0]]
        if abs(abs(ratio) - 1) < NEGLIGIBLE:
            return f"{listed(members)}: only their {'sum' if ratio < 0 else 'difference'}"
    return f"{listed(members)}: only together"
