"""Test values from probed points: spheres and single points, or calibrated lengths."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin.accuracy import single_point_statistics
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import PREDICTED_ACCURATE
from aacmm_pin.verification.places import PointsInFile, coordinates_of, named, rows_of
from aacmm_pin.verification.spheres import (
    FEWEST_POINTS,
    FittedSphere,
    fitted_sphere,
    minimum_circumscribed_sphere,
)

LENGTH_KEY = ("length_id", "position", "repeat")
"""Labels of a measured length."""
SPHERE = ("feature", "position")
MOST_DIAMETER_FACTOR = 4.0
"""Largest u of a diameter over that of points. With more, 25 points are within about 45° of their
middle, nine within 60°.
"""
REPEATS, POSITIONS = 3, 7
"""Of each length of ISO 10360-12."""
VOLUMETRIC_LENGTHS, VOLUMETRIC_POSITIONS = 2, 20
"""Of the volumetric performance test."""


@dataclass(frozen=True)
class Evaluated:
    """Test value and its standard uncertainty [m].

    Attributes:
        value: nan if points are missing.
        u: nan if not stated.
        had, missing: of points or lengths.
        errors: all errors with their u (n, 2) [m], of which the value is the largest.
        rows: lines of the points of each.
        lacking: names of what was begun, or is elsewhere, and missing here.
    """

    value: float
    u: float
    had: int
    missing: int
    why_incomplete: str = ""
    errors: Array = field(default_factory=lambda: np.empty((0, 2)))
    rows: tuple[tuple[int, ...], ...] = ()
    lacking: tuple[str, ...] = ()


class Error(NamedTuple):
    """An error, its u [m], and the lines of its points."""

    value: float
    u: float = np.nan
    rows: tuple[int, ...] = ()


def without_value(had: int, missing: int, lacking: Iterable[str] = (), why: str = "") -> Evaluated:
    """No test value."""
    lacked = tuple(lacking)
    return Evaluated(np.nan, np.nan, had, missing, why, lacking=lacked)


def _largest(errors: Sequence[Error], had: int) -> Evaluated:
    table = np.array([(error.value, error.u) for error in errors])
    largest = np.abs(table[:, 0]).argmax()
    value, u = table[largest].tolist()
    rows = tuple(error.rows for error in errors if error.rows)
    return Evaluated(value, u, had, 0, "", table, rows)


def groups_of(points: pd.DataFrame, by: Sequence[str]) -> list[pd.DataFrame]:
    """Points with the same labels, in the order of appearance."""
    return [group for _, group in points.groupby(list(by), sort=False)]


# --- what is needed


class Needed(NamedTuple):
    """Nested groups that a value needs, such as positions of lengths.

    Attributes:
        levels: labels of groups, and their number in each group above.
        each: rows in each innermost group.
    """

    levels: tuple[tuple[tuple[str, ...], int], ...]
    each: int

    def missing(self, table: pd.DataFrame) -> int:
        """Missing rows, of all groups and of every incomplete one."""
        if not self.levels:
            return max(self.each - len(table), 0)
        (by, count), *inner = self.levels
        within = Needed(tuple(inner), self.each)
        groups = groups_of(table, by)
        missing = sum(map(within.missing, groups))
        if len(groups) < count:
            missing += (count - len(groups)) * within.missing(table.iloc[:0])
        return missing

    def begun(self, table: pd.DataFrame) -> Iterator[str]:
        """Incomplete innermost groups."""
        labels = [name for by, _ in self.levels for name in by]
        for group in groups_of(table, labels):
            if len(group) < self.each:
                yield named(PointsInFile.of(group).labels)


# --- from points


@dataclass(frozen=True)
class OfPoints:
    """The largest error of groups of probed points.

    Attributes:
        needed: its outermost labels distinguish them.
        errors: of a group; nan on a small cap of a sphere.
        has_enough: further requirement of a group, or None.
    """

    needed: Needed
    errors: Callable[[pd.DataFrame], Iterable[Error]]
    has_enough: Callable[[pd.DataFrame], bool] | None = None

    def __call__(self, points: pd.DataFrame) -> Evaluated:
        """Evaluate the points of a test.

        Raises:
            AacmmError: the points of a sphere lie in a plane.
        """
        groups = groups_of(points, self.needed.levels[0][0])
        missing = self.needed.missing(points)
        if self.has_enough is not None:
            missing += sum(not self.has_enough(group) for group in groups)
        if missing:
            return without_value(len(points), missing, self.needed.begun(points))
        errors = [error for group in groups for error in self.errors(group)]
        if any(np.isnan(error.value) for error in errors):
            return without_value(len(points), 0, why="points all over the sphere")
        return _largest(errors, len(points))


def size_error(points: pd.DataFrame, sphere: FittedSphere) -> float:
    """Fitted minus calibrated and probe diameter [m]."""
    stated = points[["feature_diameter", "probe_diameter"]].iloc[0]
    return float(sphere.diameter - stated.iloc[0] - stated.iloc[1])


def size_of_sphere(points: pd.DataFrame) -> Iterator[Error]:
    """Least-squares diameter minus the calibrated one."""
    sphere = _sphere(points)
    u = points["u_length"].iloc[0]
    value = np.nan if sphere.diameter_factor > MOST_DIAMETER_FACTOR else size_error(points, sphere)
    yield Error(value, u, rows_of(points))


def form_of_sphere(points: pd.DataFrame) -> Iterator[Error]:
    """Range of radial distances from the least-squares sphere."""
    sphere = _sphere(points)
    value = np.nan if sphere.diameter_factor > MOST_DIAMETER_FACTOR else sphere.form
    yield Error(value, rows=rows_of(points))


def spread_of_centres(points: pd.DataFrame) -> Iterator[Error]:
    """Diameter of the smallest sphere around all centres."""
    centres = [_sphere(repeat).center for repeat in groups_of(points, ["repeat"])]
    _, diameter = minimum_circumscribed_sphere(np.array(centres))
    yield Error(diameter, rows=rows_of(points))


def distances_from_mean(points: pd.DataFrame) -> Iterator[Error]:
    """Distance of each point from the mean of all."""
    at = coordinates_of(points)
    distances = np.linalg.norm(at - at.mean(axis=0), axis=1)
    for distance, row in zip(distances, rows_of(points), strict=True):
        yield Error(distance, rows=(row,))


def standard_deviation(points: pd.DataFrame, times: float = 1.0) -> Iterator[Error]:
    """Of the position of one point, so many times."""
    sigma = single_point_statistics(coordinates_of(points)).sigma
    yield Error(times * sigma, rows=rows_of(points))


def deviation_of_part(points: pd.DataFrame, accurate: bool) -> Iterator[Error]:
    """RMS distance from the mean of all points, of those in accurate postures or of the others."""
    chosen = _is_in_part(points, accurate)
    statistics = single_point_statistics(coordinates_of(points), chosen)
    yield Error(statistics.part, rows=rows_of(points[chosen]))


def has_part(points: pd.DataFrame, accurate: bool) -> bool:
    """Whether the part has a point."""
    return bool(_is_in_part(points, accurate).any())


def _is_in_part(points: pd.DataFrame, accurate: bool) -> Mask:
    return ((points["part"] == PREDICTED_ACCURATE) == accurate).to_numpy()


def _sphere(points: pd.DataFrame) -> FittedSphere:
    """An error names feature and rows."""
    try:
        return fitted_sphere(coordinates_of(points))
    except AacmmError as error:
        rows = ", ".join(map(str, points["row"].head(6)))
        raise AacmmError(f"feature {points['feature'].iloc[0]}, row {rows}, …: {error}") from None


# --- from lengths


@dataclass(frozen=True)
class OfLengths:
    """The largest error of calibrated lengths, or a function of all.

    Attributes:
        missing: number of missing lengths in the table of :func:`measured_lengths`.
        lacking: their names, from probed points and this table.
        both_sides: probed from opposite sides, which adds the probe diameter.
        errors: of this table.
    """

    missing: Callable[[pd.DataFrame], int]
    lacking: Callable[[pd.DataFrame, pd.DataFrame], Iterable[str]]
    both_sides: bool
    errors: Callable[[pd.DataFrame], Iterable[Error]]

    def __call__(self, points: pd.DataFrame) -> Evaluated:
        """Evaluate the points of a test.

        Raises:
            AacmmError: points of an end in a plane, or a length with one end.
        """
        lengths = measured_lengths(points, self.both_sides)
        if missing := self.missing(lengths):
            return without_value(len(lengths), missing, self.lacking(points, lengths))
        for place in _with_one_end(points):  # the other end might not conform
            raise AacmmError(
                f"{place}: only one end has points; expected points of both ends with the same "
                "labels"
            )
        return _largest([*self.errors(lengths)], len(lengths))


def measured_lengths(points: pd.DataFrame, both_sides: bool) -> pd.DataFrame:
    """Lengths with both ends: labels, calibrated length, its u, error [m], and rows.

    Raises:
        AacmmError: not two features of one point each, or enough for a sphere.
    """
    labels = [*LENGTH_KEY]
    at = ["x", "y", "z"]
    ends = points.groupby([*labels, "feature"], sort=False)
    sizes = ends.size()
    counts = sizes.reset_index(name="points")
    features = counts.groupby(labels)["feature"].transform("size")
    bad = counts["points"].between(2, FEWEST_POINTS - 1) | (features > 2)
    if bad.any():
        wrong = counts[bad].iloc[:1][labels]
        its_ends = counts.merge(wrong, on=labels)
        came = ", ".join(f"{n} of {name}" for name, n in its_ends[["feature", "points"]].to_numpy())
        place = PointsInFile.of(points.merge(wrong, on=labels))
        raise AacmmError(
            f"{place}: {came}; expected two features, each with 1 probed point or with "
            f"{FEWEST_POINTS} or more points all over a sphere"
        )
    first = points.drop_duplicates([*labels, "feature"])
    centres = first.set_index([*labels, "feature"])[at].astype(np.float64)
    for end in sizes.index[sizes > 1]:
        centres.loc[end, at] = _sphere(ends.get_group(end)).center
    of_lengths = centres.groupby(level=labels, sort=False)
    both = (of_lengths.size() == 2).to_numpy()
    stated = points.drop_duplicates(labels).set_index(labels)
    stated = stated[["length", "u_length", "probe_diameter"]][both]
    apart = (of_lengths.last() - of_lengths.first())[both].to_numpy()
    probe = stated["probe_diameter"] if both_sides else 0.0
    errors = np.linalg.norm(apart, axis=1) - stated["length"] - probe
    lines = points["row"].to_numpy()
    of_length = points.groupby(labels, sort=False).indices
    rows = [tuple(lines[of_length[length]].tolist()) for length in stated.index]
    lengths = stated.rename(columns={"u_length": "u"})
    return lengths.assign(error=errors, rows=pd.Series(rows, stated.index)).reset_index()


def _with_one_end(points: pd.DataFrame) -> Iterator[PointsInFile]:
    for length in groups_of(points, LENGTH_KEY):
        if length["feature"].nunique() < 2:
            yield PointsInFile.of(length)


def errors_of_lengths(lengths: pd.DataFrame) -> Iterator[Error]:
    """One for each length."""
    yield from map(Error, lengths["error"], lengths["u"], lengths["rows"])


def twice_rms_of_lengths(lengths: pd.DataFrame) -> Iterator[Error]:
    """Twice the RMS error of all lengths [m].

    Its u is at most twice the largest of a length, if lengths share an error.
    """
    errors = lengths["error"].to_numpy()
    rms = np.sqrt(np.mean(errors**2))
    u = lengths["u"].max(skipna=False)
    yield Error(2 * rms, 2 * u)


def missing_places(lengths: pd.DataFrame) -> int:
    """Missing positions of 20, each with two lengths."""
    places = len(lengths[["length_id", "position"]].drop_duplicates())
    different = lengths["length_id"].nunique()
    return max(VOLUMETRIC_POSITIONS - places, VOLUMETRIC_LENGTHS - different, 0)


def lengths_with_one_end(points: pd.DataFrame, lengths: pd.DataFrame) -> Iterator[str]:
    """Names of lengths with one end."""
    for place in _with_one_end(points):
        yield named(place.labels)


def lengths_not_measured(points: pd.DataFrame, lengths: pd.DataFrame) -> Iterator[str]:
    """Missing repeats and positions, by labels elsewhere in the file."""
    measured = {*zip(*(lengths[name] for name in LENGTH_KEY), strict=True)}
    positions = points["position"].unique()
    repeats = points["repeat"].unique()
    places = points[["length_id", "position"]].drop_duplicates().itertuples(index=False, name=None)
    if len(positions) <= POSITIONS:
        places = product(points["length_id"].unique(), positions)
    for length, position in places:
        absent = [repeat for repeat in repeats if (length, position, repeat) not in measured]
        if len(repeats) - len(absent) < REPEATS:
            for repeat in absent:
                yield named(dict(zip(LENGTH_KEY, (length, position, repeat), strict=True)))
