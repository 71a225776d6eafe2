"""Accuracy at a point as a body: coverage ellipsoid, or all that bounded parameters can do, magnified so that it is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.spatial import QhullError

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.accuracy import zonotope
from aacmm_pin.accuracy.volume import COVERAGE_FACTOR, AccuracyVolume
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.plots.style import round_down
from aacmm_pin.report.scenes.shapes import hull

Shape = Literal["ellipsoid", "zonotope"]
SEEN = 0.14
"""Half the length at which the largest of the bodies is drawn at most, in sizes of the scene."""
THIN = 1e-4
"""Thickness given to a body that has none, in its lengths."""


@dataclass(frozen=True, eq=False)
class AccuracySet:
    """The bodies of many configurations at one point.

    Attributes:
        accuracy: of the configurations.
        shape: which body.
        factor: magnification.
        centre: the point (3,) [m].
    """

    accuracy: AccuracyVolume
    shape: Shape
    factor: float
    centre: Array

    @staticmethod
    def of(accuracy: AccuracyVolume, shape: Shape, centre: Array, size: float) -> AccuracySet:
        """The bodies, magnified by a round number so that they suit a scene of ``size`` [m].

        Raises:
            UnknownNameError: no such shape.
            AacmmError: ``zonotope`` without bounded parameters.
        """
        if shape not in get_args(Shape):
            raise UnknownNameError("shape", shape, list(get_args(Shape)))
        longest = half_axes(accuracy.covariance) if shape == "ellipsoid" else accuracy.largest_deviation
        return AccuracySet(accuracy, shape, round_down(SEEN * size / max(float(longest.max()), 1e-12)), centre)

    @property
    def words(self) -> str:
        """What it is, with its magnification."""
        if self.shape == "ellipsoid":
            return f"the 95 % ellipsoid of the position (k = {COVERAGE_FACTOR:.2f}), magnified {self.factor:g} times"
        return f"everything that the parameters can do together within their half-widths, magnified {self.factor:g} times"

    def ellipsoids(self) -> Array:
        """Placements that make a unit sphere the ellipsoid of each configuration (n, 4, 4) [m]."""
        _, vectors = np.linalg.eigh(self.accuracy.covariance)
        vectors[np.linalg.det(vectors) < 0, :, 0] *= -1.0
        radii = self.factor * half_axes(self.accuracy.covariance)
        placements = np.tile(np.eye(4), (len(vectors), 1, 1))
        placements[:, :3, :3] = vectors * np.maximum(radii, THIN * radii.max(axis=1, keepdims=True))[:, None, :]
        placements[:, :3, 3] = self.centre
        return placements

    def zonotope(self, number: int) -> tuple[Array, Index]:
        """Vertices (v, 3) [m] and triangles (f, 3) of the body of one configuration, about its centre."""
        one = slice(number, number + 1)
        conditions = None if self.accuracy.conditions is None else self.accuracy.conditions.take(one)
        sensitivity = self.accuracy.sources.sensitivity(self.accuracy.q[one], conditions)
        generators = self.factor * self.accuracy.sources.generators(sensitivity)
        try:
            return hull(zonotope.corners(generators)[0])
        except QhullError:  # flat: no more than two directions
            thickness = THIN * float(np.abs(generators).max()) * np.eye(3)[None]
            return hull(zonotope.corners(np.concatenate([generators, thickness], axis=2))[0])


def half_axes(covariance: Array) -> Array:
    """Half axes of the 95 % ellipsoids of covariances (n, 3, 3) [m²], growing: (n, 3) [m]."""
    return np.asarray(COVERAGE_FACTOR * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0)))
