"""Mistakes in a table, in one message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Index, Mask
from aacmm_pin.errors import MeasurementFileError

MOST_PROBLEMS = 10
MOST_ROWS_LISTED = 6
"""Rows, or runs of rows."""
MOST_NAMES = 8
LONGEST_NAME = 100
"""Characters of a name or cell in a message."""


def rows_in_words(rows: Sequence[int] | Index) -> str:
    """Ascending rows as text: ``row 7``, ``rows 3, 5 to 9, 12, …``."""
    numbers = np.unique(rows)
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    runs = [
        f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run))
        for run in np.split(numbers, breaks)
    ]
    word = "row" if len(numbers) == 1 else "rows"
    return f"{word} {first_few(runs, MOST_ROWS_LISTED)}"


@dataclass
class Problems:
    """Mistakes in the table ``source``, whose rows have the numbers ``lines`` (n,)."""

    source: str
    lines: Index
    listed: list[tuple[int | None, str, str]] = field(default_factory=list)
    """Row (None for the table), column and message."""

    def add(self, column: str, message: str) -> None:
        """Add a problem of a column; "" for the table."""
        self.listed.append((None, shortened(column), message))

    def at(self, bad: Mask, column: str, message: str, *values: NDArray[Any]) -> None:
        """Add a problem of rows ``bad`` (n,): ``message`` with ``values`` (n,) of the first."""
        rows = np.flatnonzero(bad)
        if not rows.size:
            return
        first_values = [v[rows[0]] for v in values]
        text = message.format(*(shortened(v) if isinstance(v, str) else v for v in first_values))
        if rows.size > 1:
            text += f" (also {rows_in_words(self.lines[rows[1:]])})"
        self.listed.append((int(self.lines[rows[0]]), column, text))

    def of_other_values(
        self,
        column: str,
        values: NDArray[Any],
        stated: Mask,
        groups: pd.Series,
        owner: str,
    ) -> Index:
        """Add a problem of rows that state another value than their group, one ``owner``.

        Returns:
            For each row, the first of its group that states a value (n,), or -1.
        """
        stating_rows = pd.Series(np.arange(len(values))).where(stated)
        first = stating_rows.groupby(groups).transform("first").fillna(-1).to_numpy(dtype=np.intp)
        message = f"{{}}, but row {{}} states {{}}; expected one value for one {owner}"
        differs = stated & (values != values[first])
        self.at(differs, column, message, values, self.lines[first], values[first])
        return first

    def stop(self) -> None:
        """Raise MeasurementFileError with the first problems, if any."""
        if not self.listed:
            return
        row, column, message = self.listed[0]
        for problem in self.listed[1:MOST_PROBLEMS]:
            message += f"\n{MeasurementFileError(self.source, *problem)}"
        if len(self.listed) > MOST_PROBLEMS:
            message += f"\n{self.source}: {len(self.listed) - MOST_PROBLEMS} more problems"
        raise MeasurementFileError(self.source, row, column, message)


def first_few(items: Iterable[object], most: int = MOST_NAMES) -> str:
    """As text: ``a, b, …``."""
    texts = [*map(str, items)]
    return ", ".join(texts[:most]) + (", …" if len(texts) > most else "")


def shortened(name: str) -> str:
    """For messages; of a very long name or cell the two ends."""
    half = LONGEST_NAME // 2
    return name if len(name) <= LONGEST_NAME else f"{name[:half]}…{name[-half:]}"
