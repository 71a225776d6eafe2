"""Known distances and angles between planes of one body, such as a gauge block."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.file_problems import Problems, first_few
from aacmm_pin.measurements.csv_columns import (
    DIAMETERS,
    RELATION_COLUMNS,
    checked_names,
    single_names,
)
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.csv_values import Values, read_values

DISTANCE, ANGLE = "distance", "angle"
TILTS = ("tilt 1", "tilt 2")
"""Parallel planes state two angles, about directions in them."""
SURELY_OBLIQUE = np.radians(1.0)
"""An angle nearer to 0 or 180° is that of parallel planes [rad]."""
Complex = NDArray[np.complex128]
COMPLEX_STEP = 1e-30
"""Its square is nothing [m]."""


class Relation(NamedTuple):
    """What is known of two planes.

    Attributes:
        a, b: labels of the planes.
        distance: between the ball's centres on both planes [m]; NaN if not stated.
        distance_u: its standard uncertainty [m]; NaN if not stated.
        angle: between the outward normals [rad].
        angle_u: its standard uncertainty [rad].
    """

    a: str
    b: str
    distance: float
    distance_u: float
    angle: float
    angle_u: float

    def rows(self) -> Iterator[tuple[str, float, float]]:
        """Each known number: kind, value and standard uncertainty [m, rad]."""
        if np.isfinite(self.distance):
            yield DISTANCE, self.distance, self.distance_u
        if 0.0 < self.angle < np.pi:
            yield ANGLE, self.angle, self.angle_u
        else:
            for kind in TILTS:
                yield kind, 0.0, self.angle_u


def read_relations(
    given: str | Path | pd.DataFrame, probes: Mapping[str, float], source: str
) -> tuple[Relation, ...]:
    """The relations of a file or table.

    Args:
        given: path, or table.
        probes: diameter on each plane of the records [m]; NaN if not stated.
        source: of the records.

    Raises:
        MeasurementFileError: it cannot be read, or a row not used.
    """
    values, problems = _cells(given)
    a, b = (values.label(column.names[0]) for column in RELATION_COLUMNS[:2])
    distance, distance_u, angle, angle_u = (
        values.block(column.names)[:, 0] * column.si for column in RELATION_COLUMNS[2:]
    )
    planes = first_few(map(repr, probes)) or "none"
    for name, labels in (("feature_a", a), ("feature_b", b)):
        problems.at(
            ~np.isin(labels, [*probes]),
            name,
            f"{{!r}}; expected the label of a plane in {source} ({planes}); correct the label",
            labels,
        )
    problems.stop()
    problems.at(a == b, "feature_b", "{!r} twice; expected two planes", b)
    pairs = pd.Series(["\0".join(sorted(pair)) for pair in zip(a, b, strict=True)])
    problems.at(
        pairs.duplicated().to_numpy(), "feature_b", "{!r} and {!r} again; expected one row", a, b
    )
    parallel = (angle == 0.0) | (angle == np.pi)
    problems.at(
        ~parallel & (np.minimum(angle, np.pi - angle) < SURELY_OBLIQUE),
        "angle_deg",
        "{:g}; expected 0 or 180 for parallel planes, and the deviation in u_angle_deg",
        np.degrees(angle),
    )
    problems.at(
        np.isnan(distance) != np.isnan(distance_u),
        "u_distance_mm",
        "only one of distance and standard uncertainty; expected both, or two empty cells",
    )
    problems.at(
        np.isfinite(distance) & ~parallel,
        "distance_mm",
        "a distance between planes at {:g}°; expected an angle of 0 (same side) or 180 (opposite "
        "sides), or no distance",
        np.degrees(angle),
    )
    probe_a, probe_b = (
        np.array([probes.get(label, np.nan) for label in labels]) for labels in (a, b)
    )
    opposite = angle == np.pi
    # On the same side, equal probes cancel.
    differs = (probe_a != probe_b) & ~np.isnan(probe_a)
    no_probe = np.where(opposite, np.isnan(probe_a + probe_b), differs)
    problems.at(
        np.isfinite(distance) & parallel & no_probe,
        "distance_mm",
        f"a distance between {{!r}} and {{!r}}; expected one {DIAMETERS[1]} in all rows of both "
        f"planes in {source}",
        a,
        b,
    )
    problems.stop()
    centre_distance = np.abs(distance + np.where(opposite, (probe_a + probe_b) / 2, 0.0))
    numbers = np.stack([centre_distance, distance_u, angle, angle_u]).tolist()
    return tuple(map(Relation, a, b, *numbers))


def _cells(given: str | Path | pd.DataFrame) -> tuple[Values, Problems]:
    """The cells, each in its range, and the list of mistakes."""
    if isinstance(given, pd.DataFrame):
        table = given
        problems = Problems("table", np.arange(len(given)) + 2)
    else:
        table, lines, *_ = read_table(str(given))
        problems = Problems(str(given), lines)
    if not len(table):
        problems.add("", "a table without relations; expected one row per pair of planes")
    names = checked_names([*table.columns], RELATION_COLUMNS, problems)
    for name in single_names(RELATION_COLUMNS):
        if name not in names:
            problems.add(name, "missing; expected this column in a table of relations")
    problems.stop()
    values = read_values(table, RELATION_COLUMNS, problems)
    problems.stop()
    return values, problems


def relations_of_planes(
    kind: NDArray[np.str_], stated: Array, points: Array, anchors: Array
) -> tuple[Array, Array]:
    """Distances and angles of pairs of planes (m,) [m, rad], and derivatives by both points (m, 2,
    3): complex steps, exact to rounding (Squire, Trapp 1998).

    Args:
        kind: of each number (m,).
        stated: (m,): an angle may be that of either side.
        points: of the planes (m, 2, 3) [m]; normals point there from the ``anchors``.
    """
    derivatives = np.empty_like(points)
    for end, axis in np.ndindex(2, 3):
        stepped = points.astype(np.complex128)
        stepped[:, end, axis] += COMPLEX_STEP * 1j
        derivatives[:, end, axis] = (
            _values_of_planes(kind, stated, stepped, anchors).imag / COMPLEX_STEP
        )
    return _values_of_planes(kind, stated, points.astype(np.complex128), anchors).real, derivatives


def _values_of_planes(
    kind: NDArray[np.str_], stated: Array, points: Complex, anchors: Array
) -> Complex:
    """Distances along the mean normal, and angles (m,)."""
    normals = _units(points - anchors)
    first, second = normals[:, 0], normals[:, 1]
    difference = points[:, 1] - points[:, 0]
    cosine = _dot(first, second)
    sense = np.where(cosine.real < 0.0, -1.0, 1.0)
    distance = _dot(difference, first + sense[:, None] * second) / 2
    distance = np.where(distance.real < 0.0, -distance, distance)
    # Each plane lies behind the other, as at a convex edge, unless the supplement fits.
    outwards = -np.sign((_dot(difference, first) * _dot(difference, second)).real)
    angle = np.arccos(outwards * cosine)
    supplement = np.pi - angle
    is_supplement = np.abs(supplement.real - stated) + SURELY_OBLIQUE < np.abs(angle.real - stated)
    across = _units(np.cross(first, np.eye(3)[np.abs(first).argmin(axis=1)]))
    tilts = [sense * _dot(axis, second) for axis in (across, np.cross(first, across))]
    values = [distance, np.where(is_supplement, supplement, angle), *tilts]
    return np.select([kind == name for name in (DISTANCE, ANGLE, *TILTS)], values)


def _dot(a: Complex, b: Complex) -> Complex:
    return np.asarray(np.sum(a * b, axis=-1))


def _units(vectors: Complex) -> Complex:
    return np.asarray(vectors / np.sqrt(_dot(vectors, vectors))[..., None])
