"""Spheres through probed points and around centres."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, batch
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.measurements import best_sphere

FEWEST_POINTS = 4
"""For a sphere of unknown centre and diameter."""
PLANE_TOLERANCE = 1e-6
"""Smallest over largest extent of points in a plane, which fit no sphere."""
MOST_DIAMETER_FACTOR = 4.0
"""Largest u of a diameter over that of points. With more, 25 points are within about 45° of their
middle, nine within 60°.
"""
INSIDE = 1e-10
"""Part of the radius by which a point outside still counts as on it."""


class FittedSphere(NamedTuple):
    """Centre (3,), diameter, and form, the range of radial distances [m], by least squares.

    ``diameter_factor`` is u of the diameter over u of points, ``residuals`` are radial, outwards
    (n,) [m]; ``leverages`` (n,).
    """

    center: Array
    diameter: float
    form: float
    diameter_factor: float
    residuals: Array
    leverages: Array

    @property
    def on_small_cap(self) -> bool:
        """The points do not determine the diameter."""
        return self.diameter_factor > MOST_DIAMETER_FACTOR


def fitted_sphere(points: ArrayLike) -> FittedSphere:
    """The sphere with the least sum of squared radial distances of ``points`` (n, 3) [m]."""
    points = batch(points, 3, "points", "m")
    if len(points) < FEWEST_POINTS:
        raise ShapeError(
            f"points has {len(points)} rows; expected at least {FEWEST_POINTS} for a sphere"
        )
    middle = points.mean(axis=0)
    extents = np.linalg.svd(points - middle, compute_uv=False)
    if extents[2] <= PLANE_TOLERANCE * extents[0]:
        raise AacmmError(
            f"{len(points)} points lie in one plane; expected points all over the sphere"
        )
    size = float(extents[0])
    scaled = (points - middle) / size

    def residuals(sphere: Array) -> Array:
        distance = np.linalg.norm(scaled - sphere[:3], axis=1)
        return np.asarray(distance - sphere[3])

    centre, radius = best_sphere(scaled)
    tolerances = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    fit = scipy.optimize.least_squares(residuals, [*centre, radius], jac="3-point", **tolerances)
    factor = 2 * float(np.linalg.norm(np.linalg.pinv(fit.jac)[3]))
    leverages = np.sum(np.linalg.qr(fit.jac).Q ** 2, axis=1)
    radial = fit.fun * size
    center = middle + fit.x[:3] * size
    diameter = 2 * float(fit.x[3]) * size
    return FittedSphere(center, diameter, float(np.ptp(radial)), factor, radial, leverages)


def smallest_sphere(points: Array) -> tuple[Array, float]:
    """Centre (3,) and radius [m] of the smallest sphere around ``points`` (n, 3): the smallest
    through one to four of them that encloses all.
    """
    smallest, radius = points.mean(axis=0), np.inf
    for count in range(1, 5):
        for on in combinations(points, count):
            edges = np.array(on) - on[0]
            offset, *_ = np.linalg.lstsq(2 * edges, np.sum(edges**2, axis=1))
            center = on[0] + offset
            farthest = np.linalg.norm(points - center, axis=1).max()
            through = float(np.linalg.norm(offset))
            if farthest <= through + INSIDE * farthest and through < radius:
                smallest, radius = center, through
    return smallest, radius
