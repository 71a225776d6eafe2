"""What records say of where their tips were, as arrays: known coordinates, one point touched again,
known distances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
import scipy
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aacmm_pin._support.checks import Array, Index, Mask

NOTHING_KNOWN = 1e-4
"""With less information than this nothing is known of a seat, which is somewhere within a hundred
metres [1/m²].
"""


NOTHING_BESIDE = 1e-3
"""Standard deviation of what does not count of a deviation, over that of what counts."""
WILD_CONTACT = 1e-4
"""A contact that is farther from a sphere than this pulls its first centre less [m]."""


def best_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius of the sphere that points (m, 3) are on [m], by the linear least
    squares of ``|p|² = 2 c·p + k``.
    """
    middle = points.mean(axis=0)
    about = points - middle
    columns = np.column_stack([2.0 * about, np.ones(len(about))])
    found, *_ = np.linalg.lstsq(columns, np.square(about).sum(axis=1), rcond=1e-6)
    centre, rest = np.split(found, [3])
    return middle + centre, float(np.sqrt(np.maximum(rest[0] + centre @ centre, 0.0)))


def centre_of_sphere(points: Array, radius: float) -> Array:
    """Centre (3,) of the sphere of known radius that points (m, 3) are on [m]: the least sum of
    distances of which large ones count less, from starts on both sides of the points.
    """

    def beyond(centre: Array) -> Array:
        distances = np.linalg.norm(points - centre, axis=1)
        return np.asarray(distances - radius)

    normal = normal_of_plane(points)
    middle = points.mean(axis=0)
    width = np.sqrt(np.square(points - middle).sum(axis=1).mean())
    height = np.sqrt(max(radius**2 - width**2, 0.0))
    starts = [best_sphere(points)[0], middle + height * normal, middle - height * normal]
    options = {"loss": "soft_l1", "f_scale": WILD_CONTACT}
    ends = [scipy.optimize.least_squares(beyond, start, **options) for start in starts]
    best = min(ends, key=lambda end: float(end.cost))
    return np.asarray(best.x)


