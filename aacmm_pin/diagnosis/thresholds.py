"""Every number of the diagnosis that somebody chose, and what it was chosen by."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Prior:
    """What is assumed before anything was seen.

    Attributes:
        widths: standard deviations τ of a cause's parameters, in units of the typical magnitude.
        amplitudes: root mean square of the background over that of the noise.
        library: probability, if anything is there, that it is a cause of the library.
        noise_misstated: probability that a stated noise is not the noise.
        scale_dof: degrees of freedom of the inverse gamma prior of the variance in that case.
    """

    widths: tuple[float, ...] = (0.2, 0.5, 1.0, 2.0, 10.0)
    amplitudes: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0, 3.0)
    library: float = 0.9
    noise_misstated: float = 0.05
    scale_dof: float = 2.0


PRIOR = Prior()


@dataclass(frozen=True)
class Exploration:
    """How far the sets of causes are explored.

    Attributes:
        reach: sets whose log posterior is lower than the largest by more are not looked at.
        beside: additions to a set that are looked at, at most.
        expansions: sets of which all additions are ranked, at most, from one half of the starts.
        holds: sets with a larger weight have their members exchanged, alone and for two others.
        instead: candidates in the place of a member beside which another is tried, besides those that the member contains.
        leading: leading causes of which each is a start.
        agreement: total variation between the two halves of the starts up to which they agree.
    """

    reach: float = 7.0
    beside: int = 8
    expansions: int = 60
    holds: float = 0.1
    instead: int = 3
    leading: int = 4
    agreement: float = 0.02


EXPLORATION = Exploration()
