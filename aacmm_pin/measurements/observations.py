"""What records say of where their tips were, as arrays: known coordinates, one point touched again,
known distances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aacmm_pin._support.checks import Array, Index, Mask

NOTHING_KNOWN = 1e-4
"""With less information than this nothing is known of a seat, which is somewhere within a hundred
metres [1/m²].
"""


@dataclass(frozen=True, eq=False)
class Observations:
    """Targets of the tips of n records, some of them at s seats: points of unknown coordinates
    (nuisances).

    The residual of a record is tip - target, so that its derivative by the tip is one. What is
    known of the seats themselves, their coordinates or the lengths of bars between them, comes as
    further residuals, the *ties*: an error of a seat's stated coordinates is common to its records,
    and does not average out over them.

    Attributes:
        reference: known coordinates (n, 3) [m]; NaN where there are none, or where the record
            touches a seat.
        seat: number of the seat that a record touches (n,); -1 where none.
        covariance: of each record's own target, apart from the arm (n, 3, 3) [m²].
        labels: of the seats (s,).
        stated: stated coordinates of the seats (s, 3) [m]; NaN where there are none.
        stated_u: their standard uncertainty (s, 3) [m]; NaN where none is stated.
        ends: seats at the two ends of each bar (b, 2).
        length: calibrated lengths of the bars (b,) [m].
        length_u: their standard uncertainties (b,) [m].
        oriented: True for records that state an orientation (n,). The covariance is then (n, 6, 6),
            of the turn behind the tip [rad²].
    """

    reference: Array
    seat: Index
    covariance: Array
    labels: tuple[str, ...]
    stated: Array
    stated_u: Array
    ends: Index
    length: Array
    length_u: Array
    oriented: Mask

    @cached_property
    def says(self) -> Mask:
        """(n,) True for records that say something."""
        return np.asarray((self.seat >= 0) | np.isfinite(self.reference).all(axis=1))

    @property
    def counts(self) -> Index:
        """How many numbers each record states (n,): none, three, or six with its orientation."""
        return 3 * (self.says * (1 + self.oriented.astype(np.intp)))

    @property
    def known(self) -> Mask:
        """(s,) True for seats whose coordinates are stated."""
        return np.asarray(np.isfinite(self.stated).all(axis=1))

    @property
    def unstated(self) -> Mask:
        """(s, 3) True for coordinates of seats that are stated without an uncertainty."""
        return np.asarray(self.known[:, None] & np.isnan(self.stated_u))

    @cached_property
    def clusters(self) -> Index:
        """Number of the cluster of each seat (s,): seats that bars connect, directly or by way of
        others.
        """
        shape = (len(self.labels), len(self.labels))
        graph = coo_array(
            (np.ones(len(self.ends)), (self.ends[:, 0], self.ends[:, 1])), shape=shape
        )
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)

    def start(self, tips: Array) -> Array:
        """First coordinates of the seats (s, 3): the stated ones, else the median of their tips
        (n, 3) [m].
        """
        touched = self.seat >= 0
        if not touched.any():
            return np.empty((0, 3))
        medians = pd.DataFrame(tips[touched]).groupby(self.seat[touched]).median()
        found = self.stated.copy()
        open_ = [k for k in medians.index if not self.known[k]]
        found[open_] = medians.loc[open_].to_numpy()
        return np.nan_to_num(found)

    def targets(self, points: Array) -> Array:
        """Where the tips should be with the seats at ``points`` (s, 3): (n, 3) [m]; NaN for records
        that say nothing.
        """
        found = self.reference.copy()
        found[self.seat >= 0] = points[self.seat[self.seat >= 0]]
        return found

    def deviations(self, poses: Array, points: Array) -> Array:
        """``poses`` (n, 3 or 6) [m, rad] less the targets, see :meth:`targets`; turns are from the
        target already.
        """
        off = poses.copy()
        off[:, :3] -= self.targets(points)
        return off

    def of_seats(self, points: Array) -> Array:
        """Residual of each seat's stated coordinates over their u (s, 3); zero where none are
        stated.
        """
        known = self.known[:, None]
        return np.where(known, (points - self.stated) / np.where(known, self.stated_u, 1.0), 0.0)

    def of_bars(self, points: Array) -> tuple[Array, Array]:
        """Residuals of lengths over their u (b,), and derivatives by the first ends (b, 3): minus
        those by the others.
        """
        way = points[self.ends[:, 0]] - points[self.ends[:, 1]]
        distance = np.linalg.norm(way, axis=1)
        along = way / np.where(distance > 0.0, distance, 1.0)[:, None]
        return (distance - self.length) / self.length_u, along / self.length_u[:, None]

    def divided(self, part: Index) -> tuple[Observations, Index, Index]:
        """The same with seats of their own in each part of the records (n,); and of each seat
        its number before and its part (s',).
        """
        touched = self.seat >= 0
        pairs, number = np.unique(
            np.stack([part[touched], self.seat[touched]], axis=1), axis=0, return_inverse=True
        )
        seat = np.full(len(self.seat), -1)
        seat[touched] = number.ravel()
        place = {(int(p), int(s)): k for k, (p, s) in enumerate(pairs)}
        bars = [
            (place[p, a], place[p, b], k)
            for p in np.unique(pairs[:, 0]).tolist()
            for k, (a, b) in enumerate(self.ends.tolist())
            if (p, a) in place and (p, b) in place
        ]
        table, old = np.array(bars, dtype=np.intp).reshape(-1, 3), pairs[:, 1].astype(np.intp)
        divided = replace(
            self,
            seat=seat,
            labels=tuple(self.labels[k] for k in old),
            stated=self.stated[old],
            stated_u=self.stated_u[old],
            ends=table[:, :2],
            length=self.length[table[:, 2]],
            length_u=self.length_u[table[:, 2]],
        )
        return divided, old, pairs[:, 0].astype(np.intp)
