"""Whether measurements fit an arm, and what they lack, before anything is estimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Mask
from aacmm_pin._support.display import Note, Shown
from aacmm_pin.arm import Arm, outside_limits
from aacmm_pin.calibration import (
    ReferenceFrame,
    Repeatability,
    Setup,
    Target,
    exclusions_of,
    first_fit,
    in_first_frame,
    mistakes_of,
    problem_of,
    repeatability_of,
    rms_residual,
    session_notes,
)
from aacmm_pin.calibration.calibrate import (
    contradiction_notes,
    counted_once,
    notes_of_records,
)
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.setup import checked_input
from aacmm_pin.diagnosis.candidates import not_tried
from aacmm_pin.effects import Effect, ErrorModel, GivenModel, all_candidates
from aacmm_pin.measurements import GivenRecords, Measurements

FAR_BEYOND = 5.0
"""A distance so many times the predicted one asks for a look at file and arm."""


@dataclass(frozen=True, eq=False)
class Check(Shown):
    """What is known of an arm and its records before a calibration.

    Attributes:
        measurements: the records, without copies of others.
        used: (n,) False for records too far off to belong, or without reference.
        excluded: (n,) True for records that are too far off.
        rms: RMS distance of tip and target, set-up fitted and geometry as stated [m]; nan if no
            record has a target.
        calibrated_rms: the same with fitted geometry.
        predicted_rms: expected ``rms`` by the stated uncertainties, see
            :attr:`~aacmm_pin.calibration.Fit.predicted_rms` [m]; nan if the arm
            states none.
        missing: condition that the records do not state, and the causes that need it.
        notes: what was assumed, and what looks unusual.
    """

    model: ErrorModel
    measurements: Measurements
    used: Mask
    excluded: Mask
    rms: float
    calibrated_rms: float
    predicted_rms: float
    missing: Mapping[str, tuple[type[Effect], ...]]
    repeatability: Repeatability | None
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        records, name = self.measurements, self.model.arm.name
        fits = f"{self.used.sum()} of {records.n} records"
        return f"{fits} of {records.source} fit {name}"


def check_measurements(
    model: GivenModel,
    measurements: GivenRecords,
    *,
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
) -> Check:
    """Fit the geometry as :func:`aacmm_pin.calibration.calibrate` does and the set-up alone, and
    state what the records lack.

    The set-up is what no file states: the place of an external frame, of an unknown target and of
    seats without coordinates.

    Args:
        reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise:
            see :func:`aacmm_pin.calibration.calibrate`.

    Raises:
        MistakenFileError: one mistake in the file, or two, explain the records.
        AacmmError: the records do not fit the arm, or a file cannot be used.
    """
    model, records = checked_input(model, measurements)
    records, notes = counted_once(records)
    setup = Setup.of(
        model.arm,
        reference_frame,
        target,
        prior,
        encoder_noise,
        reference_noise,
        probe_noise,
        length_noise,
    )
    records, setup = in_first_frame(model, records, setup)
    calibrated = first_fit(problem_of(model, records, ["geometry"], setup))
    as_stated = fit(problem_of(model, records, [], setup), used=calibrated.used)
    rms_as_stated = rms_residual(as_stated, as_stated.used)
    rms_calibrated = rms_residual(calibrated, calibrated.used)
    missing = not_tried(model.arm, list(all_candidates(model.arm, records)), records)
    wrong = [*mistakes_of(calibrated), *contradiction_notes(calibrated)]
    notes = [*wrong, *notes, *exclusions_of(calibrated).notes]
    notes += [*notes_of_records(as_stated), *session_notes(as_stated)]
    if silent_count := int((~calibrated.used & ~calibrated.excluded).sum()):
        notes.append(Note("records_silent", {"records": silent_count}))
    notes += _limit_notes(model.arm, records)
    if model.arm.masses is None:
        notes.append(Note("masses_not_stated", {"arm": model.arm.name}))
    predicted_rms = as_stated.predicted_rms
    noise_unknown = []
    if model.arm.encoder_noise is None and setup.encoder_noise is None:
        noise_unknown.append("readings")
    u_stated = np.isfinite(records.reference_u[records.known]).all()
    if not u_stated and setup.reference_noise is None:
        noise_unknown.append("references")
    if noise_unknown:
        notes.append(Note("prediction_without_noise", {"of": noise_unknown}))
    chi2_stated = calibrated.chi2_stated
    if chi2_stated is not None and not chi2_stated.acceptable:
        notes.append(Note("beyond_noise", {"times": rms_calibrated / calibrated.noise_rms}))
    if rms_as_stated > FAR_BEYOND * predicted_rms:
        notes.append(Note("beyond_prediction", {"times": rms_as_stated / predicted_rms}))
    return Check(
        model,
        records,
        as_stated.used,
        calibrated.excluded,
        rms_as_stated,
        rms_calibrated,
        predicted_rms,
        missing,
        repeatability_of(calibrated),
        tuple(notes),
    )


def _limit_notes(arm: Arm, records: Measurements) -> list[Note]:
    """A note for each joint with readings outside its limits."""
    outside = outside_limits(records.q, arm.limits)
    notes = []
    for joint in np.flatnonzero(outside.any(axis=0)).tolist():
        is_outside_here = outside[:, joint]
        values = records.q[is_outside_here, joint]
        data = {
            "joint": joint + 1,
            "rows": records.row[is_outside_here].tolist(),
            "limits": arm.limits[joint],
            "values": [values.min(), values.max()],
            "unit": "mm" if arm.chain.prismatic[joint] else "°",
        }
        notes.append(Note("outside_limits", data))
    return notes
