"""Scatter of tips, of turns and of seats beyond the stated noise: variance components by which χ²
meets its freedom.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import f_isf
from aacmm_pin.calibration.noise_model import Scatters
from aacmm_pin.calibration.solver import LEAST_DOF, MEDIAN, Solution

FALSE_EXCLUSION = 0.01
"""Chance that any good record is excluded, over the whole file."""
EFFICIENCY = 0.53
"""A scatter taken from the median of χ² with three degrees is as certain as from this part of all
the records' numbers."""
LEAST_TOLD = 1e-3
"""A seat of whose coordinates refitting leaves less than this tells nothing of their scatter."""
LEAST_SCATTER = 1e-10
"""Data from a computer may fit without any residual; the scatter then counts as this [m]."""


def variance_components(solution: Solution, used: Mask, open_: Mask) -> Scatters:
    """Scatters beyond the stated noise with which χ² of tips, of turns and of the coordinates of
    seats (s, 3) that are ``open_``, for nobody stated their uncertainty, meet their degrees of
    freedom.
    """
    seat, dof = _of_seats(solution, open_) if open_.any() else (0.0, 0.0)
    tip, turn = (_variance_component(solution, used, turns, open_, dof) for turns in (False, True))
    return Scatters(tip, turn, seat)


def _variance_component(
    solution: Solution, used: Mask, turns: bool, open_: Mask, dof_of_seats: float
) -> float:
    """Scatter beyond the stated noise with which χ² meets its degrees of freedom; as it was where
    there are none [m].

    That of tips, beside the coordinates of seats (s, 3) that are ``open_`` and have degrees of
    freedom of their own; or of turns [rad], which are looked at beside what the tips say already.
    """
    noise = solution.noise
    own = solution.noise.without_scatter[used]
    of_turns = solution.turn_dof
    scatters = noise.scatters
    dof = of_turns if turns else solution.chi2.dof - of_turns - dof_of_seats
    if dof < LEAST_DOF:
        return scatters.turn if turns else scatters.tip
    deviation = solution.system.off[used]
    seats = solution.point.seats
    ties = (
        np.where(open_, 0.0, noise.observations.of_seats(seats)),
        noise.observations.of_bars(seats)[0],
    )
    rest = sum(float(np.square(tie).sum()) for tie in ties)
    varied = np.eye(3)
    if turns:
        own[:, :3, :3] += scatters.tip**2 * np.eye(3)
        rest = -float(squared_distances(deviation[:, :3], own[:, :3, :3]).sum())
        varied = np.diag([0.0, 0, 0, 1, 1, 1])
    else:
        deviation = deviation[:, :3]
        own = own[:, :3, :3]

    def excess(variance: float) -> float:
        distances = squared_distances(deviation, own + variance * varied)
        return float(distances.sum()) + rest - dof

    return float(np.sqrt(root(excess, deviation[:, -3:])))


def _of_seats(solution: Solution, open_: Mask) -> tuple[float, float]:
    """Scatter of the coordinates of seats (s, 3) that are ``open_`` [m], and degrees of freedom of
    all of them.

    Their residuals over what refitting leaves of them, the almost unbiased estimate of a variance
    component (Horn, Horn and Duncan 1975, J. Am. Stat. Assoc. 70). Few seats tell it poorly: as one
    number more the scatter of the tips counts. Seats that are outliers beside the better half, such
    as one that was moved, have no part in it.
    """
    noise = solution.noise
    system = solution.system
    known = solution.noise.observations.known
    ties = 3 * int(known.sum())
    bars = len(noise.observations.ends)
    first = len(system.residual) - ties - bars
    steps = system.jacobian[first : first + ties] @ system.independent_steps
    by_parameters = np.square(steps).sum(axis=1).reshape(-1, 3)
    whole, tie, _ = information_of_seats(solution)
    variances = np.diagonal(np.linalg.inv(whole[known]), axis1=1, axis2=2)
    parts = 1.0 - tie[known] * variances - by_parameters
    left = np.where(open_[known], parts, 0.0).sum(axis=1)
    off = np.where(open_, solution.point.seats - noise.observations.stated, 0.0)
    square = np.square(off[known]).sum(axis=1)
    dof = float(left.sum())
    is_shown = left > LEAST_TOLD
    square = square[is_shown]
    left = left[is_shown]
    each = square / left
    own = noise.scatters.tip**2
    limit = f_isf(FALSE_EXCLUSION / max(each.size, 1), 3, max(EFFICIENCY * dof, 1.0))
    middle = float(np.median(each)) if each.size else 0.0
    belongs = each <= limit * (3.0 / MEDIAN) * max(middle, own)
    variance = (square[belongs].sum() + own) / (left[belongs].sum() + 1.0)
    return float(np.sqrt(variance)), dof


def information_of_seats(solution: Solution) -> tuple[Array, Array, Array]:
    """Of where each seat is (s, 3, 3) [1/m²], without bars; its coordinates' part of it, the
    diagonal (s, 3); that of each record that touches one (records, 3, 3).
    """
    observations = solution.noise.observations
    touched = np.flatnonzero(observations.seat >= 0)
    of_records = np.linalg.inv(solution.noise.of_residuals[touched, :3, :3])
    of_records = solution.weights[touched, None, None] * of_records
    tie = np.where(observations.known[:, None], observations.stated_u, np.inf) ** -2.0
    whole = tie[:, :, None] * np.eye(3)
    np.add.at(whole, observations.seat[touched], of_records)
    return whole, tie, np.asarray(of_records)


def squared_distances(deviation: Array, covariance: Array) -> Array:
    """``dᵀ Σ⁻¹ d`` of each deviation (n, k) by its covariance (n, k, k)."""
    # Stated noise may be nothing at all, of an exact contact with exact readings.
    width = deviation.shape[1]
    covariance = covariance + LEAST_SCATTER**2 * np.eye(width)
    weighted = np.linalg.solve(covariance, deviation[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ni,ni->n", deviation, weighted))


def root(excess: Callable[[float], float], deviation: Array) -> float:
    """Variance at which ``excess``, which falls with it, vanishes; the largest that can be where it
    does not.
    """
    low = LEAST_SCATTER**2
    high = 10 * (float(np.square(deviation).sum()) + LEAST_SCATTER**2)
    if excess(low) <= 0:
        return low
    return (
        high
        if excess(high) > 0
        else float(scipy.optimize.brentq(excess, low, high, xtol=1e-24, rtol=1e-10))
    )
