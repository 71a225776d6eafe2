"""The columns of a measurement file: what they are called, and what is wrong with a table that has them.

A table is judged in three steps: its header, each cell, and what cells say together. Each step gathers its complaints in
:class:`Problems`, so that one message tells the first few of them.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import RANGES, Array, Index
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.effects.conditions import UNITS, Labels
from aacmm_pin.errors import MeasurementFileError

AngleUnit = Literal["deg", "rad"]
Mask = NDArray[np.bool_]

THETA: dict[AngleUnit, str] = {"deg": "theta#_deg", "rad": "theta#_rad"}
REFERENCE = ("x_mm", "y_mm", "z_mm")
REFERENCE_U = ("u_x_mm", "u_y_mm", "u_z_mm")
ORIENTATION, ORIENTATION_U = ("qw", "qx", "qy", "qz"), "u_rot_rad"
BAR, BAR_U = ("bar", "bar_end", "bar_length_mm"), "u_bar_length_mm"
APPROACH, TORQUE, LINK_TEMPERATURE = "approach#", "torque#_nm", "temperature#_c"
FIELDS: dict[str, tuple[tuple[str, ...], float]] = {
    "reference": (REFERENCE, MM),
    "reference_u": (REFERENCE_U, MM),
    "orientation": (ORIENTATION, 1.0),
    "orientation_u": ((ORIENTATION_U,), 1.0),
    "seat": (("seat",), 1.0),
    "marker": (("marker",), 1.0),
    "bar": (("bar",), 1.0),
    "bar_end": (("bar_end",), 1.0),
    "bar_length": (("bar_length_mm",), MM),
    "bar_length_u": ((BAR_U,), MM),
    "time": (("time_s",), 1.0),
    "temperature": (("temperature_c",), 1.0),
    "link_temperature": ((LINK_TEMPERATURE,), 1.0),
    "approach": ((APPROACH,), 1.0),
    "torque": ((TORQUE,), 1.0),
    "session": (("session",), 1.0),
    "operator": (("operator",), 1.0),
    "record": (("record",), 1.0),
}
"""The columns behind each attribute of measurements and of their conditions, and their unit in SI; all but the angles.

A name with # stands for as many columns with numbers in its place, from 1: of the joint, or of the DH row for temperatures.
"""
PLAUSIBLE: dict[str, Range] = {
    "reference": plausible.COORDINATE,
    "reference_u": plausible.LENGTH_NOISE,
    "orientation_u": plausible.TURN_NOISE,
    "bar_length": plausible.BAR_LENGTH,
    "bar_length_u": plausible.LENGTH_NOISE,
    **{condition: RANGES[unit] for condition, unit in UNITS.items() if unit in RANGES},
}
"""What the numbers behind an attribute can be, in SI."""
LABELS = ("seat", "marker", "bar", "bar_end", "session", "operator", "record")
NUMBERED = (*THETA.values(), APPROACH, TORQUE, LINK_TEMPERATURE)
SINGLE = tuple(name for columns, _ in FIELDS.values() for name in columns if "#" not in name)
MAY_BE_EMPTY = (*REFERENCE, *REFERENCE_U, *ORIENTATION, ORIENTATION_U, "bar_length_mm", BAR_U)
NOT_ROUNDING = 2e-3
"""A quaternion whose norm is off one by more than this is none: four numbers with three decimals give 1e-3 at most."""

ALIKE = 0.9
"""Similarity (difflib) from which an unknown name is taken for a slip of a known one: one letter wrong in ten."""
OTHER_UNITS = frozenset(["m", "cm", "um", "µm", "in", "inch", "k", "f", "ms", "min", "nmm", "mrad", "gon", "arcsec"])
ENOUGH_RECORDS = 5
"""So many records tell degrees from radians."""
MOSTLY = 0.75
"""Part of the angles that are within ±2π where degrees may be radians."""
MOST_PROBLEMS = 10
LONGEST_NAME = 100
"""Characters of a column's name, or of a cell, that a message has."""


