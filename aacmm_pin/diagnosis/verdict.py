"""What a diagnosis may conclude from its findings, and from what its records would have shown.

A new doubt is one entry of :data:`DOUBTS`, with its sentence in the report. Most rules need no new
attribute of :class:`Evidence`: its last fit has the records, residuals and exclusions.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Literal

from aacmm_pin._support.notes import Note
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis.result import Finding, too_good
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

Verdict = Literal[
    "explained",
    "partly-explained",
    "no-discrepancy",
    "ambiguous",
    "unexplained",
    "inconclusive",
]


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a verdict is read from.

    Attributes:
        findings: the causes of the median probability model.
        structure: the discrepancy is more probable than not.
        structure_left: structure over some covariate is left beyond chance, though none is more
            probable than not.
        more: probability that a cause acts that was not named.
        visible: how many causes of typical magnitude these records would have shown, and of how
            many.
        otherwise: what would be found if excluded records counted.
        no_better: causes were added with which held-out records are not predicted better.
        agree: the searches from the two starts found the same.
        fits: the searches on which all that rests, that of the extended arm last.
        named, nameless: mean square that the causes which act without doubt displace tips by, and
            that of what has no name [m²].
    """

    findings: tuple[Finding, ...]
    structure: bool
    structure_left: bool
    more: float
    visible: tuple[int, int]
    otherwise: tuple[str, ...]
    no_better: bool
    contradicted: tuple[Note, ...]
    agree: bool
    fits: tuple[Fit, ...]
    named: float = 0.0
    nameless: float = 0.0

    @property
    def settled(self) -> bool:
        """Whether each cause of the extended arm acts without doubt, and probably no other."""
        sure = all(finding.probability >= THRESHOLDS.settled for finding in self.findings)
        return sure and self.more < THRESHOLDS.named

    @property
    def mostly_named(self) -> bool:
        """Whether held-out records do not contradict the causes, and the certain ones displace tips
        by more than what has no name.
        """
        return not self.no_better and self.named > self.nameless


def _shows_few_causes(evidence: Evidence) -> bool:
    """Whether no cause acts, and the records would have shown few of those tried."""
    shown, tried = evidence.visible
    nothing_acts = not evidence.findings and evidence.more < THRESHOLDS.named
    return nothing_acts and shown <= THRESHOLDS.shown * tried


DOUBTS: Mapping[str, Callable[[Evidence], bool]] = {
    "contradicted references": lambda evidence: bool(evidence.contradicted),
    "residuals too small": lambda evidence: not evidence.findings and too_good(evidence.fits[-1]),
    "few causes shown": _shows_few_causes,
    "cause not named": lambda evidence: not evidence.findings and bool(evidence.otherwise),
    "below zero": lambda evidence: any(finding.below_zero for finding in evidence.findings),
    "cause not borne out": lambda evidence: (
        not all(finding.borne_out for finding in evidence.findings)
    ),
    "no better": lambda evidence: evidence.no_better,
    "structure left": lambda evidence: evidence.structure_left,
    "more causes": lambda evidence: evidence.more >= THRESHOLDS.settled,
    "starts disagree": lambda evidence: not evidence.agree,
}
"""Why a diagnosis, whose searches all ended without structure, is not ``explained`` or
``no-discrepancy``.
"""


def doubts_of(evidence: Evidence) -> tuple[str, ...]:
    """Names of the doubts that stand."""
    return tuple(name for name, stands in DOUBTS.items() if stands(evidence))


def verdict_of(evidence: Evidence, doubts: Collection[str]) -> Verdict:
    """The verdict.

    Returns:
        ``unexplained``: structure is left. ``partly-explained``: the same, but causes that are
        certain are larger. ``inconclusive``: a search did not converge, the noise cannot be told,
        so many records were excluded that they are no gross errors, or a doubt stands.
        ``ambiguous``: the mass is on several sets of causes. ``explained``, ``no-discrepancy``:
        else.
    """
    if not all(fit.converged and fit.determines_noise for fit in evidence.fits):
        return "inconclusive"
    if evidence.structure:
        doubtful = evidence.fits[-1].too_many_excluded or "below zero" in doubts
        return "partly-explained" if evidence.mostly_named and not doubtful else "unexplained"
    if evidence.fits[-1].too_many_excluded or "below zero" in doubts:
        return "inconclusive"
    if not evidence.settled:
        return "ambiguous"
    if doubts:
        return "inconclusive"
    return "explained" if evidence.findings else "no-discrepancy"
