"""What the three hundred records behind Table 3, angles and touched seat, would tell that six spreads cannot.

By calculation: all records together are normal, ``r ~ N(0, B + s² K)``. B holds what is there anyway, the stated uncertainty
of the arm and a floor of noise; K is the covariance by the cause at size 1. The place of each seat is unknown, so only
contrasts within seats count (Helmert contrasts; restricted likelihood). If cause t of size s_t is true, cause a loses
against it on average ``½ [tr(C_a⁻¹ C_t) - N + ln|C_a| - ln|C_t|]`` in log-likelihood, the Kullback–Leibler divergence,
smallest over the size of a and over a factor κ ≥ 1 of all of C_a, the scatter that a diagnosis refits: the expected
logarithm of a Bayes factor but for the price of what is free. And by trying: records simulated with one cause, which go
through the package's own diagnosis.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.linalg import helmert, solve_triangular
from scipy.optimize import minimize_scalar

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.papers.sino6_table3.causes import CONTACT, NOISE, ODD, systematic
from aacmm_pin.papers.sino6_table3.diagnosis import FIVE, local_noise_needed
from aacmm_pin.papers.sino6_table3.evidence import evidence
from aacmm_pin.papers.sino6_table3.patterns import LOCAL, Pattern, drawn_values, of_effects, of_encoder_noise, of_local_noise
from aacmm_pin.papers.sino6_table3.seats import MEASURED, SIXTH, TouchedSeats
from aacmm_pin.postures.sampling import brought_to

SCATTER = "scatter alone"
"""No cause but more noise than stated."""


def expected_of_records(seats: TouchedSeats, tau: float, rng: np.random.Generator) -> pd.DataFrame:
    """Expected loss of log-likelihood when another cause is assumed than the true one, with the records at hand.

    See :func:`expected_log_bayes_factors`. Every cause has the size that seats 1 to 5 of Table 3 give it.
    """

    def size(pattern: Pattern) -> float:
        return float(evidence(pattern.take(FIVE), MEASURED[:SIXTH], tau).size(rng)[1])

    noise, levers = of_encoder_noise(seats), seats.levers()
    own = size(noise)
    everywhere = np.broadcast_to(LOCAL * np.eye(3), (*seats.q.shape[:2], 3, 3))
    odd = np.zeros((*seats.q.shape[:2], 3, levers.shape[-1] + 3))
    odd[..., :-3] = own * levers
    odd[SIXTH, ..., -3:] = local_noise_needed(own * np.sqrt(noise.second[0])) * np.eye(3)
    causes = {
        NOISE: own * of_records(levers),
        CONTACT: size(of_local_noise(seats, CONTACT, np.ones(len(seats.q)))) * of_records(everywhere),
        ODD: of_records(odd),
    }
    for name, effects in systematic().items():
        typical = np.array([term.typical for effect in effects for term in effect.terms])
        own = size(of_effects(seats, name, effects, rng))
        causes[name] = own * contrasts(seats.sensitivity(effects) * typical)
    return expected_log_bayes_factors(seats, causes)


def contrasts(columns: Array) -> Array:
    """Helmert contrasts within seats of ``columns`` (seats, records, 3, p): (N, p), N = 3 · seats · (records - 1)."""
    within = np.einsum("an,snip->saip", helmert(columns.shape[1]), columns, optimize=True)
    return np.asarray(within.reshape(-1, columns.shape[-1]))


def of_records(factors: Array) -> Array:
    """Contrasts of noise that is new in every record, with covariance ``f fᵀ`` for its f in ``factors`` (seats, n, 3, m)."""
    seats, records, _, m = factors.shape
    spread = np.zeros((seats, records, 3, seats, records, m))
    seat, record = np.indices((seats, records))
    spread[seat, record, :, seat, record] = factors
    return contrasts(spread.reshape(seats, records, 3, -1))


def expected_log_bayes_factors(seats: TouchedSeats, causes: dict[str, Array], floor: float = ENCODER) -> pd.DataFrame:
    """Expected loss of log-likelihood, truth in the rows, alternatives in the columns, scatter alone the last.

    Args:
        seats: seats and postures of the records; the model's own stated uncertainty is there in every case.
        causes: a factor F of ``s² K = F Fᵀ`` of each cause at its size, in :func:`contrasts` (N, r) [m].
        floor: encoder noise that is there in every case [rad].
    """
    known, noise = contrasts(seats.sensitivity()), of_records(seats.levers())
    base = known @ seats.model.covariance() @ known.T + floor**2 * noise @ noise.T
    lower = np.linalg.cholesky(base + 1e-12 * np.trace(base) / len(base) * np.eye(len(base)))
    added = {name: solve_triangular(lower, factor, lower=True) for name, factor in causes.items()}  # B is the identity
    axes = {name: _axes(factor) for name, factor in added.items()}
    table = pd.DataFrame(index=pd.Index(list(causes), name="true cause"), columns=[*causes, SCATTER], dtype=float)
    for truth, factor in added.items():
        own = axes[truth][0]
        for name, (values, vectors) in axes.items():
            table.loc[truth, name] = max(0.0, _least_loss(len(base), own, values, np.square(vectors.T @ factor).sum(axis=1)))
        table.loc[truth, SCATTER] = _loss(len(base), own, 0.0, 0.0)
    return table


def _axes(factor: Array) -> tuple[Array, Array]:
    """Eigenvalues that are not zero, and eigenvectors, of ``F Fᵀ``."""
    vectors, singular, _ = np.linalg.svd(factor, full_matrices=False)
    there = singular**2 > 1e-12 * singular[0] ** 2
    return singular[there] ** 2, vectors[:, there]


def _loss(count: int, own: Array, taken: float, log_determinant: float) -> float:
    """Of an alternative that takes ``taken`` from the trace of C_a⁻¹ C_t, its scatter refitted; ``own``: C_t beyond B."""
    trace = count + own.sum() - taken
    factor = max(1.0, trace / count)
    return float(0.5 * (trace / factor - count + count * np.log(factor) + log_determinant - np.log1p(own).sum()))


def _least_loss(count: int, own: Array, values: Array, along: Array) -> float:
    """Over the size of the alternative with eigenvalues ``values``, along which the truth has variances ``along``."""

    def loss(log_size: float) -> float:
        scaled = np.exp(2 * log_size) * values
        share = scaled / (1.0 + scaled)  # of the variance beside B, along each axis
        return _loss(count, own, float(((1.0 + along) * share).sum()), float(np.log1p(scaled).sum()))

    # A first look all over, for the loss may have two valleys: small, or so large that scatter is not needed.
    tried = np.arange(-5.0, 12.0, 0.5) - 0.5 * np.log(values.max())
    best = tried[np.argmin([loss(t) for t in tried])]
    return float(minimize_scalar(loss, bounds=(best - 0.5, best + 0.5), method="bounded", options={"xatol": 1e-5}).fun)


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
    drawn = [(effect, size * drawn_values([effect], rng, 1)[0]) for effect in known[cause]]
    effects = [effect.at(np.abs(values) if effect.elastic else values) for effect, values in drawn]
    truth = perturbed_model(ErrorModel(seats.model.arm, tuple(effects)), rng)
    off: Array = np.zeros((*seats.q.shape[:2], 3))
    if cause == CONTACT:
        off += size * rng.normal(size=off.shape)
    elif cause == ODD:
        by_noise = size * np.sqrt(of_encoder_noise(seats).second[0])
        off[SIXTH] = (local_noise_needed(by_noise) * rng.normal(size=off.shape))[SIXTH]
    target = seats.model.predict(seats.all_q) + off.reshape(-1, 3)
    q, arrived = brought_to(lambda q, _: truth.state(q), seats.all_q, target, truth.arm.limits)
    if not arrived.all():
        raise AacmmError(f"{cause}: {(~arrived).sum()} tips cannot be brought to their seats within the limits")
    labels = np.repeat(np.array([f"S{k + 1}" for k in range(len(seats.q))], dtype=object), seats.q.shape[1])
    readings = q + (size if cause in (NOISE, ODD) else ENCODER) * rng.normal(size=q.shape)
    return Measurements.of(readings, conditions=Conditions(len(q), seat=labels), source=f"simulated, {cause}")
