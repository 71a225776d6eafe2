"""What about touches is not as a test gives them: copies, other units, touches beside their sphere,
wrong probes.
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
"""Coordinates that differ by no more are those of a copy that is rounded to a micrometre, or more
finely [m].
"""
PART_OF_RANGE = 0.1
"""Positions of a test are spread over more of the measuring range than this."""
CLOSE = 3e-3
"""Touches of a test that are all closer together than this may be coordinates in another unit [m].
"""
IMPLAUSIBLE_LENGTH_FACTOR = 2.0
"""No arm measures a length this many times too long, or too short."""
UNIT_FACTOR_TOLERANCE = 0.02
"""Lengths that are so by one factor up to this part of it are in another unit."""
WRONG_SIZE = 1e-3
"""No arm measures a sphere so much too large, or too small [m]."""
LEAST_DISTANCE_FROM_SPHERE = 5e-5
"""A touch nearer to its sphere than this is none that is beside it [m]."""
TIMES_SMALLER = 50.0
"""Touches of a position that scatter so much less than those of the others may be coordinates in
another unit.
"""
CHANCE = 1e-4
"""Chance that one of the touches of a sphere is as far off as one that is named."""
TIMES_ITS_LIKE = 10.0
"""Touches too few to tell which is off do not lie on a sphere whose form is so many times the
median of spheres like it.
"""


def check_unit(probed_points: pd.DataFrame) -> None:
    """Look whether the lengths of each test are in the unit of the coordinates.

    Raises:
        AacmmError: all of them are too long, or too short, by one factor.
    """
    for test, of_test in probed_points[probed_points["length"].notna()].groupby("test", sort=False):
        try:
            lengths = measured_lengths(of_test, both_sides=test == "length-bi")
        except AacmmError:  # a note says that these have no value
            continue
        factors = (1 + lengths["error"] / lengths["length"]).to_numpy()
        if (
            len(factors)
            and np.ptp(factors) <= UNIT_FACTOR_TOLERANCE * factors.min()
            and not 1 / IMPLAUSIBLE_LENGTH_FACTOR < factors.mean() < IMPLAUSIBLE_LENGTH_FACTOR
        ):
            times = f"{factors.mean():.4g} times" + f", or 1/{1 / factors.mean():.4g} of," * bool(
                factors.mean() < 1
            )
            raise AacmmError(
                f"test {test}: each of {len(factors)} lengths measures {times} its length_mm; "
                "expected coordinates and length_mm in mm"
            )


def doubts(
    source: str, probed_points: pd.DataFrame, measuring_range: float | None = None
) -> Iterator[Note]:
    """Notes on the touches of one set of coordinates; ``measuring_range`` of the arm [m], None
    where not given.
    """
    at = probed_points[["x", "y", "z"]]
    nearest = scipy.spatial.KDTree(at).query(at, 2, p=np.inf, distance_upper_bound=COPY_TOLERANCE)[
        0
    ][:, 1]  # inf where farther
    if alike := int(np.isfinite(nearest).sum()):
        yield Note("touches_copied", {"copies": alike, "touches": len(at)}).with_place(source)
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
        found = [*_spheres(of_test)]
        yield from (note.with_place(source) for note in (*_beside(found), *_wrong_sizes(found)))


def _too_small(probed_points: pd.DataFrame) -> Iterator[Note]:
    """Positions whose touches scatter far less than those of the others."""
    extents = probed_points.groupby("position", sort=False)[["x", "y", "z"]].agg(np.ptp).max(axis=1)
    for position, extent in extents.items():
        others = float(extents.drop(position).median()) if len(extents) > 1 else 0.0
        if 0.0 < extent * TIMES_SMALLER < others:  # of copies there is a note
            yield Note("position_small", {"extent": float(extent), "others": others}).with_place(
                f"position {position}"
            )


def _spheres(probed_points: pd.DataFrame) -> Iterator[tuple[pd.DataFrame, FittedSphere]]:
    """The spheres of a test of which more is known than four touches say."""
    by = (
        ["feature", "position"]
        if probed_points["test"].iloc[0] == "sphere"
        else [*LENGTH_KEY, "feature"]
    )
    for _, group in probed_points.groupby(by, sort=False):
        try:
            if len(group) > FEWEST_POINTS and group["test"].iloc[0] != "single-point":
                yield group, fitted_sphere(coordinates_of(group))
        except AacmmError:  # a note says that its figures have no value
            continue


def _beside(spheres: list[tuple[pd.DataFrame, FittedSphere]]) -> Iterator[Note]:
    """Touches far from the sphere of the others; spheres of five or six touches that do not lie on
    one.
    """
    forms = np.array([sphere.form for _, sphere in spheres])
    for k, (group, sphere) in enumerate(spheres):
        touch, off = _farthest(group, sphere)
        if touch is not None:
            yield Note("touch_off_sphere", {"distance": off}).with_place(str(Place.of(touch)))
        elif len(spheres) > 2 and sphere.form > max(
            TIMES_ITS_LIKE * float(np.median(np.delete(forms, k))), LEAST_DISTANCE_FROM_SPHERE
        ):
            yield Note("touches_off_sphere", {"form": sphere.form}).with_place(str(Place.of(group)))


def _farthest(group: pd.DataFrame, sphere: FittedSphere) -> tuple[pd.DataFrame | None, float]:
    """The touch that is not on the sphere of the others by more than chance, and how far it is from
    that [m].
    """
    points = coordinates_of(group)
    free = np.sqrt(np.maximum(1 - sphere.leverages, 0.0))
    studentised = np.zeros(len(free))
    np.divide(np.abs(sphere.residuals), free, where=free > 0, out=studentised)
    k = int(studentised.argmax())
    dof = len(group) - 5
    try:
        others = fitted_sphere(np.delete(points, k, axis=0)) if dof > 0 else None
    except AacmmError:  # the others lie in a plane
        others = None
    if others is None:
        return None, 0.0
    radius = float(np.linalg.norm(points[k] - others.center))
    off = abs(radius - others.diameter / 2)
    variance = others.residuals @ others.residuals / dof
    scatter = max(float(np.sqrt(variance)), 1e-12)
    chance = 2 * len(group) * stdtr(dof, -off * free[k] / scatter)
    return (group.iloc[[k]] if off > LEAST_DISTANCE_FROM_SPHERE and chance < CHANCE else None), off


def _wrong_sizes(spheres: list[tuple[pd.DataFrame, FittedSphere]]) -> Iterator[Note]:
    """Spheres whose size no arm gets so wrong, or is off by about the probe."""
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
