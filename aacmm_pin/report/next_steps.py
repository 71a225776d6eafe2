"""Steps that a diagnosis may recommend next; :mod:`aacmm_pin.report.verdicts` chooses one."""

from __future__ import annotations

from collections.abc import Sequence
from shlex import quote

import numpy as np

from aacmm_pin._support.units import MM
from aacmm_pin.arm import bundled_arms
from aacmm_pin.calibration import rms
from aacmm_pin.diagnosis import Diagnosis, Finding, too_good
from aacmm_pin.effects import Effect, corrects_seat, in_words, listed, text_of
from aacmm_pin.measurements import LABELS
from aacmm_pin.report.numbers import lengths

WORTH_CALIBRATION = 0.7
"""Ratio of residuals below which calibration is useful."""
PLACE, SCALE = ("x", "y", "z", "place"), "scale"
"""Names of what :mod:`aacmm_pin.diagnosis.covariates` calls so."""
ORDER = ("record", "time")
"""Covariates of the order of the records."""
LENGTHS_OFF = ("bar_length_off", "relation_off")
"""Notes on stated lengths and angles that all else contradicts."""
MORE_RECORDS = "take more records, at other postures"


def urgent_step(result: Diagnosis, with_structure: bool) -> str:
    """Advice to repair set-up, readings or references first; "" if they seem right."""
    unexplained = result.unexplained
    if too_good(result.extended):
        return (
            "check the value and unit of the stated noise, because noise of this size hides most "
            "causes. Check also that the angles are readings, not planned angles"
        )
    if any(note.code == "rows_in_another_frame" for note in result.notes):
        return (
            "label the rows of each reference frame in the column session. Then diagnose the "
            "records with --reference-frame session"
        )
    if result.extended.too_many_excluded and not with_structure:
        return (
            "find what the excluded records have in common, repeat some excluded records, and "
            "state time_s and session of all records"
        )
    if result.reversed_torques:
        return (
            "reverse the sign of all columns torque1_nm …, because they have to be the torques "
            "with which the drives hold the load, not the moments of the load. Then diagnose the "
            "records again"
        )
    choice = result.choice
    for block in choice.covariates:
        if (choice.covariate(block).name, choice.way(block).carrier) == ("session", "frame"):
            return (
                "diagnose the records again with --reference-frame session, because the stand or "
                "the references moved between the sessions"
            )
    for effect in (finding.effect for finding in result.findings):
        if effect.remedy:
            cause = in_words(effect, result.model.arm)
            return f"{effect.remedy} ({cause}). Then diagnose the records again"
    run_order, conditions = unexplained.run_order, result.extended.problem.measurements.conditions
    if run_order is not None and conditions.time is None:
        return (
            "state the time of each record in the column time_s, because consecutive records share "
            "an error. Approximate times are enough. Then diagnose the records again, to try "
            "slips, drifts and movements of the stand or the stylus"
        )
    if run_order is not None and run_order.joint is not None:
        return (
            f"examine encoder, cable and coupling of joint {run_order.joint}, because "
            "an intermittent error of consecutive records is likely. Then repeat the records"
        )
    if unexplained.readings and not unexplained.depends_on:
        joint = unexplained.readings[0].joint
        if conditions.approach is None:
            return (
                "if the rows are in the order of measurement, diagnose them with "
                "--approach-from-order. Otherwise repeat the records and state in the columns "
                f"approach1 … the direction of the last motion of joint {joint}"
            )
        return (
            f"approach some postures with joint {joint} from both sides and with other loads, to "
            "find the error of its encoder or gear"
        )
    # A wrong length makes residuals everywhere, which then seem to depend on the place.
    is_of_length = any(note.code in LENGTHS_OFF for note in result.contradicted)
    if result.contradicted and (is_of_length or not with_structure):
        return f"measure the references again, because {'; '.join(map(str, result.contradicted))}"
    excluded = unexplained.excluded
    if with_structure and excluded is not None and excluded.name in ORDER:
        return (
            f"find what differed for the records that have {excluded.where}, such as the stand, "
            "the references or an encoder. Diagnose these records and the others separately"
        )
    return ""


