"""What the tests work out by other means than the package: Pinocchio alone, models made anew,
differences, determinants, Newton's method; and one comparison for all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pinocchio as pin

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, ArmFile, Poses

DH_KEYS = ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad")


def close(found: Array, expected: Array, atol: float = 1e-12) -> None:
    """``found`` is ``expected`` within ``atol``, in every element."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


def postures(arm: Arm, rng: np.random.Generator, n: int) -> Array:
    """Uniform within the limits, of which at most -π to 2π: (n, nq) [rad]."""
    return rng.uniform(*np.clip(arm.limits, -np.pi, 2 * np.pi).T, (n, arm.nq))


def jacobian_of(poses: Poses) -> Array:
    """Jacobian of Pinocchio (n, 6, nq) in ``LOCAL_WORLD_ALIGNED``, linear part first."""
    model, data = poses.model, poses.model.createData()
    jacobians = [
        pin.computeFrameJacobian(model, data, q, poses.frame_id, pin.LOCAL_WORLD_ALIGNED)
        for q in poses.q
    ]
    return np.reshape(jacobians, (len(poses.q), 6, model.nv))


def perturbed_positions(arm: Arm, q: Array, errors: Array, at: str | None = None) -> Array:
    """Exact positions (m, 3) [m] with ``errors`` (m, p) of the parameters, at one posture or one
    for each row of errors.
    """
    twists: dict[int, Array] = {}
    for (place, component), error in zip(arm.chain.parameters.tolist(), errors.T, strict=True):
        twists.setdefault(place, np.zeros((len(errors), 6)))[:, component] = error
    q = np.broadcast_to(q, (len(errors), arm.nq))
    return np.asarray(arm.chain.walk(q, twists)[1][arm.place(at)])


def with_dh_errors(file: ArmFile, errors: Array) -> Arm:
    """The arm of a file whose a, d [m], alpha, theta offset [rad] are off by ``errors`` (rows, 4).

    Not validated: an angle may be beyond a turn.
    """
    rows = []
    for row, error in zip(file.joints, np.reshape(errors, (-1, 4)) / [MM, MM, 1, 1], strict=True):
        change = {key: getattr(row, key) + e for key, e in zip(DH_KEYS, error, strict=True)}
        rows.append(row.model_copy(update=change))
    return Arm.from_file(file.model_copy(update={"joints": rows}))


def derivative(function: Callable[[Array], Array], x: Array, step: float = 1e-6) -> Array:
    """Central differences of a function of a vector (p,): its shape, and p as the last axis."""
    ends = [[function(x + s * h) for s in (1, -1)] for h in step * np.eye(len(x))]
    return np.stack([(plus - minus) / (2 * step) for plus, minus in ends], axis=-1)


# --- by Pinocchio


def placements(arm: Arm, q: Array) -> Array:
    """Placements of the base and of the frame of each DH row: (n, rows + 1, 4, 4) [m]."""
    frames = [arm.poses(q, f"frame{row}").placement for row in range(1, arm.chain.rows + 1)]
    return np.stack([np.broadcast_to(np.eye(4), frames[0].shape), *frames], axis=1)


def placement_sensitivity(arm: Arm, q: Array, at: str = "") -> Array:
    """∂(origin of frame ``at``)/∂(twists of all placements), (n, 3, 6 nq) [m/m, m/rad]."""
    model, data = arm.model, arm.model.createData()
    frame = arm.poses(q, at or None).frame_id
    columns = np.empty((len(q), 3, 6 * (model.njoints - 1)))
    for k, each in enumerate(q):
        pin.framesForwardKinematics(model, data, each)
        regressor = pin.computeFrameKinematicRegressor(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        columns[k] = regressor[:3]
    return columns


def dh_sensitivity(arm: Arm, q: Array, frames: list[str]) -> dict[str, Array]:
    """∂(origin of each frame)/∂(a, d, alpha, theta of each row), each (n, 3, 4 rows) [m/m, m/rad],
    from models made anew.

    A position is linear in a length and A + B cos x + C sin x in an angle x: half the difference of
    its values a metre, or a quarter of a turn, to either side is the exact derivative.
    """
    assert arm.file is not None
    steps = np.tile([1.0, 1.0, np.pi / 2, np.pi / 2], len(arm.file.joints))
    columns = []
    for step in np.diag(steps):
        arms = [with_dh_errors(arm.file, s * step) for s in (1, -1)]
        ends = np.array([[one.poses(q, frame).position for frame in frames] for one in arms])
        columns.append((ends[0] - ends[1]) / 2)
    return dict(zip(frames, np.stack(columns, axis=3), strict=True))


def gravity_torques(arm: Arm, q: Array) -> Array:
    """Torque of the weights about each joint's axis: (n, nq) [N·m]."""
    data = arm.model.createData()
    return np.array([-pin.computeGeneralizedGravity(arm.model, data, each) for each in q])


def gravity_moments(arm: Arm, q: Array) -> Array:
    """Moment of the weight of all that hangs beyond each joint, about the joint's origin, base
    axes: (n, nq, 3) [N·m].
    """
    data, moments = arm.model.createData(), np.zeros((len(q), arm.nq, 3))
    for k, each in enumerate(q):
        pin.centerOfMass(arm.model, data, each, True)
        for joint in range(1, arm.nq + 1):
            if data.mass[joint] > 0.0:  # Pinocchio's centre of nothing is 0/0
                lever = data.oMi[joint].rotation @ data.com[joint]
                moments[k, joint - 1] = np.cross(lever, data.mass[joint] * arm.model.gravity.linear)
    return moments


def by_newton(arm: Arm, pose: Array, starts: Array) -> Array:
    """Those solutions (n, nq) [rad] for ``pose`` (4, 4) that Newton's method (log6, frame Jacobian)
    reaches from ``starts`` (m, nq).
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


# --- by algebra


def dh_frames(rows: Array, q: Array) -> Array:
    """The last frame (n, 4, 4) of a standard DH table at joint angles ``q`` (n, r) [rad], by
    products of matrices; its rows (r, 4) are a, d [any unit], alpha, theta offset [rad].
    """
    frames = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    zero = np.zeros(len(q))
    for angle, (a, d, alpha, offset) in zip(q.T, rows, strict=True):
        c, s, ca, sa = np.cos(angle + offset), np.sin(angle + offset), np.cos(alpha), np.sin(alpha)
        step = [c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s]
        step += [zero, zero + sa, zero + ca, zero + d, zero, zero, zero, zero + 1.0]
        frames = frames @ np.stack(step, axis=1).reshape(-1, 4, 4)
    return frames


def twist_matrix(twist: Array) -> Array:
    """Of a twist (6,), linear first: the matrix (4, 4) whose exponential is the motion."""
    x, y, z = twist[3:]
    return np.array(
        [[0, -z, y, twist[0]], [z, 0, -x, twist[1]], [-y, x, 0, twist[2]], [0, 0, 0, 0]]
    )


def zonotope_volume(generators: Array) -> float:
    """Sum of the determinants of all triples of the columns of (3, p)."""
    triples = combinations(range(generators.shape[1]), 3)
    return 8 * sum(abs(np.linalg.det(generators[:, list(triple)])) for triple in triples)


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
