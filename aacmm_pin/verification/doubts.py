"""Mistakes that probed points show."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pandas as pd
import scipy
from scipy.special import stdtr

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin.errors import AacmmError
from aacmm_pin.verification.evaluators import (
    LENGTH_KEY,
    PointsInFile,
    coordinates_of,
    measured_lengths,
    size_error,
)
from aacmm_pin.verification.spheres import FEWEST_POINTS, FittedSphere, fitted_sphere

COPY_TOLERANCE = 5e-7
"""Nearer coordinates are a copy rounded to a micrometre or finer [m]."""
PART_OF_RANGE = 0.1
"""Positions of a test extend over more of the measuring range."""
CLOSE = 3e-3
"""A smaller extent of a test may be in another unit [m]."""
IMPLAUSIBLE_LENGTH_FACTOR = 2.0
"""No arm measures lengths wrong by this factor."""
UNIT_FACTOR_TOLERANCE = 0.02
"""Lengths whose factors agree to this part are in another unit."""
WRONG_SIZE = 1e-3
"""No arm measures a diameter so wrong [m]."""
LEAST_DISTANCE_FROM_SPHERE = 5e-5
"""Shorter distances of a point from its sphere give no note [m]."""
LEAST_FREE = 1e-6
"""Part of a residual that its own point leaves, against division by 0."""
CHANCE = 1e-4
"""Probability of a distance from the sphere that gives a note."""
TIMES_ITS_LIKE = 10.0
"""Spheres of few points give a note from so many median forms of the others."""


def check_unit(probed_points: pd.DataFrame) -> None:
    """Check that lengths are in the unit of the coordinates."""
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


def doubts(probed_points: pd.DataFrame, measuring_range: float | None) -> Iterator[Note]:
    """Notes on the points of one set of coordinates; range in m."""
    points = coordinates_of(probed_points)
    tree = scipy.spatial.KDTree(points)
    distances, _ = tree.query(points, 2, p=np.inf, distance_upper_bound=COPY_TOLERANCE)
    copies = int(np.isfinite(distances[:, 1]).sum())  # the first is the distance from itself
    if copies:
        yield Note("touches_copied", {"copies": copies, "touches": len(points)})
    for test, of_test in probed_points.groupby("test", sort=False):
        extent = float(np.ptp(coordinates_of(of_test), axis=0).max())
        several_positions = of_test["position"].nunique() > 1
        data = {"test": test, "extent": extent}
        if extent < CLOSE and (several_positions or test != "single-point"):
            yield Note("test_small", data)
        elif (
            several_positions
            and measuring_range is not None
            and extent < PART_OF_RANGE * measuring_range
        ):
            yield Note("test_small_in_range", {**data, "range": measuring_range})
        if test != "single-point":
            yield from _of_spheres(of_test)


def _of_spheres(of_test: pd.DataFrame) -> Iterator[Note]:
    """Notes on outliers, on spheres of five or six points with a large form, and on diameters with
    implausible errors, or near the probe diameter.
    """
    columns = ["feature", "position"]
    if of_test["test"].iloc[0] != "sphere":
        columns = [*LENGTH_KEY, "feature"]
    spheres = []
    for _, group in of_test.groupby(columns, sort=False):
        if len(group) > FEWEST_POINTS:
            with suppress(AacmmError):  # a note states that its characteristics have no value
                spheres.append((group, fitted_sphere(coordinates_of(group))))
    forms = np.array([sphere.form for _, sphere in spheres])
    wrong_sizes = []
    for k, (group, sphere) in enumerate(spheres):
        outlier = _outlier(coordinates_of(group), sphere)
        if outlier is not None:
            number, distance = outlier
            place = str(PointsInFile.of(group.iloc[[number]]))
            yield Note("touch_off_sphere", {"distance": distance}).with_place(place)
        elif len(spheres) > 2:
            usual = float(np.median(np.delete(forms, k)))
            if sphere.form > max(TIMES_ITS_LIKE * usual, LEAST_DISTANCE_FROM_SPHERE):
                place = str(PointsInFile.of(group))
                yield Note("touches_off_sphere", {"form": sphere.form}).with_place(place)
        error = size_error(group, sphere)
        probe = group["probe_diameter"].iloc[0]
        if abs(error) > WRONG_SIZE or 0.9 * probe < abs(error) < 1.1 * probe:
            wrong_sizes.append((group, error))
    if wrong_sizes:
        group, error = max(wrong_sizes, key=lambda wrong: abs(wrong[1]))
        note = Note("sphere_size_off", {"difference": error})
        yield note.with_place(str(PointsInFile.of(group)))


def _outlier(points: Array, sphere: FittedSphere) -> tuple[int, float] | None:
    """The number of the one of ``points`` (n, 3) [m] that is farther from the sphere of the others
    than by chance, and its distance: a t-test of the largest studentised residual.
    """
    dof = len(points) - 5
    if dof < 1:
        return None
    free = np.sqrt(np.maximum(1 - sphere.leverages, 0.0))
    studentised = np.abs(sphere.residuals) / np.maximum(free, LEAST_FREE)
    suspect = int(studentised.argmax())
    try:
        others = fitted_sphere(np.delete(points, suspect, axis=0))
    except AacmmError:  # the others lie in a plane
        return None
    radius = float(np.linalg.norm(points[suspect] - others.center))
    distance = abs(radius - others.diameter / 2)
    variance = others.residuals @ others.residuals / dof
    scatter = max(float(np.sqrt(variance)), 1e-12)
    chance = 2 * len(points) * stdtr(dof, -distance * free[suspect] / scatter)
    is_outlier = distance > LEAST_DISTANCE_FROM_SPHERE and chance < CHANCE
    return (suspect, distance) if is_outlier else None
