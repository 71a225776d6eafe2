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
        widths: prior standard deviations τ of the parameters of a cause, in units of the typical
            magnitude; all are equally probable.
        amplitudes: RMS of the background divided by the RMS of the noise; all values are equally
            probable.
        library: prior probability that an error comes from a cause of the library.
        noise_misstated: prior probability that the stated noise is wrong.
        scale_dof: degrees of freedom of the inverse gamma prior of the variance if the stated noise
            is wrong.
        readings: increase of the log likelihood from which on the readings of a joint have a
            scatter of their own. Blind files with a branch or an error of a gear: 35 to 62; with
            smooth structure or none: 0 to 0.1.
        as_stated: a scatter that is larger than the stated noise by at most this factor counts as
            the stated noise.
        rescaled: a scatter is stable if it changes by less than this factor from round to round.
        reach: a set is not expanded if its log posterior is below the largest by more than this. A
            sampler over sets found no better set in 5 real and 17 of 18 blind files, and
            probabilities of causes within 0.013.
        negligible_set: a set has no weight if its log posterior is below the largest by more than
            this. In files without hidden causes, sets between `reach` and this value had a weight
            of 0.04.
        expanded: a set is not expanded if its probability is below this part of the largest. For
            720 records of a Fanuc, whose posterior is flat, the leading cause had a probability of
            0.85 at 0.01, 0.79 at 0.004, 0.78 at 0.002, and 0.79 by a sampler over sets.
        close: the posterior of a set is approximate if its log posterior is below the largest by
            more than about this.
        expansions: largest number of expanded sets in each half of the exploration.
        expansions_of_part: the same if a part of the records is held out.
        holds: members of a set are exchanged for one or two other candidates if the weight of the
            set is larger than this. The exchange precedes the expansion of weaker sets: it found a
            set better by 4.3 in a real file.
        instead: number of candidates that replace a member while another candidate is added,
            besides those that the member contains.
        imitated: a member is exchanged for two candidates if one of them explains at least this
            part of what the member explains, in log posterior.
        leading: number of leading candidates from which the second half of the exploration starts.
        agreement: largest difference of a probability between the halves of the exploration at
            which they agree.
        named: probability from which on a cause is named and is in the extended arm.
        settled: probability from which on a cause counts as certain.
        worth_listing: smallest probability of an alias or a set that is listed.
        same: canonical correlation from which on an alias is listed, whatever its probability.
        unlike: causes with a smaller canonical correlation are no aliases, whatever their
            probability.
        shows: noncentrality at which a cause is found in more than half of all files.
        shown: records that would show more than this part of all causes show most causes.
        rival: probability from which on a set without a doubtful cause cannot be excluded.
        large: the readings of a joint scatter more than stated if they displace tips by more than
            this part of the noise.
        negligible: a background that is smaller than this part of the noise counts as none. In 11
            of 12 blind files with a complete library it was smaller.
        left: structure that depends on a covariate is reported if its p-value is below this, even
            if its probability is small.
        left_alone: the same if no cause is named.
        much_more: residuals that are larger than the stated noise by this factor, beyond chance,
            are not explained.
        plain_encoder: noise of a reading that is assumed if none is stated [rad].
        too_good: p-value below which the residuals are far smaller than the stated noise.
        least_gain: a gain on held-out records that is not larger than this counts as no gain, and
            is shown as 0 %.
        fewest_groups: with fewer groups, no group can be called different from the others.
        fewest_records: a group needs more records than this, because its own shift would explain
            fewer records.
        odd: p-value (family-wise) below which a group of records disagrees with the others.
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
