"""Results of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note, Shown, notes_in_json, report
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.effects import Effect, ErrorModel
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.measurement_conditions import set_up_in_words
from aacmm_pin.planning.separability import Power

PLAN_SCHEMA = "aacmm-pin/plan/1"
DECIDED = 0.95
"""Probability of the right decision at which causes are distinguished."""


@dataclass(frozen=True, eq=False)
class Tried(Shown):
    """A set-up that was considered.

    Attributes:
        words: changes to make.
        power: with a plan in it; with its whole pool if nothing distinguishes the causes.
        why_not: why no posture distinguishes them, or "".
    """

    words: str
    power: Power
    why_not: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanOfRecords(Shown):
    """What all plans have; see :class:`MeasurementPlan`."""

    model: ErrorModel
    records: pd.DataFrame
    expected: Array
    measurements: Measurements
    existing: int
    seed: int | None = None
    notes: tuple[Note, ...] = ()

    def csv(self) -> str:
        """Return the text of the measurement file."""
        return csv_text(self.records)

    def summary_of_records(self) -> dict[str, Any]:
        """The entries of every plan in JSON."""
        return {
            "arm": self.model.arm.name,
            "records": len(self.records),
            "existing": self.existing,
            "expected_mm": np.round(self.expected / MM, 3).tolist(),
            "seed": self.seed,
            **notes_in_json(self.notes),
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasurementPlan(PlanOfRecords):
    """A plan to distinguish causes, with the probability of success.

    Attributes:
        model: the arm during the measurements; if ``changes_arm``, another than before.
        split: the two causes; without a request the most difficult pair.
        records: the measurement file to complete: angles, conditions, empty references.
        expected: approximate tips in the frame of the references ``(n, 3)`` [m].
        set_up: its changes, in words; () if none.
        changes_arm: requires another arm file; existing records then do not count.
        before: power of existing records, or None.
        after: with the planned records.
        tried: considered set-ups, by effort.
        existing: number of existing records that count.
        notes: assumptions, and causes not distinguished.
        measurements: the planned records.
        pairs: all pairs with their T, most difficult first; None for a requested split.
        enough: approximate number of similar records that would suffice, if the plan does not; None
            if several times as many do not.
        seed: of the random generator, or None.
    """

    split: tuple[Effect, Effect]
    set_up: tuple[str, ...]
    changes_arm: bool
    before: Power | None
    after: Power
    tried: tuple[Tried, ...]
    pairs: pd.DataFrame | None = None
    enough: int | None = None

    @property
    def asked(self) -> bool:
        """True for a requested split."""
        return self.pairs is None

    @property
    def decided(self) -> bool:
        """True if the plan distinguishes the two causes."""
        return self.after.probability >= DECIDED and not self.after.inseparable

    @property
    def needed(self) -> bool:
        """True if the existing records do not distinguish them."""
        if self.before is None or self.before.inseparable:
            return True
        return self.before.probability < DECIDED

    @property
    def setup(self) -> str:
        """Changes of the set-up as text."""
        return set_up_in_words(self.set_up)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save the measurement file (CSV) to complete.

        Raises:
            OutputError: see :func:`aacmm_pin._support.output_files.whole_file`.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(self.csv(), encoding="utf-8", newline="")

    def summary(self) -> dict[str, Any]:
        """Return the JSON content of schema ``aacmm-pin/plan/1``."""
        pairs: dict[str, Any] | None = None
        if self.pairs is not None:
            distinguished = self.pairs["told"]
            pairs = {
                "count": len(distinguished),
                "told": int(distinguished.sum()),
                "untold": self.pairs[~distinguished].to_dict("records"),
            }
        return {
            "schema": PLAN_SCHEMA,
            "split": [effect.key for effect in self.split],
            "asked": self.asked,
            "set_up": list(self.set_up),
            "changes_arm": self.changes_arm,
            "power": {
                "before": None if self.before is None else _power(self.before),
                "after": _power(self.after),
                "decided": self.decided,
                "enough": self.enough,
            },
            "tried": [
                {"set_up": tried.words, "inseparable": bool(tried.why_not), "why": tried.why_not}
                | _power(tried.power)
                for tried in self.tried
            ],
            "pairs": pairs,
            **self.summary_of_records(),
        }

    def __str__(self) -> str:
        return str(report().plan_page.plan_line(self))


def _power(power: Power) -> dict[str, Any]:
    return {
        "T": [float(power.separation.distances[pair]) for pair in ((0, 1), (1, 0))],
        "alone": power.separation.alone.tolist(),
        "probability": power.probability,
    }
