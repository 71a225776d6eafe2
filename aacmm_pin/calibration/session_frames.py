"""Sessions whose references are in frames of their own: brought into that of the first session, up
to a small displacement that is estimated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame
from aacmm_pin.calibration.setup import Setup, sessions_of
from aacmm_pin.calibration.solver import initial_point
from aacmm_pin.effects import ErrorModel, ReferenceFrame
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements

ONE_FRAME = 0.01
"""Frames whose coordinates differ by less than this are one, up to what is estimated [m]."""
AGREES = 0.01
"""Two frames agree if the chance of an estimated displacement as large as theirs is larger."""


def in_first_frame(
    model: ErrorModel, records: Measurements, setup: Setup
) -> tuple[Measurements, list[Note]]:
    """The records with all references in the frame of the first session, if each session has its
    own; and notes of the sessions whose references were moved.

    Each session is registered with the tips of the arm as described, robustly.

    Raises:
        AacmmError: a record has no session, or a session too few references for a frame.
    """
    if not setup.frame_of_session:
        return records, []
    notes = []
    first, *others = sessions_of(records)
    stays = _registration(model, records, setup, first)
    for label in others:
        own = records.conditions.require("session", "reference frame") == label
        frame = _registration(model, records, setup, label)
        rotation = stays.rotation @ frame.rotation.T
        shift = stays.shift - rotation @ frame.shift
        there = records.reference[own & records.placed]
        if np.abs(there @ rotation.T + shift - there).max(initial=0.0) < ONE_FRAME:
            continue
        records = _moved(records, own, rotation, shift)
        turn = float(Rotation.from_matrix(rotation).magnitude())
        data = {"session": label, "first": first, "shift": shift.tolist(), "turn": turn}
        notes.append(Note("session_moved", data))
    return records, notes


def agreement_of(fit: Fit, moved: list[Note]) -> list[Note]:
    """Notes whether the frames of the sessions agree whose references were not ``moved``: by the
    Mahalanobis distance of the estimated displacement from zero.
    """
    apart = [note.data["session"] for note in moved]
    notes = []
    for effect, own in fit.problem.vector:
        if not isinstance(effect, ReferenceFrame) or effect.session in (None, *apart):
            continue
        step = fit.point.x[own]
        distance = float(step @ np.linalg.pinv(fit.covariance[own, own], hermitian=True) @ step)
        p_value = float(chi2_sf(distance, step.size))
        code = "sessions_agree" if p_value > AGREES else "sessions_differ"
        first = sessions_of(fit.problem.measurements)[0]
        data = {"session": effect.session, "first": first, "p_value": p_value}
        sizes = np.linalg.norm(step.reshape(2, 3), axis=1).tolist()
        notes.append(Note(code, data | {"shift": sizes[0], "turn": sizes[1]}))
    return notes


def _registration(model: ErrorModel, records: Measurements, setup: Setup, label: str) -> Frame:
    """The base in the frame of one session."""
    own = records.conditions.require("session", "reference frame") == label
    alone = replace(setup, reference_frame="external")
    problem = problem_of(model, replace(records.take(own), orientation=None), [], alone)
    try:
        return initial_point(problem, observations_of(problem.measurements, alone)).frame
    except AacmmError as error:
        raise AacmmError(f"{records.source}: session {label}: {error}") from None


def _moved(records: Measurements, own: Mask, rotation: Array, shift: Array) -> Measurements:
    """The records with the references of some (n,) in another frame."""
    reference = np.where(own[:, None], records.reference @ rotation.T + shift, records.reference)
    turned_u = np.sqrt(np.square(records.reference_u) @ np.square(rotation).T)
    reference_u = np.where(own[:, None], turned_u, records.reference_u)
    moved = replace(records, reference=reference, reference_u=reference_u)
    if records.orientation is None:
        return moved
    orientation = records.orientation.copy()
    stated = own & records.oriented
    seen = Rotation.from_quat(orientation[stated], scalar_first=True)
    turned = Rotation.from_matrix(rotation) * seen
    orientation[stated] = turned.as_quat(scalar_first=True)
    return replace(moved, orientation=orientation)
