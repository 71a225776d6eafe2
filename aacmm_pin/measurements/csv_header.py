"""The first line of a measurement or acceptance file: which columns there are, and which names must
be mistakes.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from aacmm_pin._support import plausible
from aacmm_pin._support.file_problems import Problems, shortened
from aacmm_pin._support.units import count
from aacmm_pin.measurements.csv_columns import (
    BAR,
    EULER,
    EULER_ORDERS,
    LINK_TEMPERATURE,
    MEASUREMENT_FILE,
    ORIENTATION_U,
    ORIENTATIONS,
    PROBE_DIRECTION,
    REFERENCE,
    REFERENCE_U,
    THETA,
    AngleUnit,
    Column,
    column_of,
    entry_of,
    named,
    number_in,
    numbered_forms,
    single_names,
    span,
)

SPELLING_SIMILARITY = 0.9
"""Similarity (difflib) from which an unknown name is taken for a slip of a known one: one letter
wrong in ten.
"""
OF_ANGLES = ("deg", "rad", "mrad", "gon", "arcsec")
OTHER_UNITS = {*OF_ANGLES, "m", "cm", "um", "µm", "in", "inch", "k", "f", "ms", "min", "nmm"}
SPELLED = {"°c": "c", "°": "deg", "θ": "theta"}
"""Signs in names, and the letters that our names have in their stead."""
MOST_NAMES = 8
"""So many columns are listed."""


@dataclass(frozen=True)
class Header:
    """Unit of the angles, the columns of each form with numbers in the order of these, and those
    that no attribute has.
    """

    unit: AngleUnit
    numbered: dict[str, tuple[str, ...]]
    extra: tuple[str, ...]

    @property
    def theta(self) -> tuple[str, ...]:
        """Columns of the angles."""
        return self.numbered[THETA[self.unit]]

    def names(self, column: Column) -> tuple[str, ...]:
        """The columns of an entry."""
        return self.numbered[column.names[0]] if column.is_numbered else column.names


def read_header(names: Sequence[object], nq: int | None, problems: Problems) -> Header:
    """Sort the names of columns of a measurement file; ``nq`` is the number of joints, None where
    any will do.

    Raises:
        MeasurementFileError: a name is missing, there twice, almost a known one, or one that does
            not stand alone.
    """
    texts = checked_names(names, MEASUREMENT_FILE, problems)
    unit = _angle_unit(texts, problems)
    extra = tuple(name for name in dict.fromkeys(texts) if not entry_of(name).field)
    forms = numbered_forms(MEASUREMENT_FILE)
    header = Header(unit, {form: _numbered(texts, form, problems) for form in forms}, extra)
    joints = len(header.theta)
    _check_joints(header, [*map(str, names)], nq, problems)
    for form, columns in header.numbered.items():
        each_joint = form != LINK_TEMPERATURE
        if each_joint and columns and joints and len(columns) != joints:
            problems.add(
                span(columns),
                f"{len(columns)} columns; expected one for each of the {joints} joints",
            )
    _check_companions({*texts}, problems)
    _check_temperatures({*texts}, joints, header.numbered[LINK_TEMPERATURE], problems)
    problems.stop()
    return header


def checked_names(
    names: Sequence[object], columns: Sequence[Column], problems: Problems
) -> list[str]:
    """The names of a file with these columns, as text; known names in place of similar ones.

    Raises:
        MeasurementFileError: too many are unknown; ``problems`` has names that are missing, there
            twice, or almost a known one.
    """
    texts = [name if isinstance(name, str) else "" for name in names]
    for place, name in enumerate(names, start=1):
        if not isinstance(name, str) or not name.strip():
            came = "no name" if isinstance(name, str) else f"the name {name!r}"
            expected = "expected a name for each column"
            problems.add("", f"column {place} of {len(names)} has {came}; {expected}")
    for name, times in Counter(texts).items():
        if times > 1 and name.strip():
            problems.add(name, f"{times} columns have this name; expected each name once")
    unknown = [name for name in dict.fromkeys(texts) if column_of(name, columns) is None]
    most = plausible.MOST_UNKNOWN
    if len(unknown) > most:
        first = ", ".join(map(shortened, unknown[:3]))
        problems.add(
            "",
            f"{len(unknown)} columns with unknown names, such as {first}; expected at most {most}; "
            "delete columns on which the residuals do not depend",
        )
        problems.stop()
    meant = {name: near_miss(name, texts, columns) or name for name in unknown}
    for name in unknown:
        if meant[name] != name:
            problems.add(
                name,
                f"unknown name; expected {shortened(meant[name])}{_in_unit(meant[name], columns)}; "
                "rename the column, or use a less similar name if it has other values",
            )
    return list(dict.fromkeys(meant.get(name, name) for name in texts))


def near_miss(name: str, present: Sequence[str], columns: Sequence[Column]) -> str | None:
    """The known name that was meant, or the form of such names, if one was: of the same letters, or
    a missing one, similar or with another unit.
    """
    with_unit = f"{name.lower()}_mm"
    if with_unit in REFERENCE and with_unit not in present:
        return with_unit  # a reference that would be lost in silence
    if name.lower().startswith(EULER):  # so would be an orientation
        return f"{EULER}ORDER_a_deg (or b, c) with ORDER {', '.join(EULER_ORDERS)}"
    known = _names_with_number_of(name, columns)
    letters = {_letters(k): k for k in known}
    if _letters(name) in letters:
        return letters[_letters(name)]
    stems = {_stem(k) for k in known if k in present}
    missing = {key: k for key, k in letters.items() if _stem(k) not in stems}
    if name.rpartition("_")[2] in OTHER_UNITS:
        for k in missing.values():
            if _stem(k) == _stem(name):
                return k
    close = difflib.get_close_matches(_letters(name), missing, n=1, cutoff=SPELLING_SIMILARITY)
    return missing[close[0]] if close else None


def _in_unit(name: str, columns: Sequence[Column]) -> str:
    """The unit of the numbers in a column, in words; "" where its cells are labels."""
    column = column_of(name, columns)
    return f" with numbers in {column.unit}" if column is not None and column.unit else ""


def _names_with_number_of(name: str, columns: Sequence[Column]) -> tuple[str, ...]:
    """The known names: with the number that is in ``name``, or those without numbers."""
    digits = re.search("[0-9]+", name)
    if digits is None:
        return single_names(columns)
    number = digits[0].lstrip("0") or "0"
    return tuple(form.replace("#", number) for form in numbered_forms(columns))


def similar_labels(labels: Iterable[str]) -> list[str]:
    """Pairs of labels that differ only in letter case, signs that are no letters or digits, leading
    zeros, or ``.0``.
    """
    spellings: dict[str, list[str]] = {}
    for label in filter(None, labels):
        key = re.sub(r"\.0$|[\W_]|(?<!\d)0+(?=\d)", "", label.casefold())
        spellings.setdefault(key, []).append(label)
    return [f"{same[0]!r} and {same[1]!r}" for same in spellings.values() if len(same) > 1]


def _stem(name: str) -> str:
    return name.rpartition("_")[0] or name


def _letters(name: str) -> str:
    """The letters and digits of a name, signs spelled out."""
    text = name.casefold()
    for sign, letters in SPELLED.items():
        text = text.replace(sign, letters)
    return "".join(c for c in text if c.isalnum())


def _numbered(names: Sequence[str], form: str, problems: Problems) -> tuple[str, ...]:
    """The columns of ``form`` in the order of their numbers."""
    numbers = [number for number in (number_in(name, form) for name in names) if number is not None]
    numbers.sort(key=lambda number: (len(number), number))
    found = [form.replace("#", number) for number in numbers]
    expected = named(form, len(found))
    if found != expected:
        there = {*found}
        missing = next(name for name in expected if name not in there)
        came = ", ".join(map(shortened, numbers))
        problems.add(
            span(found),
            f"the numbers are {came}; expected numbers from 1 without a gap; add {missing}",
        )
    return tuple(found)


def _angle_unit(names: Sequence[str], problems: Problems) -> AngleUnit:
    """Unit of the angles."""
    columns = {
        unit: ", ".join(shortened(name) for name in names if number_in(name, form))
        for unit, form in THETA.items()
    }
    if all(columns.values()):
        came = f"{columns['deg']} are in degrees, and {columns['rad']} in radians"
        problems.add("", f"{came}; expected one unit for all joints")
        problems.stop()
    return "rad" if columns["rad"] else "deg"


def _check_joints(header: Header, names: Sequence[str], nq: int | None, problems: Problems) -> None:
    """Whether there are angles, of as many joints as the arm has."""
    theta = header.theta
    if not theta:
        problems.add(
            "",
            f"no angles; expected columns theta1_deg … or theta1_rad …{_renaming(names, nq)}; "
            "configurations computes the angles of a pose",
        )
    elif nq is not None and len(theta) != nq:
        expected = span(named(THETA[header.unit], nq))
        problems.add(
            span(theta),
            f"the file has angles of {len(theta)} joints; expected {expected}, because the arm has "
            f"{count(nq, 'joint')}",
        )


def _renaming(names: Sequence[str], nq: int | None) -> str:
    """How to name columns that may be the angles, for they are unknown and numbered, as many as
    joints; "" where there are none.
    """
    alike: dict[str, list[str]] = {}
    for name in names:
        form, numbers = re.subn("[0-9]+", "#", name)
        if numbers == 1 and column_of(name) is None:
            alike.setdefault(form, []).append(name)
    joints = nq or max(map(len, alike.values()), default=0)
    found = [each for each in alike.values() if len(each) == joints > 1]
    if not found:
        return f"; the first line has {listed(map(repr, names))}" if names else ""
    degrees, radians = (span(named(form, joints)) for form in THETA.values())
    came = " or ".join(f"{shortened(each[0])} … {shortened(each[-1])}" for each in found)
    return f"; if {came} are the angles, rename them {degrees}, or in radians {radians}"


def listed(names: Iterable[str]) -> str:
    """The first names."""
    texts = [*names]
    return ", ".join(texts[:MOST_NAMES]) + (", …" if len(texts) > MOST_NAMES else "")


def _check_companions(there: set[str], problems: Problems) -> None:
    """Names that need others."""
    for group in (REFERENCE, REFERENCE_U, *ORIENTATIONS, BAR, PROBE_DIRECTION):
        present = [name for name in group if name in there]
        missing = [name for name in group if name not in there]
        if present and missing:
            expected = f"expected all of {', '.join(group)}"
            problems.add(
                ", ".join(missing), f"missing, but the file has {', '.join(present)}; {expected}"
            )
    stated = [form for form in ORIENTATIONS if there.intersection(form)]
    if len(stated) > 1:
        problems.add(
            ", ".join(map(span, stated)),
            "orientations in two forms; expected one of these forms",
        )
    for u, of in ((REFERENCE_U[0], REFERENCE), (ORIENTATION_U, (stated or ORIENTATIONS)[0])):
        if u in there and not there.intersection(of):
            problems.add(u, f"uncertainty without values; expected also {', '.join(of)}")
    if there.intersection(BAR) and "seat" not in there:
        problems.add(
            "seat",
            "missing, but the file has bar; expected the label of the seat at each end of a bar",
        )


def _check_temperatures(
    there: set[str], joints: int, of_rows: Sequence[str], problems: Problems
) -> None:
    """One temperature of the arm, or one of each row."""
    if of_rows and "temperature_c" in there:
        problems.add(
            "temperature_c",
            f"stated together with {span(of_rows)}; expected either temperature_c for the whole "
            "arm, or one column for each DH row",
        )
    if 0 < len(of_rows) < joints:
        problems.add(
            span(of_rows),
            f"{len(of_rows)} columns; expected {joints} or more, one for each DH row; for the "
            "whole arm use temperature_c",
        )
