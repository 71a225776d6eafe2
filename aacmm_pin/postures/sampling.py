"""Postures of any arm, brought to a point, or chosen to differ."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask, chunks
from aacmm_pin.arm import Arm, joint_bounds
from aacmm_pin.effects import State

StateOf = Callable[[Array, Index], State]
"""The arm at readings (m, nq) of records with these numbers (m,)."""

TOUCHING = 1e-12
"""Distance at which a tip is at a point [m]."""
MOST_ROUNDS = 30
LONGEST_STEP = 0.5
"""[rad, m]"""
MIN_MOBILITY_RATIO = 0.01
"""Least ratio of the tip's mobilities in its directions; other postures are omitted."""
DIFFERENT = 0.02
"""Distance of the cosines and sines from which postures differ, about the same in rad."""


def tip_jacobian(state: State) -> Array:
    """∂tip/∂q (n, 3, nq) [m/rad], displacements of causes held."""
    jacobian, _ = state.arm.chain.jacobian(state.rotation, state.origin, state.position)
    return jacobian


def brought_to(state_of: StateOf, q: Array, target: Array, bounds: Array) -> tuple[Array, Mask]:
    """Postures near ``q`` (n, nq) [rad] with tips at ``target`` (n, 3) [m], inside ``bounds`` (nq,
    2).

    Damped least-norm Newton steps ``Jᵀ (J Jᵀ + λ² I)⁻¹ (target - tip)``, λ² = |target - tip|²/10
    (Nakamura, Hanafusa 1986; the damping is ours).

    Returns:
        postures (n, nq), and which arrived (n,).
    """
    q, arrived = q.copy(), np.zeros(len(q), dtype=bool)
    for part in chunks(len(q)):
        active = np.arange(part.start, part.stop)
        for _ in range(MOST_ROUNDS):
            state = state_of(q[active], active)
            miss = target[active] - state.position
            far = np.linalg.norm(miss, axis=1) > TOUCHING
            arrived[active[~far]] = True
            if not far.any():
                break
            active = active[far]
            miss = miss[far]
            jacobian = tip_jacobian(state)[far]
            transposed = jacobian.transpose(0, 2, 1)
            damping = 0.1 * np.einsum("ni,ni->n", miss, miss)[:, None, None] * np.eye(3)
            square = jacobian @ transposed + damping
            square += 1e-15 * np.eye(3)  # an arm with fewer joints than directions has no inverse
            step = (transposed @ np.linalg.solve(square, miss[:, :, None]))[:, :, 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            step *= LONGEST_STEP / np.maximum(longest, LONGEST_STEP)
            q[active] = np.clip(q[active] + step, *bounds.T)
    return q, arrived


def agile(state: State) -> Mask:
    """Which tips can move about alike in all possible directions: (n,)."""
    mobility = np.linalg.svd(tip_jacobian(state), compute_uv=False)  # m per unit of joint motion
    most = mobility[:, :1]
    is_possible = (mobility > 1e-9 * most).any(axis=0)
    is_easy = mobility[:, is_possible] > MIN_MOBILITY_RATIO * most
    return np.asarray(is_easy.all(axis=1))


def spread_out(features: Array, count: int, apart: float) -> Index:
    """Numbers of at most ``count`` rows, each at least ``apart`` from the others.

    Farthest-point order from row 0 (Gonzalez 1985).
    """
    if not len(features):
        return np.empty(0, dtype=np.intp)
    chosen = [0]
    distance = np.full(len(features), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(features - features[chosen[-1]], axis=1))
        farthest = int(distance.argmax())
        if distance[farthest] < apart or distance[farthest] == 0.0:
            break
        chosen.append(farthest)
    return np.array(chosen, dtype=np.intp)


def different_postures(arm: Arm, q: Array, count: int) -> Array:
    """At most ``count`` postures of ``q`` (n, nq), different by more than whole revolutions."""
    slides = arm.chain.prismatic
    low, high = joint_bounds(arm)[slides].T
    angles = q[:, ~slides]
    fractions = (q[:, slides] - low) / (high - low)
    features = np.hstack([np.cos(angles), np.sin(angles), fractions])
    return q[spread_out(features, count, DIFFERENT)]
