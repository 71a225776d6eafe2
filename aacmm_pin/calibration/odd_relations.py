"""Stated distances and angles of planes, and lengths of bars, that all else contradicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.linearisation import Linearisation
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import ANGLE, DISTANCE, OF_BAR, TILTS

ODD_RELATION = 4.0
"""A relation so many standard deviations off may have another value; chance: 1 of 16 000."""
REDUNDANCY = 1e-3
"""Least share of all else in a relation."""
IMPOSSIBLE = 30.0
"""A relation off by so many standard deviations, and by more than …"""
GROSS_DISTANCE = 3e-4
GROSS_SCALE = 2e-3
GROSS_ANGLE = 5e-3
"""… these [m; part of the distance; rad] is mistyped: no cause acts so unequally on one body."""


def deviations_of_relations(system: Linearisation) -> Array:
    """Deviation of each relation from all else, in standard deviations (b,): deletion residuals
    (Belsley, Kuh, Welsch 1980, eq. 2.27), one Gauss–Newton step away. Divided by ``(1 + H Hᵀ)^½``
    again, rows of relations that share seats are deviations.
    """
    inverse = np.linalg.inv(system.elimination.relation_factor)
    rows = slice(-len(inverse), None)
    steps = system.jacobian[rows] @ system.independent_steps
    residual = inverse.T @ (system.residual[rows] - steps @ system.solution.along)
    variance = np.diag(inverse.T @ (np.eye(len(inverse)) - steps @ steps.T) @ inverse)
    least = REDUNDANCY * np.square(inverse).sum(axis=0)
    return np.asarray(np.abs(residual) / np.sqrt(np.maximum(variance, least)))


def odd_relation(after: Fit) -> Note | None:
    """A note on the relation that all else contradicts most."""
    observations = after.observations
    if len(observations.ends) < 2:
        return None
    deviations = deviations_of_relations(after.system)
    worst = int(deviations.argmax())
    data = {"deviations": float(deviations[worst])}
    if deviations[worst] < ODD_RELATION:
        return None
    kind = observations.relation[worst]
    ends = [observations.labels[end] for end in observations.ends[worst]]
    if kind == OF_BAR:
        bars = after.problem.measurements.bars()
        bar = next(bar.bar for bar in bars if [bar.seat_a, bar.seat_b] == ends)
        return Note("bar_length_off", data | {"bar": bar})
    word = DISTANCE if kind == DISTANCE else ANGLE
    return Note("relation_off", data | {"kind": word, "planes": ends})


def require_possible_relations(problem: Problem) -> None:
    """Compare the relations of planes with a fit without them.

    Raises:
        AacmmError: one is off by far more than an arm can be.
    """
    records = problem.measurements
    stated = observations_of(records, problem.setup)
    of_planes = stated.relation != OF_BAR
    if not of_planes.any():
        return
    free = fit(problem.of(replace(records, relations=())))
    names = ("ends", "relation", "value", "value_u")
    related = replace(free.observations, **{name: getattr(stated, name) for name in names})
    noise = replace(free.noise, observations=related)
    system = Fit.at(problem, noise, free.point, free.weights).system
    # All relations may be wrong alike, by a wrong diameter of the probe.
    deviations = np.maximum(
        deviations_of_relations(system), _deviations_from_free(system, free.system)
    )
    is_tilt = np.isin(related.relation, TILTS)
    as_angles = replace(related, relation=np.where(is_tilt, ANGLE, related.relation))
    excess = as_angles.relation_residuals(free.point.seats)[0] * related.value_u
    is_distance = related.relation == DISTANCE
    gross = np.where(is_distance, GROSS_DISTANCE + GROSS_SCALE * related.value, GROSS_ANGLE)
    impossible = of_planes & (deviations >= IMPOSSIBLE) & (np.abs(excess) >= gross)
    if not impossible.any():
        return
    worst = int(np.where(impossible, deviations, 0.0).argmax())
    excess_in_words = f"angle by {excess[worst] / DEG:+.3g}°"
    if is_distance[worst]:
        excess_in_words = f"distance by {excess[worst] / MM:+.3g} mm"
    one, other = (related.labels[end] for end in related.ends[worst])
    raise AacmmError(
        f"{records.source}: the contacts of planes {one!r} and {other!r} contradict the stated "
        f"{excess_in_words} ({deviations[worst]:.0f} standard deviations); expected a value that "
        "agrees with the contacts; check the distance, the angle (0: same side, 180: opposite "
        "sides), probe_diameter_mm and the labels of the contacts"
    )


def _deviations_from_free(system: Linearisation, free: Linearisation) -> Array:
    """Innovation of each relation after a fit without any, in standard deviations (b,)."""
    factor = system.elimination.relation_factor
    rows = system.jacobian[-len(factor) :] @ free.independent_steps
    spread = np.hstack([factor, factor @ rows])
    residual = factor @ system.residual[-len(factor) :]
    return np.asarray(np.abs(residual) / np.linalg.norm(spread, axis=1))
