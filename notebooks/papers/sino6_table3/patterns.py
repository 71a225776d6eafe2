"""The pattern of a cause: the spreads that it causes at each seat, with a free size.

A spread is the experimental standard deviation of the position, ``s² = Σ|p_i - p̄|²/(n - 1)``. By
the delta method, the logarithm of a spread of n records has the standard deviation
``½ √((m₄/m₂² - 1)/n)``, where m₂ and m₄ are the mean second and fourth power of the distance from
the mean. All formulas are of first order: an effect with parameters β displaces record i by
``S_i β``. A displacement that is equal in all postures of a seat moves the mean and causes no
spread. Noise with covariance ``Σ_i`` causes a spread by its trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.arrays import Array, chunks
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
"""Causes outside the arm."""
DECADE = (0.1, 10.0)
"""Possible sizes in units of the typical size."""
NOISE_SIZES = np.geomspace(DECADE[0] * ENCODER, DECADE[1] * ENCODER, 41)
"""Encoder noises that are combined with DH errors [rad]."""
LOCAL = 1e-5
"""Typical local noise of one coordinate [m]."""
RATIOS = np.geomspace(0.1, 10.0, 61)
"""Spread of the second cause of a mixture divided by that of the first."""
HEIGHT = printed_points()[:, 2] - printed_points()[:, 2].min()
"""Height of each seat above the lowest seat (6,) [m]."""
POWERS = (0.5, 1.0, 2.0, 3.0)
"""Powers of the height in the deflection of a stand: 1 for a tilting column, 3 for a bending one.
"""
UNEQUAL = 0.5
"""Standard deviation of the logarithm of the noise of a joint, for unequal joints."""
JOINTS, TUBES = range(1, 7), (3, 5)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Spreads at the seats by one cause of size 1, for each draw of its parameters.

    Attributes:
        second: mean squared distance from the mean, m₂ (draws, seats) [m²].
        fourth: mean fourth power of the distance, m₄ (draws, seats) [m⁴].
        records: number of records of each seat.
        sizes: smallest and largest possible size, log-uniform between; equal if the size is known.
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
        """Standard deviation of the logarithm of an observed spread for random postures (draws,
        seats).
        """
        return np.asarray(
            0.5 * np.sqrt(np.maximum(self.fourth / self.second**2 - 1.0, 0.0) / self.records)
        )

    def take(self, seats: Sequence[int]) -> Pattern:
        """The pattern of some of the seats."""
        return replace(self, second=self.second[:, list(seats)], fourth=self.fourth[:, list(seats)])


def patterns(seats: TouchedSeats, rng: np.random.Generator, draws: int) -> dict[str, Pattern]:
    """The pattern of each compared cause, by name.

    Hysteresis with changing directions of approach acts as noise of unequal encoders. The size of
    DH errors is known from their half-widths. The odd seat and the stand act together with encoder
    noise, with several ratios.
    """
    noise = of_encoder_noise(seats)
    dh = replace(
        of_displacements(seats.sensitivity(), parameter_errors(seats.model, rng, draws)),
        sizes=(1.0, 1.0),
    )
    unequal = np.exp(UNEQUAL * rng.normal(size=(200, len(JOINTS))))
    # mean spread equal to that of encoder noise of size 1
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
    """Effects that depend only on the posture."""
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
    """Values of all parameters (draws, p): typical magnitude times a standard normal number.

    Flexibilities have positive values.
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
    """Independent normal noise of every encoder in every record.

    Size 1 is one radian; possible sizes are 0.8 µrad to 80 µrad. ``weights`` (draws, nq) is the
    noise of each joint relative to the size, by default 1.
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
    """Noise of contact or seat; ``sd`` (draws, seats) [m] is its standard deviation in each
    coordinate at size 1.
    """
    return Pattern(3.0 * sd**2, 15.0 * sd**4, seats.q.shape[1])


def of_displacements(sensitivity: Array, values: Array) -> Pattern:
    """Pattern of systematic causes from ``sensitivity`` (seats, n, 3, p) [m/unit] and ``values``
    (draws, p) at size 1.
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
    """Two independent causes together; ``ratios`` (r,) are sizes of the second by those of the
    first.

    The draws of both patterns are paired, with each ratio. The sizes are those of ``first``. Second
    powers add up. Fourth powers are ``m₄ + m₄' + (10/3) m₂ m₂'``, as for displacements without a
    common direction.
    """
    ratio = np.asarray(ratios, dtype=np.float64)[:, None, None]
    one, other = first.second[None], ratio**2 * second.second[None]
    fourth = first.fourth[None] + ratio**4 * second.fourth[None] + 10.0 / 3.0 * one * other
    seats = first.second.shape[1]
    return replace(first, second=(one + other).reshape(-1, seats), fourth=fourth.reshape(-1, seats))
