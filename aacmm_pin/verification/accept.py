"""An arm against its specification: every figure that a file of touches has something for, and a verdict on each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.verification.figures import ASME, DEFINITIONS, ISO, Definition, Evaluated
from aacmm_pin.verification.touches import read_touches

ACCEPTANCE_SCHEMA = "aacmm-pin/acceptance/1"
COVERAGE = 2.0
"""Coverage factor of the guard band: U = 2 u, about 95 %."""
LONGEST_PART = 2 / 3
"""The longest of five lengths is at least this part of the measuring range (ISO 10360-12)."""
STANDARDS = {"iso10360-12": ISO, "asme-b89.4.22": ASME}
"""What ``standard`` can be, and whose figures are then evaluated."""

SINGULAR = {"touches": "touch", "lengths": "length"}

Verdict = Literal["conformity", "non-conformity", "neither"]


@dataclass(frozen=True)
class AcceptanceFigure:
    """One figure of one set of coordinates.

    Attributes:
        source: whose coordinates: those of the file, or of the arm of this name from its indications.
        definition: what the figure is.
        evaluated: its value and standard uncertainty [m], and what is missing.
        mpe: maximum permissible error [m]; nan where none is given.
    """

    source: str
    definition: Definition
    evaluated: Evaluated
    mpe: float = math.nan

    @property
    def verdict(self) -> Verdict | None:
        """By ISO 14253-1 with the guard band U = 2u; None without a value or an MPE. A u not stated is zero."""
        size, guard = abs(self.evaluated.value), COVERAGE * np.nan_to_num(self.evaluated.u)
        if math.isnan(size) or math.isnan(self.mpe):
            return None
        if size + guard <= self.mpe:
            return "conformity"
        return "non-conformity" if size - guard > self.mpe else "neither"

    @property
    def missing(self) -> str:
        """What is missing, in words; "" where nothing is."""
        few, counted = self.evaluated.missing, self.definition.counted
        return f"{few} {counted if few > 1 else SINGULAR[counted]}" if few else self.evaluated.why_incomplete


@dataclass(frozen=True)
class AcceptanceResult(Shown):
    """What :func:`accept` found.

    Attributes:
        path: the file of touches.
        figures: one after the other; of several sets of coordinates those of one set stand together.
        notes: what was assumed.
    """

    path: str
    figures: tuple[AcceptanceFigure, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def failed(self) -> tuple[AcceptanceFigure, ...]:
        """The figures that do not conform."""
        return tuple(figure for figure in self.figures if figure.verdict == "non-conformity")

    def __str__(self) -> str:
        counts = pd.Series([figure.verdict or "without verdict" for figure in self.figures]).value_counts()
        return ", ".join(f"{count} {verdict}" for verdict, count in counts.items())

    def to_frame(self) -> pd.DataFrame:
        """One row a figure, lengths in mm; NaN where there is no number."""
        rows = [
            {
                "coordinates": f.source,
                "figure": f.definition.name,
                "standard": f.definition.standard,
                "clause": f.definition.clause,
                "definition": f.definition.text,
                "value_mm": f.evaluated.value / MM,
                "U_mm": COVERAGE * f.evaluated.u / MM,
                "mpe_mm": f.mpe / MM,
                "verdict": f.verdict,
                "had": f.evaluated.had,
                "counted": f.definition.counted,
                "missing": f.missing,
            }
            for f in self.figures
        ]
        return pd.DataFrame(rows)

    def summary(self) -> dict[str, Any]:
        """Schema ``aacmm-pin/acceptance/1``."""
        table = self.to_frame().astype(object)
        figures = table.where(table.notna(), None).to_dict("records")
        return {
            "schema": ACCEPTANCE_SCHEMA,
            "source": self.path,
            "coverage_factor": COVERAGE,
            "figures": [{str(k): v for k, v in row.items()} for row in figures],
            "notes": [*self.notes],
        }


def accept(
    path: str | Path,
    arms: Mapping[str, Arm | ErrorModel] | None = None,
    *,
    mpe: Mapping[str, float] | None = None,
    standard: str | None = None,
    measuring_range: float | None = None,
) -> AcceptanceResult:
    """The figures of ISO 10360-12 and ASME B89.4.22 from a file of touches, and whether each is within its limit.

    Args:
        path: CSV of touches, see the file formats in the documentation; coordinates are of the probe's centre.
        arms: arms that make coordinates of the file's indications, by what the result calls each.
        mpe: maximum permissible errors by the name of the figure [m].
        standard: ``iso10360-12`` or ``asme-b89.4.22``: its figures alone.
        measuring_range: of the arm, the diameter of its working volume [m]; with it E_Uni and E_Bi are
            given only where the longest length is at least two thirds of it.

    Raises:
        MeasurementFileError: the file cannot be used.
        UnknownNameError: a figure or a standard that is not known.
        AacmmError: an MPE or the range is no positive number, touches determine no sphere, arms do not fit the file.
    """
    limits = _limits(mpe or {})
    if standard is not None and standard not in STANDARDS:
        raise UnknownNameError("standard", standard, [*STANDARDS])
    if measuring_range is not None and not (math.isfinite(measuring_range) and measuring_range > 0):
        raise AacmmError(f"measuring range is {measuring_range}, expected a length above 0")
    models = {name: ErrorModel.of(arm) for name, arm in (arms or {}).items()}
    wanted = [d for d in DEFINITIONS if standard is None or d.standard == STANDARDS[standard]]
    sets, read_as = read_touches(str(path), models)
    figures = []
    for source, touches in sets.items():
        for definition in wanted:
            of_test = touches[touches["test"] == definition.test]
            if len(of_test) or definition.name in limits:
                try:
                    evaluated = _in_range(definition.evaluate(of_test), definition, of_test, measuring_range)
                except AacmmError as error:
                    raise AacmmError(f"{path}: {definition.name} by {source}: {error}") from None
                figures.append(AcceptanceFigure(source, definition, evaluated, limits.get(definition.name, math.nan)))
    return AcceptanceResult(str(path), tuple(figures), read_as + _notes(figures, measuring_range))


def _limits(mpe: Mapping[str, float]) -> dict[str, float]:
    known = [definition.name for definition in DEFINITIONS]
    for name, limit in mpe.items():
        if name not in known:
            raise UnknownNameError("figure", name, known)
        if not (math.isfinite(limit) and limit > 0):
            raise AacmmError(f"MPE of {name} is {limit}, expected a length above 0")
    return dict(mpe)


def _in_range(found: Evaluated, definition: Definition, touches: pd.DataFrame, measuring_range: float | None) -> Evaluated:
    """A length error without its value where the lengths are too short for the range."""
    longest = touches["length"].max()
    if definition.counted != "lengths" or definition.standard != ISO or measuring_range is None or found.missing:
        return found
    if longest >= LONGEST_PART * measuring_range:
        return found
    least = LONGEST_PART * measuring_range / MM
    return Evaluated(math.nan, math.nan, found.had, 0, f"longest length {longest / MM:g} mm, expected {least:g} mm or more")


def _notes(figures: Sequence[AcceptanceFigure], measuring_range: float | None) -> tuple[str, ...]:
    judged = [f for f in figures if f.verdict is not None]
    unstated = dict.fromkeys(f.definition.name for f in judged if math.isnan(f.evaluated.u))
    notes = []
    if unstated:
        notes.append(f"{', '.join(unstated)}: no uncertainty is stated, so the guard band of the verdict is zero")
    if measuring_range is None and any(f.definition.name in ("E_Uni", "E_Bi") for f in figures):
        notes.append("measuring range not given; whether the longest length is two thirds of it was not checked")
    return tuple(notes)
