"""What keeps a verdict from being ``explained`` or ``no-discrepancy``, in words.

A new rule of :mod:`aacmm_pin.diagnosis.verdict` has one function here, and its entry in
:data:`WORDS_OF_DOUBTS`. The function takes the diagnosis, whose ``extended`` is the last of the
fits that the rule saw. The first line of its docstring stands in the documentation of the JSON.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from aacmm_pin._support.units import count
from aacmm_pin.diagnosis import THRESHOLDS, Diagnosis, Unexplained
from aacmm_pin.effects import listed, name_in_words, probability, several_in_words
from aacmm_pin.report.numbers import p_equals

WITH_STRUCTURE = ("unexplained", "partly-explained")
"""Verdicts with structure that no cause explains."""


def doubts_in_words(result: Diagnosis) -> list[str]:
    """What stands against the verdict, without what the verdict itself states of the causes.

    Raises:
        KeyError: a doubt has no sentence.
    """
    each = [WORDS_OF_DOUBTS[doubt](result) for doubt in result.doubts]
    return [words for words in each if words]


def _contradicted_references(result: Diagnosis) -> str:
    """The stated coordinates of a seat, or a stated length, contradict the records."""
    return "; ".join(map(str, result.contradicted))


def _residuals_too_small(_: Diagnosis) -> str:
    """The residuals are far smaller than the stated noise, so that noise can hide every cause."""
    return (
        "the residuals are far smaller than the stated noise, and noise of this size hides causes"
    )


def _few_causes_shown(result: Diagnosis) -> str:
    """`diagnose` found no cause, and the records would show at most half of all causes."""
    seen, of = result.visible
    return f"these records would show only {seen} of {count(of, 'cause')} of typical magnitude"


def _cause_not_named(result: Diagnosis) -> str:
    """`diagnose` would find a cause only with the excluded records."""
    causes, records = result.otherwise, int(result.extended.excluded.sum())
    excluded = count(records, "excluded record")
    found = labels_in_words(result, causes)
    return f"with the {excluded}, diagnose would find {found}"


def _below_zero(result: Diagnosis) -> str:
    """The estimate of a cause is negative by more than U, which is physically impossible."""
    causes = several_in_words(result.below_zero, result.model.arm)
    return f"the estimate of {causes} is negative, which is physically impossible"


def _not_borne_out(result: Diagnosis) -> str:
    """Held-out records do not confirm a cause."""
    if "no better" in result.doubts:
        return ""
    unconfirmed = [finding.effect for finding in result.findings if not finding.borne_out]
    return f"held-out records do not confirm {several_in_words(unconfirmed, result.model.arm)}"


def _no_better(result: Diagnosis) -> str:
    """The extended arm does not predict held-out records better than the recalibrated arm."""
    return ""


def _structure_left(result: Diagnosis) -> str:
    """The residuals have significant structure (`unexplained.p_value` is below the threshold)."""
    if result.verdict in WITH_STRUCTURE or "more causes" in result.doubts:
        return ""
    return f"the residuals have significant structure ({beside_threshold(result.unexplained)})"


def _more_causes(result: Diagnosis) -> str:
    """A cause that `diagnose` cannot identify acts with a probability of at least 0.95."""
    if result.verdict == "ambiguous" and not result.findings:
        return ""  # the sets that may act are in the sentence
    chance = f"probability {probability(result.more)}, threshold {THRESHOLDS.settled:g}"
    return f"diagnose cannot identify a further cause that acts ({chance})"


def _starts_disagree(result: Diagnosis) -> str:
    """Two searches over the sets of causes found different sets (`agreement`)."""
    return "two searches over the sets of causes found different sets"


WORDS_OF_DOUBTS: Mapping[str, Callable[[Diagnosis], str]] = {
    "contradicted references": _contradicted_references,
    "residuals too small": _residuals_too_small,
    "few causes shown": _few_causes_shown,
    "cause not named": _cause_not_named,
    "below zero": _below_zero,
    "cause not borne out": _not_borne_out,
    "no better": _no_better,
    "structure left": _structure_left,
    "more causes": _more_causes,
    "starts disagree": _starts_disagree,
}
"""The sentence of each doubt, by its name; empty if the verdict, or another doubt, states it."""


def beside_threshold(left: Unexplained) -> str:
    """The p-value of what is left, and its threshold: ``p = 0.02, threshold 0.001``."""
    return f"{p_equals(left.p_value)}, threshold {left.threshold:g}"


def labels_in_words(result: Diagnosis, labels: Sequence[str]) -> str:
    """Causes and covariates that labels of the result name, in a row."""
    return listed([_label_in_words(result, label) for label in labels])


def _label_in_words(result: Diagnosis, label: str) -> str:
    cause = result.cause(label)
    if cause is None:
        return f"dependence on {label}"
    return name_in_words(cause, result.model.arm)