def step_for_odd_records(result: Diagnosis) -> str:
    """Advice if one group of records, or each posture, has an error of its own; else ""."""
    groups, depends_on = result.unexplained.groups, result.unexplained.depends_on
    if groups and depends_on[:1] == (groups[0].name,):
        return (
            f"set up {groups[0].name} again, and repeat its records. Diagnose the "
            "other records without this group"
        )
    if result.unexplained.shared_by_postures is not None and not depends_on:
        return (
            "repeat the same postures on another day, with the stand or the references elsewhere, "
            "to find whether the arm, the set-up or the references cause the shared error"
        )
    return ""


def step_for_structure(result: Diagnosis) -> str:
    """How to find on what the structure depends."""
    if result.unexplained.depends_on:
        return _how_to_vary(result, result.unexplained.depends_on)
    if result.choice.noise.repeat:
        return (
            "check columns, units and reference frame, because the residuals exceed the scatter of "
            "the repeats. Add columns for quantities that change between postures"
        )
    return (
        "repeat some postures without any change, because the scatter of the repeats is the "
        "true noise. If this scatter is as stated, check columns, units and reference frame, "
        "and add columns for other quantities that change"
    )


def step_for_seats(result: Diagnosis) -> str:
    """Which seats to measure again, with their errors; or ""."""
    seats = []
    for finding in result.findings:
        if corrects_seat(finding.effect):
            in_base = [value for value, _ in finding.parameters.values()]
            in_file = result.choice.fit.point.frame.rotation @ in_base
            values = ", ".join(f"{value:.3f}" for value in in_file)
            error = f"true minus stated coordinates: ({values}) mm, according to these records"
            seats.append(f"seat {finding.effect.place} ({error})")
    if not seats:
        return ""
    return (
        f"measure the coordinates of {listed(seats)} again. Then check the extended arm on new "
        "records"
    )


def step_with_extended_arm(result: Diagnosis) -> str:
    """How to check the extended arm."""
    frame, held_out = result.extended.problem.setup.reference_frame, result.held_out
    option = "" if frame == "base" else f" --reference-frame {frame}"
    where = "in these records" if held_out is None else "in held-out records"
    size = result.rms["extended"] if held_out is None else rms(held_out.extended)
    expected = lengths([*result.rms.values(), size])[-1]
    planes = " from planes" if result.extended.observations.on_plane.all() else ""
    return (
        f"take new records over the full ranges of the joints. Run aacmm-pin check{option} with "
        f"the extended arm on the new records. The RMS distance{planes} should be about "
        f"{expected}, as {where}"
    )


def step_without_causes(result: Diagnosis) -> str:
    """Calibrate if it is worth it, and keep the records."""
    before, after = result.rms["nominal"], result.rms["recalibrated"]
    shown = "{} of {} causes of typical magnitude".format(*result.visible)
    calibrate = ""
    if after < WORTH_CALIBRATION * before:
        calibrate = (
            "calibrate the arm, because recalibration alone reduces the RMS residual from "
            f"{' to '.join(lengths([before, after]))}. Then "
        )
    return f"{calibrate}keep these records for the next check. These records would show {shown}"


def step_to_distinguish(result: Diagnosis, doubtful: Sequence[Finding] = ()) -> str:
    """How to separate two causes in which the most probable set and a possible other set differ."""
    best = next(iter(result.alternatives))
    named = {finding.label: finding.effect for finding in result.findings}
    pairs = (labels for labels in result.cannot_tell_apart if len(labels) == 2)
    pair = sorted(next(pairs, ()), key=lambda label: label not in best)
    causes = [named.get(label) or result.cause(label) for label in pair]
    effects = [cause for cause in causes if cause is not None]
    if len(effects) == 2:
        return _to_distinguish_pair(result, *effects)
    for finding in doubtful:
        if finding.aliases and finding.aliases[0].effect is None:
            covariate = finding.aliases[0].label
            return (
                f"to distinguish {finding.label} from other causes that depend on {covariate}, "
                f"{_how_to_vary(result, [covariate])}"
            )
    return f"{MORE_RECORDS}, to find which of the listed causes act"


