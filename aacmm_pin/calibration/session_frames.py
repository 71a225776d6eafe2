"""References of all sessions in the frame of the first, up to a small estimated displacement; probe
directions in that of the base.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.display import Note
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, registered
from aacmm_pin.calibration.setup import Setup, sessions_of
from aacmm_pin.calibration.solver import initial_point
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, orientation

FEWEST_OF_A_FRAME = 8
FITTING_PART = 0.8
"""Least part of the excluded records that has to fit their frame …"""
RESIDUAL_RATIO = 2.0
"""… with residuals at most so many times those of the other records …"""
REMAINING_PART = 0.1
"""… and at most this part of those in the frame of the others."""
RUN = 7
"""A stand that moved moves consecutive rows: a row counts as most of the so many around it …"""
ROWS_OUT_OF_RUNS = 0.2
"""… unless this changes more than this part of them: then rows are not in order of time."""
ONE_FRAME = 0.01
"""Frames whose coordinates differ by less are one, up to what is estimated [m]."""
LEAST_CHANCE = 0.01
"""Least chance of a displacement as large as theirs of frames that agree."""


def in_first_frame(
    model: ErrorModel, records: Measurements, setup: Setup
) -> tuple[Measurements, Setup]:
    """The records with all references in the frame of the first session, if each has its own, and
    probe directions in that of the base; and the set-up. Tips of the arm as described register the
    sessions.

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
    if not labels:
        raise AacmmError(
            f"{records.source}: no record has reference coordinates, so that no session has a "
            "reference frame. Use --reference-frame base, and if the stand moved between sessions, "
            "give the seats other labels in each session"
        )
    stated_session = records.conditions.labels("session")
    records = _with_session_of_references(records)
    session = records.conditions.labels("session")
    frames = {}
    for label in labels:
        source = f"{records.source}: session {label}"
        of_session = replace(records.take(session == label), source=source)
        frames[label] = _registration(model, of_session, setup)
    first = frames.pop(labels[0])
    moved_frames = {}
    for label, frame in frames.items():
        in_session = session == label
        rotation = first.rotation @ frame.rotation.T
        shift = first.shift - rotation @ frame.shift
        references = records.reference[in_session & records.placed]
        in_first = references @ rotation.T + shift
        if np.abs(in_first - references).max(initial=0.0) >= ONE_FRAME:
            records = _displaced(records, stated_session == label, Frame(rotation, shift))
            moved_frames[label] = (rotation, shift)
    return records, replace(setup, moved_frames=moved_frames)


def _with_session_of_references(records: Measurements) -> Measurements:
    """The records, each with the session in whose frame its target is stated: its own, if it has a
    reference, else that of the first reference of its seat, else none.
    """
    conditions = records.conditions
    stated = conditions.labels("session")
    session = np.where(records.placed, stated, "")
    for rows in records.seats().values():
        is_placed = records.placed[rows]
        if is_placed.any():
            session[rows] = np.where(is_placed, stated[rows], stated[rows[is_placed][0]])
    return replace(records, conditions=replace(conditions, session=session))


def session_notes(fit: Fit) -> Iterator[Note]:
    """Whether each session's frame agrees with the first, by the Mahalanobis distance of the
    displacement.
    """
    moved_frames = fit.problem.setup.moved_frames
    for session, entries in fit.problem.vector.of_sessions():
        data = {"session": session, "first": sessions_of(fit.problem.measurements)[0]}
        if session in moved_frames:
            rotation, _ = moved_frames[session]
            turn = float(scipy.spatial.transform.Rotation.from_matrix(rotation).magnitude())
            yield Note("session_moved", data | {"turn": turn})
            continue
        displacement = fit.point.x[entries]
        precision = np.linalg.pinv(fit.covariance[entries, entries], hermitian=True)
        chi2 = float(displacement @ precision @ displacement)
        p_value = float(chi2_sf(chi2, displacement.size))
        shift, turn = np.linalg.norm(displacement.reshape(2, 3), axis=1).tolist()
        code = "sessions_agree" if p_value > LEAST_CHANCE else "sessions_differ"
        yield Note(code, data | {"p_value": p_value, "shift": shift, "turn": turn})


def another_frame(fit: Fit) -> Iterator[Note]:
    """A note if the excluded records fit the calibrated arm in a reference frame of their own."""
    records = fit.problem.measurements
    excluded = fit.excluded & records.known
    if excluded.sum() < FEWEST_OF_A_FRAME or fit.problem.setup.frame_of_session:
        return
    fitted = fit.point.frame
    references = records.reference[excluded]
    in_base = fitted.back(fit.point.prediction.tips)
    frame_of_excluded = registered(in_base[excluded], references)
    in_own_frame = np.linalg.norm(frame_of_excluded.apply(in_base) - records.reference, axis=1)
    distances = np.linalg.norm(fit.system.deviation, axis=1)
    others = np.nanquantile(distances[fit.used], FITTING_PART)
    of_most = np.quantile(in_own_frame[excluded], FITTING_PART)
    remaining_part = np.median(in_own_frame[excluded]) / np.median(distances[excluded])
    if of_most >= RESIDUAL_RATIO * others or remaining_part > REMAINING_PART:
        return
    belongs = in_own_frame < np.fmin(distances, RESIDUAL_RATIO * of_most)
    belongs_of_known = belongs[records.known]
    in_runs = scipy.ndimage.median_filter(belongs_of_known, RUN)
    if np.count_nonzero(in_runs != belongs_of_known) > ROWS_OUT_OF_RUNS * belongs.sum():
        in_runs = belongs_of_known
    rows = records.row[records.known][in_runs]
    rotation = frame_of_excluded.rotation @ fitted.rotation.T
    centre = references.mean(axis=0)
    moved_centre = frame_of_excluded.apply(fitted.back(centre))
    angle = scipy.spatial.transform.Rotation.from_matrix(rotation).magnitude()
    shift = float(np.linalg.norm(moved_centre - centre))
    data = {"rows": rows.tolist(), "shift": shift}
    yield Note("rows_in_another_frame", data | {"turn": float(angle)})


def _registration(model: ErrorModel, records: Measurements, setup: Setup) -> Frame:
    external = replace(setup, reference_frame="external")
    problem = problem_of(model, replace(records, orientation=None), [], external)
    return initial_point(problem, observations_of(problem.measurements, external)).frame


def _with_directions(records: Measurements, chosen: Mask, rotation: Array) -> Measurements:
    directions = records.conditions.probe_direction
    if directions is None:
        return records
    rotated = np.where(chosen[:, None], directions @ rotation.T, directions)
    conditions = replace(records.conditions, probe_direction=rotated)
    return replace(records, conditions=conditions)


def _displaced(records: Measurements, chosen: Mask, frame: Frame) -> Measurements:
    """With references, orientations and directions of the ``chosen`` records (n,) in ``frame``."""
    rotated_u = np.sqrt(np.square(records.reference_u) @ np.square(frame.rotation).T)
    stated = records.orientation
    if stated is not None:
        rows = chosen & records.oriented
        stated = stated.copy()
        rotations = frame.rotation @ orientation.matrices(stated[rows])
        stated[rows] = orientation.quaternions(rotations)
    displaced = replace(
        records,
        reference=np.where(chosen[:, None], frame.apply(records.reference), records.reference),
        reference_u=np.where(chosen[:, None], rotated_u, records.reference_u),
        orientation=stated,
    )
    return _with_directions(displaced, chosen, frame.rotation)
