"""What the shell says of a diagnosis."""

from __future__ import annotations

import pandas as pd

from aacmm_pin.cli.common import say
from aacmm_pin.cli.tables import show
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.report.diagnosis_findings import (
    group_in_words,
    line_to_remember,
    probability,
    unexplained_in_words,
    verdict_in_words,
)
from aacmm_pin.report.diagnosis_tables import OFF_FORMATS, RANKING_FORMATS, curves_in_words, most_off, ranking

SHORT = {"at the tip [µm]": "tip [µm]", "probability": "prob.", "retained": "left"}
"""Heads that leave room for the values at 80 columns."""
FORMATS = {SHORT[name]: form for name, form in RANKING_FORMATS.items()}
WORST = 3
"""So many groups of records that are off most are told."""
LEAST_SHOWN = 1e-3
"""Look-alikes less probable than this are in the page and the JSON only."""


def say_diagnosis(result: Diagnosis) -> None:
    """All that a reader of the page has at its head, in the order of its sections."""
    say(f"{result.verdict}. {verdict_in_words(result)}")
    say(line_to_remember(result))
    labels = [finding.label for finding in result.findings]
    causes = ranking(result).assign(cause=labels) if labels else pd.DataFrame()
    show(causes.rename(columns=SHORT), FORMATS, "causes found; left: the part of the effect that recalibration leaves:")
    for line in curves_in_words(result):
        say(line)
    show(_look_alikes(result), {"r": ".2f"}, "or, with the probability of the other cause in its place:")
    _say_unexplained(result)
    show(result.excluded, {"residual_mm": ".3f"}, f"excluded records ({len(result.excluded)}):")
    head = "where the simulation is off most, beside what its own stated uncertainties predict there:"
    show(most_off(result, WORST), OFF_FORMATS, head)
    say(f"next: {result.next_measurements}")


def _look_alikes(result: Diagnosis) -> pd.DataFrame:
    """Look-alikes with their labels, as commands take them."""
    return pd.DataFrame(
        [
            {"cause": f.label, "looks like": a.label, "r": a.correlation, "probability": probability(a.probability)}
            for f in result.findings
            for a in f.aliases
            if a.probability > LEAST_SHOWN
        ]
    )


def _say_unexplained(result: Diagnosis) -> None:
    open_ = result.unexplained
    if open_.shapes or open_.groups:
        say(unexplained_in_words(result))
    for name, acts_on in open_.acts_on.items():
        say(f"  over {name}: {acts_on}")
    for group in open_.groups:
        say(f"  {group_in_words(group)}")
