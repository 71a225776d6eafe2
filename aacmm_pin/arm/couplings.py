"""Couplings of readings and joint angles, and joints that follow others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, FiniteFloat

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.plausible import MOST_RATIO
from aacmm_pin.errors import UnsupportedArmError

SINGULAR = 1e-6
"""Least singular value of an invertible map with unit columns."""


class Coupling(BaseModel):
    """Part of the angle of the ``joint`` in a row: ``ratio`` times the reading ``of`` a row
    [rad/rad; with m for prismatic joints]; see :meth:`Arm.with_couplings`.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    joint: int
    of: int
    ratio: FiniteFloat


def coupling_matrix(couplings: Sequence[Coupling], rows: Sequence[int]) -> Array:
    """∂(joint angles)/∂(readings) (nq, nq), for joints in these rows."""
    matrix = np.eye(len(rows))
    stated = set()
    for number, coupling in enumerate(couplings, start=1):
        place = f"couplings[{number}]"
        for key in ("joint", "of"):
            row = getattr(coupling, key)
            if row not in rows:
                numbers = ", ".join(map(str, rows))
                raise ValueError(
                    f"{place}.{key} is {row}; expected a row with a joint, one of {numbers}"
                )
        if abs(coupling.ratio) > MOST_RATIO:
            raise ValueError(
                f"{place}.ratio is {coupling.ratio:g}; expected {-MOST_RATIO:g} to {MOST_RATIO:g}"
            )
        pair = rows.index(coupling.joint), rows.index(coupling.of)
        if pair in stated:
            raise ValueError(
                f"{place}: joint = {coupling.joint}, of = {coupling.of} occurs again; expected "
                "each pair once; delete one coupling"
            )
        stated.add(pair)
        matrix[pair] = coupling.ratio
    length = np.linalg.norm(matrix, axis=0)
    unit_columns = matrix / np.where(length > 0.0, length, 1.0)
    singular_values = np.linalg.svd(unit_columns, compute_uv=False)
    if singular_values[-1] < SINGULAR:
        raise ValueError(
            "the couplings are singular, because other readings give the same joint angles; change "
            "a ratio"
        )
    return matrix


class Mimic(NamedTuple):
    """A joint that follows another: ``ratio`` times its angle, plus ``offset``.

    Attributes:
        joint, of: joint numbers from 1; equal for the first that follows an encoder beside the arm.
        ratio: [rad/rad; with m for prismatic joints].
        offset: [rad, m].
    """

    joint: int
    of: int
    ratio: float
    offset: float


@dataclass(frozen=True, eq=False)
class Drive:
    """Angles of all m joints by those of the nq independent ones: ``matrix q + offset``.

    Attributes:
        matrix: (m, nq).
        offset: (m,) [rad, m].
        independent: numbers of the independent joints (nq,).
    """

    matrix: Array
    offset: Array
    independent: Index

    @staticmethod
    def of(joints: int, mimics: Sequence[Mimic] = ()) -> Drive:
        """The drive of so many joints, some of which follow others."""
        matrix, offset = np.eye(joints), np.zeros(joints)
        for mimic in mimics:
            matrix[mimic.joint - 1] = mimic.ratio * np.eye(joints)[mimic.of - 1]
            offset[mimic.joint - 1] = mimic.offset
        followers = [mimic.joint - 1 for mimic in mimics if mimic.joint != mimic.of]
        leaders = np.delete(np.arange(joints), followers)
        return Drive(matrix[:, leaders], offset, leaders)

    @cached_property
    def is_identity(self) -> bool:
        """Whether no joint follows another or has a ratio."""
        return np.array_equal(self.matrix, np.eye(len(self.matrix))) and not self.offset.any()

    @property
    def leader(self) -> Index:
        """The independent joint that moves each joint (m,)."""
        return np.asarray(np.abs(self.matrix).argmax(axis=1))

    def angles(self, q: Array) -> Array:
        """Angles of all joints (n, m) by ``q`` (n, nq)."""
        if self.is_identity:
            return q
        return q @ self.matrix.T + self.offset

    def by_independent(self, by_all: Array) -> Array:
        """The derivative by the nq independent joints from that by all m (…, m)."""
        return by_all if self.is_identity else by_all @ self.matrix

    def limits(self, of_all: Array) -> Array:
        """Limits (nq, 2) within which all m joints are within theirs (m, 2); limits of ±2π count as
        none.
        """
        scale = self.matrix[self.independent, np.arange(len(self.independent))][:, None]
        limits = np.sort(
            (of_all[self.independent] - self.offset[self.independent, None]) / scale, axis=1
        )
        for joint, leader in enumerate(self.leader):
            ratio = self.matrix[joint, leader]
            if ratio and np.ptp(of_all[joint]) < 4.0 * np.pi:
                bounds = (of_all[joint] - self.offset[joint]) / ratio
                low, high = limits[leader]
                limits[leader] = max(low, bounds.min()), min(high, bounds.max())
        if (limits[:, 0] > limits[:, 1]).any():
            raise UnsupportedArmError(
                "the limits of a joint exclude the limits of a joint that mimics it; expected a "
                "common range"
            )
        return limits
