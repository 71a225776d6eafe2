"""What to measure next, in a sentence: of a diagnosis, and of a plan where two causes are alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aacmm_pin._support.threads import one_blas_thread
from aacmm_pin.calibration import rms
from aacmm_pin.diagnosis import THRESHOLDS, Diagnosis, Finding, too_good
from aacmm_pin.effects import Effect, corrects_seat, in_words, listed
from aacmm_pin.measurements import LABELS
from aacmm_pin.report.doubts import WITH_STRUCTURE, doubts_in_words
from aacmm_pin.report.numbers import capital, lengths
from aacmm_pin.report.plan import advice, mostly_seats

WORTH_CALIBRATION = 0.7
"""Calibration that reduces the residuals to less than this part is worth it."""
PLACE, SCALE = ("x", "y", "z", "place"), "scale"
"""Names of what :mod:`aacmm_pin.diagnosis.covariates` calls so."""
MORE_RECORDS = "take more records, at other postures, to find which of the listed causes act"
ORDER = ("record", "time")
"""The same, of the order in which records were taken."""


@one_blas_thread
def next_measurements(result: Diagnosis) -> str:
    """Return a sentence with the next measurements that a diagnosis recommends.

    If the records cannot distinguish two causes, the sentence has a command for a plan that does.
    The function needs several seconds for such a plan.
    """
    first = _first(result)
    if result.verdict in WITH_STRUCTURE and result.cannot_tell_apart:
        return f"{first}. Then {_to_distinguish(result)}"
    return first


def _first(result: Diagnosis) -> str:
    """What to measure first."""
    verdict, findings, unexplained, (seen, of) = (
        result.verdict,
        result.findings,
        result.unexplained,
        result.visible,
    )
    if too_good(result.extended):
        return (
            "check the value and unit of the stated noise, because noise of this size hides most "
            "causes. Check also that the angles are readings, not planned angles"
        )
    if verdict == "inconclusive" and result.extended.too_many_excluded:
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
    better = [note for note in result.assumed if note.code == "session_frames_fit"]
    if better:
        return f"diagnose the records again. {capital(str(better[0]))}"
    of_set_up = [finding.effect for finding in findings if finding.effect.remedy]
    if of_set_up:
        moved = in_words(of_set_up[0], result.model.arm)
        return f"{of_set_up[0].remedy} ({moved}). Then diagnose the records again"
    if unexplained.run_order is not None and unexplained.run_order.joint is not None:
        joint = unexplained.run_order.joint
        return (
            f"examine encoder, cable and coupling of joint {joint}, because an intermittent error "
            "of consecutive records is likely. Then repeat the records"
        )
    if unexplained.readings and not unexplained.depends_on:
        joint = unexplained.readings[0].joint
        if result.choice.design.fit.problem.measurements.conditions.approach is None:
            return (
                "if the rows are in the order of measurement, diagnose them with "
                "--approach-from-order. Otherwise repeat the records and state in the columns "
                f"approach1 … the direction of the last motion of joint {joint}"
            )
        return (
            f"approach some postures with joint {joint} from both sides and with other loads, to "
            "find the error of its encoder or gear"
        )
    if (
        verdict in WITH_STRUCTURE
        and unexplained.excluded is not None
        and unexplained.excluded.name in ORDER
    ):
        where = unexplained.excluded.where
        return (
            f"find what differed for the records that have {where}, such as the stand, the "
            "references or an encoder. Diagnose these records and the others separately"
        )
    if result.contradicted and verdict not in WITH_STRUCTURE:
        return f"measure the references again, because {'; '.join(map(str, result.contradicted))}"
    if verdict == "inconclusive" and not findings and result.otherwise:
        return (
            "check the excluded records, and repeat them at the same postures, because with them "
            "diagnose would find a cause"
        )
    if verdict == "inconclusive" and not findings:
        return (
            f"take more records, at other postures, because these records would show only {seen} "
            f"of {of} causes of typical magnitude"
        )
    if verdict == "no-discrepancy":
        before, after = result.rms["simulation"], result.rms["recalibrated"]
        calibrate = ""
        if after < WORTH_CALIBRATION * before:
            calibrate = (
                "calibrate the arm, because recalibration alone reduces the RMS residual from "
                f"{' to '.join(lengths([before, after]))}. Then "
            )
        return (
            f"{calibrate}keep these records for the next check. These records would show "
            f"{seen} of {of} causes of typical magnitude"
        )
    if unexplained.groups and unexplained.depends_on[:1] == (unexplained.groups[0].name,):
        return (
            f"set up {unexplained.groups[0].name} again, and repeat its records. Diagnose the "
            "other records without this group"
        )
    if unexplained.shared_by_postures is not None and not unexplained.depends_on:
        return (
            "repeat the same postures on another day, with the stand or the references elsewhere, "
            "to find whether the arm, the set-up or the references cause the shared error"
        )
    if verdict in WITH_STRUCTURE and not unexplained.depends_on and unexplained.has_background:
        return (
            "take more records, at other postures, and add columns for other changing quantities, "
            "because the remaining structure depends on several quantities together"
        )
    if (
        verdict in WITH_STRUCTURE
        and not unexplained.depends_on
        and result.choice.noise.postures.repeat
    ):
        return (
            "check columns, units and reference frame, because the residuals exceed the scatter of "
            "the repeats. Add columns for quantities that change between postures"
        )
    if verdict in WITH_STRUCTURE and not unexplained.depends_on:
        return (
            "repeat some postures without any change, because the scatter of the repeats is the "
            "true noise. If this scatter is as stated, check columns, units and reference frame, "
            "and add columns for other quantities that change"
        )
    if verdict in WITH_STRUCTURE:
        return _otherwise(unexplained.depends_on) + _and_repeat(result)
    doubtful = [finding for finding in findings if finding.probability < THRESHOLDS.settled]
    if doubtful or verdict == "ambiguous":
        return _to_distinguish(result, doubtful)
    seats = [finding for finding in findings if corrects_seat(finding.effect)]
    if seats:
        return (
            f"measure the coordinates of {listed([*map(_off, seats)])} again. Then check the "
            "extended arm on new records"
        )
    if result.no_better:
        return (
            "take more records, at other postures, because the extended arm does not predict "
            "held-out records better than the recalibrated arm"
        )
    if negative := [effect.label for effect in result.below_zero]:
        return (
            "check the signs of gravity, torques and temperatures, because the value of "
            f"{' and '.join(negative)} is negative. If the signs are right, take more records, at "
            "other postures"
        )
    if verdict == "inconclusive":
        doubts = doubts_in_words(result) or ["these records do not confirm the named causes"]
        return f"take more records, at other postures, because {'; '.join(doubts)}"
    until = [getattr(finding.effect, "until_s", None) for finding in findings]
    if ends := [end for end in until if end is not None]:
        return (
            f"take records after {max(ends):.4g} s, with the same clock, to find whether the drift "
            "stops or continues"
        )
    frame = result.extended.problem.setup.reference_frame
    option = "" if frame == "base" else f" --reference-frame {frame}"
    return (
        f"take new records over the full ranges of the joints. Run aacmm-pin check{option} with "
        f"the extended arm on the new records. {_as_held_out(result)}"
    )


def _as_held_out(result: Diagnosis) -> str:
    """Which number of the extended arm at new records to compare with which."""
    sizes, held = result.rms, result.held_out
    if held is None:
        return f"The RMS distance should be about {lengths(sizes.values())[2]}, as in these records"
    *_, size = lengths([*sizes.values(), rms(held.extended)])
    return f"The RMS distance should be about {size}, as in held-out records"


def _and_repeat(result: Diagnosis) -> str:
    """Repeats show the noise, where there are none yet."""
    return (
        ""
        if result.choice.noise.postures.repeat
        else "; also repeat some records without any change"
    )


def _to_distinguish(result: Diagnosis, doubtful: Sequence[Finding] = ()) -> str:
    """How to distinguish the most probable set of causes from those that cannot be excluded."""
    if (pair := _open_pair(result)) is not None:
        return _to_distinguish_pair(result, *pair)
    for finding in doubtful:
        if finding.aliases and finding.aliases[0].effect is None:
            on = finding.aliases[0].label
            return (
                f"to distinguish {finding.label} from other causes that depend on {on}, "
                f"{_otherwise((on,))}{_and_repeat(result)}"
            )
    return MORE_RECORDS


def _open_pair(result: Diagnosis) -> tuple[Effect, Effect] | None:
    """A cause of the most probable set, and the one that the most probable other set has in its
    place which differs so and cannot be excluded.
    """
    best = next(iter(result.alternatives))
    found = {finding.label: finding.effect for finding in result.findings}
    pairs = (labels for labels in result.cannot_tell_apart if len(labels) == 2)
    pair = sorted(next(pairs, ()), key=lambda label: label not in best)
    causes = [found.get(label) or result.cause(label) for label in pair]
    one, other = causes or (None, None)
    return None if one is None or other is None else (one, other)


def _to_distinguish_pair(result: Diagnosis, cause: Effect, other: Effect) -> str:
    if cause.refitted or other.refitted:  # so that no plan can split it from another
        return (
            f"take more records, at other postures, to distinguish {cause.label} from {other.label}"
        )
    for one, freer in ((cause, other), (other, cause)):
        same_place = freer.function_of == one.function_of and freer.place == one.place
        if freer.free_form and same_place:
            return (
                f"take more records with joint {one.place} evenly over its range, to find how the "
                "error depends on the angle"
            )
    return _plan_for(result, (cause, other))


def _plan_for(result: Diagnosis, split: tuple[Effect, Effect]) -> str:
    problem = result.extended.problem
    records = problem.measurements
    if result.unexplained.shared_by_postures is not None:
        group = result.choice.noise.postures.group
        records = records.take(np.unique(group, return_index=True)[1])
    keywords = problem.setup.keywords | _noise_as_found(result)
    return advice(result.before.problem.model, split, records, **keywords)


def _noise_as_found(result: Diagnosis) -> dict[str, Any]:
    """The noise of records where it is more than what was stated: of references, or of contacts at
    seats [m], with the error that records of one posture share.
    """
    shared, setup = result.unexplained.shared_by_postures, result.extended.problem.setup
    of_postures = 0.0 if shared is None else shared.rms / np.sqrt(3.0)
    more = float(np.hypot(result.extended.unmodelled, of_postures))
    if not more:
        return {}
    at_seats = mostly_seats(result.extended.problem.measurements)
    name = "probe_noise" if at_seats else "reference_noise"
    found = {name: float(np.hypot(getattr(setup, name) or 0.0, more))}
    return found if setup.encoder_noise is not None else found | {"encoder_noise": 0.0}


def _off(finding: Finding) -> str:
    """Where the records put a seat."""
    values = ", ".join(f"{value:.3f}" for value, _ in finding.parameters.values())
    return f"seat {finding.effect.place} (wrong by ({values}) mm, according to these records)"


def _otherwise(depends_on: Sequence[str]) -> str:
    """What to do differently, so that what the residuals depend on is not tied to all the rest."""
    joints = [name for name in depends_on if name.startswith("joint ")]
    places = [name for name in depends_on if name in PLACE]
    others = [name for name in depends_on if name not in (*joints, *places, SCALE)]
    found = []
    if joints:
        found.append(f"probe the same places in postures with other angles of {listed(joints)}")
    if places:
        found.append(
            "measure the same postures with the stand elsewhere, to find whether the room or the "
            "arm causes the error"
        )
    if SCALE in depends_on:
        found.append(
            "measure a length with an independent calibration, to find whether the references or "
            "the arm have the error"
        )
    if moments := [name for name in others if name.startswith("moment ")]:
        found.append(
            "probe the same places with another load, or in postures with another "
            f"{listed(moments)}"
        )
        others = [name for name in others if name not in moments]
    labels = [name for name in others if name.split()[0] in LABELS]
    if labels:
        found.append(
            f"repeat some postures with another {' and another '.join(labels)}, without any other "
            "change"
        )
    if numbers := [name for name in others if name not in (*labels, *ORDER)]:
        found.append(
            f"repeat some postures at another time, with other values of {listed(numbers)}"
        )
    elif set(others) & set(ORDER):
        found.append("repeat some postures at another time, without any other change")
    return "; ".join(found)
