"""Accuracy of the real model by draws of its error sources: exact, nothing linearised; the check on first order."""

from __future__ import annotations

import numpy as np
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin._support.progress import watched
from aacmm_pin.accuracy.error_sources import ErrorSources
from aacmm_pin.accuracy.parameter_draws import drawn_effects
from aacmm_pin.arm.dh import chunks
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import displaced
from aacmm_pin.errors import AacmmError

FEWEST_DRAWS = 100


def exact_volume(
    sources: ErrorSources,
    q: Array,
    conditions: Conditions | None,
    rng: np.random.Generator,
    draws: int,
    progress: bool = False,
) -> tuple[Array, Array, Array]:
    """Accuracy volume, its sampling error and the covariance of the position, from ``draws`` at each configuration.

    Returns:
        volume (n,) [m³], how far half of the draws change it (n,) [m³], covariance (n, 3, 3) [m²].

    Raises:
        AacmmError: fewer than 100 draws.
    """
    if draws < FEWEST_DRAWS:
        raise AacmmError(f"draws is {draws}, expected at least {FEWEST_DRAWS}")
    volume, error, covariance = np.empty(len(q)), np.empty(len(q)), np.empty((len(q), 3, 3))
    generators = sources.generators(q, conditions)
    with watched(range(len(q)), progress, "Monte Carlo", "posture") as postures:
        for k in postures:
            record = None if conditions is None else conditions.take([k])
            corners = exact_positions(sources, q[k : k + 1], record, _corners(sources, generators[k], rng, draws))
            volume[k] = scipy.spatial.ConvexHull(corners).volume
            error[k] = volume[k] - scipy.spatial.ConvexHull(corners[: draws // 2]).volume
            covariance[k] = np.cov(exact_positions(sources, q[k : k + 1], record, _errors(sources, rng, draws)).T)
    return volume, error, covariance


def _corners(sources: ErrorSources, generators: Array, rng: np.random.Generator, m: int) -> Array:
    """Errors (m, p) at the corners of the box, for correlated sources along their principal axes, that go farthest along
    random directions; any corner is possible, so the hull never exceeds the true set, and random interior draws would
    leave most of it empty.
    """
    pick = list(sources.bounded)
    signs = np.sign(rng.normal(size=(m, 3)) @ generators)
    if sources.axes is not None:
        signs = signs @ sources.axes[np.ix_(pick, pick)].T
    errors = np.zeros((m, len(sources.parameters)))
    errors[:, pick] = signs * sources.half_widths
    return errors


def _errors(sources: ErrorSources, rng: np.random.Generator, m: int) -> Array:
    """Draws (m, p) of all sources: rectangular where u is that of the bounds, half-width/√3, else normal, jointly where
    they are correlated (JCGM 101:2008, 6.4).
    """
    normal = rng.normal(size=(m, len(sources.parameters)))
    errors = (normal if sources.axes is None else normal @ sources.axes.T) * sources.u
    for i, half_width in zip(sources.bounded, sources.half_widths, strict=True):
        if np.isclose(half_width, np.sqrt(3.0) * sources.parameters[i].u, rtol=1e-9, atol=0.0):
            errors[:, i] = rng.uniform(-1.0, 1.0, size=m) * half_width
    return errors


def exact_positions(sources: ErrorSources, q: Array, conditions: Conditions | None, errors: Array) -> Array:
    """Positions of the real model with ``errors`` in the sources.

    With effects the geometry is moved as the causes ``link_length``, ``joint_distance``, ``link_twist`` and
    ``joint_zero_offset`` move it: exactly, but the lengths that bend and grow warm remain those of the table, so that an
    error of a length counts without its own warmth and sag, a few parts in ten thousand of it.

    Args:
        sources: what may be off.
        q: one configuration (1, nq) [rad].
        conditions: of that one record.
        errors: (m, p) [SI].

    Returns:
        (m, 3) [m].
    """
    arm, count = sources.arm, len(sources.model.parameters)
    whole = np.zeros((len(errors), count + arm.nq))
    whole[:, list(sources.columns)] = errors
    moved, q = whole[:, :count], q + whole[:, count:]
    if not sources.effects:
        return arm.perturbed_positions(q, moved[:, : len(arm.parameters)], sources.at)
    conditions = Conditions(1) if conditions is None else conditions
    positions = np.empty((len(errors), 3))
    for part in chunks(len(errors)):
        records = conditions.take(np.zeros(len(q[part]), dtype=np.intp))
        drawn = tuple(e for e in drawn_effects(sources.model, moved[part]) if e not in sources.left_out)
        positions[part] = displaced(arm, drawn, q[part], records, arm.place(sources.at), False).position
    return positions
