"""What the tests work out by Pinocchio alone, to hold the closed forms against."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm

EXACT_STEPS = {"a_mm": 1e3, "d_mm": 1e3, "alpha_rad": np.pi / 2, "theta_offset_rad": np.pi / 2}


def placements(arm: Arm, q: Array) -> Array:
    """Placements of the base and of the frame of each DH row: (n, rows + 1, 4, 4) [m]."""
    frames = [arm.poses(q, f"frame{row}").placement for row in range(1, arm.chain.rows + 1)]
    return np.stack([np.broadcast_to(np.eye(4), frames[0].shape), *frames], axis=1)


def dh_sensitivity(arm: Arm, q: Array, frames: list[str]) -> dict[str, Array]:
    """∂(origin of each frame)/∂(a, d, alpha, theta of each row), each (n, 3, 4 rows) [m/m, m/rad],
    from models made anew.

    A position is linear in a length and A + B cos x + C sin x in an angle x: half the difference of
    its values a metre, or a quarter of a turn, to either side is the exact derivative.
    """
    assert arm.file is not None
    rows, columns = arm.file.joints, []
    for i, row in enumerate(rows):
        for key, step in EXACT_STEPS.items():
            moved = []
            for sign in (0.5, -0.5):
                # Not validated: an angle may be beyond a turn.
                changed = row.model_copy(update={key: getattr(row, key) + np.sign(sign) * step})
                file = arm.file.model_copy(update={"joints": [*rows[:i], changed, *rows[i + 1 :]]})
                other = Arm.from_file(file)
                moved.append([sign * other.poses(q, frame).position for frame in frames])
            columns.append(np.sum(moved, axis=0))
    return dict(zip(frames, np.stack(columns, axis=3), strict=True))


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
