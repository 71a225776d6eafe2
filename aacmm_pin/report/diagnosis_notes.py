"""Notes on assumptions and limits of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aacmm_pin._support.display import Note
from aacmm_pin.calibration.calibrate import notes_of as notes_of_fit
from aacmm_pin.diagnosis import Diagnosis, not_tried, too_good
from aacmm_pin.effects import (
    CONDITION_COLUMNS,
    Conditions,
    Effect,
    cause_in_words,
    listed,
    values_in_words,
    values_with_u,
)

RESTARTS = 5
"""If a clock goes back more often, the records are in another order."""
LATE = 10.0
"""A clock that starts later than so many durations of the records does not count from switching
on.
"""


def notes_of(result: Diagnosis) -> Iterator[Note]:
    """Notes on what the diagnosis did not try or assumed."""
    choice, extended, findings = result.choice, result.extended, result.findings
    arm, conditions = result.model.arm, extended.problem.measurements.conditions
    yield from notes_of_fit(extended)
    lacking = []
    for need, causes in not_tried(arm, choice.library, choice.fit.problem.measurements).items():
        names = listed([cause_in_words(cause) for cause in causes])
        lacking.append(f"{names} (column {CONDITION_COLUMNS[need]})")
    if lacking:
        yield Note("causes_not_tried", {"causes": lacking})
    if choice.otherwise:
        yield Note("excluded_would_show", {"causes": choice.otherwise})
    if not choice.posterior.agree:
        yield Note("explorations_disagree", {"difference": choice.posterior.disagreement})
    for finding in findings:
        for key in finding.below_zero:
            yield Note("value_below_zero", {"cause": finding.label, "value": key})
    lasting = [f.label for f in findings if f.was is None and "time" not in f.effect.needs]
    if lasting and result.recalibrated.problem.from_earlier:
        yield Note("partly_in_calibration", {"causes": lasting})
    effects = [finding.effect for finding in findings]
    loaded = [e.label for e in effects if hasattr(e, "load_at") and "torque" not in e.needs]
    if any(getattr(effect, "bodies", ()) for effect in effects):
        yield Note("masses_missing", {"causes": loaded})
    elif loaded:
        yield Note("masses_exact", {"causes": loaded})
    for finding in findings:
        until = getattr(finding.effect, "until_s", None)
        if until is not None:
            yield Note("drift_slope", {"cause": finding.label, "until": until})
    for finding in findings:
        if finding.beside is not None:
            yield Note("on_top", {"cause": finding.label, "other": finding.beside.label})
    yield from _notes_of_known_causes(result)
    for effect in result.before.problem.model.effects:
        yield from effect.validity_notes(conditions)
    yield from _notes_of_clock(conditions)
    if too_good(extended):
        chi2, dof = extended.chi2
        yield Note("noise_too_large", {"chi2": chi2, "dof": dof})
    yield from result.assumed


def _notes_of_clock(conditions: Conditions) -> Iterator[Note]:
    """A clock that restarts, starts late or is below zero."""
    time = conditions.time
    if time is None or np.ptp(time) == 0.0:
        return
    restarts = 0 if conditions.session is not None else int((np.diff(time) < 0).sum())
    if 0 < restarts <= RESTARTS < len(time):
        yield Note("clock_restarts", {"times": restarts})
    elif not 0.0 <= time.min() < LATE * np.ptp(time):
        yield Note("clock_offset", {"least": float(time.min())})


def _notes_of_known_causes(result: Diagnosis) -> Iterator[Note]:
    """Causes of the model whose values have changed, or that have gone."""
    for finding in result.findings:
        former, joint_slides = finding.was, finding.slides
        if former is not None:
            stated = values_with_u(former, np.diag(np.square(former.u)))
            data = {"cause": finding.label, "was": _values(former, stated, joint_slides)}
            if finding.gone:
                yield Note("known_cause_gone", data)
            else:
                now = _values(finding.effect, finding.parameters, joint_slides)
                yield Note("known_cause_changed", data | {"now": now})


def _values(effect: Effect, values: dict[str, tuple[float, float]], slides: bool) -> str:
    return ", ".join([values_in_words(effect, values, slides), *effect.details])
