"""Spread of a part of the records and of the rest, when the part was chosen before measuring or after."""

from __future__ import annotations

from typing import Literal

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.errors import AacmmError

Chosen = Literal["before", "after"]


def part_and_rest(positions: Array, size: int, chosen: Chosen, order: Index | None = None) -> tuple[Array, Array]:
    """Root mean square distance from the mean of all, of a part and of the rest (eqs. 18, 19 of Xu You et al. 2019).

    Args:
        positions: indications of one seat in each draw (draws, n, 3) [m].
        size: number of records in the part.
        chosen: ``before`` measuring, the first in ``order``; or ``after``, those nearest the mean.
        order: numbers of the records, the one thought most accurate first (n,); for ``before``.

    Returns:
        Part and rest, (draws,) each [m].

    Raises:
        AacmmError: the part is empty or everything, or ``order`` is missing.
    """
    n = positions.shape[1]
    if not 0 < size < n:
        raise AacmmError(f"the part has {size} of {n} records, expected at least one, and one in the rest")
    squares = np.square(positions - positions.mean(axis=1, keepdims=True)).sum(axis=2)
    if chosen == "after":
        squares = np.sort(squares, axis=1)
    elif order is None:
        raise AacmmError("a part chosen before measuring needs an order of the records")
    else:
        squares = squares[:, order]
    return np.sqrt(squares[:, :size].mean(axis=1)), np.sqrt(squares[:, size:].mean(axis=1))
