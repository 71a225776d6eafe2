"""What is wrong with a table, row by row, gathered so that one message states the first of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Index, Mask
from aacmm_pin.errors import MeasurementFileError

MOST_PROBLEMS = 10
"""Problems that a message states one by one."""
MOST_ROWS_LISTED = 6
"""Rows, or sequences of rows, that a message lists."""
LONGEST_NAME = 100
"""Characters of a column's name, or of a cell, that a message has."""


def rows_in_words(rows: Sequence[int] | Index) -> str:
    """Rows of a file in ascending order, those that follow one another by the first and the last:
    ``row 7``, ``rows 3, 5 to 9, 12, …``.
    """
    numbers = np.unique(rows)
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    runs = [_run(*run) for run in np.split(numbers, breaks)]
    word = "row" if len(numbers) == 1 else "rows"
    more = ", …" if len(runs) > MOST_ROWS_LISTED else ""
    return f"{word} {', '.join(runs[:MOST_ROWS_LISTED])}{more}"


def _run(first: int, *others: int) -> str:
    """Rows that follow one another: ``3``, ``3, 4``, ``3 to 9``."""
    if len(others) > 1:
        return f"{first} to {others[-1]}"
    return ", ".join(map(str, (first, *others)))


@dataclass
class Problems:
    """What is wrong with a table from ``source``; ``lines`` (n,) are the numbers of its rows."""

    source: str
    lines: Index
    found: list[tuple[int | None, str, str]] = field(default_factory=list)

    def add(self, column: str, message: str) -> None:
        """A problem of a whole column, or of the whole table where ``column`` is ""."""
        self.found.append((None, shortened(column), message))

    def at(self, bad: Mask, column: str, message: str, *values: NDArray[Any]) -> None:
        """A problem of the rows ``bad`` (n,): ``message`` with ``values`` (n,) of the first.

        The message lists which others share it.
        """
        where = np.flatnonzero(bad)
        if not where.size:
            return
        first = [v[where[0]] for v in values]
        text = message.format(*(shortened(v) if isinstance(v, str) else v for v in first))
        if where.size > 1:
            text += f" (also {rows_in_words(self.lines[where[1:]])})"
        self.found.append((int(self.lines[where[0]]), column, text))

    def of_other_values(
        self,
        column: str,
        values: NDArray[Any],
        stated: Mask,
        by: pd.Series,
        of: str,
    ) -> Index:
        """The first row of each row's group ``by`` that states a value (n,); -1 where none does.

        Rows that state another value are a problem: expected is one for one ``of``.
        """
        rows = pd.Series(np.arange(len(values))).where(stated)
        first = rows.groupby(by).transform("first").fillna(-1).to_numpy(dtype=np.intp)
        message = f"{{}}, but row {{}} states {{}}; expected one value for one {of}"
        other = stated & (values != values[first])
        self.at(other, column, message, values, self.lines[first], values[first])
        return first

    def stop(self) -> None:
        """Raise MeasurementFileError with the first problems, one a line, if there are any."""
        if not self.found:
            return
        row, column, message = self.found[0]
        for problem in self.found[1:MOST_PROBLEMS]:
            message += f"\n{MeasurementFileError(self.source, *problem)}"
        if len(self.found) > MOST_PROBLEMS:
            message += f"\n{self.source}: {len(self.found) - MOST_PROBLEMS} more problems"
        raise MeasurementFileError(self.source, row, column, message)


def shortened(name: str) -> str:
    """A name or a cell as messages have it: of a very long one the two ends."""
    half = LONGEST_NAME // 2
    return name if len(name) <= LONGEST_NAME else f"{name[:half]}…{name[-half:]}"
