"""How much a cause spreads the indications at each seat: a pattern over the seats, with a size that is free.

A spread is the experimental standard deviation of the position, ``s² = Σ|p_i - p̄|²/(n - 1)``. Its logarithm from n records
has, by the delta method, the standard deviation ``½ √((m₄/m₂² - 1)/n)``, m₂ and m₄ the mean second and fourth power of the
distance from the mean. All to first order: an effect with parameters β displaces record i by ``S_i β``, and what it does
alike in all postures of a seat moves their mean and does not spread; noise with covariance ``Σ_i`` spreads by its trace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.arm.dh import chunks
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.gravity import GravityEffect
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.papers.sino6_table3.seats import TouchedSeats

DECADE = (0.1, 10.0)
"""Sizes that are thought possible, in units of the typical one."""
LOCAL = 1e-5
"""Typical local noise of one coordinate [m]."""
AT_ONCE = 200
"""Draws evaluated together."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """Spreads at the seats by one cause of size 1, for every way in which it may act.

    Attributes:
        name: of the cause.
        second: mean squared distance from the mean, m₂ (draws, seats) [m²].
        fourth: mean fourth power of the distance, m₄ (draws, seats) [m⁴].
        records: number of records of each seat.
        sizes: smallest and largest size that is thought possible, equal where the size is known; log-uniform between.
    """

    name: str
    second: Array
    fourth: Array
    records: int
    sizes: tuple[float, float] = DECADE

    @property
    def log_spread(self) -> Array:
        """Logarithm of the spread at size 1 (draws, seats) [ln m]; -inf where the cause does not spread."""
        with np.errstate(divide="ignore"):
            return np.asarray(0.5 * np.log(self.second))

    @property
    def log_sd(self) -> Array:
        """Standard deviation of the logarithm of an observed spread (draws, seats), as if postures were drawn at random."""
        excess = np.divide(self.fourth, self.second**2, out=np.ones_like(self.second), where=self.second > 0) - 1.0
        return np.asarray(0.5 * np.sqrt(np.maximum(excess, 0.0) / self.records))

    def take(self, seats: Sequence[int]) -> Pattern:
        """The same of some of the seats."""
        return replace(self, second=self.second[:, list(seats)], fourth=self.fourth[:, list(seats)])


def drawn_values(effects: Sequence[Effect], rng: np.random.Generator, draws: int) -> Array:
    """Values of all parameters (draws, p): the typical one times a standard normal number, of a flexibility its size."""
    terms = [(term.typical, isinstance(effect, GravityEffect)) for effect in effects for term in effect.terms]
    typical, flexible = (np.array(column) for column in zip(*terms, strict=True))
    normal = rng.normal(size=(draws, len(terms)))
    return np.asarray(np.where(flexible, np.abs(normal), normal) * typical)


def of_effects(
    seats: TouchedSeats,
    name: str,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    draws: int = 1000,
    conditions: Callable[[np.random.Generator], Conditions] | None = None,
    sizes: tuple[float, float] = DECADE,
) -> Pattern:
    """Effects of one kind, such as the eccentricities of all encoders, with one common size.

    Size 1 is the typical magnitude of each parameter, see :func:`drawn_values`. A single parameter needs one draw, for its
    size is free anyway. ``conditions`` draws what the effects depend on beside the posture, anew in each draw.

    Raises:
        MissingConditionError: an effect depends on a condition that is not drawn.
    """
    if conditions is None:
        sensitivity = seats.sensitivity(effects)
        single = sensitivity.shape[-1] == 1
        values = np.array([[effects[0].terms[0].typical]]) if single else drawn_values(effects, rng, draws)
        return _of_displacements(name, sensitivity, values, sizes)
    found = []
    for _ in range(draws):
        values = drawn_values(effects, rng, 1)
        found.append(_of_displacements(name, seats.sensitivity(effects, conditions(rng)), values, sizes))
    second, fourth = (np.concatenate([getattr(one, power) for one in found]) for power in ("second", "fourth"))
    return replace(found[0], second=second, fourth=fourth)


def of_stated_uncertainty(seats: TouchedSeats, name: str, rng: np.random.Generator, draws: int = 1000) -> Pattern:
    """What is uncertain in the arm by its own file: DH values within their half-widths. The size is 1 and known."""
    values = parameter_errors(seats.model, rng, draws)
    return _of_displacements(name, seats.sensitivity(), values, (1.0, 1.0))


def of_encoder_noise(seats: TouchedSeats, name: str = "encoder noise", weights: Array | None = None) -> Pattern:
    """Independent normal noise of every encoder in every record; size 1 is one radian, thought possible 0.8 µrad to 80 µrad.

    ``weights`` is the noise of each joint relative to the size, (draws, nq) for several possibilities; by default all 1.
    """
    levers = seats.levers()
    weight = np.ones((1, levers.shape[-1])) if weights is None else weights
    products = np.einsum("snij,snik->snjk", levers, levers)
    each = np.einsum("snjj,dj->dsn", products, weight**2)
    twice = np.einsum("snjk,dj,dk->dsn", products**2, weight**2, weight**2)  # trace of Σ²
    fourth = (each**2 + 2.0 * twice).mean(axis=2)
    return Pattern(name, each.mean(axis=2), fourth, seats.q.shape[1], (DECADE[0] * ENCODER, DECADE[1] * ENCODER))


def of_local_noise(seats: TouchedSeats, name: str, relative: ArrayLike, typical: float = LOCAL) -> Pattern:
    """Noise of the contact or the seat, alike in all directions.

    ``relative``, (seats,) or (draws, seats), is the standard deviation of each coordinate at each seat as a multiple of
    ``typical`` [m]: ones for the contact of ball and seat; powers of the height for a stand that yields; one seat alone for
    a loose one.
    """
    size = np.atleast_2d(np.asarray(relative, dtype=np.float64)) * typical
    return Pattern(name, 3.0 * size**2, 15.0 * size**4, seats.q.shape[1])


def _of_displacements(name: str, sensitivity: Array, values: Array, sizes: tuple[float, float]) -> Pattern:
    """For ``sensitivity`` (seats, n, 3, p) and ``values`` (draws, p)."""
    seats, records = sensitivity.shape[:2]
    centred = sensitivity - sensitivity.mean(axis=1, keepdims=True)
    second, fourth = np.empty((2, len(values), seats))
    for rows in chunks(len(values), AT_ONCE):
        squares = np.square(np.einsum("snip,dp->dsni", centred, values[rows], optimize=True)).sum(axis=3)
        second[rows], fourth[rows] = squares.sum(axis=2) / (records - 1), np.square(squares).mean(axis=2)
    return Pattern(name, second, fourth, records, sizes)


def mixed(name: str, first: Pattern, second: Pattern, ratios: Array) -> Pattern:
    """Two independent causes at once: the size of the second is each of ``ratios`` (r,) times that of the first.

    Draws of both are paired: as many of each, or one of either, times all ratios. Sizes are those of ``first``. The squares
    add; fourth powers as those of two displacements without common direction, ``m₄ + m₄' + (10/3) m₂ m₂'``.

    Raises:
        AacmmError: other numbers of draws.
    """
    if len({len(first.second), len(second.second)} - {1}) > 1:
        raise AacmmError(f"{name}: {len(first.second)} and {len(second.second)} draws, expected as many, or one")
    ratio = np.asarray(ratios, dtype=np.float64)[:, None, None]
    one, other = first.second[None], ratio**2 * second.second[None]
    fourth = first.fourth[None] + ratio**4 * second.fourth[None] + 10.0 / 3.0 * one * other
    seats = first.second.shape[1]
    return replace(first, name=name, second=(one + other).reshape(-1, seats), fourth=fourth.reshape(-1, seats))
