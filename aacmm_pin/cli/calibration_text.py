"""A calibration as it is told at the shell."""

from __future__ import annotations

from aacmm_pin.calibration import Calibration
from aacmm_pin.cli.common import note, say
from aacmm_pin.cli.tables import show
from aacmm_pin.report.calibration_findings import (
    causes_in_words,
    decimals,
    fit_in_words,
    frame_in_words,
    readable_parameters,
    sizes_table,
    verdict,
)

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
    show(sizes_table(result), dict.fromkeys(("before [mm]", "after [mm]"), ".4f"), "RMS distance of tip and target:")
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
    head = f"excluded records ({len(excluded)}), {excluded['reason'].iloc[0]}:"
    shown = excluded.head(MOST_EXCLUDED).drop(columns="reason").rename(columns={"residual_mm": "off by [mm]"})
    show(shown, {"off by [mm]": ".3f"}, head)
    if len(excluded) > MOST_EXCLUDED:
        say(f"  … and {len(excluded) - MOST_EXCLUDED} more")


def _say_parameters(result: Calibration) -> None:
    if not result.fit.problem.parameters:
        say("No parameter was estimated: the arm states all of them to be exact; --no-prior estimates them all the same.")
        return
    rows = readable_parameters(result)
    form = decimals(rows)
    shown = rows[["parameter", "value", "change", "u", "U", "in", "known"]].rename(columns={"U": "U (k = 2)"})
    shown["change"] = [f"{'* ' * b}{change:{form}}" for b, change in zip(rows["beyond"], rows["change"], strict=True)]
    show(shown, dict.fromkeys(("u", "U (k = 2)"), form), "parameters:")
    if rows["beyond"].any():
        say("* moved farther than its stated and its new uncertainty together allow")