def normal_of_plane(points: Array) -> Array:
    """Unit normal (3,) of the plane that fits points (m, 3) best, up to its sign."""
    about = points - points.mean(axis=0)
    *_, directions = np.linalg.svd(about, full_matrices=False)
    return np.asarray(directions[2])


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
        radius: distance of the tip from its seat where this is the centre of a sphere (n,) [m]; NaN
            where the tip is at the seat.
        on_plane: (n,) True where the tip is on a plane parallel to the one that the record touches;
            its seat is then the point of that plane nearest to the ``anchor``.
        anchor: a point 1 m off the plane of each seat (s, 3) [m]; NaN where the seat is no plane.
        normal: of the sphere or plane at each record (n, 3); zero where the tip is at the seat.
        by_place: derivative of a record's distance from its plane by the seat, times -1 (n, 3).
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
    radius: Array
    on_plane: Mask
    anchor: Array
    normal: Array
    by_place: Array

    @cached_property
    def has_target(self) -> Mask:
        """(n,) True for records that say something."""
        known = np.isfinite(self.reference).all(axis=1)
        return (self.seat >= 0) | known

    @property
    def counts(self) -> Index:
        """How many numbers each record states (n,): none, three, or six with its orientation."""
        of_tip = np.where(self.on_surface, 1, 3)
        return np.asarray(self.has_target * of_tip + 3 * (self.has_target & self.oriented))

    @property
    def on_sphere(self) -> Mask:
        """(n,) True for records that touch a sphere."""
        return np.asarray(np.isfinite(self.radius))

    @property
    def on_surface(self) -> Mask:
        """(n,) True for records that touch a sphere or a plane: of their deviation, the part along
        the normal counts.
        """
        return self.on_sphere | self.on_plane

    @property
    def spheres(self) -> Mask:
        """(s,) True for seats that are centres of spheres."""
        return self._seats_of(self.on_sphere)

    @property
    def planes(self) -> Mask:
        """(s,) True for seats that are planes."""
        return self._seats_of(self.on_plane)

    def _seats_of(self, records: Mask) -> Mask:
        """Which seats some of the records (n,) touch (s,)."""
        number = np.arange(len(self.labels))
        return np.isin(number, self.seat[records])

    @property
    def surfaces(self) -> Mask:
        """(s,) True for seats that are spheres or planes."""
        return self.spheres | self.planes

    def with_normals(self, tips: Array, points: Array) -> Observations:
        """The same with the normals of spheres and planes at tips (n, 3), whose seats are at
        ``points`` (s, 3) [m].
        """
        on = self.on_sphere
        way = tips[on] - points[self.seat[on]]
        normal = np.zeros((len(tips), 3))
        normal[on] = way / np.linalg.norm(way, axis=1, keepdims=True)
        anchor = self.anchor.copy()
        for k in np.flatnonzero(self.planes & np.isnan(anchor[:, 0])):
            anchor[k] = points[k] - normal_of_plane(tips[self.seat == k])
        placed = replace(self, anchor=anchor)
        return placed._with_planes(normal, tips, points)

    def _with_planes(self, normal: Array, tips: Array, points: Array) -> Observations:
        on = self.on_plane
        seat = self.seat[on]
        height = np.linalg.norm(points[seat] - self.anchor[seat], axis=1)[:, None]
        normal[on] = self._normals_of_planes(points)
        off = tips[on] - points[seat]
        along = np.sum(off * normal[on], axis=1, keepdims=True) * normal[on]
        by_place = np.zeros_like(normal)
        by_place[on] = normal[on] - (off - along) / height
        return replace(self, normal=normal, by_place=by_place)

    def _normals_of_planes(self, points: Array) -> Array:
        """Of the planes that records touch, with the seats at ``points`` (s, 3) [m]."""
        seat = self.seat[self.on_plane]
        way = points[seat] - self.anchor[seat]
        return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))

    def by_seats(self, whitening: Array) -> Array:
        """Derivative of whitened deviations by the seats (n, r, 3), by the rows of ``whitening``
        (n, r, 3 or 6).
        """
        found = -whitening[:, :, :3]
        on = self.on_plane
        if on.any():
            along = found[on] @ self.normal[on][:, :, None]
            found[on] = along * self.by_place[on][:, None, :]
        return found

    def along_normals(self, rows: Array) -> Array:
        """Rows (n, r, 3 or 6) that multiply deviations, with the part that counts alone."""
        if not self.on_surface.any():
            return rows
        return np.asarray(rows @ self._projections(rows.shape[2]))

    def counting(self, covariance: Array) -> Array:
        """Covariance of deviations (n, 3 or 6, 3 or 6) [m², rad²], that of the part that does not
        count being next to nothing.
        """
        if not self.on_surface.any():
            return covariance
        projection = self._projections(covariance.shape[2])
        along = projection @ covariance @ projection
        size = np.trace(along[:, :3, :3], axis1=1, axis2=2)[:, None, None]
        rest = NOTHING_BESIDE**2 * size * (np.eye(covariance.shape[2]) - projection)
        return np.asarray(along + rest)

    def _projections(self, width: int) -> Array:
        """Onto the part of deviations that counts (n, width, width)."""
        found = np.tile(np.eye(width), (len(self.normal), 1, 1))
        normal = self.normal[self.on_surface]
        found[self.on_surface, :3, :3] = normal[:, :, None] * normal[:, None, :]
        return found

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
        (n, 3), the centre of the sphere that they are on, or their mean on a plane [m].
        """
        touched = self.seat >= 0
        if not touched.any():
            return np.empty((0, 3))
        medians = pd.DataFrame(tips[touched]).groupby(self.seat[touched]).median()
        found = self.stated.copy()
        open_ = [k for k in medians.index if not self.known[k]]
        found[open_] = medians.loc[open_].to_numpy()
        for k in np.flatnonzero(self.spheres & ~self.known):
            own = self.seat == k
            found[k] = centre_of_sphere(tips[own], float(self.radius[own][0]))
        for k in np.flatnonzero(self.planes):
            found[k] = tips[self.seat == k].mean(axis=0)
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
        target already. From a sphere or plane it is the distance along the normal.
        """
        off = poses.copy()
        off[:, :3] -= self.targets(points)
        on = self.on_sphere
        beyond = np.linalg.norm(off[on, :3], axis=1) - self.radius[on]
        off[on, :3] = beyond[:, None] * self.normal[on]
        on = self.on_plane
        above = np.sum(off[on, :3] * self._normals_of_planes(points), axis=1)
        off[on, :3] = above[:, None] * self.normal[on]
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
            anchor=self.anchor[old],
            ends=np.array(ends, dtype=np.intp).reshape(-1, 2),
            length=self.length[kept],
            length_u=self.length_u[kept],
        )
        return divided, old, parts
