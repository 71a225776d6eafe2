"""What a diagnosis may conclude from its findings, and from what its records would have shown.

A new doubt is one entry of :data:`DOUBTS`, with its sentence in the report.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Literal

from aacmm_pin.diagnosis.budget import BEYOND, SHARED, STRUCTURE
from aacmm_pin.diagnosis.result import Diagnosis, too_good
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import exceeds_noise

Verdict = Literal[
    "explained",
    "partly-explained",
    "no-discrepancy",
    "ambiguous",
    "unexplained",
    "inconclusive",
]


def _mostly_named(result: Diagnosis) -> bool:
    """Whether held-out records do not contradict the causes, and the certain ones displace tips by
    more than what has no name, noise beyond the stated included.
    """
    certain_labels = {
        f.label for f in result.findings if f.probability >= THRESHOLDS.settled and f.borne_out
    }
    nameless_parts = (STRUCTURE, SHARED, BEYOND)
    named = sum(part.mean_square for part in result.budget if certain_labels & {*part.causes})
    nameless = sum(part.mean_square for part in result.budget if part.part in nameless_parts)
    if result.extended.noise_is_stated:
        nameless += result.budget[-1].mean_square - result.noise**2
    return not result.no_better and named > max(nameless, 0.0)


def _shows_few_causes(result: Diagnosis) -> bool:
    """Whether no cause acts, and the records would have shown few of those tried."""
    shown, tried = result.visible
    nothing_acts = not result.findings and result.more < THRESHOLDS.named
    return nothing_acts and shown <= THRESHOLDS.shown * tried


DOUBTS: Mapping[str, Callable[[Diagnosis], bool]] = {
    "contradicted references": lambda result: bool(result.contradicted),
    "residuals too small": lambda result: not result.findings and too_good(result.extended),
    "few causes shown": _shows_few_causes,
    "cause not named": lambda result: not result.findings and bool(result.otherwise),
    "below zero": lambda result: bool(result.below_zero),
    "cause not borne out": lambda result: not all(finding.borne_out for finding in result.findings),
    "no better": lambda result: result.no_better,
    "structure left": lambda result: result.unexplained.left,
    "more causes": lambda result: result.more >= THRESHOLDS.settled,
    "starts disagree": lambda result: not result.choice.posterior.agree,
}
"""Why a diagnosis, whose searches all ended without structure, is not ``explained`` or
``no-discrepancy``.
"""


def judged(result: Diagnosis) -> Diagnosis:
    """The diagnosis with its doubts and its verdict."""
    doubts = tuple(name for name, stands in DOUBTS.items() if stands(result))
    return replace(result, doubts=doubts, verdict=verdict_of(result, doubts))


def verdict_of(result: Diagnosis, doubts: Collection[str]) -> Verdict:
    """The verdict.

    Returns:
        ``unexplained``: structure is left. ``partly-explained``: the same, but causes that are
        certain are larger. ``inconclusive``: a search did not converge, the noise cannot be told,
        so many records were excluded that they are no gross errors, or a doubt stands.
        ``ambiguous``: the mass is on several sets of causes. ``explained``, ``no-discrepancy``:
        else.
    """
    extended = result.extended
    if not (result.converged and result.recalibrated.determines_noise):
        return "inconclusive"
    if not extended.determines_noise:
        return "inconclusive"
    doubtful = extended.too_many_excluded or "below zero" in doubts
    if result.unexplained.structure or exceeds_noise(extended):
        return "partly-explained" if _mostly_named(result) and not doubtful else "unexplained"
    if doubtful:
        return "inconclusive"
    all_certain = all(finding.probability >= THRESHOLDS.settled for finding in result.findings)
    if not all_certain or result.more >= THRESHOLDS.named:
        return "ambiguous"
    if doubts:
        return "inconclusive"
    return "explained" if result.findings else "no-discrepancy"
