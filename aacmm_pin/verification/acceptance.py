"""Test value and verdict of each characteristic of a file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from aacmm_pin._support.display import Note, Shown, notes_in_json
from aacmm_pin._support.plausible import MPE
from aacmm_pin._support.units import MM, count, plain_mm
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import measurement_file
from aacmm_pin.verification.acceptance_file import read_file
from aacmm_pin.verification.characteristics import (
    DEFINITIONS,
    UNCALIBRATED,
    Definition,
    definitions,
)
from aacmm_pin.verification.doubts import check_unit, doubts
from aacmm_pin.verification.evaluators import LENGTH_KEY, Error, Evaluated, PointsInFile

ACCEPTANCE_SCHEMA = "aacmm-pin/acceptance/1"
GUARD_BAND_FACTOR = 2.0
"""Of the guard band U = 2 u (ISO 14253-1:1998 and 2013). ISO 14253-1:2017 has 1.65 u by default (95
% at one limit): U makes more verdicts inconclusive.
"""
FAR_BELOW = 100.0
"""An MPE above 1 mm and so many test values may be in another unit."""
LONGEST_PART = 0.66
"""Least part of the measuring range of the longest length (ISO 10360-12:2016, by public
descriptions).
"""

IN_RANGE = ("length-uni", "length-bi")
"""Where :data:`LONGEST_PART` applies."""
MOST_LACKING = 3

Verdict = Literal["conformity", "non-conformity", "neither"]
SHOWN_AS: dict[str, str] = {"non-conformity": "nonconformity", "neither": "inconclusive"}
"""Verdicts in the words of ISO 14253-1."""
WORST_FIRST: tuple[Verdict, ...] = ("non-conformity", "neither", "conformity")


@dataclass(frozen=True)
class CharacteristicValue:
    """Test value of a characteristic, from one set of coordinates.

    Attributes:
        source: coordinates: of the file, or of the arm of this name.
        evaluated: test value and standard uncertainty [m], and missing points.
        mpe: maximum permissible error [m], or nan.
    """

    source: str
    definition: Definition
    evaluated: Evaluated
    mpe: float = math.nan

    @property
    def where(self) -> PointsInFile | None:
        """Probed points of the largest error; None if all determine the value."""
        return self.evaluated.largest.place

    @property
    def verdict(self) -> Verdict | None:
        """By ISO 14253-1:2013 with the guard band U = 2u; None without value or MPE. A u not stated
        is zero.

        Each error has its own U: the value conforms if every error does.
        """
        if not self.evaluated.errors or math.isnan(self.mpe):
            return None
        return _verdict(self.evaluated.errors, self.mpe)

    def row(self) -> dict[str, Any]:
        """Row of a table, lengths in mm, nan if missing."""
        definition = self.definition
        evaluated = self.evaluated
        return {
            "coordinates": self.source,
            "figure": definition.name,
            "standard": definition.standard,
            "test": definition.test_name,
            "definition": definition.text,
            "value_mm": evaluated.largest.value / MM,
            "U_mm": GUARD_BAND_FACTOR * evaluated.largest.u / MM,
            "mpe_mm": self.mpe / MM,
            "verdict": self.verdict,
            "where": "" if self.where is None else str(self.where),
            "had": evaluated.had,
            "counted": f"{definition.counted}s",
            "missing": self.missing,
        }

    def to_dict(self) -> dict[str, Any]:
        """The row for JSON, None for nan, with labels and rows of the largest error."""
        row = {key: None if pd.isna(value) else value for key, value in self.row().items()}
        place = self.where
        where = None if place is None else {**place.labels, "rows": [*place.rows]}
        return row | {"clause": row["test"], "where": where}

    @property
    def stated(self) -> int:
        """Number of errors with a stated u."""
        return sum(not math.isnan(error.u) for error in self.evaluated.errors)

    @property
    def decided_by(self) -> Error | None:
        """A smaller error whose U forbids a better verdict, or None."""
        errors = self.evaluated.errors
        if self.verdict == _verdict([self.evaluated.largest], self.mpe):
            return None
        # Non-conformity is proven by the lower end of an interval, all else fails by the upper end.
        end = _lower_end if self.verdict == "non-conformity" else _upper_end
        deciding = max(errors, key=end)
        return None if deciding is self.evaluated.largest else deciding

    @property
    def missing(self) -> str:
        """In words; "" if nothing."""
        number = self.evaluated.missing
        lacking = self.evaluated.lacking
        text = count(number, self.definition.counted) if number else self.evaluated.why_incomplete
        if not lacking:
            return text
        more = ["…"] if len(lacking) > MOST_LACKING else []
        return f"{text}: {'; '.join([*lacking[:MOST_LACKING], *more])}"


def shown_verdict(verdict: str | None) -> str:
    """In the words of readers."""
    return SHOWN_AS.get(verdict or "", verdict or "")


def _expanded(error: Error) -> float:
    """U [m] of an error; a u not stated is zero."""
    return 0.0 if math.isnan(error.u) else GUARD_BAND_FACTOR * error.u


def _lower_end(error: Error) -> float:
    return abs(error.value) - _expanded(error)


def _upper_end(error: Error) -> float:
    return abs(error.value) + _expanded(error)


def _verdict(errors: Sequence[Error], mpe: float) -> Verdict:
    if all(_upper_end(error) <= mpe for error in errors):
        return "conformity"
    proven = any(_lower_end(error) > mpe for error in errors)
    return "non-conformity" if proven else "neither"


def _worst(
    figures: Iterable[CharacteristicValue],
) -> tuple[Verdict | None, tuple[CharacteristicValue, ...]]:
    """The worst verdict of those with an MPE, and its characteristics; without value it is
    neither.
    """
    by_verdict: dict[Verdict, list[CharacteristicValue]] = {}
    for figure in figures:
        if not math.isnan(figure.mpe):
            by_verdict.setdefault(figure.verdict or "neither", []).append(figure)
    for verdict in WORST_FIRST:
        if verdict in by_verdict:
            return verdict, tuple(by_verdict[verdict])
    return None, ()


@dataclass(frozen=True)
class AcceptanceResult(Shown):
    """The result of an acceptance test.

    Attributes:
        path: file of probed points.
        figures: test values, grouped by set of coordinates.
        notes: assumptions.
        stated: different entries in columns of the whole test, such as ``temperature_c``.
        measuring_range: of the arm [m], or None.
        longest: length of each test that :func:`accept` compared with 66 % of the range [m].
        data: content of the file.
    """

    path: str
    figures: tuple[CharacteristicValue, ...]
    notes: tuple[Note, ...] = field(default=())
    stated: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    measuring_range: float | None = None
    longest: Mapping[str, float] = field(default_factory=dict)
    data: bytes = b""

    @property
    def failed(self) -> tuple[CharacteristicValue, ...]:
        """Characteristics with the verdict ``non-conformity``."""
        return tuple(figure for figure in self.figures if figure.verdict == "non-conformity")

    @property
    def verdict(self) -> Verdict | None:
        """Worst verdict of all coordinates; None without MPE."""
        return _worst(self.figures)[0]

    @property
    def overall(self) -> dict[str, tuple[Verdict | None, tuple[CharacteristicValue, ...]]]:
        """For each set of coordinates, the worst verdict and its characteristics.

        Characteristics with an MPE count; without any the verdict is None. One without test value
        is ``neither`` (inconclusive).
        """
        sources = dict.fromkeys(figure.source for figure in self.figures)
        return {
            source: _worst(figure for figure in self.figures if figure.source == source)
            for source in sources
        }

    def __str__(self) -> str:
        texts = {}
        for source, (verdict, decisive) in self.overall.items():
            limits = [figure.mpe for figure in self.figures if figure.source == source]
            stated = sum(not math.isnan(mpe) for mpe in limits)
            names = [
                figure.definition.name + (" without a value" if figure.verdict is None else "")
                for figure in decisive
            ]
            texts[source] = (
                f"{shown_verdict(verdict)}, decided by {', '.join(names)}. An MPE exists for "
                f"{stated} of {len(limits)} characteristics"
                if names
                else "not determined; state an MPE"
            )
        if len(texts) > 1:
            return "; ".join(f"{source}: {text}" for source, text in texts.items())
        return f"The verdict is {''.join(texts.values())}"

    def to_frame(self) -> pd.DataFrame:
        """Return a table of characteristics, lengths in mm; NaN if missing."""
        return pd.DataFrame([figure.row() for figure in self.figures])

    def summary(self) -> dict[str, Any]:
        """Return the JSON content of schema ``aacmm-pin/acceptance/1``."""
        overall = []
        for source, (verdict, decisive) in self.overall.items():
            names = [figure.definition.name for figure in decisive]
            overall.append({"coordinates": source, "verdict": verdict, "decided_by": names})
        return {
            "schema": ACCEPTANCE_SCHEMA,
            "source": self.path,
            "coverage_factor": GUARD_BAND_FACTOR,
            "overall": overall,
            "figures": [figure.to_dict() for figure in self.figures],
            "measuring_range_mm": self.measuring_range and self.measuring_range / MM,
            "longest_length_mm": {test: size / MM for test, size in self.longest.items()},
            **notes_in_json(self.notes),
        }


def accept(
    path: str | Path,
    arms: Mapping[str, GivenModel] | None = None,
    *,
    mpe: Mapping[str, float] | None = None,
    standard: str | None = None,
    measuring_range: float | None = None,
) -> AcceptanceResult:
    """Determine characteristics of ISO 10360-12:2016 and ASME B89.4.22-2004 from probed points, and
    compare them with limits.

    Definitions follow public descriptions; nobody compared them with the standards.

    Args:
        path: CSV file of probed points (acceptance columns of the documentation), with coordinates
            of the probe centre.
        arms: for coordinates from readings, by their names in the result.
        mpe: maximum permissible errors by characteristic [m].
        standard: ``iso10360-12`` or ``asme-b89.4.22``: the result has all its characteristics
            alone, even without probed points.
        measuring_range: diameter of the working volume [m]. E_Uni and E_Bi then have a value only
            if the longest length is at least 66 % of it.

    Raises:
        MeasurementFileError: it cannot be used.
        UnknownNameError: unknown characteristic or standard.
        AacmmError: an MPE or range is not positive, an arm does not fit the file, or all lengths
            have another unit.
    """
    limits = dict(mpe or {})
    names = [definition.name for definition in DEFINITIONS]
    for name, limit in limits.items():
        if name not in names:
            raise UnknownNameError("characteristic", name, names)
        MPE.check(limit, f"MPE of {name}")
    if measuring_range is not None and not (math.isfinite(measuring_range) and measuring_range > 0):
        raise AacmmError(f"measuring_range is {measuring_range} m; expected more than 0 m")
    models = {name: ErrorModel.of(arm) for name, arm in (arms or {}).items()}
    wanted = definitions(standard)
    data = measurement_file(str(path))
    points = read_file(str(path), data, models)
    first_source, first_points = next(iter(points.sets.items()))
    try:
        check_unit(first_points)
    except AacmmError as error:
        raise AacmmError(f"{path}: {first_source}: {error}") from None
    figures: list[CharacteristicValue] = []
    names_by_error: dict[Note, list[str]] = {}
    for source, of_source in points.sets.items():
        for definition in wanted:
            of_test = of_source[of_source["test"] == definition.test]
            has_points = bool(of_test[definition.column].any())
            if standard is None and definition.name not in limits and not has_points:
                continue
            try:
                evaluated = definition.evaluate(of_test)
                if definition.test in IN_RANGE and measuring_range is not None:
                    evaluated = _in_range(evaluated, of_test["length"].max(), measuring_range)
            except AacmmError as error:
                is_length = definition.counted == "length"
                had = of_test.groupby([*LENGTH_KEY]).ngroups if is_length else len(of_test)
                evaluated = Evaluated(had, why_incomplete="see the notes")
                note = Note("figure_without_value", {"error": str(error)}).with_place(source)
                names_by_error.setdefault(note, []).append(definition.name)
            limit = limits.get(definition.name, math.nan)
            figures.append(CharacteristicValue(source, definition, evaluated, limit))
    notes = [*points.notes]
    notes += [note.with_place(first_source) for note in doubts(first_points, measuring_range)]
    notes += [note.with_place(", ".join(names)) for note, names in names_by_error.items()]
    if left_out := [name for name in limits if name not in {d.name for d in wanted}]:
        notes.append(Note("mpe_of_other_standard", {"figures": left_out, "standard": standard}))
    notes += _notes(figures, measuring_range)
    longest: dict[Any, float] = {}
    if measuring_range is not None:
        in_range = first_points[first_points["test"].isin(IN_RANGE)]
        longest = in_range.groupby("test", sort=False)["length"].max().to_dict()
    return AcceptanceResult(
        str(path), tuple(figures), tuple(notes), points.stated, measuring_range, longest, data
    )


def _in_range(evaluated: Evaluated, longest: float, measuring_range: float) -> Evaluated:
    if evaluated.missing:
        return evaluated
    if longest > measuring_range:
        raise AacmmError(
            f"the longest length is {plain_mm(longest)} mm; expected at most "
            f"{plain_mm(measuring_range)} mm, the measuring range"
        )
    least = LONGEST_PART * measuring_range
    if longest >= least:
        return evaluated
    why = f"the longest length is {plain_mm(longest)} mm; expected {plain_mm(least)} mm or more"
    return Evaluated(evaluated.had, why_incomplete=why)


def _notes(
    figures: Sequence[CharacteristicValue], measuring_range: float | None
) -> tuple[Note, ...]:
    with_verdict = [figure for figure in figures if figure.verdict is not None]
    names_by_code: dict[str, dict[str, None]] = {
        code: {} for code in ("guard_band_zero", "no_guard_band", "some_guard_bands_zero")
    }
    large: dict[str, float] = {}
    for figure in with_verdict:
        name = figure.definition.name
        if figure.mpe > max(FAR_BELOW * abs(figure.evaluated.largest.value), MM):
            large[name] = figure.mpe
        if figure.stated == len(figure.evaluated.errors):
            continue
        code = "no_guard_band" if name.startswith(UNCALIBRATED) else "guard_band_zero"
        names_by_code["some_guard_bands_zero" if figure.stated else code][name] = None
    notes = [Note(code, {"figures": [*names]}) for code, names in names_by_code.items() if names]
    for name, mpe in large.items():
        notes.append(Note("mpe_large", {"figure": name, "mpe": mpe, "times": FAR_BELOW}))
    for figure in with_verdict:
        if figure.decided_by is not None:
            data = {
                "figure": figure.definition.name,
                "source": figure.source,
                "error": abs(figure.decided_by.value),
                "expanded": _expanded(figure.decided_by),
                "where": figure.decided_by.place,
            }
            notes.append(Note("other_error_decides", data))
    if measuring_range is None and any(f.definition.test in IN_RANGE for f in figures):
        notes.append(Note("measuring_range_unknown"))
    return tuple(notes)
