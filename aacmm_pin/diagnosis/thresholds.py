"""Every threshold of the diagnosis, and the measurement behind it where there is one.

A new threshold is a field of :class:`Thresholds` with its default and its line under
``Attributes``. That line states what the number decides, and the measurement that it comes from: of
which files, how many, with which result. The documentation lists all lines.

How many functions a covariate has, and how many draws a chance is from, stand where these are made.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """The prior, how far sets are explored, and what the verdicts ask.

    Where no measurement is stated, other values were not tried.

    Attributes:
        widths: prior standard deviations τ of a cause's parameters, in units of the typical
            magnitude, each as probable.
        amplitudes: root mean square of the background over that of the noise, each as probable.
        library: prior probability, if anything is there, that it is a cause of the library.
        noise_misstated: prior probability that a stated noise is not the noise.
        scale_dof: degrees of freedom of the inverse gamma prior of the variance in that case.
        readings: log likelihood by which readings that scatter more than stated have to be likelier
            than tips that do. Blind files with a branch or a gear's error: 35 to 62; with smooth
            structure or none: 0 to 0.1.
        as_stated: a scatter beside all that was found is the stated noise if it is not larger by
            this.
        rescaled: a scatter that changes by less than this factor from round to round is found.
        reach: sets whose log posterior is lower than the largest by more are not expanded. A
            sampler over sets found no better one in 5 real and 17 of 18 blind files, and inclusion
            probabilities within 0.013.
        negligible_set: sets whose log posterior is lower by more have no weight. In files with
            nothing hidden, those between both had 0.04.
        expanded: of sets that are less probable than this part of the most probable, no additions
            are ranked. Of 720 records of a Fanuc, whose posterior is flat, the leading cause had
            0.85 at 0.01, 0.79 at 0.004, 0.78 at 0.002, and 0.79 by a sampler over sets.
        close: of sets whose log posterior is about lower by more, it is not worked out exactly.
        expansions: sets of which all additions are ranked, at most, from each half of the starts.
        expansions_of_part: the same where a part of the records is left out.
        holds: sets with a larger weight have their members exchanged, for one other and for two.
            Exchanged before weaker sets are expanded: a set better by 4.3 was found in a real file.
        instead: candidates in the place of a member beside which another is tried, besides those
            that it contains.
        imitated: one of two that imitate a member explains at least this part of what the member
            does, in log posterior.
        leading: leading causes of which each is a start.
        agreement: difference of an inclusion probability between the two halves of the starts up to
            which they agree.
        named: inclusion probability from which on a cause is in the extended arm and in sentences.
        settled: inclusion probability from which on a cause is named without doubt.
        worth_listing: aliases and sets that are less probable are not listed.
        same: canonical correlation from which on an alias is listed whatever its probability.
        unlike: causes with a smaller one are no aliases, whatever their probability.
        shows: noncentrality at which a cause is found more often than not among all others.
        shown: records that would show more than this part of all causes would show most of them.
        rival: probability from which on a set without a doubtful cause cannot be excluded.
        large: readings of a joint that move tips by this part of the noise scatter more than
            stated.
        negligible: a background that is smaller than this part of the noise is none. In 12 blind
            files with a complete library it was smaller, but in one.
        left: structure over some covariate with less chance than this is left, even if its
            probability is small …
        left_alone: … and with less than this where nothing was named.
        much_more: residuals larger by this than the stated noise, beyond chance, are not explained.
        plain_encoder: noise of a reading that a plain encoder has where none is stated [rad].
        too_good: residuals that are smaller than the stated noise allows by this chance are far
            smaller.
        least_gain: a gain on held-out records that is not larger is shown as 0 %, and is none.
        fewest_groups: of fewer groups nobody can say which one is the odd one out, nor how much
            they differ.
        fewest_records: a group has more records, or its own shift explains them whatever they are.
        odd: a group whose records agree with the others with less chance than this, family-wise, is
            odd.
    """

    widths: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 10.0)
    amplitudes: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0, 3.0)
    library: float = 0.9
    noise_misstated: float = 0.05
    scale_dof: float = 2.0
    readings: float = 10.0
    as_stated: float = 1.03
    rescaled: float = 1.1
    reach: float = 7.0
    negligible_set: float = 12.0
    expanded: float = 0.004
    close: float = 3.0
    expansions: int = 120
    expansions_of_part: int = 4
    holds: float = 0.1
    instead: int = 3
    imitated: float = 0.2
    leading: int = 3
    agreement: float = 0.02
    named: float = 0.5
    settled: float = 0.95
    worth_listing: float = 1e-3
    same: float = 0.95
    unlike: float = 0.3
    shows: float = 15.0
    shown: float = 0.5
    rival: float = 0.05
    large: float = 0.5
    negligible: float = 0.1
    left: float = 1e-3
    left_alone: float = 1e-6
    much_more: float = 1.15
    plain_encoder: float = 3e-5
    too_good: float = 1e-6
    least_gain: float = 0.005
    fewest_groups: int = 3
    fewest_records: int = 3
    odd: float = 1e-4


THRESHOLDS = Thresholds()
