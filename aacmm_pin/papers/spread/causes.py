"""Patterns of spread: of any effect, of what is uncertain in the arm, and of noise that is new in every record.

To first order. An effect with parameters β displaces record i by ``S_i β``; what it does alike in all postures of a seat
moves their mean and does not spread. Noise with covariance ``Σ_i`` spreads by its trace.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array, vector
from aacmm_pin._support.units import ARCSEC
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.gravity import GravityEffect
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.papers.spread.pattern import DECADE, Pattern
from aacmm_pin.papers.spread.seats import TouchedSeats

DrawConditions = Callable[[np.random.Generator], Conditions]
"""Conditions of all records, seat by seat, as they may have been."""
AT_ONCE = 200
"""Draws evaluated together."""


def of_effects(
    seats: TouchedSeats,
    name: str,
    effects: Sequence[Effect],
    rng: np.random.Generator,
    draws: int = 1000,
    conditions: DrawConditions | None = None,
) -> Pattern:
    """Effects of one kind, such as the eccentricities of all encoders, with one common size.

    Size 1 is the typical magnitude of each parameter; in each draw every parameter is that times a standard normal number,
    of a flexibility its absolute value. A single parameter needs one draw, for its size is free anyway.

    Args:
        seats: the seats.
        name: of the pattern.
        effects: the causes; their values do not matter.
        rng: for parameters and conditions.
        draws: number of draws.
        conditions: draws what the effects depend on beside the posture: temperatures, times, directions of approach.

    Raises:
        AacmmError: no effects.
        MissingConditionError: an effect depends on a condition that is not drawn.
    """
    terms = [(term.typical, isinstance(effect, GravityEffect)) for effect in effects for term in effect.terms]
    if not terms:
        raise AacmmError(f"{name}: there are no effects, expected at least one")
    typical, flexible = np.array([t for t, _ in terms]), np.array([f for _, f in terms])
    if conditions is None:
        normal = np.ones((1, 1)) if len(terms) == 1 else rng.normal(size=(draws, len(terms)))
        return _of_displacements(
            seats, name, seats.sensitivity(effects), np.where(flexible, np.abs(normal), normal) * typical
        )
    found = []
    for _ in range(draws):
        normal = rng.normal(size=(1, len(terms)))
        sensitivity = seats.sensitivity(effects, conditions(rng))
        found.append(_of_displacements(seats, name, sensitivity, np.where(flexible, np.abs(normal), normal) * typical))
    return Pattern(name, np.concatenate([p.second for p in found]), np.concatenate([p.fourth for p in found]), seats.records)


def of_stated_uncertainty(seats: TouchedSeats, name: str, rng: np.random.Generator, draws: int = 1000) -> Pattern:
    """What is uncertain in the arm by its own file: DH values within their half-widths, effects within their u.

    The size is 1 and known. See :func:`aacmm_pin.accuracy.parameter_draws.parameter_errors` for the distributions.

    Raises:
        AacmmError: nothing is uncertain.
    """
    errors = parameter_errors(seats.model, rng, draws)
    if not errors.any():
        raise AacmmError(f"{seats.model.arm.name}: no parameter has an uncertainty, so nothing spreads")
    sensitivity = seats.model.sensitivity(seats.all_q, at=seats.at)
    pattern = _of_displacements(seats, name, sensitivity, errors)
    return Pattern(name, pattern.second, pattern.fourth, seats.records, (1.0, 1.0), "× stated half-widths")


def of_encoder_noise(seats: TouchedSeats, name: str = "encoder noise", weights: ArrayLike | None = None) -> Pattern:
    """Independent normal noise of every encoder in every record; size 1 is one radian, thought possible 0.8 µrad to 80 µrad.

    Args:
        seats: the seats.
        name: of the pattern.
        weights: noise of each joint relative to the size: (nq,), or (draws, nq) for several possibilities; default all 1.
    """
    nq = seats.model.arm.nq
    weight = np.ones((1, nq)) if weights is None else np.atleast_2d(np.asarray(weights, dtype=np.float64))
    if weight.shape[1] != nq or (weight < 0).any() or not np.isfinite(weight).all():
        raise ShapeError(f"weights has shape {weight.shape}, expected (draws, {nq}) numbers that are not negative")
    second, fourth = [], []
    for levers in seats.by_seat(seats.levers()):
        products = np.einsum("nij,nik->njk", levers, levers)  # (n, nq, nq)
        each = np.einsum("njj,dj->dn", products, weight**2)
        twice = np.einsum("njk,dj,dk->dn", products**2, weight**2, weight**2)  # trace of Σ²
        second.append(each.mean(axis=1))
        fourth.append((each**2 + 2.0 * twice).mean(axis=1))
    sizes = (DECADE[0] * ENCODER, DECADE[1] * ENCODER)
    return Pattern(name, np.stack(second, axis=1), np.stack(fourth, axis=1), seats.records, sizes, "″", ARCSEC)


def of_local_noise(seats: TouchedSeats, name: str, relative: ArrayLike, typical: float = 1e-5) -> Pattern:
    """Noise of the contact or the seat, alike in all directions: (seats,) or (draws, seats) of it, relative to the size.

    Ones for the contact of ball and seat; powers of the height for a stand that yields; one seat alone for a loose one.

    Args:
        seats: the seats.
        name: of the pattern.
        relative: standard deviation of each coordinate at each seat, relative to ``typical``.
        typical: of one coordinate [m].
    """
    size = np.atleast_2d(np.asarray(relative, dtype=np.float64)) * typical
    for row in size:
        vector(row, len(seats.labels), f"{name}: relative", "1")
    return Pattern(name, 3.0 * size**2, 15.0 * size**4, seats.records)


def _of_displacements(seats: TouchedSeats, name: str, sensitivity: Array, values: Array) -> Pattern:
    """For ``sensitivity`` (n, 3, p) and ``values`` (draws, p)."""
    second, fourth = np.empty((2, len(values), len(seats.labels)))
    for k, part in enumerate(seats.by_seat(sensitivity)):
        centred = part - part.mean(axis=0)
        for start in range(0, len(values), AT_ONCE):
            rows = slice(start, start + AT_ONCE)
            squares = np.square(np.einsum("nip,dp->dni", centred, values[rows], optimize=True)).sum(axis=2)
            second[rows, k] = squares.sum(axis=1) / (len(part) - 1)
            fourth[rows, k] = np.square(squares).mean(axis=1)
    return Pattern(name, second, fourth, seats.records)
