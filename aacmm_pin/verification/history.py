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

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.output_files import OutputFiles
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM, count
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import is_workbook, measurement_file, read_table
from aacmm_pin.verification.acceptance import AcceptanceResult

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
DOUBLE_OF = {"SinglePoint.Sigma": "SPAT.2s"}
"""Characteristics that are twice another: where both are tested, only the double has a chart."""
CHECK_KEY = ["time", "instrument", "arm", "figure"]
"""Columns of which each value of a check has its own."""
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
            usual = self.values[:k][counted[:k]]
            counted[k] = not self.failed[k] and not _outside(value, _limits(usual))
        return counted

    @property
    def usual(self) -> Array:
        """Values of the counted checks [m]."""
        return self.values[:-1][self.counted]

    @property
    def centre(self) -> float:
        """Mean of the usual values [m], or nan."""
        return float(self.usual.mean()) if len(self.usual) else math.nan

    @property
    def limits(self) -> tuple[float, float]:
        """Control limits [m]; nan with fewer than :data:`LEAST_CHECKS` of them, or below zero."""
        return _limits(self.usual)

    @property
    def is_outside(self) -> bool:
        """Whether the latest value is outside the control limits."""
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
            "left_usual_range": self.is_outside if np.isfinite(upper) else None,
        }
        return dict(plain(summary))


def _limits(values: Array) -> tuple[float, float]:
    if len(values) < LEAST_CHECKS:
        return math.nan, math.nan
    centre = float(values.mean())
    half_width = PER_MOVING_RANGE * float(np.abs(np.diff(values)).mean())
    return centre - half_width if half_width < centre else math.nan, centre + half_width


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
        content = measurement_file(name)
        if is_workbook(content) or b"\n#" in b"\n" + content:
            raise MeasurementFileError(
                name,
                None,
                "",
                "a workbook, or comments (#); expected a CSV file without comments, because accept "
                "rewrites the file",
            )
        table, lines, *_ = read_table(name, content)
        problems = Problems(name, lines)
        if sorted(table.columns) != sorted(HISTORY_COLUMNS):
            columns = ", ".join(table.columns)
            problems.add("", f"the columns are {columns}; expected {', '.join(HISTORY_COLUMNS)}")
            problems.stop()
        checks = table[list(HISTORY_COLUMNS)].apply(lambda cells: cells.str.strip())

        def refuse(bad: pd.Series, column: str, expected: str) -> None:
            problems.at(bad.to_numpy(), column, f"{{!r}}{expected}", table[column].to_numpy())

        times = pd.to_datetime(checks["time"], format="ISO8601", utc=True, errors="coerce")
        refuse(times.isna(), "time", "; expected a time such as 2026-01-31T09:30:00+00:00")
        for column in ("value_mm", "U_mm", "mpe_mm"):
            numbers = pd.to_numeric(checks[column], errors="coerce").astype(np.float64)
            may_be_empty = (checks[column] == "") & (column != "value_mm")
            refuse(~(np.isfinite(numbers) | may_be_empty), column, "; expected a number")
            checks[column] = numbers
        instruments = checks["instrument"]
        checks["instrument"] = instruments.groupby(instruments.str.casefold()).transform("first")
        checks["time"] = times
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
        names = {name.casefold(): name for name in self.checks["instrument"]}
        instrument = names.get(instrument.strip().casefold(), instrument.strip())
        table = result.to_frame().rename(columns={"coordinates": "arm"}).dropna(subset="value_mm")
        table["verdict"] = table["verdict"].astype(object).where(table["verdict"].notna(), "")
        earlier = self.checks
        for time_of_check, check in earlier[earlier["instrument"] == instrument].groupby("time"):
            in_both = check.reset_index().merge(table, on=["arm", "figure"], suffixes=("", "_now"))
            differences = in_both["value_mm"] - in_both["value_mm_now"]
            is_same = len(in_both) > 0 and bool((differences.abs() <= VALUE_TOLERANCE).all())
            if is_same and (time_of_check == time or len(in_both) == len(table)):
                time = check["time"].iloc[0]
                has_new_verdict = (in_both["verdict"] == "") & (in_both["verdict_now"] != "")
                earlier = earlier.drop(index=in_both["index"][has_new_verdict].tolist())
                break
            if time_of_check == time and len(in_both):
                raise AacmmError(
                    f"the history has a check of {instrument or 'this arm'} at {time.isoformat()} "
                    "with other values; state another --time or --instrument"
                )
        table = table.assign(time=time, instrument=instrument, version=version("aacmm_pin"))
        table = table[list(HISTORY_COLUMNS)]
        checks = table if earlier.empty else pd.concat([earlier, table], ignore_index=True)
        checks = checks.drop_duplicates(CHECK_KEY, ignore_index=True)
        appended = len(checks) > len(earlier)
        return replace(self, checks=checks, time=time, instrument=instrument, appended=appended)

    def charts(self) -> tuple[ControlChart, ...]:
        """Of each arm and characteristic of the latest check of this instrument, but for those in
        :data:`DOUBLE_OF` whose double was tested, too.
        """
        if self.time is None:
            return ()
        checks = self.checks[self.checks["instrument"] == self.instrument]
        until_latest = checks[checks["time"] <= self.time].sort_values("time")
        charts = {}
        for (arm, name), tests in until_latest.groupby(["arm", "figure"]):
            values = np.abs(tests["value_mm"].to_numpy(dtype=np.float64)) * MM
            failed = (tests["verdict"] == "non-conformity").to_numpy()
            mpe = tests["mpe_mm"].iloc[-1] * MM
            times = tuple(tests["time"])
            charts[arm, name] = ControlChart(str(arm), str(name), times, values, mpe, failed)
        latest = checks[checks["time"] == self.time]
        tested = [*zip(latest["arm"], latest["figure"], strict=True)]
        return tuple(
            charts[arm, name] for arm, name in tested if (arm, DOUBLE_OF.get(name)) not in tested
        )

    def __str__(self) -> str:
        outside = [f"{chart.figure} by {chart.arm}" for chart in self.charts() if chart.is_outside]
        checks = self.checks[["time", "instrument"]].drop_duplicates()
        text = count(len(checks), "check")
        return text + (f"; outside the control limits: {', '.join(outside)}" if outside else "")

    def summary(self) -> list[dict[str, Any]]:
        """The charts for JSON."""
        return [chart.to_dict() for chart in self.charts()]

    def write(self, files: OutputFiles, path: str | Path) -> None:
        """Write with other files, in place of the file that was read."""
        table = self.checks.assign(time=[time.isoformat() for time in self.checks["time"]])
        target = files.file(path, update=self.from_file)
        target.write_text(csv_text(table), encoding="utf-8", newline="")

    def plot(self, ax: Any = None) -> Any:
        """Draw the control charts."""
        return report().plots.plot_history(self, ax)


def in_utc(text: str) -> datetime:
    """A time in ISO 8601; UTC if it states no zone."""
    time = datetime.fromisoformat(text)
    try:
        return _utc(time)
    except OverflowError as error:  # of the first or the last day of the calendar
        raise ValueError(str(error)) from None


def _utc(time: datetime) -> datetime:
    if time.tzinfo is None:
        return time.replace(tzinfo=UTC)
    return time.astimezone(UTC)
