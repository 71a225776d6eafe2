"""Random errors of parameters, and their exact effect on the tip."""

from __future__ import annotations

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array, chunks
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.effects import Conditions, ErrorModel, displaced, of_geometry

FEWEST_DRAWS = 100
"""For a volume or an interval."""
FLAT = 1e-13
"""Part of coordinates by which rounding moves points off a plane."""


def parameter_errors(model: ErrorModel, rng: np.random.Generator, count: int) -> Array:
    """Random errors of all parameters, (count, p) [their units].

    Those in the covariance of the arm file are jointly normal (JCGM 101:2008, 6.4.8), others with
    bounds rectangular (6.4.2), the rest normal (6.4.7).
    """
    parameters = model.parameters
    covariance_of_file = model.arm.covariance
    correlated = () if covariance_of_file is None else covariance_of_file.parameters
    bounded = np.array([p.half_width is not None and p.name not in correlated for p in parameters])
    covariance = model.covariance()
    u = np.sqrt(np.diag(covariance))
    half_width = np.array([p.half_width or 0.0 for p in parameters])
    errors = np.zeros((count, len(parameters)))
    uniform = rng.uniform(-1.0, 1.0, size=(count, int(bounded.sum())))
    errors[:, bounded] = uniform * half_width[bounded]
    normal = np.flatnonzero(~bounded & (u > 0))
    correlation = covariance[np.ix_(normal, normal)] / np.outer(u[normal], u[normal])
    variance, direction = np.linalg.eigh(correlation)
    # A correlation matrix that was rounded in a file may have eigenvalues a little below zero: they
    # are zero.
    root = direction * np.sqrt(np.maximum(variance, 0.0))
    errors[:, normal] = rng.normal(size=(count, len(normal))) @ root.T * u[normal]
    return errors


def exact_volume(
    sources: ErrorSources,
    draws: int,
    part: tuple[Array, Conditions | None, list[np.random.Generator]],
) -> tuple[Array, Array]:
    """Volume and covariance in some postures.

    Args:
        sources: parameters with an uncertainty.
        draws: for each volume, and again for each covariance.
        part: postures (n, nq) [rad], conditions, a random generator for each.

    Returns:
        (n,) [m³], and (n, 3, 3) [m²].
    """
    q, conditions, rngs = part
    volume = np.empty(len(q))
    covariance = np.empty((len(q), 3, 3))
    generators = sources.generators(sources.sensitivity(q, conditions))
    for k, rng in enumerate(rngs):
        posture = q[k : k + 1]
        record = None if conditions is None else conditions.take([k])
        extreme_errors = _corners(sources, generators[k], rng, draws)
        volume[k] = _hull_volume(exact_positions(sources, posture, record, extreme_errors))
        errors = source_errors(sources, rng, draws)
        covariance[k] = np.cov(exact_positions(sources, posture, record, errors).T)
    return volume, covariance


def _hull_volume(points: Array) -> float:
    """Of the convex hull of points (m, 3) [m³]; 0 in a plane."""
    centred = points - points.mean(axis=0)
    _, _, principal_axes = np.linalg.svd(centred, full_matrices=False)
    thickness = np.ptp(centred @ principal_axes[-1])
    if thickness <= FLAT * np.abs(points).max():
        return 0.0
    return float(scipy.spatial.ConvexHull(points).volume)


def _corners(sources: ErrorSources, generators: Array, rng: np.random.Generator, m: int) -> Array:
    """Errors (m, p) at the corners farthest along random directions.

    Their hull never exceeds the true set; interior errors would leave most of it empty.
    """
    bounded = list(sources.bounded)
    signs = np.sign(rng.normal(size=(m, 3)) @ generators)
    if sources.axes is not None:
        signs = signs @ sources.axes[np.ix_(bounded, bounded)].T
    errors = np.zeros((m, len(sources.parameters)))
    errors[:, bounded] = signs * sources.half_widths
    return errors


def source_errors(sources: ErrorSources, rng: np.random.Generator, m: int) -> Array:
    """Random errors (m, p), and normal ones of readings."""
    model = sources.model
    noise = rng.normal(size=(m, sources.arm.nq))
    columns = np.array(sources.columns)
    errors = np.hstack([parameter_errors(model, rng, m), noise])[:, columns]
    is_noise = columns >= len(model.parameters)
    errors[:, is_noise] *= sources.u[is_noise]
    return errors


def exact_positions(
    sources: ErrorSources, q: Array, conditions: Conditions | None, errors: Array
) -> Array:
    """Exact positions (m, 3) [m] at ``q`` (1, nq) [rad] with ``errors`` (m, p) [SI].

    Errors of causes act in the posture without them, and lengths that bend and expand stay
    nominal: this neglects some 1e-4 of an error.
    """
    arm = sources.arm
    causes = (*of_geometry(arm), *sources.model.effects)
    ends = np.cumsum([len(cause.terms) for cause in causes])
    all_errors = np.zeros((len(errors), ends[-1] + arm.nq))
    all_errors[:, list(sources.columns)] = errors
    *errors_of_causes, noise = np.split(all_errors, ends, axis=1)
    conditions = Conditions(1) if conditions is None else conditions
    place = arm.place(sources.at)
    state = displaced(arm, sources.effects, q, conditions, place, False)
    twists = {at: np.tile(twist[0], (len(errors), 1)) for at, twist in state.twists.items()}
    for cause, of_cause in zip(causes, errors_of_causes, strict=True):
        for displacement in cause.displacements(state) if of_cause.any() else ():
            twist = of_cause @ displacement.columns[0].T
            twists[displacement.place] = twists.get(displacement.place, 0.0) + twist
    readings = arm.readings(q) + noise
    positions = np.empty((len(errors), 3))
    for part in chunks(len(errors)):
        of_part = {at: twist[part] for at, twist in twists.items()}
        _, origin = arm.chain.walk(arm.joint_angles(readings[part]), of_part)
        positions[part] = origin[place]
    return positions
