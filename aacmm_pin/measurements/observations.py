"""Reference data of records as arrays: known coordinates, seats and known distances."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.measurements.relations import relations_of_planes

NOTHING_KNOWN = 1e-4
"""Smallest information for a known seat [1/m²]; less leaves it 100 m of freedom."""


NOTHING_BESIDE = 1e-3
"""Relative standard deviation of the part of a deviation that does not count."""
WILD_CONTACT = 1e-4
"""Distance from a sphere at which a contact loses weight in the first centre [m]."""
PLANE_ITERATIONS = 20
LEAST_MEDIAN = 1e-9
"""Of distances from a plane, for computed contacts may fit exactly [m]."""
LEAST_WIDTH = 1e-3
"""Contacts of a plane nearer together do not show its tilt [m]."""
OF_BAR = "bar"
"""The relation of two seats at a known distance."""


def best_sphere(points: Array) -> tuple[Array, float]:
    """Fit a sphere to points ``(m, 3)`` [m]: centre ``(3,)`` and radius [m].

    Linear least squares of ``|p|² = 2 c·p + k``.
    """
    middle = points.mean(axis=0)
    centred = points - middle
    design = np.column_stack([2.0 * centred, np.ones(len(centred))])
    solution, *_ = np.linalg.lstsq(design, np.square(centred).sum(axis=1), rcond=1e-6)
    centre, k = solution[:3], solution[3]
    return middle + centre, float(np.sqrt(np.maximum(k + centre @ centre, 0.0)))


def centre_of_sphere(points: Array, radius: float) -> Array:
    """Fit a sphere of known radius to points ``(m, 3)`` [m]: centre ``(3,)`` [m].

    The robust fit (soft L1 loss) starts on both sides of the points.
    """

    def distances(centre: Array) -> Any:
        return np.linalg.norm(points - centre, axis=1) - radius

    normal = normal_of_plane(points)
    middle = points.mean(axis=0)
    width = np.sqrt(np.square(points - middle).sum(axis=1).mean())
    height = np.sqrt(max(radius**2 - width**2, 0.0))
    starts = [best_sphere(points)[0], middle + height * normal, middle - height * normal]
    options = {"loss": "soft_l1", "f_scale": WILD_CONTACT}
    fits = [scipy.optimize.least_squares(distances, start, **options) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost))
    return np.asarray(best.x)


def normal_of_plane(points: Array) -> Array:
    """Unit normal ``(3,)`` of the best plane through points ``(m, 3)`` [m]."""
    centred = points - points.mean(axis=0)
    *_, directions = np.linalg.svd(centred, full_matrices=False)
    return np.asarray(directions[2])


def plane_of_most(points: Array) -> tuple[Array, Array]:
    """Point and unit normal (3,) of the plane of points (m, 3) [m], in which the nearer half has
    full weight and the others have it by their distance: a contact of another face hardly tilts it.
    """
    weights = np.ones(len(points))
    for _ in range(PLANE_ITERATIONS):
        middle = np.average(points, axis=0, weights=weights)
        centred = points - middle
        *_, directions = np.linalg.svd(np.sqrt(weights)[:, None] * centred, full_matrices=False)
        distance = np.abs(centred @ directions[2])
        weights = 1.0 / np.maximum(distance, np.median(distance) + LEAST_MEDIAN)
    return middle, np.asarray(directions[2])


def clusters_of(ends: Index, seats: int) -> Index:
    """The cluster of each seat, ``(seats,)``; pairs ``ends`` ``(b, 2)`` connect seats."""
    graph = coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(seats, seats))
    _, number = connected_components(graph, directed=False)
    return np.asarray(number, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Observations:
    """The targets of the tip in n records, some of these at s seats with unknown or stated
    coordinates.

    The residual of a record, its deviation when whitened, is tip minus target. Stated seats,
    lengths of bars, and distances and angles between planes add residuals, the *ties*. All records
    of a seat share the error of its stated coordinates, which more records do not reduce.

    Attributes:
        reference: known coordinates ``(n, 3)`` [m]; NaN if unknown or at a seat.
        seat: index of the touched seat ``(n,)``; -1 for none.
        covariance: of the targets, without that of the arm, ``(n, 3, 3)`` [m²]; with any
            orientation ``(n, 6, 6)``, the rotation after the position [rad²].
        labels: of the seats ``(s,)``.
        stated: coordinates of the seats ``(s, 3)`` [m]; NaN if not stated.
        stated_u: of ``stated`` ``(s, 3)`` [m]; NaN if not stated.
        ends: indices of both seats of each relation ``(b, 2)``.
        relation: its kind ``(b,)``: a bar, or a distance, angle or tilt of two planes.
        value: its calibrated value ``(b,)`` [m, rad].
        value_u: its standard uncertainty ``(b,)`` [m, rad].
        oriented: records that state an orientation ``(n,)``.
        radius: distance from tip to seat if this is the centre of a sphere ``(n,)`` [m]; else NaN.
        on_plane: records that touch a plane ``(n,)``. Their seat is the point nearest to ``anchor``
            of the parallel plane of ball centres.
        anchor: a point as far from the plane as the contacts are from their mean, RMS and at least
            1 mm ``(s, 3)`` [m]; NaN for no plane.
        normal: of the surface at each record ``(n, 3)``; zero without surface.
        normal_for_seat: minus the derivative of the distance from the plane by the seat ``(n, 3)``.
    """

    reference: Array
    seat: Index
    covariance: Array
    labels: tuple[str, ...]
    stated: Array
    stated_u: Array
    ends: Index
    relation: NDArray[np.str_]
    value: Array
    value_u: Array
    oriented: Mask
    radius: Array
    on_plane: Mask
    anchor: Array
    normal: Array
    normal_for_seat: Array

    @cached_property
    def has_target(self) -> Mask:
        """Records with a target, ``(n,)``."""
        has_reference = np.isfinite(self.reference).all(axis=1)
        return (self.seat >= 0) | has_reference

    @property
    def counts(self) -> Index:
        """Number of coordinates of each record, ``(n,)``: 0 without target, 1 on a surface, 3 for a
        point, and 3 more for an orientation.
        """
        of_tip = np.where(self.on_surface, 1, 3)
        return self.has_target * of_tip + 3 * (self.has_target & self.oriented)

    @property
    def on_sphere(self) -> Mask:
        """Records that touch a sphere, ``(n,)``."""
        return np.isfinite(self.radius)

    @property
    def on_surface(self) -> Mask:
        """Records that touch a sphere or plane, ``(n,)``; deviations along the normal count."""
        return self.on_sphere | self.on_plane

    @property
    def spheres(self) -> Mask:
        """Seats that are centres of spheres, ``(s,)``."""
        return self._seats_of(self.on_sphere)

    @property
    def planes(self) -> Mask:
        """Seats that are planes, ``(s,)``."""
        return self._seats_of(self.on_plane)

    def _seats_of(self, records: Mask) -> Mask:
        number = np.arange(len(self.labels))
        return np.isin(number, self.seat[records])

    @property
    def surfaces(self) -> Mask:
        """Seats that are spheres or planes, ``(s,)``."""
        return self.spheres | self.planes

    def with_normals(self, tips: Array, points: Array) -> Observations:
        """Return the observations with normals, for tips ``(n, 3)`` and seats ``(s, 3)`` [m]."""
        normal = np.zeros((len(tips), 3))
        sphere = self.on_sphere
        from_centre = tips[sphere] - points[self.seat[sphere]]
        normal[sphere] = from_centre / np.linalg.norm(from_centre, axis=1, keepdims=True)
        anchor = self.anchor.copy()
        for k in np.flatnonzero(self.planes & np.isnan(anchor[:, 0])):
            contacts = tips[self.seat == k]
            width = np.sqrt(np.square(contacts - contacts.mean(axis=0)).sum(axis=1).mean())
            anchor[k] = points[k] - max(width, LEAST_WIDTH) * plane_of_most(contacts)[1]
        anchored = replace(self, anchor=anchor)
        plane = self.on_plane
        seat = self.seat[plane]
        of_planes = anchored._normals_of_planes(points)
        normal[plane] = of_planes
        height = np.linalg.norm(points[seat] - anchor[seat], axis=1)[:, None]
        from_seat = tips[plane] - points[seat]
        along_normal = np.sum(from_seat * of_planes, axis=1, keepdims=True) * of_planes
        normal_for_seat = np.zeros_like(normal)
        # A displaced seat also rotates its plane about the anchor.
        normal_for_seat[plane] = of_planes - (from_seat - along_normal) / height
        return replace(anchored, normal=normal, normal_for_seat=normal_for_seat)

    def _normals_of_planes(self, points: Array) -> Array:
        seat = self.seat[self.on_plane]
        from_anchor = points[seat] - self.anchor[seat]
        return np.asarray(from_anchor / np.linalg.norm(from_anchor, axis=1, keepdims=True))

    def seat_derivatives(self, whitening: Array) -> Array:
        """Derivative of each whitened deviation with respect to its seat ``(n, r, 3)``;
        ``whitening`` ``(n, r, 3 or 6)`` makes r numbers of a deviation.
        """
        derivative = -whitening[:, :, :3]
        plane = self.on_plane
        along_normal = derivative[plane] @ self.normal[plane][:, :, None]
        derivative[plane] = along_normal * self.normal_for_seat[plane][:, None, :]
        return derivative

    def along_normals(self, rows: Array) -> Array:
        """Rows ``(n, r, 3 or 6)`` that multiply only the part of a deviation that counts."""
        if not self.on_surface.any():
            return rows
        return rows @ self._projections(rows.shape[2])

    def counting_covariance(self, covariance: Array) -> Array:
        """Covariance of the part of deviations that counts, ``(n, 3 or 6, 3 or 6)`` [m², rad²]; the
        rest has a tiny variance.
        """
        if not self.on_surface.any():
            return covariance
        projection = self._projections(covariance.shape[2])
        along_normal = projection @ covariance @ projection
        size = np.trace(along_normal[:, :3, :3], axis1=1, axis2=2)[:, None, None]
        across = NOTHING_BESIDE**2 * size * (np.eye(covariance.shape[2]) - projection)
        return np.asarray(along_normal + across)

    def _projections(self, width: int) -> Array:
        """(n, width, width)."""
        projections = np.tile(np.eye(width), (len(self.normal), 1, 1))
        normal = self.normal[self.on_surface]
        projections[self.on_surface, :3, :3] = normal[:, :, None] * normal[:, None, :]
        return projections

    @property
    def is_stated(self) -> Mask:
        """Seats with stated coordinates, ``(s,)``."""
        return np.asarray(np.isfinite(self.stated).all(axis=1))

    @property
    def without_u(self) -> Mask:
        """Stated coordinates without an uncertainty, ``(s, 3)``."""
        is_stated = self.is_stated[:, None]
        return is_stated & np.isnan(self.stated_u)

    @cached_property
    def clusters(self) -> Index:
        """The cluster of each seat, ``(s,)``; relations connect its seats."""
        return clusters_of(self.ends, len(self.labels))

    def first_seats(self, tips: Array) -> Array:
        """First estimates of the seats, ``(s, 3)`` [m], from tips ``(n, 3)`` [m].

        The stated value, else the median of the tips; of a sphere the fitted centre, of a plane the
        mean.
        """
        has_seat = self.seat >= 0
        if not has_seat.any():
            return np.empty((0, 3))
        medians = pd.DataFrame(tips[has_seat]).groupby(self.seat[has_seat]).median()
        seats = self.stated.copy()
        not_stated = [k for k in medians.index if not self.is_stated[k]]
        seats[not_stated] = medians.loc[not_stated].to_numpy()
        for k in np.flatnonzero(self.spheres & ~self.is_stated):
            contacts = self.seat == k
            seats[k] = centre_of_sphere(tips[contacts], float(self.radius[contacts][0]))
        for k in np.flatnonzero(self.planes):
            seats[k], _ = plane_of_most(tips[self.seat == k])
        return np.nan_to_num(seats)

    def targets(self, points: Array) -> Array:
        """Targets of the tips, ``(n, 3)`` [m], for seats at ``points`` ``(s, 3)``; NaN without
        target.
        """
        has_seat = self.seat >= 0
        targets = self.reference.copy()
        targets[has_seat] = points[self.seat[has_seat]]
        return targets

    def deviations(self, poses: Array, points: Array) -> Array:
        """Deviations of ``poses`` from the targets, ``(n, 3 or 6)`` [m, rad]; along the normal on a
        surface.

        Args:
            poses: tips, and rotations from the target if stated, ``(n, 3 or 6)`` [m, rad].
            points: the seats ``(s, 3)`` [m].
        """
        deviations = poses.copy()
        deviations[:, :3] -= self.targets(points)
        sphere = self.on_sphere
        above_sphere = np.linalg.norm(deviations[sphere, :3], axis=1) - self.radius[sphere]
        deviations[sphere, :3] = above_sphere[:, None] * self.normal[sphere]
        plane = self.on_plane
        above_plane = np.sum(deviations[plane, :3] * self._normals_of_planes(points), axis=1)
        deviations[plane, :3] = above_plane[:, None] * self.normal[plane]
        return deviations

    def seat_residuals(self, points: Array) -> Array:
        """Residuals of the stated seats over their u, ``(s, 3)``; zero if not stated."""
        is_stated = self.is_stated[:, None]
        u = np.where(is_stated, self.stated_u, 1.0)
        return np.where(is_stated, (points - self.stated) / u, 0.0)

    def relation_residuals(self, points: Array) -> tuple[Array, Array]:
        """Residuals of relations over their u ``(b,)``; derivatives by both ends ``(b, 2, 3)``."""
        first, second = self.ends.T
        difference = points[first] - points[second]
        values = np.linalg.norm(difference, axis=1)
        direction = difference / np.where(values > 0.0, values, 1.0)[:, None]
        derivatives = np.stack([direction, -direction], axis=1)
        planes = self.relation != OF_BAR
        if planes.any():
            ends = self.ends[planes]
            values[planes], derivatives[planes] = relations_of_planes(
                self.relation[planes], self.value[planes], points[ends], self.anchor[ends]
            )
        return (values - self.value) / self.value_u, derivatives / self.value_u[:, None, None]

    def divided(self, part: Index) -> tuple[Observations, Index, Index]:
        """Separate the seats of each ``part`` ``(n,)`` of the records.

        Returns:
            The observations; old index, and part, of each new seat ``(s',)``.
        """
        has_seat = self.seat >= 0
        part_and_seat = np.stack([part[has_seat], self.seat[has_seat]], axis=1)
        pairs, new_number = np.unique(part_and_seat, axis=0, return_inverse=True)
        seat = np.full(len(self.seat), -1)
        seat[has_seat] = new_number.ravel()
        parts, old_seat = pairs.astype(np.intp).T
        # Records of no part, -1, are in the last row.
        new_seat = np.full((part.max(initial=-1) + 2, len(self.labels)), -1)
        new_seat[parts, old_seat] = np.arange(len(old_seat))
        ends = new_seat[:, self.ends]
        has_both = (ends >= 0).all(axis=2)
        relations = np.nonzero(has_both)[1]
        divided = replace(
            self,
            seat=seat,
            labels=tuple(self.labels[k] for k in old_seat),
            stated=self.stated[old_seat],
            stated_u=self.stated_u[old_seat],
            anchor=self.anchor[old_seat],
            ends=ends[has_both],
            relation=self.relation[relations],
            value=self.value[relations],
            value_u=self.value_u[relations],
        )
        return divided, old_seat, parts
