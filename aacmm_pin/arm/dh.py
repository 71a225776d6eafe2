"""The Denavit–Hartenberg table.

A row leads from frame i-1 to frame i:

- ``standard-dh``: ``T_i = Rz(θ_i + θ0_i) Tz(d_i) Tx(a_i) Rx(α_i)``
- ``modified-dh`` (Craig): ``T_i = Rx(α_i) Tx(a_i) Rz(θ_i + θ0_i) Tz(d_i)``

A prismatic joint (``slides[i]``) has d_i + q_i and θ_i = 0; a fixed row (a stylus) has θ_i = 0. In
the chain, standard DH puts (d, θ) of row i at ``axis i`` and (a, α) at ``end i``; modified DH puts
(a, α) at ``end i-1``. Screws about one axis commute: a displacement by (δa, δα) is exactly a + δa,
α + δα.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from aacmm_pin._support.arrays import Array, Mask, batch
from aacmm_pin._support.display import Shown
from aacmm_pin.arm.chain import OMEGA_X, OMEGA_Z, V_X, V_Z, Chain, axis, end, screws

Convention = Literal["standard-dh", "modified-dh"]
KINDS = ("a", "d", "alpha", "theta_offset")
"""The four values of a row, in order."""


@dataclass(frozen=True, eq=False)
class DHTable(Shown):
    """Denavit–Hartenberg values of an arm.

    Attributes:
        a: link lengths, (rows,) [m].
        d: joint distances, (rows,) [m].
        alpha: link twists, (rows,) [rad].
        theta_offset: joint zero offsets, (rows,) [rad].
        moving: rows with a joint, (rows,).
        slides: prismatic joints, (rows,).
        convention: ``standard-dh`` or ``modified-dh``.
    """

    a: Array
    d: Array
    alpha: Array
    theta_offset: Array
    moving: Mask
    slides: Mask
    convention: Convention = "standard-dh"

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.a.shape[0])

    @property
    def nq(self) -> int:
        """Number of joints."""
        return int(self.moving.sum())

    @property
    def standard(self) -> bool:
        """True for standard DH."""
        return self.convention == "standard-dh"

    def values(self) -> Array:
        """All values (rows, 4): a, d, alpha, theta_offset [m, m, rad, rad]."""
        columns = self.a, self.d, self.alpha, self.theta_offset
        return np.stack(columns, axis=1)

    @cached_property
    def chain(self) -> Chain:
        """Kinematics; parameters are the values row by row, and fixed rows have a fixed
        ``axis``.
        """
        about_z = screws(self.theta_offset, 0.0, 2)
        along_z = screws(0.0, self.d, 2)
        on_x = screws(self.alpha, self.a, 0)
        axes = []
        ends = [np.eye(4)]
        parameters = []
        for row in range(self.rows):
            if self.standard:
                axes.append(about_z[row])
                ends.append(along_z[row] @ on_x[row])
            else:
                ends[-1] = ends[-1] @ on_x[row]
                axes.append(about_z[row] @ along_z[row])
                ends.append(np.eye(4))
            joint = axis(row + 1)
            link = end(row + 1 if self.standard else row)
            parameters += [(link, V_X), (joint, V_Z), (link, OMEGA_X), (joint, OMEGA_Z)]
        numbers = np.where(self.moving, np.cumsum(self.moving) - 1, -1)
        return Chain.of_pieces(axes, ends, numbers, self.slides[self.moving], parameters)

    def place(self, frame: int) -> int:
        """Place of the chain at the origin of ``frame``; 0 is the base."""
        if frame == 0:
            return end(0)
        return end(frame) if self.standard else axis(frame)


def table(
    rows: Array,
    convention: Convention = "standard-dh",
    moving: list[bool] | None = None,
    slides: list[bool] | None = None,
) -> DHTable:
    """Make a table from ``rows`` (rows, 4): a, d, alpha, theta_offset [m, m, rad, rad]."""
    rows = batch(rows, 4, "rows", "m, m, rad, rad")
    a, d, alpha, theta_offset = rows.T
    has_joint = np.ones(len(rows), dtype=bool) if moving is None else np.array(moving, dtype=bool)
    prismatic = np.zeros(len(rows), dtype=bool) if slides is None else np.array(slides, dtype=bool)
    return DHTable(a, d, alpha, theta_offset, has_joint, prismatic, convention)