@dataclass
class Problems:
    """What is wrong with a table from ``source``; ``lines`` (n,) are the line numbers of its records."""

    source: str
    lines: Index
    found: list[tuple[int | None, str, str]] = field(default_factory=list)

    def add(self, column: str, message: str) -> None:
        """A problem of a whole column, or of the whole table where ``column`` is ""."""
        self.found.append((None, _short(column), message))

    def at(self, bad: Mask, column: str, message: str, *values: NDArray[Any]) -> None:
        """A problem of the rows ``bad`` (n,): ``message`` with ``values`` (n,) of the first, and which others share it."""
        where = np.flatnonzero(bad)
        if where.size:
            lines = [str(line) for line in self.lines[where[:6]]]
            others = f" (and {where.size - 1} more: row {', '.join(lines[1:])}{', …' * (where.size > 6)})"
            first = [v[where[0]] for v in values]
            said = message.format(*(_short(v) if isinstance(v, str) else v for v in first))
            self.found.append((int(lines[0]), column, said + others * (where.size > 1)))

    def stop(self) -> None:
        """Raise MeasurementFileError with the first problems, one a line, if there are any."""
        if not self.found:
            return
        row, column, message = self.found[0]
        for problem in self.found[1:MOST_PROBLEMS]:
            message += f"\n{MeasurementFileError(self.source, *problem)}"
        if len(self.found) > MOST_PROBLEMS:
            message += f"\n{self.source}: and {len(self.found) - MOST_PROBLEMS} more problems"
        raise MeasurementFileError(self.source, row, column, message)


def _short(name: str) -> str:
    """A name or a cell as messages have it: of a very long one the two ends."""
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME // 2]}…{name[-LONGEST_NAME // 2 :]}"


# --- the header


@dataclass(frozen=True)
class Header:
    """Unit of the angles, the columns of each form with numbers in the order of these, and those that nobody knows."""

    unit: AngleUnit
    numbered: dict[str, tuple[str, ...]]
    extra: tuple[str, ...]

    @property
    def theta(self) -> tuple[str, ...]:
        """Columns of the angles."""
        return self.numbered[THETA[self.unit]]


def named(form: str, count: int) -> list[str]:
    """The names of ``form`` with the numbers 1 … ``count``."""
    return [form.replace("#", str(k)) for k in range(1, count + 1)]


def span(names: Sequence[str]) -> str:
    """First and last of ``names``."""
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"


def is_known(name: str) -> bool:
    """Whether it names a column that means something."""
    return name in SINGLE or any(_number(name, form) for form in NUMBERED)


def read_header(names: Sequence[object], nq: int | None, problems: Problems) -> Header:
    """Sort the names of columns; ``nq`` is the number of joints of the arm, None where any will do.

    Raises:
        MeasurementFileError: a name is missing, there twice, almost a known one, or one that does not stand alone.
    """
    texts = [name if isinstance(name, str) else "" for name in names]
    for place, name in enumerate(names, start=1):
        if not isinstance(name, str) or not name.strip():
            came = "" if isinstance(name, str) else f" but {name!r}, which is not text"
            problems.add("", f"column {place} of {len(names)} has no name{came}; expected a name for each column")
    for name, count in Counter(texts).items():
        if count > 1 and name.strip():
            problems.add(name, f"is there {count} times, expected each name once in the header")
    extra = [name for name in dict.fromkeys(texts) if not is_known(name)]
    if len(extra) > plausible.MOST_UNKNOWN:
        came = f"{len(extra)} columns of unknown names, such as {', '.join(map(_short, extra[:3]))}"
        problems.add("", f"{came}; expected at most {plausible.MOST_UNKNOWN}, so leave out what residuals do not depend on")
        problems.stop()
    for name in extra:
        if meant := _near_miss(name, texts):
            other = "if something else is meant, a name that cannot be taken for it"
            problems.add(name, f"is not a known name; expected {_short(meant)}, or {other}")
    problems.stop()
    header = Header(_unit(texts, problems), {form: _numbered(texts, form, problems) for form in NUMBERED}, tuple(extra))
    joints = _joints(header, texts, nq, problems)
    for columns in (header.numbered[form] for form in (APPROACH, TORQUE)):
        if columns and joints and len(columns) != joints:
            problems.add(span(columns), f"{len(columns)} columns, expected one for each of the {joints} joints")
    _companions(set(texts), joints, header.numbered[LINK_TEMPERATURE], problems)
    problems.stop()
    return header


