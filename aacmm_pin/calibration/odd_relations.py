"""Stated distances and angles of planes, and lengths of bars, that all else contradicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.linearisation import Linearisation
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.solver import solution_at
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import DISTANCE

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


def odd_relation(system: Linearisation) -> tuple[int, float]:
    """The relation that is farthest off what all else says, and by how many standard deviations: by
    its deletion residual (Belsley, Kuh, Welsch 1980, eq. 2.27), one Gauss–Newton step away.

    The rows of relations that share a seat are those of what they are off by without them, over
    ``(1 + H Hᵀ)^½``; so divided again, they are what the relations are off by with them.
    """
    inverse = np.linalg.inv(system.elimination.relation_factor)
    rows = slice(-len(inverse), None)
    steps = system.jacobian[rows] @ system.independent_steps
    residual = inverse.T @ (system.residual[rows] - steps @ system.solution.along)
    variance = np.diag(inverse.T @ (np.eye(len(inverse)) - steps @ steps.T) @ inverse)
    least = REDUNDANCY * np.square(inverse).sum(axis=0)
    deviations = np.abs(residual) / np.sqrt(np.maximum(variance, least))
    return int(deviations.argmax()), float(deviations.max())


def require_possible_relations(problem: Problem) -> None:
    """Compare the relations of planes with a fit without them.

    Raises:
        AacmmError: one is off by far more than an arm can be; see :func:`fit`.
    """
    records = problem.measurements
    if not records.relations:
        return
    free = fit(problem.of(replace(records, relations=())))
    stated = observations_of(records, problem.setup)
    names = ("ends", "relation", "value", "value_u")
    at = replace(free.observations, **{name: getattr(stated, name) for name in names})
    noise = replace(free.noise, observations=at)
    system = solution_at(problem, noise, free.point, free.used.astype(np.float64)).system
    worst, deviations = odd_relation(system)
    excess = float(at.of_relations(free.point.seats)[0][worst] * at.value_u[worst])
    kind = at.relation[worst]
    of_distance = GROSS_DISTANCE + GROSS_SCALE * float(at.value[worst])
    if deviations < IMPOSSIBLE or abs(excess) < (of_distance if kind == DISTANCE else GROSS_ANGLE):
        return
    what = (
        f"distance by {excess / MM:+.3g} mm"
        if kind == DISTANCE
        else f"angle by {excess / DEG:+.3g}°"
    )
    one, other = (at.labels[end] for end in at.ends[worst])
    raise AacmmError(
        f"{records.source}: the contacts of planes {one!r} and {other!r} contradict the stated "
        f"{what} ({deviations:.0f} standard deviations); expected a value that agrees with the "
        "contacts; check the distance, the angle (0: same side, 180: opposite sides), "
        "probe_diameter_mm and the labels of the contacts"
    )
