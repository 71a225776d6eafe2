"""Mistakes that probed points show: copies, other units, outliers of spheres, wrong probe
diameters.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import scipy
from scipy.special import stdtr

from aacmm_pin._support.notes import Note
from aacmm_pin.errors import AacmmError
from aacmm_pin.verification.evaluators import LENGTH_KEY, measured_lengths, size_error
from aacmm_pin.verification.places import Place, coordinates_of
from aacmm_pin.verification.spheres import FEWEST_POINTS, FittedSphere, fitted_sphere

COPY_TOLERANCE = 5e-7
"""Coordinates within this tolerance are a copy rounded to a micrometre or finer [m]."""
PART_OF_RANGE = 0.1
"""Positions of a test extend over more than this part of the measuring range."""
CLOSE = 3e-3
"""If all probed points of a test are within this extent, they may be in another unit [m]."""
IMPLAUSIBLE_LENGTH_FACTOR = 2.0
"""No arm measures a length too long or too short by this factor."""
UNIT_FACTOR_TOLERANCE = 0.02
"""Lengths whose factors agree up to this part are in another unit."""
WRONG_SIZE = 1e-3
"""No arm measures a diameter with an error as large as this [m]."""
LEAST_DISTANCE_FROM_SPHERE = 5e-5
"""Shorter distances of a probed point from its sphere give no note [m]."""
TIMES_SMALLER = 50.0
"""If the points of a position scatter less than the others by this factor, they may be in another
unit.
"""
CHANCE = 1e-4
"""Probability of a distance from the sphere below which a note names a probed point."""
TIMES_ITS_LIKE = 10.0
"""Spheres of too few points to find the outlier give a note if their form is so many medians of the
others.
"""


def check_unit(probed_points: pd.DataFrame) -> None:
    """Check that the lengths of each test are in the unit of the coordinates.

    Raises:
        AacmmError: all lengths are wrong by one factor.
    """
    for test, of_test in probed_points[probed_points["length"].notna()].groupby("test", sort=False):
        try:
            lengths = measured_lengths(of_test, both_sides=test == "length-bi")
        except AacmmError:  # a note states that these have no value
            continue
        factors = (1 + lengths["error"] / lengths["length"]).to_numpy()
        if (
            len(factors)
            and np.ptp(factors) <= UNIT_FACTOR_TOLERANCE * factors.min()
            and not 1 / IMPLAUSIBLE_LENGTH_FACTOR < factors.mean() < IMPLAUSIBLE_LENGTH_FACTOR
        ):
            raise AacmmError(
                f"test {test}: each of {len(factors)} measured lengths is {factors.mean():.4g} "
                "times the stated length_mm; expected coordinates and length_mm in mm"
            )


def doubts(
    source: str, probed_points: pd.DataFrame, measuring_range: float | None = None
) -> Iterator[Note]:
    """Notes on the probed points of one set of coordinates; ``measuring_range`` in m."""
    at = coordinates_of(probed_points)
    tree = scipy.spatial.KDTree(at)
    distances, _ = tree.query(at, 2, p=np.inf, distance_upper_bound=COPY_TOLERANCE)
    copies = int(np.isfinite(distances[:, 1]).sum())  # the first is the distance from itself
    if copies:
        yield Note("touches_copied", {"copies": copies, "touches": len(at)}).with_place(source)
    for test, of_test in probed_points.groupby("test", sort=False):
        extent = float(np.ptp(of_test[["x", "y", "z"]].to_numpy(), axis=0).max())
        several = of_test["position"].nunique() > 1
        data = {"test": test, "extent": extent}
        if extent < CLOSE and (several or test != "single-point"):
            yield Note("test_small", data).with_place(source)
        elif several and measuring_range is not None and extent < PART_OF_RANGE * measuring_range:
            yield Note("test_small_in_range", {**data, "range": measuring_range}).with_place(source)
        if test == "single-point":
            yield from (note.with_place(source) for note in _too_small(of_test))
        spheres = [*_spheres(of_test)]
        yield from (
            note.with_place(source) for note in (*_outliers(spheres), *_wrong_sizes(spheres))
        )


def _too_small(probed_points: pd.DataFrame) -> Iterator[Note]:
    extents = probed_points.groupby("position", sort=False)[["x", "y", "z"]].agg(np.ptp).max(axis=1)
    for position, extent in extents.items():
        others = float(extents.drop(position).median()) if len(extents) > 1 else 0.0
        if 0.0 < extent * TIMES_SMALLER < others:  # of copies there is a note
            yield Note("position_small", {"extent": float(extent), "others": others}).with_place(
                f"position {position}"
            )


def _spheres(probed_points: pd.DataFrame) -> Iterator[tuple[pd.DataFrame, FittedSphere]]:
    """The spheres of a test with more than four probed points."""
    by = (
        ["feature", "position"]
        if probed_points["test"].iloc[0] == "sphere"
        else [*LENGTH_KEY, "feature"]
    )
    for _, group in probed_points.groupby(by, sort=False):
        try:
            if len(group) > FEWEST_POINTS and group["test"].iloc[0] != "single-point":
                yield group, fitted_sphere(coordinates_of(group))
        except AacmmError:  # a note states that its characteristics have no value
            continue


def _outliers(spheres: list[tuple[pd.DataFrame, FittedSphere]]) -> Iterator[Note]:
    """Notes on outliers, and on spheres of five or six points with a large form."""
    forms = np.array([sphere.form for _, sphere in spheres])
    for k, (group, sphere) in enumerate(spheres):
        point, distance = _outlier(group, sphere)
        if point is not None:
            yield Note("touch_off_sphere", {"distance": distance}).with_place(str(Place.of(point)))
        elif len(spheres) > 2 and sphere.form > max(
            TIMES_ITS_LIKE * float(np.median(np.delete(forms, k))), LEAST_DISTANCE_FROM_SPHERE
        ):
            yield Note("touches_off_sphere", {"form": sphere.form}).with_place(str(Place.of(group)))


def _outlier(group: pd.DataFrame, sphere: FittedSphere) -> tuple[pd.DataFrame | None, float]:
    """The point farther from the sphere of the others than chance explains, and its distance
    [m].
    """
    points = coordinates_of(group)
    free = np.sqrt(np.maximum(1 - sphere.leverages, 0.0))
    studentised = np.zeros(len(free))
    np.divide(np.abs(sphere.residuals), free, where=free > 0, out=studentised)
    suspect = int(studentised.argmax())
    dof = len(group) - 5
    try:
        others = fitted_sphere(np.delete(points, suspect, axis=0)) if dof > 0 else None
    except AacmmError:  # the others lie in a plane
        others = None
    if others is None:
        return None, 0.0
    radius = float(np.linalg.norm(points[suspect] - others.center))
    distance = abs(radius - others.diameter / 2)
    variance = others.residuals @ others.residuals / dof
    scatter = max(float(np.sqrt(variance)), 1e-12)
    chance = 2 * len(group) * stdtr(dof, -distance * free[suspect] / scatter)
    far = distance > LEAST_DISTANCE_FROM_SPHERE and chance < CHANCE
    return (group.iloc[[suspect]] if far else None), distance


def _wrong_sizes(spheres: list[tuple[pd.DataFrame, FittedSphere]]) -> Iterator[Note]:
    """Notes on diameters with implausible errors, or errors near the probe diameter."""
    wrong = []
    for group, sphere in spheres:
        error = size_error(group, sphere)
        probe = group["probe_diameter"].iloc[0]
        if abs(error) > WRONG_SIZE or 0.9 * probe < abs(error) < 1.1 * probe:
            wrong.append((group, error))
    if wrong:
        group, error = max(wrong, key=lambda of: abs(of[1]))
        more = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        code = "sphere_too_large" if error > 0 else "sphere_too_small"
        yield Note(code, {"difference": abs(error)}).with_place(f"{Place.of(group)}{more}")
