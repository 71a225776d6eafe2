"""Results of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.notes import Note, notes_in_json
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.effects import Effect, ErrorModel
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.measurement_conditions import set_up_in_words
from aacmm_pin.planning.separability import Power

PLAN_SCHEMA = "aacmm-pin/plan/1"
DECIDED = 0.95
"""Probability of the right decision at which causes count as distinguished."""


@dataclass(frozen=True, eq=False)
class Tried(Shown):
    """A set-up that was considered.

    Attributes:
        words: changes to make.
        power: with a plan in this set-up; with its whole pool if no records can distinguish the
            causes.
        why_not: why no posture distinguishes the causes; "" if some do.
    """

    words: str
    power: Power
    why_not: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanOfRecords(Shown):
    """What every plan of records has; see :class:`MeasurementPlan`."""

    model: ErrorModel
    records: pd.DataFrame
    expected: Array
    measurements: Measurements
    existing: int
    seed: int | None = None
    notes: tuple[Note, ...] = ()

    def csv(self) -> str:
        """Return the plan as the text of a measurement file."""
        return csv_text(self.records)

    def summary_of_records(self) -> dict[str, Any]:
        """The entries that the JSON file of every plan has."""
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
    """A plan of measurements that distinguish causes, with the probability of success.

    Attributes:
        model: the arm during the planned measurements; if ``changes_arm`` is True, another arm than
            before.
        split: the two causes to distinguish; without a request, the pair that is most difficult to
            distinguish.
        records: the plan as a measurement file for you to complete, with angles, conditions and
            empty references.
        expected: approximate positions of the tip in the frame of the references ``(n, 3)`` [m].
        set_up: changes of the set-up, in words; () if the set-up stays.
        changes_arm: True if the plan requires another arm file; existing records then do not count
            in the power.
        before: power of the existing records, or None.
        after: power of the existing and planned records.
        tried: the set-ups that the plan considered, in the order of effort.
        existing: number of existing records that count.
        notes: assumptions, and causes that the plan cannot distinguish.
        measurements: the planned records as measurements.
        pairs: all pairs of causes with their T, most difficult first, if no split was requested;
            otherwise None.
        enough: approximate number of similar records that would distinguish the causes, if the plan
            does not; None if even several times as many records do not suffice.
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
        """True if the caller requested the split."""
        return self.pairs is None

    @property
    def decided(self) -> bool:
        """True if the plan distinguishes the two causes."""
        return self.after.probability >= DECIDED and not self.after.same

    @property
    def needed(self) -> bool:
        """True if the existing records alone do not distinguish the causes."""
        if self.before is None or self.before.same:
            return True
        return self.before.probability < DECIDED

    @property
    def setup(self) -> str:
        """The changes of the set-up as text."""
        return set_up_in_words(self.set_up)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save the plan as a measurement file (CSV) with empty references for you to complete.

        Raises:
            OutputError: see :func:`aacmm_pin._support.output_files.whole_file`.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(self.csv(), encoding="utf-8", newline="")

    def summary(self) -> dict[str, Any]:
        """Return the content of the JSON file with the schema ``aacmm-pin/plan/1``."""
        pairs: dict[str, Any] | None = None
        if self.pairs is not None:
            told = self.pairs["told"]
            untold = self.pairs[~told].to_dict("records")
            pairs = {"count": len(told), "told": int(told.sum()), "untold": untold}
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
        "T": [power.one, power.other],
        "alone": list(power.alone),
        "probability": power.probability,
    }
