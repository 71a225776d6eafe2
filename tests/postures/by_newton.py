"""Postures at a pose by Newton's method in Pinocchio alone (log6, frame Jacobian), from starts that
the caller draws.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm


def by_newton(arm: Arm, pose: Array, starts: Array) -> Array:
    """Those solutions (n, nq) [rad] for ``pose`` (4, 4) that are reached from ``starts``
    (m, nq).
    """
    data, frame = arm.model.createData(), arm.model.getFrameId(arm.tip, pin.FrameType.BODY)
    goal, found = pin.SE3(pose[:3, :3], pose[:3, 3]), []
    for start in starts:
        q = start.copy()
        for _ in range(60):
            pin.framesForwardKinematics(arm.model, data, q)
            off = data.oMf[frame].actInv(goal)
            error = pin.log6(off).vector
            if np.linalg.norm(error) < 1e-11:
                found.append(q)
                break
            jacobian = pin.Jlog6(off.inverse()) @ pin.computeFrameJacobian(
                arm.model, data, q, frame, pin.LOCAL
            )
            damping = 1e-8 * error @ error
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(6), error)
            q += step * min(1.0, 0.8 / np.linalg.norm(step))
    return np.array(found).reshape(-1, arm.nq)


def gaps(one: Array, other: Array) -> Array:
    """Differences of angles, modulo full turns, between rows of ``one`` (n, nq) and of ``other``
    (m, nq): (n, m, nq).
    """
    return np.asarray((one[:, None] - other[None] + np.pi) % (2 * np.pi) - np.pi)


def distances(one: Array, other: Array) -> Array:
    """Largest difference of any angle, modulo full turns: (n, m)."""
    return np.asarray(np.abs(gaps(one, other)).max(axis=2))


def off_polylines(q: Array, component: Array, vertices: Array) -> Array:
    """Distance of each ``q`` (n, nq) from the closed polylines through the ``vertices`` of each
    component, (n,) [rad].
    """
    best = np.full(len(q), np.inf)
    for number in np.unique(component):
        mine = vertices[component == number]
        way = np.diagonal(gaps(np.roll(mine, -1, axis=0), mine)).T
        to = gaps(q, mine)
        part = np.clip(np.einsum("nmi,mi->nm", to, way) / np.einsum("mi,mi->m", way, way), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(to - part[:, :, None] * way, axis=2).min(axis=1))
    return best