def _number(name: str, form: str) -> str | None:
    match = re.fullmatch(form.replace("#", "(0|[1-9][0-9]*)"), name)
    return match[1] if match else None


def _near_miss(name: str, present: Sequence[str]) -> str | None:
    """The known name that was meant, if one was."""
    if f"{name.lower()}_mm" in REFERENCE and f"{name.lower()}_mm" not in present:
        return f"{name.lower()}_mm"  # a reference that would be lost in silence
    digits = re.search("[0-9]+", name)
    known = [form.replace("#", digits[0].lstrip("0") or "0") for form in NUMBERED] if digits else list(SINGLE)
    return near_miss(name, present, known)


def near_miss(name: str, present: Sequence[str], known: Sequence[str]) -> str | None:
    """The one of the ``known`` names that was meant: of the same letters, or a missing one, similar or with another unit."""
    letters = {_letters(k): k for k in known}
    if _letters(name) in letters:
        return letters[_letters(name)]
    stems = {_stem(k) for k in known if k in present}
    missing = {key: k for key, k in letters.items() if _stem(k) not in stems}
    if name.rpartition("_")[2] in OTHER_UNITS:
        for k in missing.values():
            if _stem(k) == _stem(name):
                return k
    close = difflib.get_close_matches(_letters(name), missing, n=1, cutoff=ALIKE)
    return missing[close[0]] if close else None


def alike(labels: Iterable[str]) -> list[str]:
    """Pairs of labels that differ only in letter case, blanks, dashes, leading zeros, or in a ``.0`` of a spreadsheet."""
    of_text: dict[str, list[str]] = {}
    for label in filter(None, labels):
        of_text.setdefault(re.sub(r"[\s_-]|\.0$|(?<!\d)0+(?=\d)", "", label.casefold()), []).append(label)
    return [f"{first!r} and {second!r}" for first, second, *_ in (same for same in of_text.values() if len(same) > 1)]


def _stem(name: str) -> str:
    return name.rpartition("_")[0] or name


def _letters(name: str) -> str:
    return "".join(c for c in name.casefold() if c.isalnum())


def _numbered(names: Sequence[str], form: str, problems: Problems) -> tuple[str, ...]:
    """The columns of ``form`` in the order of their numbers."""
    # As text: Python reads no number of thousands of digits.
    numbers = sorted((number for name in names if (number := _number(name, form))), key=lambda number: (len(number), number))
    found = [form.replace("#", number) for number in numbers]
    if found != named(form, len(found)):
        there = {*found}
        missing = next(name for name in named(form, len(numbers)) if name not in there)
        came = ", ".join(map(_short, numbers))
        problems.add(span(found), f"numbered {came}; expected numbers from 1 without gap, but {missing} is missing")
    return tuple(found)


def _unit(names: Sequence[str], problems: Problems) -> AngleUnit:
    in_degrees, in_radians = (", ".join(_short(n) for n in names if _number(n, form)) for form in THETA.values())
    if in_degrees and in_radians:
        problems.add("", f"{in_degrees} in degrees beside {in_radians} in radians; expected one unit for all joints")
        problems.stop()
    return "rad" if in_radians else "deg"


def _joints(header: Header, names: Sequence[str], nq: int | None, problems: Problems) -> int:
    """Number of joints of which there are angles."""
    theta = header.theta
    if not theta:
        came = ", ".join(map(repr, names[:8])) + ", …" * (len(names) > 8)
        problems.add("", f"no angles: expected columns theta1_deg … (or theta1_rad …) in the first line, which has {came}")
    elif nq is not None and len(theta) != nq:
        expected = span(named(THETA[header.unit], nq))
        problems.add(span(theta), f"angles of {len(theta)} joints, but the arm has {nq}; expected {expected}")
    return len(theta)


