"""What the three hundred records behind Table 3, angles and touched seat, would tell that six spreads cannot.

Twice: by the expected logarithm of a Bayes factor between causes, each of the size that Table 3 implies for it; and by
records simulated with one cause, which go through the package's own diagnosis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.papers.spread import (
    Kernel,
    Pattern,
    TouchedSeats,
    evidence,
    expected_log_bayes_factors,
    kernel_of_effects,
    kernel_of_noise,
    of_effects,
    of_encoder_noise,
    of_local_noise,
)
from aacmm_pin.papers.table3.causes import CONTACT, NOISE, ODD, systematic
from aacmm_pin.papers.table3.postures import MEASURED, SIXTH
from aacmm_pin.papers.table3.seat6 import local_noise_needed
from aacmm_pin.postures.sampling import brought_to


def expected_of_records(seats: TouchedSeats, tau: float, rng: np.random.Generator) -> pd.DataFrame:
    """Expected loss of log-likelihood when another cause is assumed than the true one, with the records at hand.

    See :func:`aacmm_pin.papers.spread.expected_log_bayes_factors`. Every cause has the size that seats 1 to 5 of Table 3
    give it.
    """
    five = list(range(SIXTH))
    noise, contact = of_encoder_noise(seats, NOISE), of_local_noise(seats, CONTACT, np.ones(len(seats.labels)))

    def size(pattern: Pattern) -> float:
        found = evidence(pattern.take(five), MEASURED[:SIXTH], tau)
        return float(found.size(rng)[1] * pattern.unit_size)

    levers = seats.levers()
    own = size(noise)
    kernels = [
        kernel_of_noise(seats, NOISE, levers, own),
        kernel_of_noise(seats, CONTACT, _everywhere(seats), size(contact)),
    ]
    kernels.append(_odd(seats, levers, own, float(np.sqrt(noise.second[0, SIXTH])) * own))
    for name, effects in systematic().items():
        kernels.append(kernel_of_effects(seats, name, effects, size(of_effects(seats, name, effects, rng))))
    return expected_log_bayes_factors(seats, kernels)


def _everywhere(seats: TouchedSeats) -> Array:
    return np.broadcast_to(1e-5 * np.eye(3), (len(seats.all_q), 3, 3))


def _odd(seats: TouchedSeats, levers: Array, noise: float, by_noise: float) -> Kernel:
    """Encoder noise, and at seat 6 what it needs beside."""
    local = local_noise_needed(np.full(len(seats.labels), by_noise))
    factors = np.zeros((len(levers), 3, levers.shape[2] + 3))
    factors[:, :, : levers.shape[2]] = noise * levers
    factors[_of_seat(seats, SIXTH), :, levers.shape[2] :] = local * np.eye(3)
    return kernel_of_noise(seats, ODD, factors)


def _of_seat(seats: TouchedSeats, seat: int) -> NDArray[np.bool_]:
    return np.asarray(np.repeat(np.arange(len(seats.q)), [len(q) for q in seats.q]) == seat)


def simulated_records(seats: TouchedSeats, cause: str, size: float, rng: np.random.Generator) -> Measurements:
    """Fifty records at each seat by an arm that has one cause beside DH errors: angles and the label of the seat.

    By exact physics: the arm's geometry is drawn within its half-widths, its tip is brought to the seat with all its errors,
    and the angles are read with noise: 1.6″ where another cause is simulated.

    Args:
        seats: seats and postures, tips in the seats.
        cause: ``encoder noise``, ``encoder noise + one odd seat`` (seat 6), ``contact noise`` or one of the systematic ones.
        size: encoder noise [rad]; contact noise of each coordinate [m]; of a systematic cause in typical magnitudes.
        rng: for arm, parameters and noise.

    Raises:
        UnknownNameError: no such cause.
        AacmmError: the seats are not touched with the tip, or a tip cannot be brought to its seat.
    """
    known: dict[str, list[Effect]] = {NOISE: [], ODD: [], CONTACT: [], **systematic()}
    if cause not in known:
        raise UnknownNameError("cause", cause, list(known))
    if seats.at is not None:
        raise AacmmError(f"the seats are touched with {seats.at}, expected the tip")
    effects = [_drawn(effect, size, rng) for effect in known[cause]]
    truth = perturbed_model(ErrorModel(seats.model.arm, tuple(effects)), rng)
    encoder = size if cause in (NOISE, ODD) else ENCODER
    target = seats.model.predict(seats.all_q) + _contact(seats, cause, size, rng)
    q, arrived = brought_to(lambda q, _: truth.state(q), seats.all_q, target, truth.arm.limits)
    if not arrived.all():
        raise AacmmError(f"{cause}: {(~arrived).sum()} tips cannot be brought to their seats within the limits")
    labels = np.repeat(np.array([f"S{label}" for label in seats.labels], dtype=object), [len(q) for q in seats.q])
    readings = q + encoder * rng.normal(size=q.shape)
    return Measurements.of(readings, conditions=Conditions(len(q), seat=labels), source=f"simulated, {cause}")


def _drawn(effect: Effect, size: float, rng: np.random.Generator) -> Effect:
    """The effect with parameters drawn as its pattern draws them."""
    normal = rng.normal(size=len(effect.terms))
    values = np.abs(normal) if effect.elastic else normal
    return replace(effect, values=tuple(size * values * np.array([term.typical for term in effect.terms])))


def _contact(seats: TouchedSeats, cause: str, size: float, rng: np.random.Generator) -> Array:
    """How far each contact is off its seat (n, 3) [m]."""
    n = len(seats.all_q)
    if cause == CONTACT:
        return size * rng.normal(size=(n, 3))
    if cause != ODD:
        return np.zeros((n, 3))
    by_noise = size * np.sqrt(of_encoder_noise(seats).second[0])
    return np.asarray(local_noise_needed(by_noise) * rng.normal(size=(n, 3)) * _of_seat(seats, SIXTH)[:, None])
