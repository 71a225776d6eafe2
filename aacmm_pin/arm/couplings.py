"""Couplings: which joint angles the readings of the encoders make."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, FiniteFloat

from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import MOST_RATIO

SINGULAR = 1e-6
"""Least singular value of a map, its columns of unit length, from which angles follow."""


class Coupling(BaseModel):
    """A part of a joint angle: ``ratio`` times the reading of one encoder.

    A joint angle is the sum of its parts. The reading of the joint's own encoder counts with ratio
    1, unless a coupling with ``of = joint`` states another, such as that of a gear.

    Attributes:
        joint: number of the row whose joint angle it is a part of.
        of: number of the row whose encoder is read.
        ratio: joint angle per reading [rad/rad; with m where a joint slides].
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    joint: int
    of: int
    ratio: FiniteFloat


def coupling_matrix(couplings: Sequence[Coupling], rows: Sequence[int]) -> Array:
    """∂(joint angles)/∂(readings) (nq, nq), for joints in these rows.

    Raises:
        ValueError: a row without joint, a pair that is stated twice, a ratio that no arm has, or
            readings from which no joint angles follow.
    """
    matrix = np.eye(len(rows))
    stated = set()
    for number, coupling in enumerate(couplings, start=1):
        place = f"couplings[{number}]"
        for key in ("joint", "of"):
            row = getattr(coupling, key)
            if row not in rows:
                known = ", ".join(map(str, rows))
                raise ValueError(f"{place}.{key} is {row}; expected a row with a joint: {known}")
        if abs(coupling.ratio) > MOST_RATIO:
            raise ValueError(
                f"{place}.ratio is {coupling.ratio:g}; expected at most {MOST_RATIO:g}"
            )
        pair = rows.index(coupling.joint), rows.index(coupling.of)
        if pair in stated:
            raise ValueError(
                f"{place}: joint = {coupling.joint}, of = {coupling.of} is stated before; expected "
                "each pair once; delete one"
            )
        stated.add(pair)
        matrix[pair] = coupling.ratio
    length = np.linalg.norm(matrix, axis=0)
    unit = matrix / np.where(length > 0.0, length, 1.0)
    if np.linalg.svd(unit, compute_uv=False)[-1] < SINGULAR:
        raise ValueError(
            "couplings are singular: other readings make the same joint angles; expected one "
            "reading for each joint; change a ratio"
        )
    return matrix
