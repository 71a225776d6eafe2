"""A calibration as it is told at the shell."""

from __future__ import annotations

import sys

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration_findings import (
    causes_in_words,
    decimals,
    fit_in_words,
    frame_in_words,
    readable_parameters,
    verdict,
)
from aacmm_pin.cli.common import note, say

WIDTH = 118
"""Columns of a table that goes to a file."""
MOST_EXCLUDED = 10
"""Excluded records that are told one by one; the residuals' file has all."""


def say_calibration(result: Calibration) -> None:
    """The verdict, what was excluded, what is not told, and the parameters; what was assumed goes to stderr."""
    for line in result.notes:
        note(f"note: {line}")
    say(verdict(result))
    say(fit_in_words(result))
    if frame := frame_in_words(result):
        say(frame)
    for line in causes_in_words(result):
        say(line)
    _say_excluded(result)
    if result.undetermined:
        say("These data do not tell, and leave as it was:")
        for line in result.undetermined:
            say(f"  {line}")
    _say_parameters(result)


def _say_excluded(result: Calibration) -> None:
    excluded = result.excluded
    if not len(excluded):
        return
    say(f"{len(excluded)} records excluded, {excluded['reason'].iloc[0]}:")
    for row in excluded.head(MOST_EXCLUDED).to_dict("records"):
        where = f" ({row['seat']})" if row.get("seat") else ""
        say(f"  row {row['row']}{where}: {row['residual_mm']:.3f} mm off")
    if len(excluded) > MOST_EXCLUDED:
        say(f"  … and {len(excluded) - MOST_EXCLUDED} more")


def _say_parameters(result: Calibration) -> None:
    if not result.fit.problem.parameters:
        say("No parameter was estimated: the arm states all of them to be exact; --no-prior estimates them all the same.")
        return
    table = Table(
        Column("parameter", no_wrap=True),
        Column("value", justify="right", no_wrap=True),
        *(Column(head, justify="right", no_wrap=True) for head in ("change", "u", "U (k = 2)")),
        Column("in", no_wrap=True),
        Column("known", no_wrap=True),
        box=SIMPLE,
    )
    rows = readable_parameters(result)
    form = decimals(rows)
    for row in rows.to_dict("records"):
        numbers = [f"{row[name]:{form}}" for name in ("change", "u", "U")]
        numbers[0] = "* " * row["beyond"] + numbers[0]
        table.add_row(row["parameter"], row["value"], *numbers, row["in"], row["known"])
    Console(width=None if sys.stdout.isatty() else WIDTH).print(table)
    if rows["beyond"].any():
        say("* moved farther than its stated and its new uncertainty together allow")
