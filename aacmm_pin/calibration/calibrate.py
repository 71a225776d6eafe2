"""From an arm and measurements to a calibrated arm."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Index
from aacmm_pin._support.display import Note
from aacmm_pin._support.progress import Progress
from aacmm_pin._support.threads import one_blas_thread
from aacmm_pin._support.units import MM
from aacmm_pin.arm import whole_turn_notes
from aacmm_pin.calibration.calibrated_arm import temperature_of
from aacmm_pin.calibration.cross_validation import enough_postures, held_out, rms
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.input_mistakes import FAR, first_fit, mistakes_of, odd_relation
from aacmm_pin.calibration.noise_model import BAR_NOISE, contradictions, reference_u
from aacmm_pin.calibration.parameters import (
    ASSEMBLED,
    ParameterSet,
    is_reestimated,
    named_parameters,
    problem_of,
    require_scale,
)
from aacmm_pin.calibration.result import Calibration
from aacmm_pin.calibration.session_frames import in_first_frame, session_notes
from aacmm_pin.calibration.setup import ReferenceFrame, Setup, Target, checked_input
from aacmm_pin.calibration.shared_exclusions import exclusions_of
from aacmm_pin.effects import (
    CAUSES,
    TEMPERATURE_TOLERANCE,
    Effect,
    ErrorModel,
    GivenCause,
    GivenModel,
    StylusOffset,
    as_causes,
    require_shown,
)
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import (
    FEWEST_CONTACTS,
    GivenRecords,
    Measurements,
    as_measurements,
    best_sphere,
    fingerprints,
    fingerprints_of_standards,
    means_of_contacts,
    originals,
)

UNIT_RATIO = 100.0
"""An uncertainty so many times off may be in another unit (a factor of 1000)."""
BEST_REFERENCE = 2e-7
"""No coordinate is known better [m]: a measuring machine has 5e-7, a laser tracker 1e-5."""
RECORDS_PER_POSTURE = 2
"""With more consecutive records of a posture on average, they read one contact."""
MOST_NAMED = 3
OTHER_DIAMETER = 5e-4
"""Spheres are others if their diameters, by contacts and as stated, differ more in the median
[m].
"""
OPTION_OF_NOISE = {
    "reference coordinates": "--u-reference-mm",
    "orientations": "u_rot_rad",
    "contacts in seats": "--probe-noise-mm",
}
FEW_SEATS = 5
NAMED_PART = 0.1
"""Parameters below this part of the largest share in what is open about the tip are not named."""
SEVERAL = 3
"""So many excluded records, all of one seat, are no coincidence."""


@one_blas_thread
def calibrate(
    model: GivenModel,
    measurements: GivenRecords,
    parameters: GivenCause | Iterable[GivenCause] = "geometry",
    *,
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
    robust: bool = True,
    hold_out: bool = True,
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> Calibration:
    """Estimate parameters of the arm and their covariance from measurements.

    The method is weighted least squares (JCGM 100:2008, 5.2). Known coordinates, seats, known
    distances and the stated uncertainties of the arm are data of one fit. A record weighs by its
    noise, with the effect of the encoder noise on the tip. Records with gross errors are listed and
    excluded.

    Args:
        model: the arm, or the arm with causes of error, which keep their values unless
            ``parameters`` names them. Records outside the known range of a cause are excluded, with
            a note.
        measurements: the records.
        parameters: ``zero-offsets`` of all joints (the method of the 2010 paper); ``geometry`` (all
            lengths and axes); ``tool`` (place of the target on the last body); names of parameters
            such as ``d3``, or patterns such as ``theta_offset*``; a cause, or its text such as
            ``encoder_gain:5``; or a list of these. Other parameters keep their values.
        reference_frame: ``base`` if the reference coordinates are in the base of the arm;
            ``external`` if the relation of their frame to the base is unknown; ``session`` if it
            also differs between sessions: results are then in the frame of the first session.
        target: ``tip`` if the reference coordinates are those of the tip; ``unknown`` if they are
            of an unknown point on the last body; ``frame`` if the target has the position and the
            axes of the tip frame. Targets with a marker label are always unknown, within the
            standard uncertainty of their ``stylus_offset`` if the model states it. For ``tip`` and
            ``unknown``, the fit also estimates one constant rotation for each marker if the records
            state orientations.
        prior: use the stated uncertainties of the arm as information.
        encoder_noise: standard uncertainty of one reading, one number or ``(nq,)`` [rad]; default
            from the arm file.
        reference_noise: standard uncertainty of each reference coordinate [m], for records that
            state none.
        probe_noise: standard uncertainty of each coordinate of one contact [m].
        length_noise: standard uncertainty of the length of a ball bar [m], for bars that state
            none; default 50 µm, with a note.
        robust: search for gross errors.
        hold_out: predict held-out records in groups: random groups, seats, sessions, or regions of
            joint angles.
        rng: random generator for the held-out groups; default seed 1.
        progress: True for a progress bar in a notebook or on stderr, or a function such as
            ``tqdm``.

    Raises:
        UnknownNameError: a set of parameters, cause, frame or target is unknown.
        MissingConditionError: the records lack a column that a cause needs.
        AacmmError: no record has reference data or shows a requested cause; the records are too few
            to estimate the noise, or do not fit the arm.
    """
    model = ErrorModel.of(model)
    measurements = as_measurements(measurements, model.arm)
    chosen = _sets_names_and_causes(parameters, model, measurements)
    asked = [effect.label for effect in chosen if isinstance(effect, Effect)]
    model, measurements = checked_input(model, measurements, asked)
    measurements, notes_of_input = counted_once(measurements)
    for effect in chosen:
        if isinstance(effect, Effect):
            require_shown(
                effect, model.arm, measurements.q, measurements.conditions, measurements.source
            )
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
    notes_of_input += held_postures(measurements, setup)
    measurements, setup = in_first_frame(model, measurements, setup)
    problem = problem_of(model, measurements, chosen, setup)
    require_scale(problem)
    after = first_fit(problem, robust=robust)
    if not after.determines_noise:
        raise AacmmError(
            f"the records have {3 * int(after.used.sum())} coordinates; expected more than "
            f"{after.problem.scales.size} parameters and the coordinates of the seats, to estimate "
            "the noise. State the noise, take more records, or estimate fewer parameters"
        )
    markers = [e for e in model.effects if e.place and is_reestimated(e, setup, measurements)]
    unused = [effect.label for effect in markers if effect.label not in asked]
    if unused and prior:
        notes_of_input.append(Note("places_unused", {"places": unused}))
    if len(measurements.extra.columns):
        notes_of_input.append(Note("columns_unused", {"columns": [*measurements.extra]}))
    notes = (*mistakes_of(after), *notes_of(after), *session_notes(after), *notes_of_input)
    calibration = Calibration(after, problem_of(model, measurements, [], setup), (), notes)
    if not hold_out:
        return calibration
    rng = rng or np.random.default_rng(1)
    residuals = held_out(calibration.before, after, rng, progress)
    return replace(calibration, held_out=tuple(residuals))


def _sets_names_and_causes(
    parameters: GivenCause | Iterable[GivenCause], model: ErrorModel, measurements: Measurements
) -> list[GivenCause]:
    """Sets and names of parameters as text, all else as causes."""
    items = [parameters] if isinstance(parameters, Effect | str) else list(parameters)
    sets = get_args(ParameterSet)
    present = measurements.conditions.present
    as_text = {*sets, *named_parameters(model.arm, items)}
    for item in items:
        if item in as_text or not isinstance(item, str):
            continue
        if re.split("[:,]", item)[0] not in CAUSES:
            names = [parameter.name for parameter in model.arm.parameters]
            raise UnknownNameError("set of parameters", item, [*sets, *names, *CAUSES])
    return [item if item in as_text else as_causes([item], model, present)[0] for item in items]


def counted_once(measurements: Measurements) -> tuple[Measurements, list[Note]]:
    """Records that each count once, and notes: without copies, successive readings of a contact
    averaged. Records without a seat that repeat coordinates share one measurement of these, and get
    a seat.
    """
    original = originals(measurements)
    copies = np.flatnonzero(original != np.arange(measurements.n))
    kept = measurements.take(np.unique(original)) if copies.size else measurements
    notes = list(measurements.read_as)
    if copies.size:
        notes.append(Note("copies", {"rows": measurements.row[copies].tolist()}))
    means, averaged = means_of_contacts(kept)
    if averaged.size:
        contacts = averaged.size - kept.n + means.n
        rows = kept.row[averaged].tolist()
        notes.append(Note("contacts_averaged", {"rows": rows, "contacts": contacts}))
        kept = means
    kept, seated = _with_seats(kept)
    if seated.size:
        notes.append(Note("seats_by_coordinates", {"rows": kept.row[seated].tolist()}))
    if not enough_postures(kept):
        postures = np.unique(kept.postures).size
        notes.append(Note("few_postures", {"postures": postures, "records": kept.n}))
    return kept, notes


def held_postures(measurements: Measurements, setup: Setup) -> list[Note]:
    """A note if more than :data:`RECORDS_PER_POSTURE` records per posture count as independent.

    With stated encoder noise, targets share the noise of one reading: each counts as a posture.
    """
    changes = np.diff(measurements.postures) != 0
    if setup.encoder_noise is not None:
        marker = measurements.conditions.labels("marker")
        changes |= marker[1:] != marker[:-1]
    postures = 1 + np.count_nonzero(changes)
    if measurements.n <= RECORDS_PER_POSTURE * postures:
        return []
    return [Note("held_postures", {"records": measurements.n, "postures": postures})]


def _with_seats(measurements: Measurements) -> tuple[Measurements, Index]:
    """With seats for records without that repeat coordinates; and their numbers."""
    stated = measurements.conditions.labels("seat")
    seat = stated.copy()
    table = pd.DataFrame(measurements.reference).assign(seat=seat)[measurements.known]
    repeated = table[table.duplicated([0, 1, 2], keep=False)]
    for point, seats in repeated.groupby([0, 1, 2], sort=False)["seat"]:
        alone = seats.index[seats == ""]
        # Of two without a seat, one may have the coordinates of the other by mistake.
        if len(alone) < len(seats) or len(seats) >= SEVERAL:
            place = ", ".join(f"{x:.6g}" for x in np.array(point) / MM)
            seat[alone] = next(filter(None, seats), f"at {place} mm")
    seated = np.flatnonzero(seat != stated)
    conditions = replace(measurements.conditions, seat=seat)
    return replace(measurements, conditions=conditions) if seated.size else measurements, seated


def _notes_on_prior(after: Fit) -> Iterator[Note]:
    """Records behind the prior are correlated inputs (JCGM 100:2008, F.1.2.3)."""
    problem = after.problem
    if not problem.from_earlier:
        return
    used = problem.measurements.take(after.used)
    arm = problem.model.arm
    name = {"arm": arm.name}
    earlier = {*problem.earlier_records}
    if again := earlier.intersection(fingerprints(used)):
        yield Note("records_used_before", {"again": len(again), "records": used.n} | name)
    elif standards := earlier.intersection(fingerprints_of_standards(used)):
        yield Note("standards_used_before", {"standards": len(standards)} | name)
    if arm.unexplained:
        yield Note("prior_left_unexplained", {"unexplained": arm.unexplained} | name)


def notes_of_records(after: Fit) -> Iterator[Note]:
    """What looks unusual in the records themselves."""
    records = after.problem.measurements
    placed = after.used & records.known
    if placed.any():
        # NaN: not stated.
        u = float(np.median(reference_u(records, after.problem.setup, np.nan)[placed]))
        residual = rms(after.system.deviation[placed])
        too_small = u < BEST_REFERENCE and u < residual / UNIT_RATIO
        if too_small or 0.0 < residual < u / UNIT_RATIO:
            yield Note("reference_noise_odd", {"u": u, "residual": residual})
    arm = after.problem.model.arm
    yield from whole_turn_notes(records.q, arm.limits, arm.chain.prismatic)
    yield from records.conditions.temperature_notes(arm.reference_temperature, are_used=True)
    for j in np.flatnonzero(arm.chain.prismatic) + 1:
        joint = {"joint": int(j)}
        yield Note("slide_units", joint)
        if not (records.known.any() or records.lengths()):
            yield Note("slide_scale_exact", joint)
    yield from _sphere_diameters(after)


def _sphere_diameters(after: Fit) -> Iterator[Note]:
    observations = after.observations
    tips = after.point.prediction.tips
    differences = []
    for seat in np.flatnonzero(observations.spheres):
        contacts = after.used & (observations.seat == seat)
        if contacts.sum() > FEWEST_CONTACTS:
            _, radius = best_sphere(tips[contacts])
            differences.append(2.0 * (radius - observations.radius[contacts][0]))
    median = float(np.median(differences)) if differences else 0.0
    if abs(median) >= OTHER_DIAMETER:
        yield Note("sphere_diameters", {"off": median})


def _notes_on_calibrated_arm(after: Fit) -> Iterator[Note]:
    arm = after.problem.model.arm
    for effect in after.effects if after.problem.tip_on_target else ():
        if isinstance(effect, StylusOffset) and effect.marker is None:
            distance = float(np.linalg.norm(effect.values))
            yield Note("target_becomes_tip", {"distance": distance, "arm": arm.name})
    spread = np.linalg.norm(after.undetermined.tip_spread, axis=1) / after.problem.widths
    if spread.any():
        chosen = np.flatnonzero(spread > NAMED_PART * spread.max())
        names = [after.problem.vector.names[k] for k in chosen]
        yield Note("tip_undetermined", {"parameters": names})
    stated = arm.reference_temperature
    temperature = temperature_of(after)
    if abs(temperature - stated) >= TEMPERATURE_TOLERANCE:
        yield Note("temperature_of_lengths", {"temperature": temperature, "stated": stated})


def _notes_on_noise(after: Fit) -> Iterator[Note]:
    setup = after.problem.setup
    if setup.encoder_noise is None:
        yield Note("encoder_noise_estimated")
    if after.noise_is_stated:
        if after.scatter > 0:
            yield Note("scatter_added", {"scatter": after.scatter_in_words})
        return
    unstated_noise = setup.unstated(after.problem.measurements)
    of_seats = after.noise.scatters.seat
    if after.has_scatter:
        options = [OPTION_OF_NOISE[noise] for noise in unstated_noise]
        data = {"of": unstated_noise, "scatter": after.scatter_in_words, "options": options}
        yield Note("noise_estimated", data)
        if of_seats:
            yield Note("seat_scatter_estimated", {"scatter": of_seats})
    else:
        yield Note("noise_enough", {"of": unstated_noise})
    seats = int(after.observations.is_stated.sum())
    if of_seats and seats < FEW_SEATS:
        yield Note("few_seats", {"seats": seats})


def contradiction_notes(after: Fit) -> Iterator[Note]:
    """Notes on stated coordinates and lengths that other data, or all excluded records,
    contradict.
    """
    records = after.problem.measurements
    count = int(after.excluded.sum())
    seats = {*records.conditions.labels("seat")[after.excluded]}
    if len(seats) == 1 and count >= SEVERAL and "" not in seats:
        yield Note("seat_excluded", {"records": count, "seat": seats.pop()})
    if note := odd_relation(after):
        yield note
    yield from contradictions(records, after.problem.setup, after.noise.scatters)


def notes_of(after: Fit) -> Iterator[Note]:
    """What was assumed, or estimated instead of stated."""
    problem = after.problem
    yield from exclusions_of(after).notes
    yield from _notes_on_prior(after)
    yield from _notes_on_noise(after)
    yield from notes_of_records(after)
    yield from _notes_on_calibrated_arm(after)
    if after.scatter > FAR:
        yield Note("scatter_too_large", {"scatter": after.scatter})
    arm_parameters = zip(problem.vector.arm_parameters, problem.stated, strict=True)
    unstated = [p.name for p, stated in arm_parameters if p is not None and not stated]
    if unstated:
        names = ", ".join(unstated)
        if len(unstated) > MOST_NAMED:
            names = f"{len(unstated)} parameters"
        assumed = {"parameters": names, "length": ASSEMBLED["m"], "angle": ASSEMBLED["rad"]}
        yield Note("uncertainty_assumed", assumed)
    estimated = {p.name for p in problem.vector.arm_parameters if p is not None}
    held = sum(p.u > 0 and p.name not in estimated for p in problem.model.arm.parameters)
    if held and problem.asked:
        yield Note("geometry_held", {"held": held})
    if not after.redundant and not after.excluded.any():
        yield Note("gross_errors_unsought")
    has_u = [np.isfinite(bar.u) for bar in problem.measurements.bars()]
    if problem.setup.length_noise is None and not all(has_u):
        yield Note("bar_noise_assumed", {"u": BAR_NOISE})
    if not after.converged:
        yield Note("not_converged", {"why": after.message})
    yield from contradiction_notes(after)
    silent = int((~after.used & ~after.excluded).sum())
    if silent:
        yield Note("records_silent", {"records": silent})
