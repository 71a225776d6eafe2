"""The header of a measurement or acceptance file, and mistakes in its names."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence

from aacmm_pin._support.file_problems import Problems, first_few, shortened
from aacmm_pin._support.units import count
from aacmm_pin.measurements.csv_columns import (
    BAR,
    EULER,
    EULER_ORDERS,
    LINK_TEMPERATURE,
    MEASUREMENT_FILE,
    ORIENTATION_U,
    ORIENTATIONS,
    READING_COLUMNS,
    REFERENCE,
    REFERENCE_U,
    THETA,
    UNKNOWN_COLUMN,
    Column,
    column_of,
    named,
    numbered_forms,
    single_names,
    span,
)

SPELLING_SIMILARITY = 0.9
"""Similarity (difflib) of a misspelt name: one wrong letter in ten."""
OF_ANGLES = ("deg", "rad", "mrad", "gon", "arcsec")
OTHER_UNITS = {*OF_ANGLES, "m", "cm", "um", "µm", "in", "inch", "k", "f", "ms", "min", "nmm"}
SPELLED = {"°c": "c", "°": "deg", "θ": "theta"}


def check_header(names: Sequence[object], nq: int | None, problems: Problems) -> None:
    """Check the columns of a measurement file; ``nq`` joints, or any for None.

    Raises:
        MeasurementFileError: a name is missing, repeated, misspelt, or needs another column.
    """
    texts = checked_names(names, MEASUREMENT_FILE, problems)
    degrees, radians = (column.among(texts) for column in READING_COLUMNS)
    if degrees and radians:
        came = (
            f"{', '.join(map(shortened, degrees))} are in degrees, and "
            f"{', '.join(map(shortened, radians))} in radians"
        )
        problems.add("", f"{came}; expected one unit for all joints")
        problems.stop()
    theta = degrees or radians
    joints = len(theta)
    for form in numbered_forms(MEASUREMENT_FILE):
        columns = column_of(form.replace("#", "1")).among(texts)
        of_each_joint = joints and form not in (LINK_TEMPERATURE, *THETA.values())
        expected = named(form, joints if of_each_joint else len(columns))
        if columns and columns != expected:
            for_each_joint = f", one for each of the {joints} joints" if of_each_joint else ""
            missing = [name for name in expected if name not in columns]
            remedy = f"; add {missing[0]}" if missing else ""
            present = first_few(map(shortened, columns))
            problems.add(
                span(columns),
                f"the columns are {present}; expected numbers from 1 without a gap{for_each_joint}"
                f"{remedy}",
            )
    if not joints:
        came = first_few(map(repr, names)) or "nothing"
        problems.add(
            "",
            f"no angles; expected columns theta1_deg … or theta1_rad …; the header has {came}; "
            "configurations computes the angles of a pose",
        )
    elif nq is not None and joints != nq:
        all_joints = span(named(THETA["rad" if radians else "deg"], nq))
        problems.add(
            span(theta),
            f"the file has angles of {joints} joints; expected {all_joints}, because the arm has "
            f"{count(nq, 'joint')}",
        )
    _check_companions({*texts}, problems)
    row_temperatures = column_of(LINK_TEMPERATURE.replace("#", "1")).among(texts)
    if row_temperatures and "temperature_c" in texts:
        problems.add(
            "temperature_c",
            f"stated together with {span(row_temperatures)}; expected either temperature_c for "
            "the whole arm, or one column for each DH row",
        )
    if 0 < len(row_temperatures) < joints:
        problems.add(
            span(row_temperatures),
            f"{len(row_temperatures)} columns; expected {joints} or more, one for each DH row; for "
            "the whole arm use temperature_c",
        )
    problems.stop()


def checked_names(
    names: Sequence[object], columns: Sequence[Column], problems: Problems
) -> list[str]:
    """The names as text, known names in place of similar ones; mistakes go to ``problems``."""
    texts = [name if isinstance(name, str) else "" for name in names]
    for number, name in enumerate(names, start=1):
        if not isinstance(name, str) or not name.strip():
            came = "no name" if isinstance(name, str) else f"the name {name!r}"
            expected = "expected a name for each column"
            problems.add("", f"column {number} of {len(names)} has {came}; {expected}")
    for name, times in Counter(texts).items():
        if times > 1 and name.strip():
            problems.add(name, f"{times} columns have this name; expected each name once")
    unknown = [name for name in dict.fromkeys(texts) if column_of(name, columns) is UNKNOWN_COLUMN]
    meant = {name: near_miss(name, texts, columns) or name for name in unknown}
    for name, intended in meant.items():
        if intended != name:
            unit = column_of(intended, columns).unit
            in_unit = f" with numbers in {unit}" if unit else ""
            problems.add(
                name,
                f"unknown name; expected {shortened(intended)}{in_unit}; rename the column, or use "
                "a less similar name if it has other values",
            )
    return list(dict.fromkeys(meant.get(name, name) for name in texts))


def near_miss(name: str, present: Sequence[str], columns: Sequence[Column]) -> str | None:
    """The name or form that was meant: the same letters, or a missing one that is similar or has
    another unit; else None.
    """
    # A reference or an orientation would be lost in silence.
    with_unit = f"{name.lower()}_mm"
    if with_unit in REFERENCE and with_unit not in present:
        return with_unit
    if name.lower().startswith(EULER):
        return f"{EULER}ORDER_a_deg (or b, c) with ORDER {', '.join(EULER_ORDERS)}"
    possible = single_names(columns)
    if digits := re.search("[0-9]+", name):
        number = digits[0].lstrip("0") or "0"
        possible = tuple(form.replace("#", number) for form in numbered_forms(columns))
    by_letters = {_letters(other): other for other in possible}
    if _letters(name) in by_letters:
        return by_letters[_letters(name)]
    present_stems = {_stem(other) for other in possible if other in present}
    missing = {
        letters: other for letters, other in by_letters.items() if _stem(other) not in present_stems
    }
    if name.rpartition("_")[2] in OTHER_UNITS:
        for other in missing.values():
            if _stem(other) == _stem(name):
                return other
    close = difflib.get_close_matches(_letters(name), missing, n=1, cutoff=SPELLING_SIMILARITY)
    return missing[close[0]] if close else None


def similar_labels(labels: Iterable[str]) -> list[str]:
    """Pairs that differ only in case, other signs, leading zeros, or ``.0``."""
    spellings: dict[str, list[str]] = {}
    for label in filter(None, labels):
        key = re.sub(r"\.0$|[\W_]|(?<!\d)0+(?=\d)", "", label.casefold())
        spellings.setdefault(key, []).append(label)
    return [f"{same[0]!r} and {same[1]!r}" for same in spellings.values() if len(same) > 1]


def _stem(name: str) -> str:
    """The name without its unit."""
    return name.rpartition("_")[0] or name


def _letters(name: str) -> str:
    text = name.casefold()
    for sign, letters in SPELLED.items():
        text = text.replace(sign, letters)
    return "".join(c for c in text if c.isalnum())


def _check_companions(names: set[str], problems: Problems) -> None:
    groups = [column.names for column in MEASUREMENT_FILE if len(column.names) > 1]
    for group in (*groups, BAR):
        present = [column for column in group if column in names]
        missing = [column for column in group if column not in names]
        if present and missing:
            expected = f"expected all of {', '.join(group)}"
            problems.add(
                ", ".join(missing), f"missing, but the file has {', '.join(present)}; {expected}"
            )
    forms = [form for form in ORIENTATIONS if names.intersection(form)]
    if len(forms) > 1:
        problems.add(
            ", ".join(map(span, forms)),
            "orientations in two forms; expected one of these forms",
        )
    needs = {REFERENCE_U[0]: REFERENCE, ORIENTATION_U: (*forms, *ORIENTATIONS)[0]}
    for u, values in needs.items():
        if u in names and not names.intersection(values):
            problems.add(u, f"uncertainty without values; expected also {', '.join(values)}")
    if names.intersection(BAR) and "seat" not in names:
        problems.add(
            "seat",
            "missing, but the file has bar; expected the label of the seat at each end of a bar",
        )
