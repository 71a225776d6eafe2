"""References of all sessions in the frame of the first, up to a small estimated displacement; probe
directions in that of the base.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, registered
from aacmm_pin.calibration.setup import Setup, sessions_of
from aacmm_pin.calibration.solver import initial_point
from aacmm_pin.effects import ErrorModel
from aacmm_pin.measurements import Measurements, orientation

FEWEST_OF_A_FRAME = 8
MOST_OF_THEM = 0.8
"""Least part of the excluded records that has to fit their frame …"""
AS_CLOSE = 2.0
"""… with residuals at most so many times those of the other records …"""
REMAINS = 0.1
"""… and at most this part of those in the frame of the others."""
ONE_FRAME = 0.01
"""Frames whose coordinates differ by less are one, up to what is estimated [m]."""
AGREES = 0.01
"""Least chance of a displacement as large as theirs of frames that agree."""


def in_first_frame(
    model: ErrorModel, records: Measurements, setup: Setup
) -> tuple[Measurements, Setup]:
    """The records with all references in the frame of the first session, if each has its own, and
    probe directions in that of the base; and the set-up. Tips of the arm as described register the
    sessions; the rotation that this leaves is nothing beside a deflection.

    Raises:
        AacmmError: a record with a reference has no session, or a session too few references for a
            frame.
    """
    if setup.frame_of_session:
        records, setup = _in_one_frame(model, records, setup)
    if setup.external and records.conditions.probe_direction is not None:
        base = _registration(model, records, setup)
        records = _with_directions(records, np.ones(records.n, dtype=bool), base.rotation.T)
    return records, setup


def _in_one_frame(
    model: ErrorModel, records: Measurements, setup: Setup
) -> tuple[Measurements, Setup]:
    labels = sessions_of(records)
    stated = records.conditions.labels("session")
    records = _without_frames(records)
    session = records.conditions.labels("session")
    frames = {}
    for label in labels:
        alone = replace(records.take(session == label), source=f"{records.source}: session {label}")
        frames[label] = _registration(model, alone, setup)
    stays = frames.pop(labels[0])
    moved = {}
    for label, frame in frames.items():
        of_session = session == label
        rotation = stays.rotation @ frame.rotation.T
        shift = stays.shift - rotation @ frame.shift
        there = records.reference[of_session & records.placed]
        if np.abs(there @ rotation.T + shift - there).max(initial=0.0) >= ONE_FRAME:
            records = _moved(records, of_session, rotation, shift)
            records = _with_directions(records, stated == label, rotation)
            moved[label] = (rotation, shift)
    return records, replace(setup, moved_frames=moved)


def _without_frames(records: Measurements) -> Measurements:
    """Records of a seat with references are in the session of these; others without a reference in
    none.
    """
    conditions = records.conditions
    stated = conditions.labels("session")
    session = np.where(records.placed, stated, "")
    for rows in records.seats().values():
        placed = rows[records.placed[rows]]
        if placed.size:
            session[rows] = np.where(records.placed[rows], stated[rows], stated[placed[0]])
    return replace(records, conditions=replace(conditions, session=session))


def session_notes(fit: Fit) -> Iterator[Note]:
    """Whether each session's frame agrees with the first, by the Mahalanobis distance of the
    displacement.
    """
    moved = fit.problem.setup.moved_frames
    for session, entries in fit.problem.vector.of_sessions():
        data = {"session": session, "first": sessions_of(fit.problem.measurements)[0]}
        if session in moved:
            rotation, _ = moved[session]
            turn = float(scipy.spatial.transform.Rotation.from_matrix(rotation).magnitude())
            yield Note("session_moved", data | {"turn": turn})
            continue
        step = fit.point.x[entries]
        distance = float(
            step @ np.linalg.pinv(fit.covariance[entries, entries], hermitian=True) @ step
        )
        p_value = float(chi2_sf(distance, step.size))
        shift, turn = np.linalg.norm(step.reshape(2, 3), axis=1).tolist()
        code = "sessions_agree" if p_value > AGREES else "sessions_differ"
        yield Note(code, data | {"p_value": p_value, "shift": shift, "turn": turn})


def another_frame(after: Fit) -> Iterator[Note]:
    """A note if the excluded records fit the calibrated arm in a reference frame of their own."""
    records = after.problem.measurements
    out = after.excluded & records.known
    if out.sum() < FEWEST_OF_A_FRAME or after.problem.setup.frame_of_session:
        return
    here = after.point.frame
    in_base = (after.point.prediction.tips[out] - here.shift) @ here.rotation
    frame = registered(in_base, records.reference[out])
    in_own_frame = np.linalg.norm(frame.apply(in_base) - records.reference[out], axis=1)
    distances = np.linalg.norm(after.system.deviation, axis=1)
    others = np.nanquantile(distances[after.used], MOST_OF_THEM)
    fits = np.quantile(in_own_frame, MOST_OF_THEM) < AS_CLOSE * others
    if not fits or np.median(in_own_frame) > REMAINS * np.median(distances[out]):
        return
    turn = frame.rotation @ here.rotation.T
    centre = records.reference[out].mean(axis=0)
    there = turn @ (centre - here.shift) + frame.shift
    angle = scipy.spatial.transform.Rotation.from_matrix(turn).magnitude()
    data = {"rows": records.row[out].tolist(), "shift": float(np.linalg.norm(there - centre))}
    yield Note("rows_in_another_frame", data | {"turn": float(angle)})


def _registration(model: ErrorModel, records: Measurements, setup: Setup) -> Frame:
    alone = replace(setup, reference_frame="external")
    problem = problem_of(model, replace(records, orientation=None), [], alone)
    return initial_point(problem, observations_of(problem.measurements, alone)).frame


def _with_directions(records: Measurements, chosen: Mask, rotation: Array) -> Measurements:
    direction = records.conditions.probe_direction
    if direction is None:
        return records
    turned = np.where(chosen[:, None], direction @ rotation.T, direction)
    conditions = replace(records.conditions, probe_direction=turned)
    return replace(records, conditions=conditions)


def _moved(records: Measurements, chosen: Mask, rotation: Array, shift: Array) -> Measurements:
    reference = np.where(chosen[:, None], records.reference @ rotation.T + shift, records.reference)
    turned_u = np.sqrt(np.square(records.reference_u) @ np.square(rotation).T)
    reference_u = np.where(chosen[:, None], turned_u, records.reference_u)
    moved = replace(records, reference=reference, reference_u=reference_u)
    if records.orientation is None:
        return moved
    stated = records.orientation.copy()
    turned = chosen & records.oriented
    stated[turned] = orientation.quaternions(rotation @ orientation.matrices(stated[turned]))
    return replace(moved, orientation=stated)