def _companions(there: set[str], joints: int, link_temperature: Sequence[str], problems: Problems) -> None:
    """Names that need others, or exclude them."""
    for group in (REFERENCE, REFERENCE_U, ORIENTATION, BAR):
        present, missing = [n for n in group if n in there], [n for n in group if n not in there]
        if present and missing:
            problems.add(", ".join(missing), f"missing beside {', '.join(present)}; expected all of {', '.join(group)}")
    for u, of in ((REFERENCE_U[0], REFERENCE), (ORIENTATION_U, ORIENTATION)):
        if u in there and not there.intersection(of):
            problems.add(u, f"uncertainty of a reference that is not there; expected {', '.join(of)} too")
    if there.intersection(BAR) and "seat" not in there:
        problems.add("seat", "missing beside bar; expected the label of the seat that each end of a bar stands for")
    if link_temperature and "temperature_c" in there:
        problems.add("temperature_c", f"beside {span(link_temperature)}; expected one temperature, or one for each DH row")
    if 0 < len(link_temperature) < joints:
        expected = f"expected one for each DH row, so {joints} or more; temperature_c is that of the whole arm"
        problems.add(span(link_temperature), f"{len(link_temperature)} columns, {expected}")


# --- the cells


@dataclass(frozen=True, eq=False)
class Columns:
    """A table that may be used: its header, its columns of numbers (n,) in their own units, its columns of labels (n,)."""

    header: Header
    numbers: dict[str, Array]
    labels: dict[str, Labels]

    @property
    def n(self) -> int:
        """Number of records."""
        return len(self.numbers[self.header.theta[0]])

    def block(self, names: Sequence[str]) -> Array:
        """The columns ``names`` side by side, (n, len(names)); NaN where one is not there."""
        nothing = np.full(self.n, np.nan)
        return np.column_stack([self.numbers.get(name, nothing) for name in names])

    def label(self, name: str) -> Labels:
        """The column ``name``; "" where it is not there."""
        return self.labels.get(name, np.full(self.n, "", dtype=object))

    def field(self, attribute: str) -> NDArray[Any] | None:
        """What stands in the columns of an attribute, see :data:`FIELDS`, in SI; None where there are none."""
        names, unit = FIELDS[attribute]
        names = self.header.numbered.get(names[0], names)
        if not names or names[0] not in self.numbers:
            return self.labels.get(attribute)
        values = self.block(names) * unit
        return values[:, 0] if FIELDS[attribute][0] == names and len(names) == 1 else values


def checked_columns(table: pd.DataFrame, lines: Index, nq: int | None, source: str) -> Columns:
    """The known columns of ``table``, cells being text or numbers; ``lines`` (n,) are for messages.

    Raises:
        MeasurementFileError: the header, a cell, or what cells say together is not as expected.
    """
    problems = Problems(source, lines)
    header = read_header(list(table.columns), nq, problems)
    if not len(table):
        problems.add("", "has a header but no records")
    cells = {name: _texts(table[name]) for name in table.columns if name not in header.extra}
    labels = {name: cells.pop(name) for name in LABELS if name in cells}
    columns = Columns(header, {name: _numbers(name, each, problems) for name, each in cells.items()}, labels)
    problems.stop()
    for check in (_angles, _references, _approaches, _plausible, _spelling, _seats, _bars):
        check(columns, problems)
    problems.stop()
    return columns


def _texts(column: pd.Series) -> Labels:
    """Cells as text, exactly as they are; "" where there is nothing."""
    cells = np.array(column, dtype=object)
    if set(map(type, cells)) <= {str}:
        return cells
    nothing = column.isna().to_numpy()
    return np.array(["" if n else str(c) for c, n in zip(cells, nothing, strict=True)], dtype=object)


def _numbers(name: str, cells: Labels, problems: Problems) -> Array:
    """Cells as numbers, NaN where there is nothing."""
    values = np.array([_float(cell) for cell in cells], dtype=np.float64)
    empty = np.array([not cell.strip() for cell in cells], dtype=bool)
    unreadable = ~np.isfinite(values) & ~empty
    comma = unreadable.copy()
    comma[unreadable] = [_DECIMAL_COMMA.fullmatch(cell) is not None for cell in cells[unreadable]]
    problems.at(comma, name, "is {!r}, expected a number with a decimal point, not a decimal comma", cells)
    problems.at(unreadable & ~comma, name, "is {!r}, expected a finite number", cells)
    if name not in MAY_BE_EMPTY:
        problems.at(empty, name, "is empty (or NaN), expected a number in every row")
    return values


_DECIMAL_COMMA = re.compile(r"\s*[+-]?[0-9.]*,[0-9]+\s*")