def _to_distinguish_pair(result: Diagnosis, cause: Effect, other: Effect) -> str:
    """No plan separates a cause from a free form at the same place."""
    if cause.refitted or other.refitted:  # so that no plan can split it from another
        return f"{MORE_RECORDS}, to distinguish {cause.label} from {other.label}"
    for specific, free in ((cause, other), (other, cause)):
        acts_at_same_place = (
            free.function_of == specific.function_of and free.place == specific.place
        )
        if free.free_form and acts_at_same_place:
            return (
                f"take more records with joint {specific.place} evenly over its range, to find how "
                "the error depends on the angle"
            )
    command = _plan_command(result, cause, other)
    return f"plan records that distinguish {cause.label} from {other.label}: {command}"


def _plan_command(result: Diagnosis, cause: Effect, other: Effect) -> str:
    records, setup = result.extended.problem.measurements, result.extended.problem.setup
    source, name = records.source, result.model.arm.name.lower()
    seats, encoder = records.conditions.seat, setup.encoder_noise
    encoder_noises = np.unique([] if encoder is None else encoder)
    is_at_seats = seats is not None and np.mean(seats != "") > 0.5
    noise = {"--u-reference-mm": setup.reference_noise, "--probe-noise-mm": setup.probe_noise}
    # Scatter beyond what was stated is of the contacts at seats, or of the coordinates.
    scattered_option = "--probe-noise-mm" if is_at_seats else "--u-reference-mm"
    noise[scattered_option] = float(
        np.hypot(noise[scattered_option] or 0.0, result.extended.scatter)
    )
    options = {
        "--causes": f"{text_of(cause)} {text_of(other)}",
        "--existing": quote(source) if source.endswith(".csv") else "DATA.csv",
        "--scheme": is_at_seats and "seats",
        "--reference-frame": setup.external and setup.reference_frame,
        "--target": setup.target != "tip" and setup.target,
        **{option: size and f"{size / MM:.4g}" for option, size in noise.items()},
        "--encoder-noise": encoder_noises.size == 1 and f"{encoder_noises[0]:g}",
        "-o": "plan.csv",
    }
    arm = name if name in bundled_arms() else "ARM.toml"
    stated_options = [f"{option} {value}" for option, value in options.items() if value]
    prior = "" if setup.prior else " --no-prior"
    return f"aacmm-pin plan distinguish {arm} {' '.join(stated_options)}{prior}"


def _how_to_vary(result: Diagnosis, depends_on: Sequence[str]) -> str:
    joints = [name for name in depends_on if name.startswith("joint ")]
    moments = [name for name in depends_on if name.startswith("moment ")]
    labels = [name for name in depends_on if name.split()[0] in LABELS]
    not_numeric = {*joints, *moments, *labels, *PLACE, SCALE, *ORDER}
    numbers = [name for name in depends_on if name not in not_numeric]
    at_another_time = "repeat some postures at another time"
    unchanged = "without any other change"
    proposals = [
        (joints, f"probe the same places in postures with other angles of {listed(joints)}"),
        (
            {*PLACE} & {*depends_on},
            "measure the same postures with the stand or the reference instrument elsewhere, to "
            "find whether the room or the arm causes the error",
        ),
        (
            SCALE in depends_on,
            "measure a length with an independent calibration, to find whether the references or "
            "the arm have the error",
        ),
        (
            moments,
            "probe the same places with another load, or in postures with another "
            f"{listed(moments)}",
        ),
        (labels, f"repeat some postures with another {listed(labels)}, {unchanged}"),
        (numbers, f"{at_another_time}, with other values of {listed(numbers)}"),
        ({*ORDER} & {*depends_on} and not numbers, f"{at_another_time}, {unchanged}"),
    ]
    steps = [text for concerned, text in proposals if concerned]
    if not result.choice.noise.repeat:
        steps.append("also repeat some records without any change")
    return "; ".join(steps)
