"""What a diagnosis may conclude from its findings, and from what its records would have shown."""

from __future__ import annotations

from collections.abc import Sequence

from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis.result import SETTLED, Finding, Verdict

RIVAL = 0.05
"""A look-alike at least this probable cannot be excluded."""
SHOWN = 0.5
"""Records that would show more than this part of all causes of usual size would show most of them."""
LEFT = 1e-3
"""Structure over some covariate with less chance than this, even if nothing is sure about it, makes a name doubtful …"""
LEFT_ALONE = 1e-6
"""… and with less than this, where nothing was named: without stated noise far records, which scatter more, look so."""
MORE = 0.95
"""Probability that a cause acts which was not named, from which on what was named is not all: as a name needs."""
# 400 blind files: above 0.8 were 4 of 99 without a name, which all hid something, and 1 of 144 explained, which did not.


def verdict_of(
    findings: Sequence[Finding],
    structure: bool,
    p_left: float,
    p_more: float,
    visible: tuple[int, int],
    fits: Sequence[Fit],
    otherwise: Sequence[str] = (),
    no_better: bool = False,
) -> Verdict:
    """The verdict.

    Args:
        findings: what was named.
        structure: something is left that no cause explains.
        p_left: chance of as much structure over any covariate as is left, where there is none.
        p_more: probability that a cause acts that was not named.
        visible: how many causes of usual size these records would have shown, and of how many.
        fits: the searches on which all that rests, that of the extended arm last.
        otherwise: what would be found if excluded records counted, or was and is not told.
        no_better: causes were added with which held-out records are not predicted better.

    Returns:
        ``unexplained``: structure is left. ``inconclusive``: a search did not converge, or the noise cannot be told; nothing
        was found, and these records would not have shown most causes, or excluded ones would show one; held-out groups do
        not bear a name, or all of them together, out; a value is below zero that nature has above it; so many records were
        excluded that they are no gross errors; or something may be left that nothing was found for.
        ``ambiguous``: a name has a look-alike that these records cannot exclude. ``explained``, ``no-discrepancy``: else.
    """
    if not all(fit.solution.converged and fit.tells_noise for fit in fits):
        return "inconclusive"
    if structure:
        return "unexplained"
    if fits[-1].thinned:
        return "inconclusive"
    if not findings:
        sound = visible[0] > SHOWN * visible[1] and p_left >= LEFT_ALONE and p_more < MORE and not otherwise
        return "no-discrepancy" if sound else "inconclusive"
    if any(finding.below_zero for finding in findings):
        return "inconclusive"
    doubtful = [finding for finding in findings if finding.probability < SETTLED]
    if doubtful:
        rivals = all(any(alias.probability >= RIVAL for alias in finding.aliases) for finding in doubtful)
        return "ambiguous" if rivals else "inconclusive"
    borne_out = not no_better and all(finding.borne_out for finding in findings)
    return "explained" if borne_out and p_left >= LEFT and p_more < MORE else "inconclusive"
