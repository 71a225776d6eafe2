"""What a diagnosis assumed, and what limits what it states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from aacmm_pin._support.notes import Note
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.calibrate import notes_of as notes_of_fit
from aacmm_pin.diagnosis import (
    Choice,
    Diagnosis,
    Finding,
    estimated,
    not_tried,
    too_good,
)
from aacmm_pin.effects import (
    CONDITION_COLUMNS,
    Effect,
    cause_in_words,
    listed,
    values_in_words,
    values_with_u,
)

RESTARTS = 5
"""A clock that goes back more often than this is of records in another order."""
LATE = 10.0
"""A clock is no time since switching on if it starts later than so many times what the records
cover.
"""


def notes_of(result: Diagnosis) -> list[Note]:
    """The notes."""
    choice, extended, findings = result.choice, result.extended, result.findings
    known = result.before.problem.model.effects
    conditions = extended.problem.measurements.conditions
    notes = [*notes_of_fit(extended), *_not_tried(choice), *_otherwise(choice)]
    notes += [*_disagreement(result), *_below_zero(findings)]
    notes += _since(findings, result.recalibrated)
    notes += [*_of_masses(findings), *_slopes(findings), *_on_top(findings)]
    notes += _changed(findings, known, choice)
    for effect in known:
        notes += effect.validity_notes(conditions)
    return [*notes, *_size(extended), *_clock(extended), *_too_good(extended), *result.assumed]


def _on_top(findings: Sequence[Finding]) -> Iterator[Note]:
    """Causes of a joint whose values come on top of the same cause of the whole arm."""
    for finding in findings:
        if finding.beside is not None:
            yield Note("on_top", {"cause": finding.label, "other": finding.beside.label})


def _disagreement(result: Diagnosis) -> list[Note]:
    """Two halves of the starts that found different sets."""
    posterior = result.choice.posterior
    if posterior.agree:
        return []
    return [Note("explorations_disagree", {"difference": posterior.disagreement})]


def _not_tried(choice: Choice) -> list[Note]:
    """Columns that the file lacks, and what could not be tried without them."""
    problem = choice.fit.problem
    lacking = not_tried(problem.model.arm, choice.library, problem.measurements)
    each = []
    for need, causes in lacking.items():
        names = listed([cause_in_words(cause) for cause in causes])
        each.append(f"{names} (column {CONDITION_COLUMNS[need]})")
    return [Note("causes_not_tried", {"causes": each})] if each else []


def _otherwise(choice: Choice) -> list[Note]:
    """What the records show that were excluded, if these are no gross errors."""
    return [Note("excluded_would_show", {"causes": choice.otherwise})] if choice.otherwise else []


def _slopes(findings: Sequence[Finding]) -> Iterator[Note]:
    """Drifts of which the records show hardly more than that they go on."""
    for effect in (finding.effect for finding in findings):
        until = getattr(effect, "until_s", None)
        if until is not None:
            yield Note("drift_slope", {"cause": effect.label, "until": until})


def _changed(
    findings: Sequence[Finding], known: Sequence[Effect], choice: Choice
) -> Iterator[Note]:
    """Causes that were known with other values, and those beside which another of their kind was
    found.
    """
    now = {effect.identity: (effect, values) for effect, values in _estimates(choice)}
    found = {finding.effect.identity for finding in findings}
    for finding in findings:
        identity = finding.effect.identity
        same = [old for old in known if old.identity == identity]
        others = [old for old in known if old.label == finding.label and old.identity not in found]
        for old in same or others:
            was = _in_words(old, values_with_u(old, np.diag(np.square(old.u))), finding.slides)
            data = {"cause": finding.label, "was": was}
            if finding.gone:
                yield Note("known_cause_gone", data)
            elif same or old.identity not in now:
                data["now"] = _in_words(finding.effect, finding.parameters, finding.slides)
                yield Note("known_cause_changed", data)
            else:
                data["now"] = _in_words(*now[old.identity], finding.slides)
                yield Note("known_cause_beside", data)


def _estimates(choice: Choice) -> Iterator[tuple[Effect, dict[str, tuple[float, float]]]]:
    for effect, covariance in estimated(choice):
        yield effect, values_with_u(effect, covariance)


def _in_words(effect: Effect, values: dict[str, tuple[float, float]], slides: bool) -> str:
    """Values with U, and inner values."""
    return ", ".join([values_in_words(effect, values, slides), *effect.details])


def _size(extended: Fit) -> list[Note]:
    """The length on which all others rest."""
    held = extended.problem.setup.held
    return [] if held is None else [Note("size_taken", {"length": held.label})]


def _below_zero(findings: Sequence[Finding]) -> list[Note]:
    """Values that nature has above zero only."""
    notes = []
    for finding in findings:
        for key in finding.below_zero:
            notes.append(Note("value_below_zero", {"cause": finding.label, "value": key}))
    return notes


def _since(findings: Sequence[Finding], recalibrated: Fit) -> list[Note]:
    """Causes of which a part would be in the values of an earlier calibration, if they
    acted then.
    """
    lasting = [f.label for f in findings if f.was is None and "time" not in f.effect.needs]
    if not (lasting and recalibrated.problem.from_earlier):
        return []
    return [Note("partly_in_calibration", {"causes": lasting})]


def _of_masses(findings: Sequence[Finding]) -> list[Note]:
    """What gives way under weights that nobody measured."""
    loaded = (finding for finding in findings if hasattr(finding.effect, "load_at"))
    names = [finding.label for finding in loaded if "torque" not in finding.effect.needs]
    if any(getattr(finding.effect, "bodies", ()) for finding in findings):
        return [Note("masses_missing", {"causes": names})]
    return [Note("masses_exact", {"causes": names})] if names else []


def _clock(extended: Fit) -> list[Note]:
    """A clock that does not count from the moment at which the arm was switched on."""
    conditions = extended.problem.measurements.conditions
    time = conditions.time
    if time is None or np.ptp(time) == 0.0:
        return []
    back = 0 if conditions.session is not None else int((np.diff(time) < 0).sum())
    if 0 < back <= RESTARTS < len(time):
        return [Note("clock_restarts", {"times": back})]
    if 0.0 <= time.min() < LATE * np.ptp(time):
        return []
    return [Note("clock_starts_late" if time.min() > 0.0 else "clock_below_zero")]


def _too_good(extended: Fit) -> list[Note]:
    """Residuals far smaller than the noise."""
    if not too_good(extended):
        return []
    found, dof = extended.chi2
    return [Note("noise_too_large", {"chi2": found, "dof": dof})]
