"""Cards of diagnoses: verdict, causes, look-alikes, what stays open, and what to measure next."""

from __future__ import annotations

import pandas as pd

from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import Diagnosis, Finding, OddGroup
from aacmm_pin.diagnosis.cross_validation import Gain, rms
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.unexplained import Unexplained
from aacmm_pin.report.cards.card import bullets, details, html_of, paragraph, table
from aacmm_pin.report.diagnosis_findings import (
    PARTS,
    group_in_words,
    in_words,
    label_in_words,
    labels_in_words,
    line_to_remember,
    p_in_words,
    parameters_in_words,
    probability,
    unexplained_in_words,
    verdict_in_words,
)
from aacmm_pin.report.diagnosis_tables import (
    OFF_FORMATS,
    RANKING_FORMATS,
    RMS_FORMATS,
    curves_in_words,
    look_alikes,
    most_off,
    ranking,
    rms_table,
)

WORST = 3
"""So many groups of records that are off most are shown."""
MOST = 12
"""So many excluded records are shown."""


@html_of.register
def _diagnosis(result: Diagnosis) -> str:
    open_, excluded = result.unexplained, result.excluded
    joints = [None if f.joint is None else str(f.joint) for f in result.findings]
    causes = ranking(result)
    if len(causes):
        causes.insert(1, "joint", joints)
    left = unexplained_in_words(result) if open_.shapes or open_.groups else ""
    same = [labels_in_words({label: label_in_words(label) for label in group}) for group in result.cannot_tell_apart]
    return (
        paragraph(verdict_in_words(result), f"{result.verdict.capitalize()}.")
        + paragraph(line_to_remember(result))
        + table(causes, RANKING_FORMATS, "Causes found:")
        + bullets(curves_in_words(result))
        + table(
            look_alikes(result), {"r": ".2f"}, "What looks like them, with the probability of the other cause in its place:"
        )
        + table(rms_table(result), RMS_FORMATS, "RMS distance of tip and target:")
        + paragraph(left)
        + bullets(f"over {name}: {way}" for name, way in open_.acts_on.items())
        + bullets(group_in_words(group) for group in open_.groups)
        + table(most_off(result, WORST), OFF_FORMATS, "Where the simulation is off most, beside what it predicts itself:")
        + paragraph(f"{int(result.extended.used.sum())} records used, {len(excluded)} excluded.")
        + table(excluded, {"residual_mm": ".3f"}, "", MOST)
        + (details(f"{len(same)} groups of causes that these records cannot tell apart", bullets(same)) if same else "")
        + paragraph(result.next_measurements, "Next:")
        + bullets(result.notes, "Notes:")
    )


@html_of.register
def _finding(finding: Finding) -> str:
    row = {
        "joint": None if finding.joint is None else str(finding.joint),
        "value ± U (k = 2)": parameters_in_words(finding),
        "probability": probability(finding.probability),
        "p": p_in_words(finding.p_value),
        "retained": finding.retained_fraction,
    }
    alike = pd.DataFrame([_alike(alias) for alias in finding.aliases])
    return (
        paragraph(in_words(finding.effect), "Found:")
        + table(pd.DataFrame([row]), RANKING_FORMATS)
        + table(alike, {"r": ".2f"}, "What looks like it:")
    )


@html_of.register
def _alias(alias: Alias) -> str:
    return table(pd.DataFrame([_alike(alias)]), {"r": ".2f"})


def _alike(alias: Alias) -> dict[str, object]:
    words, odds = label_in_words(alias.label), probability(alias.probability)
    return {"looks like": words, "r": alias.correlation, "probability": odds}


@html_of.register
def _gain(gain: Gain) -> str:
    low, high = gain.interval
    sizes = {"simulated": gain.simulation, "recalibrated": gain.recalibrated, "extended": gain.extended}
    shown = pd.DataFrame({f"{name} [mm]": [rms(distance) / MM] for name, distance in sizes.items()})
    words = f"{PARTS[gain.kind]}, left out in {gain.groups} parts: gain {gain.gain:z.2f} (95 %: {low:z.2f} to {high:z.2f})"
    return paragraph(words, "Held out:") + table(shown, RMS_FORMATS, "RMS distance of tip and target:")


@html_of.register
def _unexplained(left: Unexplained) -> str:
    p = f"p {p_in_words(left.p_value)}"
    if not left.depends_on:
        return paragraph(f"nothing depends on any column beyond chance ({p}).", "Unexplained:") + _odd(left.groups)
    worth = "" if left.gain is None else f"; a smooth correction takes {left.gain:.0%} off held-out records"
    words = f"the residuals depend on {', '.join(left.depends_on)} in a way that no cause has ({p}){worth}."
    return (
        paragraph(words, "Unexplained:")
        + bullets(f"over {name}: {way}" for name, way in left.acts_on.items())
        + _odd(left.groups)
    )


def _odd(groups: tuple[OddGroup, ...]) -> str:
    return bullets(group_in_words(group) for group in groups)


@html_of.register
def _group(group: OddGroup) -> str:
    return paragraph(group_in_words(group))
