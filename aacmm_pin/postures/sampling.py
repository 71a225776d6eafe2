"""Postures of any arm, also one that came as URDF: brought to a point, and chosen to differ."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aacmm_pin._support.batches import chunks
from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.arm import Arm, joint_bounds
from aacmm_pin.effects import State

StateOf = Callable[[Array, Index], State]
"""The arm at indications (m, nq) that belong to the records with these numbers (m,)."""

TOUCHING = 1e-12
"""A tip this near to a point is there [m]."""
MOST_ROUNDS = 30
"""Of the search for a posture at a point."""
LONGEST_STEP = 0.5
"""Of one round [rad, m]."""
MIN_MOBILITY_RATIO = 0.01
"""A posture whose tip moves this many times less easily in one direction than in another is left
out.
"""
DIFFERENT = 0.02
"""Postures differ when they are this far apart, see :func:`posture_features`; about as many
radians.
"""


def tip_jacobian(state: State) -> Array:
    """∂tip/∂q (n, 3, nq) [m/rad] of the arm as it stands, its displacements taken as constant."""
    jacobian, _ = state.arm.chain.jacobian(state.rotation, state.origin, state.position)
    return jacobian


def brought_to(state_of: StateOf, q: Array, target: Array, bounds: Array) -> tuple[Array, Mask]:
    """Postures near ``q`` whose tips are at ``target``, by a damped Newton method of least steps
    that stays in ``bounds``.

    A step is ``Jᵀ (J Jᵀ + λ² I)⁻¹ (target - tip)`` with λ² = |target - tip|²/10, which vanishes on
    arrival (Nakamura, Hanafusa 1986; the damping is ours).

    Args:
        state_of: the arm.
        q: where to start (n, nq) [rad].
        target: (n, 3) [m].
        bounds: (nq, 2) [rad].

    Returns:
        Postures (n, nq), and which of them have arrived (n,); the others stand where they got
        stuck.
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
            q[active] = np.clip(q[active] + _step(jacobian, miss), bounds[:, 0], bounds[:, 1])
    return q, arrived


def _step(jacobian: Array, miss: Array) -> Array:
    damping = 0.1 * np.einsum("ni,ni->n", miss, miss)[:, None, None] * np.eye(3)
    square = jacobian @ jacobian.transpose(0, 2, 1) + damping
    square += 1e-15 * np.eye(3)  # an arm with fewer joints than directions has no inverse
    pull = np.linalg.solve(square, miss[:, :, None])
    step = (jacobian.transpose(0, 2, 1) @ pull)[:, :, 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * (LONGEST_STEP / np.maximum(longest, LONGEST_STEP)))


def agile(state: State) -> Mask:
    """Which tips can move about alike in all directions in which any of them can, see
    :data:`MIN_MOBILITY_RATIO`: (n,).
    """
    easiness = np.linalg.svd(tip_jacobian(state), compute_uv=False)
    most = easiness[:, :1]
    directions = (easiness > 1e-9 * most).any(axis=0)
    is_easy = easiness[:, directions] > MIN_MOBILITY_RATIO * most
    return np.asarray(is_easy.all(axis=1))


def posture_features(arm: Arm, q: Array) -> Array:
    """Numbers whose distance says how different postures are: cosine and sine of angles, slides
    over their range.

    A whole turn makes no difference; a small turn of one joint by δ is a distance of δ.
    """
    bounds = joint_bounds(arm)
    slides = arm.chain.prismatic
    turns = q[:, ~slides]
    span = bounds[slides, 1] - bounds[slides, 0]
    return np.concatenate(
        [np.cos(turns), np.sin(turns), (q[:, slides] - bounds[slides, 0]) / span], axis=1
    )


def spread_out(features: Array, count: int, apart: float) -> Index:
    """Numbers of ``count`` different rows, far from one another; fewer where no more are ``apart``
    from all the others.

    Farthest-point order: each is the row farthest from all before it (Gonzalez 1985); the first is
    row 0.
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
    """``count`` of the postures ``q`` (n, nq), spread out, or as many as differ from one
    another.
    """
    return q[spread_out(posture_features(arm, q), count, DIFFERENT)]