def _float(cell: str) -> float:
    """A text as a number, NaN where it is none; Python's 1_000 is none."""
    try:
        return np.nan if "_" in cell else float(cell)
    except ValueError:
        return np.nan


# --- what cells say together


def looks_like_radians(degrees: Array) -> bool:
    """Whether ``degrees`` (n, nq) are radians: at least 5 records, and the largest of all angles between 1 and 2π.

    Measurements turn several joints by tens of degrees. An arm that stays within ±1° of zero in all joints, or fewer
    records than 5, get the benefit of the doubt.
    """
    return len(degrees) >= ENOUGH_RECORDS and bool(1.0 < np.abs(degrees).max() <= 2.0 * np.pi)


def mostly_like_radians(degrees: Array) -> bool:
    """Whether most of ``degrees`` (n, nq) would be less than a turn if they were radians: of few records, or with an endless
    wrist.
    """
    turned = np.abs(degrees[degrees != 0.0])
    return bool(turned.size and turned.max() > 1.0 and np.mean(turned <= 2.0 * np.pi) >= MOSTLY)


def _angles(columns: Columns, problems: Problems) -> None:
    theta = columns.header.theta
    q = columns.block(theta)
    if columns.header.unit == "deg" and looks_like_radians(q):
        problems.add(
            span(theta),
            f"all angles of all {len(q)} records lie within ±{np.abs(q).max():.4g}°, so these look like radians; if they "
            f"are, rename the columns to {span(named(THETA['rad'], len(theta)))}; if they are degrees, convert them to "
            f"radians under these names (from {ENOUGH_RECORDS} records on, a largest angle of 1 to 2π is taken for radians)",
        )
    if columns.header.unit == "rad":
        expected = f"expected at most {plausible.MOST_TURNS} turns; if these are degrees, rename the columns to theta1_deg …"
        for name in theta:
            angle = columns.numbers[name]
            problems.at(np.abs(angle) > plausible.MOST_TURNS * 2.0 * np.pi + 1e-9, name, "is {:g} rad, " + expected, angle)


def _references(columns: Columns, problems: Problems) -> None:
    for names in (REFERENCE, REFERENCE_U, ORIENTATION):
        stated = np.isfinite(columns.block(names))
        partly = stated.any(axis=1) & ~stated.all(axis=1)
        for k, name in enumerate(names):
            expected = f"is empty in a row that states others of {', '.join(names)}; expected all or none"
            problems.at(partly & ~stated[:, k], name, expected)
    for name in filter(columns.numbers.__contains__, (*REFERENCE_U, ORIENTATION_U, BAR_U)):
        u = columns.numbers[name]
        problems.at(u == 0.0, name, "is {:g}, expected a standard uncertainty above zero", u)
    norm = np.linalg.norm(columns.block(ORIENTATION), axis=1)
    expected = "expected 1: a unit quaternion, scalar first (angles in degrees or Euler angles are to be converted)"
    problems.at(np.abs(norm - 1.0) > NOT_ROUNDING, span(ORIENTATION), f"has the norm {{:.6g}}, {expected}", norm)
    placed = np.isfinite(columns.block(REFERENCE)).any(axis=1) | (columns.label("seat") != "")
    problems.at(np.isfinite(norm) & ~placed, span(ORIENTATION), f"in a row without {span(REFERENCE)} and seat")


def _approaches(columns: Columns, problems: Problems) -> None:
    for name in columns.header.numbered[APPROACH]:
        sign = columns.numbers[name]
        problems.at(~np.isin(sign, (-1.0, 0.0, 1.0)), name, "is {:g}, expected -1, 0 or 1", sign)


def _plausible(columns: Columns, problems: Problems) -> None:
    ranges = {name: plausible.READING.of_unit("°", DEG) for name in columns.header.numbered[THETA["deg"]]}
    for attribute, range_ in PLAUSIBLE.items():
        names, unit = FIELDS[attribute]
        in_file = range_ if unit == 1.0 else range_.of_unit("mm", unit)
        ranges |= dict.fromkeys(columns.header.numbered.get(names[0], names), in_file)
    for name, range_ in ranges.items():
        if name in columns.numbers:
            values = columns.numbers[name]
            problems.at(range_.outside(values), name, f"is {{:.6g}} {range_.unit}, {range_.expected}", values)


