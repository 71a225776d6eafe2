"""Test values from probed points: spheres and single points, or calibrated lengths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.file_problems import rows_in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import PREDICTED_ACCURATE
from aacmm_pin.verification.spheres import (
    FEWEST_POINTS,
    FittedSphere,
    fitted_sphere,
    smallest_sphere,
)

LENGTH_KEY = ("length_id", "position", "repeat")
"""Labels of a measured length."""
LABELS_OF_PLACES = ("length_id", "feature", "position", "repeat")


@dataclass(frozen=True)
class PointsInFile:
    """Common labels of probed points by column, and their lines in the file."""

    labels: Mapping[str, str]
    rows: tuple[int, ...]

    @classmethod
    def of(cls, points: pd.DataFrame) -> PointsInFile:
        """Those of a table."""
        shared = {}
        for name in LABELS_OF_PLACES:
            labels = points[name].tolist()
            if labels[0] and labels.count(labels[0]) == len(labels):
                shared[name] = labels[0]
        return cls(shared, tuple(points["row"].tolist()))

    def __str__(self) -> str:
        names = [named(self.labels)] if self.labels else []
        return ", ".join([*names, rows_in_words(self.rows)])


def named(labels: Mapping[str, str]) -> str:
    """Labels with their columns."""
    names = [f"{name.removesuffix('_id')} {label}" for name, label in labels.items()]
    return ", ".join(names)


def coordinates_of(points: pd.DataFrame) -> Array:
    """Coordinates (n, 3) [m]."""
    return np.column_stack([points[name].to_numpy() for name in "xyz"])


class Error(NamedTuple):
    """An error, its u [m] (nan if not stated), and its probed points; None if all determine it."""

    value: float
    u: float = np.nan
    place: PointsInFile | None = None


@dataclass(frozen=True)
class Evaluated:
    """Errors, of which the test value is the largest.

    Attributes:
        had, missing: number of points or lengths.
        errors: none if points are missing.
        lacking: names of what was begun and is incomplete.
    """

    had: int
    missing: int = 0
    errors: tuple[Error, ...] = ()
    why_incomplete: str = ""
    lacking: tuple[str, ...] = ()

    @property
    def largest(self) -> Error:
        """The error with the test value; nan without errors."""
        return max(self.errors, key=lambda error: abs(error.value), default=Error(np.nan))


def groups_of(points: pd.DataFrame, by: Sequence[str]) -> list[pd.DataFrame]:
    """Points with the same labels, in the order of appearance."""
    return [group for _, group in points.groupby(list(by), sort=False)]


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
        (labels, count), *inner_levels = self.levels
        groups = groups_of(table, labels)
        absent = [table.iloc[:0]] * (count - len(groups))
        needed_in_group = Needed(tuple(inner_levels), self.each)
        return sum(map(needed_in_group.missing, [*groups, *absent]))

    def begun(self, table: pd.DataFrame) -> Iterator[str]:
        """Incomplete innermost groups."""
        labels = [name for by, _ in self.levels for name in by]
        for key, group in table.groupby(labels, sort=False):
            if len(group) < self.each:
                stated = {
                    name: str(label) for name, label in zip(labels, key, strict=True) if label
                }
                yield named(stated)


# --- of points


def size_error(points: pd.DataFrame, sphere: FittedSphere) -> float:
    """Fitted minus calibrated and probe diameter [m]."""
    stated = points[["feature_diameter", "probe_diameter"]].iloc[0]
    return float(sphere.diameter - stated.iloc[0] - stated.iloc[1])


def size_of_sphere(points: pd.DataFrame) -> Iterator[Error]:
    """Least-squares diameter minus the calibrated one."""
    sphere = _sphere(points)
    value = np.nan if sphere.on_small_cap else size_error(points, sphere)
    yield Error(value, points["u_length"].iloc[0], PointsInFile.of(points))


def form_of_sphere(points: pd.DataFrame) -> Iterator[Error]:
    """Range of radial distances from the least-squares sphere."""
    sphere = _sphere(points)
    value = np.nan if sphere.on_small_cap else sphere.form
    yield Error(value, place=PointsInFile.of(points))


def spread_of_centres(points: pd.DataFrame) -> Iterator[Error]:
    """Diameter of the smallest sphere around all centres."""
    centres = [_sphere(repeat).center for repeat in groups_of(points, ["repeat"])]
    _, radius = smallest_sphere(np.array(centres))
    yield Error(2 * radius, place=PointsInFile.of(points))


def distances_from_mean(points: pd.DataFrame) -> Iterator[Error]:
    """Distance of each point from the mean of all."""
    for number, distance in enumerate(_from_mean(points)):
        yield Error(distance, place=PointsInFile.of(points.iloc[[number]]))


def standard_deviation(points: pd.DataFrame, times: float = 1.0) -> Iterator[Error]:
    """Of the position of one point (eqs. 16 and 17 of Xu You et al. 2019), so many times."""
    sigma = np.sqrt(np.square(_from_mean(points)).sum() / (len(points) - 1))
    yield Error(times * sigma, place=PointsInFile.of(points))


def deviation_of_part(points: pd.DataFrame, accurate: bool) -> Iterator[Error]:
    """RMS distance from the mean of all points, of those in accurate postures or of the others
    (eqs. 18 and 19 of Xu You et al. 2019).
    """
    chosen = ((points["part"] == PREDICTED_ACCURATE) == accurate).to_numpy()
    if chosen.any():
        rms = np.sqrt(np.square(_from_mean(points)[chosen]).mean())
        yield Error(rms, place=PointsInFile.of(points[chosen]))


def _from_mean(points: pd.DataFrame) -> Array:
    """Distances of points from their mean (n,) [m]."""
    coordinates = coordinates_of(points)
    return np.asarray(np.linalg.norm(coordinates - coordinates.mean(axis=0), axis=1))


def _sphere(points: pd.DataFrame) -> FittedSphere:
    """The sphere of the points; an error names the points in their file."""
    try:
        return fitted_sphere(coordinates_of(points))
    except AacmmError as error:
        raise AacmmError(f"{PointsInFile.of(points)}: {error}") from None


# --- of lengths


def measured_lengths(points: pd.DataFrame, both_sides: bool) -> pd.DataFrame:
    """Lengths with both ends: labels, calibrated length, its u, error [m], and place."""
    lengths = []
    first_rows = points.drop_duplicates([*LENGTH_KEY]).to_dict("records")
    for stated, of_length in zip(first_rows, groups_of(points, LENGTH_KEY), strict=True):
        ends = groups_of(of_length, ["feature"])
        place = PointsInFile.of(of_length)
        if len(ends) > 2 or any(1 < len(end) < FEWEST_POINTS for end in ends):
            came = ", ".join(f"{len(end)} of {end['feature'].iloc[0]}" for end in ends)
            raise AacmmError(
                f"{place}: {came}; expected two features, each with 1 probed point or with "
                f"{FEWEST_POINTS} or more points all over a sphere"
            )
        if len(ends) < 2:
            continue
        first, last = (
            _sphere(end).center if len(end) > 1 else coordinates_of(end)[0] for end in ends
        )
        calibrated = stated["length"] + (stated["probe_diameter"] if both_sides else 0.0)
        error = float(np.linalg.norm(last - first)) - calibrated
        row = {name: stated[name] for name in (*LENGTH_KEY, "length")}
        lengths.append(row | {"u": stated["u_length"], "error": error, "place": place})
    return pd.DataFrame(lengths, columns=[*LENGTH_KEY, "length", "u", "error", "place"])


def errors_of_lengths(lengths: pd.DataFrame) -> Iterator[Error]:
    """One for each length."""
    yield from map(Error, lengths["error"], lengths["u"], lengths["place"])


def twice_rms_of_lengths(lengths: pd.DataFrame) -> Iterator[Error]:
    """Twice the RMS error of all lengths [m].

    Its u is at most twice the largest of a length, if lengths share an error.
    """
    errors = lengths["error"].to_numpy()
    rms = np.sqrt(np.mean(errors**2))
    u = lengths["u"].max(skipna=False)
    yield Error(2 * rms, 2 * u)
