"""What a diagnosis may conclude from its findings, and from what its records would have shown."""

from __future__ import annotations

from collections.abc import Sequence

from aacmm_pin._support.notes import Note
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis.result import Doubt, Finding, Verdict
from aacmm_pin.diagnosis.thresholds import THRESHOLDS


def doubts_of(
    findings: Sequence[Finding],
    left: bool,
    p_more: float,
    visible: tuple[int, int],
    otherwise: Sequence[str] = (),
    no_better: bool = False,
    contradicted: Sequence[Note] = (),
    agree: bool = True,
) -> tuple[Doubt, ...]:
    """What speaks against a diagnosis of which all searches ended and no structure stands out.

    Args:
        findings: what was named.
        left: structure over some covariate is left beyond chance, though none is more probable than
            not.
        p_more: probability that a cause acts that was not named.
        visible: how many causes of typical magnitude these records would have shown, and of how
            many.
        otherwise: what would be found if excluded records counted.
        no_better: causes were added with which held-out records are not predicted better.
        contradicted: stated places that the records contradict.
        agree: the two halves of the starts found the same.
    """
    found: dict[Doubt, bool] = {
        "contradicted references": bool(contradicted),
        "few causes shown": not findings and visible[0] <= THRESHOLDS.shown * visible[1],
        "cause not named": not findings and bool(otherwise),
        "below zero": any(finding.below_zero for finding in findings),
        "cause not borne out": not all(finding.borne_out for finding in findings),
        "no better": no_better,
        "structure left": left,
        "more causes": p_more >= THRESHOLDS.settled,
        "starts disagree": not agree,
    }
    return tuple(doubt for doubt, there in found.items() if there)


def verdict_of(
    findings: Sequence[Finding],
    structure: bool,
    p_more: float,
    doubts: Sequence[Doubt],
    fits: Sequence[Fit],
) -> Verdict:
    """The verdict.

    Args:
        findings: the causes of the median probability model.
        structure: the discrepancy is more probable than not.
        p_more: probability that a cause acts that was not named.
        doubts: see :func:`doubts_of`.
        fits: the searches on which all that rests, that of the extended arm last.

    Returns:
        ``unexplained``: structure is left. ``inconclusive``: a search did not converge, or the
        noise cannot be told; so many records were excluded that they are no gross errors; or a
        doubt stands. ``ambiguous``: the mass is on several sets of causes. ``explained``,
        ``no-discrepancy``: else.
    """
    if not all(fit.converged and fit.tells_noise for fit in fits):
        return "inconclusive"
    if structure:
        return "unexplained"
    if fits[-1].too_many_excluded or "below zero" in doubts:
        return "inconclusive"
    if (
        any(finding.probability < THRESHOLDS.settled for finding in findings)
        or p_more >= THRESHOLDS.named
    ):
        return "ambiguous"
    if doubts:
        return "inconclusive"
    return "explained" if findings else "no-discrepancy"
