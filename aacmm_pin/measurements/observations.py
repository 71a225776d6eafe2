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
    def has_target(self) -> Mask:
        """(n,) True for records that say something."""
        known = np.isfinite(self.reference).all(axis=1)
        return (self.seat >= 0) | known

    @property
    def counts(self) -> Index:
        """How many numbers each record states (n,): none, three, or six with its orientation."""
        vectors = 1 + self.oriented.astype(np.intp)
        return 3 * (self.has_target * vectors)

    @property
    def known(self) -> Mask:
        """(s,) True for seats whose coordinates are stated."""
        return np.asarray(np.isfinite(self.stated).all(axis=1))

    @property
    def unstated(self) -> Mask:
        """(s, 3) True for coordinates of seats that are stated without an uncertainty."""
        known = self.known[:, None]
        return known & np.isnan(self.stated_u)

    @cached_property
    def clusters(self) -> Index:
        """Number of the cluster of each seat (s,): seats that bars connect, directly or by way of
        others.
        """
        bars = len(self.ends)
        seats = len(self.labels)
        graph = coo_array((np.ones(bars), tuple(self.ends.T)), shape=(seats, seats))
        _, number = connected_components(graph, directed=False)
        return np.asarray(number, dtype=np.intp)

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
        first, second = self.ends.T
        way = points[first] - points[second]
        distance = np.linalg.norm(way, axis=1)
        along = way / np.where(distance > 0.0, distance, 1.0)[:, None]
        return (distance - self.length) / self.length_u, along / self.length_u[:, None]

    def divided(self, part: Index) -> tuple[Observations, Index, Index]:
        """The same with seats of their own in each part of the records (n,); and of each seat
        its number before and its part (s',).
        """
        touched = self.seat >= 0
        of_touches = np.stack([part[touched], self.seat[touched]], axis=1)
        pairs, number = np.unique(of_touches, axis=0, return_inverse=True)
        seat = np.full(len(self.seat), -1)
        seat[touched] = number.ravel()
        parts, old = pairs.astype(np.intp).T
        place = {pair: k for k, pair in enumerate(map(tuple, pairs.tolist()))}
        ends = []
        bars = []
        for p in np.unique(parts).tolist():
            for bar, (a, b) in enumerate(self.ends.tolist()):
                if (p, a) in place and (p, b) in place:
                    ends.append((place[p, a], place[p, b]))
                    bars.append(bar)
        kept = np.array(bars, dtype=np.intp)
        divided = replace(
            self,
            seat=seat,
            labels=tuple(self.labels[k] for k in old),
            stated=self.stated[old],
            stated_u=self.stated_u[old],
            ends=np.array(ends, dtype=np.intp).reshape(-1, 2),
            length=self.length[kept],
            length_u=self.length_u[kept],
        )
        return divided, old, parts
