"""Joint commands that bring the real arm where a nominal arm would be."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array, Mask, batch
from aacmm_pin.arm import OF_A_POSE
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.environment import StylusOffset
from aacmm_pin.effects.error_model import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError, ShapeError

OTHER_TIP = 5e-3
"""A target farther from the tip is another point [m]."""
ARRIVED = 1e-9
"""[m, rad]"""
MOST_STEPS = 100
"""Newton steps; four suffice except next to a singular posture."""
LONGEST_JOINT_STEP = 0.1
"""Longest step [rad]; a longer one beside a singular posture would lead far away."""
SINGULAR_MOTION = 1e-6
"""Motions below this ratio to the largest singular value are not made."""


def joint_commands(
    model: GivenModel, nominal: GivenModel, q: ArrayLike, conditions: Conditions | None = None
) -> tuple[Array, Mask]:
    """Compute joint commands for ``model`` that bring its tip to that of ``nominal`` at ``q``.

    From six joints on, the commands also reproduce the orientation. Newton's method takes the
    shortest step, so that an arm with redundant joints stays near ``q``.

    Args:
        model: the true arm.
        nominal: the arm in the controller.
        q: commands for the nominal arm ``(n, nq)`` [rad].

    Returns:
        Commands ``(n, nq)`` [rad]; True for each that arrives within 1 nm (and 1 nrad) ``(n,)``.

    Raises:
        ShapeError: ``q`` is not finite ``(n, nq)``, or the arms have different numbers of joints.
        MissingConditionError: a condition that a cause needs is missing.
        AacmmError: the tip of ``model`` is a target and the tip of ``nominal`` is not.
    """
    model = ErrorModel.of(model)
    nominal = ErrorModel.of(nominal)
    if nominal.arm.nq != model.arm.nq:
        raise ShapeError(
            f"{nominal.arm.name} has {nominal.arm.nq} joints; expected {model.arm.nq}, as many "
            f"as {model.arm.name}"
        )
    if _has_tip_on_target(model) and not _has_tip_on_target(nominal):
        raise AacmmError(
            f"{model.arm.name}: the tip is a target, and not the tip of {nominal.arm.name}; "
            "expected the same tip. Calibrate again with the column `marker`, or add the target as "
            "a frame of the URDF or as a fixed last row of the table"
        )
    q = batch(q, model.arm.nq, "q", "rad")
    nominal_state = nominal.state(q, conditions)
    position = nominal_state.position
    axes = nominal_state.rotation[-1]
    commands = q.copy()
    arrived = np.zeros(len(q), dtype=bool)
    no_limits = np.tile([-np.inf, np.inf], (model.arm.nq, 1))
    bounds = model.known_within(no_limits).T
    for _ in range(MOST_STEPS):
        state = model.state(commands, conditions)
        shift = position - state.position
        rotation = Rotation.from_matrix(axes @ state.rotation[-1].transpose(0, 2, 1)).as_rotvec()
        remaining = [shift, rotation] if model.arm.nq >= OF_A_POSE else [shift]
        arrived = (np.linalg.norm(remaining, axis=2) < ARRIVED).all(axis=0)
        if arrived.all():
            break
        jacobian = model.arm.chain.jacobian(state.rotation, state.origin, state.position)
        motions = np.concatenate(jacobian[: len(remaining)], axis=1)
        twists = np.concatenate(remaining, axis=1)[:, :, None]
        step = (np.linalg.pinv(motions, rcond=SINGULAR_MOTION) @ twists)[:, :, 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= LONGEST_JOINT_STEP / np.maximum(length, LONGEST_JOINT_STEP)
        commands[~arrived] = np.clip(commands + step, *bounds)[~arrived]
    return commands, arrived


def _has_tip_on_target(model: ErrorModel) -> bool:
    """By the arm file, or by a large offset of the tip."""
    if model.arm.tip_on_target:
        return True
    offsets = [effect for effect in model.effects if isinstance(effect, StylusOffset)]
    of_tip = [offset.values for offset in offsets if offset.marker is None]
    return any(np.linalg.norm(values) > OTHER_TIP for values in of_tip)
