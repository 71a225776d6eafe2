"""What a diagnosis may conclude from its findings, and from what its records would have shown."""

from __future__ import annotations

from collections.abc import Sequence

from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis.result import MORE, SETTLED, Doubt, Finding, Verdict

RIVAL = 0.05
"""A look-alike at least this probable cannot be excluded."""
SHOWN = 0.5
"""Records that would show more than this part of all causes of usual size would show most of them."""


def doubts_of(
    findings: Sequence[Finding],
    left: bool,
    p_more: float,
    visible: tuple[int, int],
    otherwise: Sequence[str] = (),
    no_better: bool = False,
    contradicted: Sequence[str] = (),
) -> tuple[Doubt, ...]:
    """What speaks against a diagnosis of which all searches ended and no structure stands out.

    Args:
        findings: what was named.
        left: structure over some covariate is left beyond chance, though nothing is sure about it.
        p_more: probability that a cause acts that was not named.
        visible: how many causes of usual size these records would have shown, and of how many.
        otherwise: what would be found if excluded records counted, or was and is not told.
        no_better: causes were added with which held-out records are not predicted better.
        contradicted: stated places that the records contradict.
    """
    found: dict[Doubt, bool] = {
        "contradicted references": bool(contradicted),
        "few causes shown": not findings and visible[0] <= SHOWN * visible[1],
        "cause not named": not findings and bool(otherwise),
        "below zero": any(finding.below_zero for finding in findings),
        "cause not borne out": not all(finding.borne_out for finding in findings),
        "no better": no_better,
        "structure left": left,
        "more causes": p_more >= MORE,
    }
    return tuple(doubt for doubt, there in found.items() if there)


def verdict_of(findings: Sequence[Finding], structure: bool, doubts: Sequence[Doubt], fits: Sequence[Fit]) -> Verdict:
    """The verdict.

    Args:
        findings: what was named.
        structure: something is left that no cause explains.
        doubts: see :func:`doubts_of`.
        fits: the searches on which all that rests, that of the extended arm last.

    Returns:
        ``unexplained``: structure is left. ``inconclusive``: a search did not converge, or the noise cannot be told; so many
        records were excluded that they are no gross errors; or a doubt stands. ``ambiguous``: a name has a look-alike that
        these records cannot exclude. ``explained``, ``no-discrepancy``: else.
    """
    if not all(fit.solution.converged and fit.tells_noise for fit in fits):
        return "inconclusive"
    if structure:
        return "unexplained"
    if fits[-1].thinned or "below zero" in doubts:
        return "inconclusive"
    doubtful = [finding for finding in findings if finding.probability < SETTLED]
    if doubtful:
        rivals = all(any(alias.probability >= RIVAL for alias in finding.aliases) for finding in doubtful)
        return "ambiguous" if rivals else "inconclusive"
    if doubts:
        return "inconclusive"
    return "explained" if findings else "no-discrepancy"