def _spelling(columns: Columns, problems: Problems) -> None:
    """One seat, target or bar is written in one way: what nobody sees, or marks a comment, makes no other of it."""
    for name in ("seat", "marker", "bar"):
        label, spelled = columns.label(name), {"": ""}
        first = np.array([spelled.setdefault(_seen(cell), cell) for cell in label], dtype=object)
        expected = "is {!r} beside {!r}, which differs in blanks, unseen signs or a leading # alone; expected one spelling"
        problems.at(first != label, name, expected, label, first)


def _seen(label: str) -> str:
    """A label without what distinguishes it from no other for a reader."""
    shown = "".join(letter for letter in unicodedata.normalize("NFC", label) if unicodedata.category(letter) != "Cf")
    return shown.strip().removeprefix("#").strip() or shown.strip()


def _seats(columns: Columns, problems: Problems) -> None:
    seat, bar = columns.label("seat"), columns.label("bar")
    known = np.isfinite(columns.block(REFERENCE)).any(axis=1)
    alone = pd.Series(seat).map(Counter(seat)).to_numpy() == 1
    problems.at(
        (seat != "") & alone & ~known & (bar == ""),
        "seat",
        "seat {!r} has this record only, without reference coordinates, and so contributes nothing; "
        "expected two records or more with this label, or an empty cell",
        seat,
    )


def _bars(columns: Columns, problems: Problems) -> None:
    if "bar" not in columns.labels:
        return
    bar, end, seat, length = *(columns.label(n) for n in ("bar", "bar_end", "seat")), columns.numbers["bar_length_mm"]
    held = bar != ""
    problems.at(~held & (end != ""), "bar_end", "is {!r} in a row without bar, expected an empty cell", end)
    problems.at(~held & np.isfinite(length), "bar_length_mm", "is {:g} in a row without bar, expected an empty cell", length)
    problems.at(held & ~np.isin(end, ("A", "B")), "bar_end", "is {!r}, expected A or B", end)
    problems.at(held & (seat == ""), "seat", "is empty in a row of bar {!r}, expected the label of the seat at its end", bar)
    problems.at(held & np.isnan(length), "bar_length_mm", "is empty in a row of bar {!r}, expected its length", bar)
    if (u := columns.numbers.get(BAR_U)) is not None:
        most = pd.Series(u).groupby(bar).transform("max").to_numpy()
        differs = held & np.isfinite(u) & (u != most)
        problems.at(
            differs, BAR_U, "is {:g} for bar {!r}, of which another row states {:g}; expected one value", u, bar, most
        )
    _bars_agree(bar, end, seat, length, problems)


def _bars_agree(bar: Labels, end: Labels, seat: Labels, length: Array, problems: Problems) -> None:
    """Whether the rows of each bar state one length, both ends, and another seat at each."""
    table = pd.DataFrame({"bar": bar, "end": end, "seat": seat, "length": length, "row": np.arange(len(bar))})
    by_bar, by_end = table.groupby("bar"), table.groupby(["bar", "end"])
    first, first_of_end = by_bar["row"].transform("first").to_numpy(), by_end["row"].transform("first").to_numpy()
    held = (bar != "") & np.isin(end, ("A", "B"))
    problems.at(
        held & (length != length[first]) & np.isfinite(length) & np.isfinite(length[first]),
        "bar_length_mm",
        "is {} for bar {!r}, which row {} says is {} long; expected one length for each bar",
        *(length, bar, problems.lines[first], length[first]),
    )
    problems.at(
        held & (seat != seat[first_of_end]) & (seat != "") & (seat[first_of_end] != ""),
        "seat",
        "is {!r} at end {} of bar {!r}, which row {} says is seat {!r}; expected one seat for each end",
        *(seat, end, bar, problems.lines[first_of_end], seat[first_of_end]),
    )
    ends = by_bar["end"].transform("nunique").to_numpy()
    only = "bar {!r} has records of end {} only, expected records of A and of B"
    problems.at(held & (ends == 1) & (np.arange(len(bar)) == first), "bar_end", only, bar, end)
    both = table.groupby(["bar", "seat"])["end"].transform("nunique").to_numpy() == 2
    problems.at(held & both & (seat != ""), "seat", "{!r} is at both ends of bar {!r}, expected two seats", seat, bar)
