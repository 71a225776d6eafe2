"""Where the base is in an unknown frame of the references, or in that of each session, with u."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.identifiability import ROTATION
from aacmm_pin.calibration.problem import Frame
from aacmm_pin.calibration.setup import sessions_of


@dataclass(frozen=True, eq=False)
class BasePlacement:
    """The base in a frame of references.

    Attributes:
        session: label of the session whose frame it is; "" if all records have one.
        rotation, shift: ``x_reference = R x_base + t``, (3, 3) and (3,) [m].
        u_shift: standard uncertainty of t along the axes of the references (3,) [m].
        u_rotation: of the rotation about these axes (3,) [rad].
    """

    session: str
    rotation: Array
    shift: Array
    u_shift: Array
    u_rotation: Array


def base_is_open(fit: Fit) -> bool:
    """Whether the records do not determine where the base is in an unknown frame of the
    references.
    """
    if not fit.problem.external:
        return False
    p = fit.problem.widths.size
    variances = np.diag(fit.covariance)[p + 3 : p + 6]
    return fit.undetermined.frame_is_open or bool(variances.max() > ROTATION**2)


def base_placements(fit: Fit) -> list[BasePlacement]:
    """The base in each frame of the references; none if that is the base's own, or these records
    leave it open.
    """
    problem = fit.problem
    if not problem.external or base_is_open(fit):
        return []
    p = problem.widths.size
    frame = fit.point.frame
    of_frame = fit.covariance[p : p + 6]
    by_session = problem.setup.frame_of_session
    first = sessions_of(problem.measurements)[0] if by_session else ""
    placements = [_placed(first, frame.rotation, frame.shift, of_frame[:, p : p + 6])]
    for session, entries in problem.vector.of_sessions():
        displaced = Frame(frame.rotation, frame.shift).moved(fit.point.x[entries])
        crossed = of_frame[:, entries]
        covariance = of_frame[:, p : p + 6] + fit.covariance[entries, entries] + crossed + crossed.T
        turned, moved = problem.setup.moved_frames.get(session, (np.eye(3), np.zeros(3)))
        there = turned.T @ displaced.rotation, turned.T @ (displaced.shift - moved)
        placements.append(_placed(session, *there, covariance))
    return placements


def _placed(session: str, rotation: Array, shift: Array, covariance: Array) -> BasePlacement:
    """With the covariance (6, 6) of a twist of the base in its own axes [m, rad]."""
    turned = np.kron(np.eye(2), rotation)
    u = np.sqrt(np.diag(turned @ covariance @ turned.T))
    return BasePlacement(session, rotation, shift, u[:3], u[3:])
