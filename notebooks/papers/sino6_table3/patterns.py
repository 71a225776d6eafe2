"""How much a cause spreads the indications at each seat: a pattern over the seats, with a size that
is free.

A spread is the experimental standard deviation of the position, ``s² = Σ|p_i - p̄|²/(n - 1)``. Its
logarithm from n records has, by the delta method, the standard deviation ``½ √((m₄/m₂² - 1)/n)``,
m₂ and m₄ the mean second and fourth power of the distance from the mean. All to first order: an
effect with parameters β displaces record i by ``S_i β``, and what it does alike in all postures of
a seat moves their mean and does not spread; noise with covariance ``Σ_i`` spreads by its trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.batches import chunks
from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.effects import (
    BaseCompliance,
    BearingTilt,
    Effect,
    EncoderEccentricity,
    EncoderEllipticity,
    GravityEffect,
    JointCompliance,
    LinkBending,
)
from aacmm_pin.measurements.noise import ENCODER
from papers.sino6.tables import printed_points
from papers.sino6_table3.simulated_touches import TouchedSeats

DH = "DH errors"
NOISE = "encoder noise"
CONTACT = "contact noise"
BOTH = "DH errors + encoder noise"
ODD, STAND = "encoder noise + one odd seat", "encoder noise + stand that deflects with height"
ECCENTRICITY, GRAVITY = "encoder eccentricity", "gravity (bearings, tubes, stand)"
OF_SEATS = (ODD, STAND, CONTACT)
"""Causes that are not the arm's."""
DECADE = (0.1, 10.0)
"""Sizes that are thought possible, in units of the typical one."""
NOISE_SIZES = np.geomspace(DECADE[0] * ENCODER, DECADE[1] * ENCODER, 41)
"""Encoder noise that is tried beside DH errors [rad]."""
LOCAL = 1e-5
"""Typical local noise of one coordinate [m]."""
RATIOS = np.geomspace(0.1, 10.0, 61)
"""Spread by the second cause of a mixture over that of the first."""
HEIGHT = printed_points()[:, 2] - printed_points()[:, 2].min()
"""Of each seat above the lowest (6,) [m]."""
POWERS = (0.5, 1.0, 2.0, 3.0)
"""Powers of the height with which a stand yields: a column tilts with the first, bends with the
third.
"""
UNEQUAL = 0.5
"""Standard deviation of the logarithm of each joint's noise, where the joints are not equal."""
JOINTS, TUBES = range(1, 7), (3, 5)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Spreads at the seats by one cause of size 1, for every way in which it may act.

    Attributes:
        second: mean squared distance from the mean, m₂ (draws, seats) [m²].
        fourth: mean fourth power of the distance, m₄ (draws, seats) [m⁴].
        records: number of records of each seat.
        sizes: smallest and largest size that is thought possible, equal where the size is known;
            log-uniform between.
    """

    second: Array
    fourth: Array
    records: int
    sizes: tuple[float, float] = DECADE

    @property
    def log_spread(self) -> Array:
        """Logarithm of the spread at size 1 (draws, seats) [ln m]."""
        return np.asarray(0.5 * np.log(self.second))

    @property
    def log_sd(self) -> Array:
        """Standard deviation of the logarithm of an observed spread (draws, seats), as if postures
        were drawn at random.
        """
        return np.asarray(
            0.5 * np.sqrt(np.maximum(self.fourth / self.second**2 - 1.0, 0.0) / self.records)
        )

    def take(self, seats: Sequence[int]) -> Pattern:
        """The same of some of the seats."""
        return replace(self, second=self.second[:, list(seats)], fourth=self.fourth[:, list(seats)])


def patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int) -> dict[str, Pattern]:
    """Every cause that is weighed, by its name.

    Hysteresis of joints that are approached from changing sides acts as noise of unequal encoders.
    DH errors are within their half-widths, so their size is known. The odd seat and the stand are
    beside encoder noise, by several ratios.
    """
    noise = of_encoder_noise(seats)
    dh = replace(
        of_displacements(seats.sensitivity(), parameter_errors(seats.model, rng, draws)),
        sizes=(1.0, 1.0),
    )
    unequal = np.exp(UNEQUAL * rng.normal(size=(200, len(JOINTS))))
    # Spreads on average as much as encoder noise of size 1.
    alike = np.sqrt(noise.second.mean() / 3.0)
    yielding = alike * np.power.outer(HEIGHT / HEIGHT.max(), POWERS).T
    odd = alike * np.eye(len(seats.q))
    causes = systematic().items()
    return {
        DH: dh,
        NOISE: noise,
        "unequal encoder noise": of_encoder_noise(seats, unequal),
        BOTH: mixed(dh, noise, NOISE_SIZES),
        **{
            name: of_displacements(seats.sensitivity(each), drawn_values(each, rng, draws))
            for name, each in causes
        },
        CONTACT: of_local_noise(seats, np.full((1, len(seats.q)), LOCAL)),
        STAND: mixed(noise, of_local_noise(seats, yielding), RATIOS),
        ODD: mixed(noise, of_local_noise(seats, odd), RATIOS),
    }


def systematic() -> dict[str, list[Effect]]:
    """Effects that depend on the posture alone."""
    gravity: list[Effect] = [
        BaseCompliance(),
        JointCompliance(joint=2),
        *(LinkBending(link=k) for k in TUBES),
    ]
    return {
        ECCENTRICITY: [EncoderEccentricity(joint=j) for j in JOINTS],
        "encoder ellipticity": [EncoderEllipticity(joint=j) for j in JOINTS],
        GRAVITY: [*gravity, *(BearingTilt(joint=j) for j in JOINTS)],
    }


def drawn_values(effects: Sequence[Effect], rng: np.random.Generator, draws: int) -> Array:
    """Values of all parameters (draws, p): the typical one times a standard normal number, of a
    flexibility its size.
    """
    terms = [
        (term.typical, isinstance(effect, GravityEffect))
        for effect in effects
        for term in effect.terms
    ]
    typical, flexible = (np.array(column) for column in zip(*terms, strict=True))
    normal = rng.normal(size=(draws, len(terms)))
    return np.asarray(np.where(flexible, np.abs(normal), normal) * typical)


def of_encoder_noise(seats: TouchedSeats, weights: Array | None = None) -> Pattern:
    """Independent normal noise of every encoder in every record; size 1 is one radian, thought
    possible 0.8 µrad to 80 µrad.

    ``weights`` is the noise of each joint relative to the size, (draws, nq) for several
    possibilities; by default all 1.
    """
    levers = seats.levers()
    weight = np.ones((1, levers.shape[-1])) if weights is None else weights
    products = np.einsum("snij,snik->snjk", levers, levers)
    each = np.einsum("snjj,dj->dsn", products, weight**2)
    twice = np.einsum("snjk,dj,dk->dsn", products**2, weight**2, weight**2)  # trace of Σ²
    return Pattern(
        each.mean(axis=2),
        (each**2 + 2.0 * twice).mean(axis=2),
        seats.q.shape[1],
        (NOISE_SIZES[0], NOISE_SIZES[-1]),
    )


def of_local_noise(seats: TouchedSeats, sd: Array) -> Pattern:
    """Noise of the contact or the seat; ``sd`` (draws, seats) is the standard deviation of each
    coordinate at size 1 [m].
    """
    return Pattern(3.0 * sd**2, 15.0 * sd**4, seats.q.shape[1])


def of_displacements(sensitivity: Array, values: Array) -> Pattern:
    """Systematic causes, by ``sensitivity`` (seats, n, 3, p) [m/unit] and ``values`` (draws, p) at
    size 1.
    """
    seats, records = sensitivity.shape[:2]
    centred = sensitivity - sensitivity.mean(axis=1, keepdims=True)
    second, fourth = np.empty((2, len(values), seats))
    for rows in chunks(len(values), 200):
        squares = np.square(np.einsum("snip,dp->dsni", centred, values[rows], optimize=True)).sum(
            axis=3
        )
        second[rows], fourth[rows] = (
            squares.sum(axis=2) / (records - 1),
            np.square(squares).mean(axis=2),
        )
    return Pattern(second, fourth, records)


def mixed(first: Pattern, second: Pattern, ratios: Array) -> Pattern:
    """Two independent causes at once: the size of the second is each of ``ratios`` (r,) times that
    of the first.

    Draws of both are paired: as many of each, or one of either, times all ratios. Sizes are those
    of ``first``. The squares add; fourth powers as those of two displacements without common
    direction, ``m₄ + m₄' + (10/3) m₂ m₂'``.
    """
    ratio = np.asarray(ratios, dtype=np.float64)[:, None, None]
    one, other = first.second[None], ratio**2 * second.second[None]
    fourth = first.fourth[None] + ratio**4 * second.fourth[None] + 10.0 / 3.0 * one * other
    seats = first.second.shape[1]
    return replace(first, second=(one + other).reshape(-1, seats), fourth=fourth.reshape(-1, seats))
