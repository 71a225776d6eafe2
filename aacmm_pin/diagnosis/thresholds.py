"""Every threshold of the diagnosis, and the measurement behind it if there is one.

A new threshold is a field of :class:`Thresholds` with its default and its line under
``Attributes``: what the number decides, and of which files, how many, with which result it comes.
The documentation lists all lines.

How many functions a covariate has is stated where these are made.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """The prior, how far the search goes, and what the verdicts ask.

    Without a stated measurement, other values were not tried.

    Attributes:
        widths: prior standard deviations τ of the parameters of a cause, in units of the typical
            magnitude; all equally probable.
        amplitudes: RMS of the background divided by that of the noise; all equally probable.
        library: prior probability that an error comes from a cause of the library. All of eleven
            real files that were kept aside had structure which the library lacks, beside causes.
        noise_misstated: prior probability that the stated noise is wrong.
        scale_dof: degrees of freedom of the inverse gamma prior of the variance if the stated noise
            is wrong.
        readings: smallest increase of the log likelihood at which the readings of a joint get a
            scatter of their own. It was 35 to 62 in blind files with a branch or an error of a
            gear, and 0 to 0.1 in files with smooth structure or none.
        as_stated: largest ratio of the scatter to the stated noise at which it counts as the stated
            noise.
        rescaled: largest factor by which a stable scatter changes from round to round.
        reach: the search does not visit a set whose log posterior is below the largest by more than
            this. A sampler over sets found no better set in 5 real and 17 of 18 blind files, and
            the same probabilities of causes within 0.013.
        negligible_set: a set has no weight if its log posterior is below the largest by more than
            this. In files without hidden causes, sets between `reach` and this value had a weight
            of 0.04.
        expanded: the search does not expand a set if its probability, divided by the largest, is
            below this. For 720 records of a Fanuc robot the leading cause had a probability of 0.85
            with the value 0.01, and 0.79 with 0.004; a sampler over sets gave 0.79.
        close: the posterior of a set is approximate if its log posterior is below the largest by
            more than about this.
        expansions: largest number of expanded sets in each search.
        expansions_of_part: the same if a part of the records is held out.
        holds: the search exchanges members of a set for one or two other candidates if the weight
            of the set is at least this. In a real file, the exchange found a log posterior that was
            larger by 4.3.
        instead: number of candidates that replace a member of a set while the search adds another.
        imitated: the search exchanges a member of a set for two candidates if one of them reaches
            more than this part of the log posterior that the member adds.
        imitates: smallest canonical correlation of two members of a set at which the search changes
            both together.
        agreement: largest difference of a probability at which two searches agree.
        named: smallest probability at which `diagnose` names a cause and adds it to the extended
            arm.
        settled: smallest probability at which a cause counts as certain.
        worth_listing: smallest probability at which `diagnose` lists an alias or a set.
        same: smallest canonical correlation at which `diagnose` lists an alias of any probability.
        unlike: two causes with a smaller canonical correlation are no aliases.
        shows: noncentrality at which `diagnose` finds a cause in more than half of all files.
        shown: records show most causes if they would show more than this part of all.
        rival: smallest probability at which a set without a doubtful cause remains possible.
        large: the readings of a joint scatter more than stated if that displaces tips by more than
            this part of the noise.
        left: `diagnose` reports structure that depends on a covariate if its p-value is below this,
            even if its probability is small.
        left_alone: value of `left` if `diagnose` names no cause.
        much_more: largest ratio of the residuals to the stated noise at which the noise explains
            them, apart from chance.
        plain_encoder: noise of a reading that `diagnose` assumes if you state no noise [rad].
        too_good: p-value below which the residuals are far smaller than the stated noise.
        least_gain: a gain on held-out records up to this counts as none; outputs state 0 %.
        fewest_groups: smallest number of groups of records at which one can disagree with the
            others.
        fewest_records: a group needs more records than this: its mean error would explain fewer.
        most_records: of a longer file, `diagnose` uses so many records, evenly spread. Of 100 000
            records of a robot with several waves on every joint, it then named the same seven
            causes, with an RMS residual of 63.8 µm beside a noise of 63.9 µm.
        odd: p-value (family-wise) below which a group of records disagrees with the others.
    """

    widths: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 10.0)
    amplitudes: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0, 3.0)
    library: float = 0.5
    noise_misstated: float = 0.05
    scale_dof: float = 2.0
    readings: float = 10.0
    as_stated: float = 1.03
    rescaled: float = 1.1
    reach: float = 7.0
    negligible_set: float = 12.0
    expanded: float = 0.01
    close: float = 1.5
    expansions: int = 120
    expansions_of_part: int = 2
    holds: float = 0.1
    instead: int = 3
    imitated: float = 0.2
    imitates: float = 0.9
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
    left: float = 1e-3
    left_alone: float = 1e-6
    much_more: float = 1.15
    plain_encoder: float = 3e-5
    too_good: float = 1e-6
    least_gain: float = 0.005
    fewest_groups: int = 3
    fewest_records: int = 3
    most_records: int = 8000
    odd: float = 1e-4


THRESHOLDS = Thresholds()
