"""Stated distances and angles of planes, and lengths of bars, that all else contradicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.linearisation import Linearisation
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.solver import solution_at
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import DISTANCE, OF_BAR

REDUNDANCY = 1e-3
"""Of a relation of which all else says less than this share, nobody can say how far it is off."""
IMPOSSIBLE = 30.0
"""A relation that is off by so many standard deviations, and by more than …"""
GROSS_DISTANCE = 3e-4
GROSS_SCALE = 2e-3
GROSS_ANGLE = 5e-3
"""… these [m; part of the distance; rad] is mistyped: no cause of error acts so unequally on the
faces of one body.
"""


def deviations_of_relations(system: Linearisation) -> Array:
    """How many standard deviations each relation is off what all else says (b,): deletion residuals
    (Belsley, Kuh, Welsch 1980, eq. 2.27), one Gauss–Newton step away.

    The rows of relations that share a seat are those of what they are off by without them, over
    ``(1 + H Hᵀ)^½``; so divided again, they are what the relations are off by with them.
    """
    inverse = np.linalg.inv(system.elimination.relation_factor)
    rows = slice(-len(inverse), None)
    steps = system.jacobian[rows] @ system.independent_steps
    residual = inverse.T @ (system.residual[rows] - steps @ system.solution.along)
    variance = np.diag(inverse.T @ (np.eye(len(inverse)) - steps @ steps.T) @ inverse)
    least = REDUNDANCY * np.square(inverse).sum(axis=0)
    return np.asarray(np.abs(residual) / np.sqrt(np.maximum(variance, least)))


def require_possible_relations(problem: Problem) -> None:
    """Compare the relations of planes with a fit without them.

    Raises:
        AacmmError: one is off by far more than an arm can be; see :func:`fit`.
    """
    records = problem.measurements
    stated = observations_of(records, problem.setup)
    of_planes = stated.relation != OF_BAR
    if not of_planes.any():
        return
    free = fit(problem.of(replace(records, relations=())))
    names = ("ends", "relation", "value", "value_u")
    at = replace(free.observations, **{name: getattr(stated, name) for name in names})
    noise = replace(free.noise, observations=at)
    system = solution_at(problem, noise, free.point, free.used.astype(np.float64)).system
    deviations = np.where(of_planes, deviations_of_relations(system), 0.0)
    worst = deviations.argmax()
    excess = float(at.of_relations(free.point.seats)[0][worst] * at.value_u[worst])
    if at.relation[worst] == DISTANCE:
        gross = GROSS_DISTANCE + GROSS_SCALE * float(at.value[worst])
        what = f"distance by {excess / MM:+.3g} mm"
    else:
        gross = GROSS_ANGLE
        what = f"angle by {excess / DEG:+.3g}°"
    if deviations[worst] < IMPOSSIBLE or abs(excess) < gross:
        return
    one, other = (at.labels[end] for end in at.ends[worst])
    raise AacmmError(
        f"{records.source}: the contacts of planes {one!r} and {other!r} contradict the stated "
        f"{what} ({deviations[worst]:.0f} standard deviations); expected a value that agrees with "
        "the contacts; check the distance, the angle (0: same side, 180: opposite sides), "
        "probe_diameter_mm and the labels of the contacts"
    )
