"""Test values of acceptance checks over time, and control limits.

An individuals chart (Shewhart; ISO 7870-2:2013): mean of earlier values ± 2.66 mean moving ranges.
Values that did not conform, or were outside their own limits, do not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.output_files import OutputFiles
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM, count
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import is_workbook, measurement_file, read_table
from aacmm_pin.verification.acceptance import WORST_FIRST, AcceptanceResult
from aacmm_pin.verification.characteristics import DEFINITIONS

HISTORY_COLUMNS = (
    "time",
    "instrument",
    "arm",
    "figure",
    "value_mm",
    "U_mm",
    "mpe_mm",
    "verdict",
    "version",
)
LEAST_CHECKS = 8
"""Earlier checks for limits: the value of an unchanged arm is then outside in 3.1 % of checks, with
20 in 1.9 % (200 000 series each).
"""
PER_MOVING_RANGE = 2.66
"""Three standard deviations in mean moving ranges, 3 / 1.128."""
HALF = {"SinglePoint.Sigma": "SPAT.2s"}
"""Half of another, without a chart beside it."""
VALUE_TOLERANCE = 1e-9
"""Of equal values [mm]."""


@dataclass(frozen=True, eq=False)
class ControlChart:
    """Test values of one characteristic by one arm.

    Attributes:
        arm: ``source`` in :class:`CharacteristicValue`.
        figure: name of the characteristic.
        times: of the checks (n,), ascending.
        values: magnitudes (n,) [m]; signs of largest errors vary.
        mpe: of the latest check [m], or nan.
        failed: nonconforming (n,).
    """

    arm: str
    figure: str
    times: tuple[datetime, ...]
    values: Array
    mpe: float
    failed: Mask

    @cached_property
    def counted(self) -> Mask:
        """Earlier values (n - 1,) that conform, within their own limits."""
        counted = np.zeros(len(self.values) - 1, dtype=bool)
        for k, value in enumerate(self.values[:-1]):
            counted[k] = not self.failed[k] and not _outside(
                value, _limits(self.values[:k][counted[:k]])
            )
        return counted

    @property
    def usual(self) -> Array:
        """Those values [m]."""
        return self.values[:-1][self.counted]

    @property
    def centre(self) -> float:
        """Their mean [m], or nan."""
        if not len(self.usual):
            return math.nan
        return float(self.usual.mean())

    @property
    def limits(self) -> tuple[float, float]:
        """Control limits [m]; nan with fewer than :data:`LEAST_CHECKS` of them, or below zero."""
        return _limits(self.usual)

    @property
    def left_range(self) -> bool:
        """Whether the latest value is outside."""
        return _outside(self.values[-1], self.limits)

    def to_dict(self) -> dict[str, Any]:
        """For JSON, lengths in mm, None for nan."""
        lower, upper = self.limits
        summary = {
            "coordinates": self.arm,
            "figure": self.figure,
            "checks_before": len(self.values) - 1,
            "checks_counted": int(self.counted.sum()),
            "centre_mm": self.centre / MM,
            "lower_mm": lower / MM,
            "upper_mm": upper / MM,
            "left_usual_range": self.left_range if np.isfinite(upper) else None,
        }
        return dict(plain(summary))


def _limits(values: Array) -> tuple[float, float]:
    if len(values) < LEAST_CHECKS:
        return math.nan, math.nan
    centre = float(values.mean())
    away = PER_MOVING_RANGE * float(np.abs(np.diff(values)).mean())
    return centre - away if away < centre else math.nan, centre + away


def _outside(value: float, limits: tuple[float, float]) -> bool:
    lower, upper = limits
    return bool(value < lower or value > upper)


@dataclass(frozen=True, eq=False)
class History(Shown):
    """Checks of arms.

    Attributes:
        checks: table as in the file, a row for each characteristic and check; ``time`` in UTC.
        time: of the latest check, or None.
        instrument: its arm.
        appended: False if this check was there before.
        from_file: a file was read, and may be replaced.
    """

    checks: pd.DataFrame = field(
        default_factory=lambda: pd.DataFrame(columns=list(HISTORY_COLUMNS))
    )
    time: datetime | None = None
    instrument: str = ""
    appended: bool = False
    from_file: bool = False

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """The history in a file; empty without file.

        Raises:
            MeasurementFileError: the file is damaged.
        """
        name = str(path)
        if not Path(path).exists():
            return cls()
        # The file is written again.
        if not Path(path).is_file() or is_workbook(measurement_file(name)):
            raise MeasurementFileError(
                name,
                None,
                "",
                "this is no regular file, or a workbook; expected the CSV file of a history",
            )
        content = measurement_file(name)
        for line, text in enumerate(content.splitlines(), start=1):
            if text.lstrip().startswith(b"#"):
                raise MeasurementFileError(
                    name,
                    line,
                    "",
                    "this line is a comment; expected no comments, because accept rewrites the "
                    "file; delete this line",
                )
        table, lines, *_ = read_table(name, content)
        problems = Problems(name, lines)
        if sorted(table.columns) != sorted(HISTORY_COLUMNS):
            problems.add(
                "",
                f"the columns are {', '.join(table.columns)}; expected "
                f"{', '.join(HISTORY_COLUMNS)}",
            )
            problems.stop()
        checks = table.loc[:, list(HISTORY_COLUMNS)]

        def refuse(bad: pd.Series, column: str, expected: str) -> None:
            cells = table[column].to_numpy()
            problems.at(bad.to_numpy(), column, f"{{!r}}{expected}", cells)

        times = pd.to_datetime(
            table["time"].str.strip(), format="ISO8601", utc=True, errors="coerce"
        )
        refuse(times.isna(), "time", "; expected a time such as 2026-01-31T09:30:00+00:00")
        checks["time"] = times
        for column in ("value_mm", "U_mm", "mpe_mm"):
            cells = table[column].str.strip()
            numbers = pd.to_numeric(cells, errors="coerce").astype(np.float64)
            may_be_empty = column != "value_mm"
            readable = numbers.abs().lt(np.inf) | (may_be_empty & (cells == ""))
            refuse(~readable, column, "; expected a number")
            checks[column] = numbers
        verdicts: list[str] = ["", *WORST_FIRST]
        for column, known in (("figure", [d.name for d in DEFINITIONS]), ("verdict", verdicts)):
            names = ", ".join(filter(None, sorted(known)))
            refuse(~table[column].isin(known), column, f"; expected one of {names}")
        twice = checks.duplicated(["time", "instrument", "arm", "figure"]).to_numpy()
        problems.at(
            twice,
            "figure",
            "{!r} occurs twice in this check; expected each characteristic once",
            table["figure"].to_numpy(),
        )
        problems.stop()
        return cls(checks, from_file=True)

    def with_check(self, result: AcceptanceResult, time: datetime, instrument: str = "") -> History:
        """Add the values of ``result``, unless a check has the same.

        Args:
            result: of :func:`accept`.
            time: UTC if it has no zone.
            instrument: name or serial number; case does not matter.

        Raises:
            AacmmError: other values of this arm at this time.
        """
        if not instrument.isprintable():
            raise AacmmError(f"instrument is {instrument!r}; expected one line of text")
        time = _utc(time)
        instrument = next(iter(self._of(instrument)["instrument"]), instrument.strip())
        table = result.to_frame().rename(columns={"coordinates": "arm"}).dropna(subset="value_mm")
        table = table.assign(time=time, instrument=instrument, version=version("aacmm_pin"))
        table["verdict"] = table["verdict"].astype(object).where(table["verdict"].notna(), "")
        table = table.loc[:, list(HISTORY_COLUMNS)]
        for then, check in self._of(instrument).groupby("time"):
            both = check.reset_index().merge(table, on=["arm", "figure"])
            same = len(both) > 0 and bool(
                ((both["value_mm_x"] - both["value_mm_y"]).abs() <= VALUE_TOLERANCE).all()
            )
            if same and len(both) == len(table):
                judged = both[(both["verdict_y"] != "") & (both["verdict_x"] == "")]
                checks = self.checks.copy()
                for name in ("U_mm", "mpe_mm", "verdict"):  # a check without a verdict may get one
                    checks.loc[judged["index"], name] = judged[f"{name}_y"].to_numpy()
                earlier, appended = check["time"].iloc[0], len(judged) > 0
                return replace(
                    self, checks=checks, time=earlier, instrument=instrument, appended=appended
                )
            if then == time and same:  # with characteristics that it did not have
                old = pd.MultiIndex.from_frame(both[["arm", "figure"]])
                table = table[~pd.MultiIndex.from_frame(table[["arm", "figure"]]).isin(old)]
            elif then == time and len(both):
                raise AacmmError(
                    f"the history has a check of {instrument or 'this arm'} at {time.isoformat()} "
                    "with other values; state another --time or --instrument"
                )
        checks = table if self.checks.empty else pd.concat([self.checks, table], ignore_index=True)
        return replace(
            self, checks=checks, time=time, instrument=instrument, appended=len(table) > 0
        )

    def _of(self, instrument: str) -> pd.DataFrame:
        names = self.checks["instrument"].astype(str).str.strip().str.casefold()
        return self.checks[names == instrument.strip().casefold()]

    def charts(self) -> tuple[ControlChart, ...]:
        """Of each characteristic of the latest check, but for :data:`HALF` beside its double."""
        if self.time is None:
            return ()
        checks = self._of(self.instrument)
        check: list[Any] = [*checks[checks["time"] == self.time].itertuples()]
        there = {(latest.arm, latest.figure) for latest in check}
        earlier = checks[checks["time"] <= self.time].sort_values("time")
        charts = []
        for latest in check:
            if (latest.arm, HALF.get(latest.figure)) in there:
                continue
            alike = earlier[(earlier["arm"] == latest.arm) & (earlier["figure"] == latest.figure)]
            values = np.abs(alike["value_mm"].to_numpy(dtype=np.float64)) * MM
            failed = (alike["verdict"] == "non-conformity").to_numpy()
            times = tuple(alike["time"])
            mpe = latest.mpe_mm * MM
            charts.append(ControlChart(latest.arm, latest.figure, times, values, mpe, failed))
        return tuple(charts)

    def __str__(self) -> str:
        left = [f"{chart.figure} by {chart.arm}" for chart in self.charts() if chart.left_range]
        checks = self.checks[["time", "instrument"]].drop_duplicates()
        text = count(len(checks), "check")
        return text + (f"; outside the control limits: {', '.join(left)}" if left else "")

    def summary(self) -> list[dict[str, Any]]:
        """The charts for JSON."""
        return [chart.to_dict() for chart in self.charts()]

    def write(self, files: OutputFiles, path: str | Path) -> None:
        """Write with other files, in place of the file that was read."""
        table = self.checks.assign(time=[time.isoformat() for time in self.checks["time"]])
        target = files.file(path, update=self.from_file)
        target.write_text(csv_text(table), encoding="utf-8", newline="")

    def save(self, path: str | Path) -> None:
        """Write; only a history that was read replaces a file.

        Raises:
            OutputError: it cannot be written.
        """
        with OutputFiles() as files:
            self.write(files, path)

    def plot(self, ax: Any = None) -> Any:
        """Draw the control charts."""
        return report().plots.plot_history(self, ax)


def in_utc(text: str) -> datetime:
    """A time in ISO 8601; UTC if it states no zone.

    Raises:
        ValueError: no such time.
    """
    time = datetime.fromisoformat(text)
    try:
        return _utc(time)
    except OverflowError as error:  # of the first or the last day of the calendar
        raise ValueError(str(error)) from None


def _utc(time: datetime) -> datetime:
    if time.tzinfo is None:
        return time.replace(tzinfo=UTC)
    return time.astimezone(UTC)
