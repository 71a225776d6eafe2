"""Probed points of an acceptance file, by its coordinates and by each arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin._support.file_problems import Problems, first_few
from aacmm_pin._support.units import MM
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import (
    MEASUREMENT_FILE,
    PROBED_POINT_COLUMNS,
    REFERENCE,
    Measurements,
    column_of,
    is_reading,
    read_probed_points,
    read_table,
    read_values,
)

CHECK_COLUMNS = (
    "operator",
    "session",
    "temperature_c",
    "probe_diameter_mm",
    "feature_diameter_mm",
    "length_mm",
)
"""Columns of the whole check."""
AS_GIVEN = "coordinates of the file"
"""Coordinates that the software of the arm computed."""
OF_TEST = tuple(name for column in PROBED_POINT_COLUMNS for name in column.names)


class ProbedPoints(NamedTuple):
    """The content of a file.

    Attributes:
        sets: points by the coordinates of the file and by each arm: the fields of
            :func:`aacmm_pin.measurements.read_probed_points`, and probe centre ``x``, ``y``, ``z``
            [m].
        notes: on reading.
        stated: different values of :data:`CHECK_COLUMNS`.
    """

    sets: dict[str, pd.DataFrame]
    notes: tuple[Note, ...]
    stated: dict[str, tuple[Any, ...]]


def brief(source: str, most: int) -> str:
    """A name in at most ``most`` characters."""
    if source == AS_GIVEN:
        return "file"
    return source if len(source) <= most else f"…{source[1 - most :]}"


def read_file(path: str, content: bytes, models: Mapping[str, ErrorModel]) -> ProbedPoints:
    """The probed points of a file, by its coordinates and by each arm."""
    table, lines, read_as, *_ = read_table(path, content)
    problems = Problems(path, lines)
    points = read_probed_points(table, problems)
    to_fill = [str(name) for name in table if name in REFERENCE or is_reading(name)]
    is_empty = (table[to_fill] == "").all()  # either may be: of a procedure
    table = table.drop(columns=[name for name in to_fill if is_empty[name]])
    given = _given_coordinates(table, problems)
    problems.stop()
    of_arms, notes = _by_arms(table, path, models)
    coordinates = ({} if given is None else {AS_GIVEN: given}) | of_arms
    if not coordinates:
        raise MeasurementFileError(
            path,
            None,
            "",
            "no coordinates; expected numbers in x_mm, y_mm, z_mm, or an arm and readings in "
            f"theta1_deg … (other columns are {first_few(table)})",
        )
    sets = {
        name: points.assign(**dict(zip("xyz", at.T, strict=True)))
        for name, at in coordinates.items()
    }
    stated: dict[str, tuple[Any, ...]] = {}
    for name in CHECK_COLUMNS:
        if name not in table:
            continue
        cells = table[name].str.strip()
        texts = cells[cells != ""].drop_duplicates()
        numbers = pd.to_numeric(texts, errors="coerce")
        are_labels = numbers.isna().any()
        stated[name] = tuple(texts) if are_labels else tuple(sorted({*numbers.tolist()}))
    return ProbedPoints(sets, (*read_as, *notes), stated)


def _given_coordinates(table: pd.DataFrame, problems: Problems) -> Array | None:
    """(n, 3) [m]."""
    given = [name for name in REFERENCE if name in table]
    if not given:
        return None
    if missing := [name for name in REFERENCE if name not in table]:
        problems.add(
            ", ".join(missing), f"missing, but the file has {', '.join(given)}; expected all three"
        )
    values = read_values(table[given], MEASUREMENT_FILE, problems)
    for name in given:
        empty = np.array([not cell.strip() for cell in table[name]], dtype=bool)
        problems.at(empty, name, "empty cell; expected a number with a decimal point")
    return values.block(REFERENCE) * MM


def _by_arms(
    table: pd.DataFrame, path: str, models: Mapping[str, ErrorModel]
) -> tuple[dict[str, Array], list[Note]]:
    """The tip by each arm (n, 3) [m], and notes on readings."""
    if models and not any(map(is_reading, table)):
        raise MeasurementFileError(
            path, None, "", "no readings; expected numbers in theta1_deg … for the named arms"
        )
    of_arm = [name for name in table if name not in OF_TEST and not column_of(name).of_reference]
    tips: dict[str, Array] = {}
    notes: dict[Note, list[str]] = {}
    for name, model in models.items():
        of_file = Measurements.from_frame(table[of_arm], model.arm.nq, path)
        readings = of_file.with_joint_angles(model.arm)
        for note in model.input_warnings(readings.q, readings.conditions):
            notes.setdefault(note, []).append(name)
        try:
            tips[name] = model.correct(readings.q, readings.conditions)
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
    return tips, [note.with_place(", ".join(names)) for note, names in notes.items()]
