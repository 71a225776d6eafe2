"""What a diagnosis assumed, and what limits what it states; a line each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from aacmm_pin.calibration.calibrate import notes_of as notes_of_fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.diagnosis.candidates import not_tried
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.findings import estimated
from aacmm_pin.diagnosis.result import described, too_good
from aacmm_pin.effects import COLUMNS, Effect, cause_in_words, listed, values_in_words

RESTARTS = 5
"""A clock that goes back more often than this is of records in another order."""
LATE = 10.0
"""A clock is no time since switching on if it starts later than so many times what the records cover."""


def notes_of(result: Diagnosis) -> list[str]:
    """The lines."""
    choice, extended, findings = result.choice, result.extended, result.findings
    known = result.before.problem.model.effects
    return [
        *notes_of_fit(extended),
        *_not_tried(choice),
        *_otherwise(choice),
        *_disagreement(result),
        *_below_zero(findings),
        *_since(findings, result.recalibrated),
        *_of_masses(findings),
        *_slopes(findings),
        *(f"{f.label}: its values come on top of those of {f.beside.label}" for f in findings if f.beside),
        *_changed(findings, known, choice),
        *(text for effect in known for text in effect.validity_notes(extended.problem.measurements.conditions)),
        *_size(extended),
        *_clock(extended),
        *_too_good(extended),
        *result.assumed,
    ]


def _disagreement(result: Diagnosis) -> list[str]:
    """Two halves of the starts that found different sets."""
    posterior = result.choice.posterior
    if posterior.agree:
        return []
    return [
        "two explorations of the sets of causes disagree: an inclusion probability differs by "
        f"{posterior.total_variation:.2f}"
    ]


def _not_tried(choice: Choice) -> list[str]:
    """Columns that the file lacks, and what could not be tried without them; one line."""
    lacking = not_tried(choice.library, choice.fit.problem.measurements).items()
    each = [f"no {COLUMNS[need]}: {listed([cause_in_words(c) for c in causes])} not tried" for need, causes in lacking]
    return ["; ".join(each)] if each else []


def _otherwise(choice: Choice) -> list[str]:
    """What the records show that were excluded, if these are no gross errors."""
    if not choice.otherwise:
        return []
    named = listed(choice.otherwise)
    return [
        f"unless what was excluded are gross errors, all records together show {named}: take more records where those were"
    ]


def _slopes(findings: Sequence[Finding]) -> Iterator[str]:
    """Drifts of which the records show hardly more than that they go on."""
    for effect in (finding.effect for finding in findings):
        until = getattr(effect, "until_s", None)
        if until is not None:
            yield (
                f"{effect.label}: these records hardly tell its time constant; after {until:.4g} s, when they "
                "end, it may stop or go on, which is in u then: take records later, too"
            )


def _changed(findings: Sequence[Finding], known: Sequence[Effect], choice: Choice) -> Iterator[str]:
    """Causes that were known with other values, and those beside which another of their kind was found."""
    now = {effect.identity: (effect, described(effect, covariance)) for effect, covariance in estimated(choice)}
    found, of_known = ({effect.identity for effect in some} for some in ((f.effect for f in findings), known))
    for f in findings:
        same = f.effect.identity in of_known
        others = [] if same else [old for old in known if old.label == f.label and old.identity not in found]
        for old in others or [old for old in known if old.identity == f.effect.identity]:
            was = _in_words(old, described(old, np.diag(np.square(old.u))), f.slides)
            if f.gone:
                yield f"{f.label} was known as {was}, and is gone"
            elif same or old.identity not in now:
                yield f"{f.label} was known as {was}, and has changed to {_in_words(f.effect, f.parameters, f.slides)}"
            else:
                yield f"{f.label} was known as {was}; beside the new one it is {_in_words(*now[old.identity], f.slides)}"


def _in_words(effect: Effect, values: dict[str, tuple[float, float]], slides: bool) -> str:
    """Values with U, and inner values."""
    return ", ".join([values_in_words(effect, values, slides), *effect.details])


def _size(extended: Fit) -> list[str]:
    """The length on which all others rest."""
    held = extended.problem.setup.held
    if held is None:
        return []
    return [f"no coordinates and no bar tell the arm's size: the length of {held.label} is taken as the arm's file has it"]


def _below_zero(findings: Sequence[Finding]) -> list[str]:
    """Values that nature has above zero only."""
    return [
        f"{finding.label}: {key} is negative beyond its U (k = 2), where nature has it above zero only: something else acts "
        "like this cause, or the sign of what it rests on (gravity, torques, temperatures) is wrong"
        for finding in findings
        for key in finding.below_zero
    ]


def _since(findings: Sequence[Finding], recalibrated: Fit) -> list[str]:
    """Causes of which a part would be in the values of an earlier calibration, if they acted then."""
    lasting = [f.label for f in findings if f.was is None and "time" not in f.effect.needs]
    if not (lasting and recalibrated.problem.from_earlier):
        return []
    return [
        f"{listed(lasting)}: the values hold if nothing of it acted when the arm was calibrated before, for part of it "
        "would be in what that calibration states; --no-prior does without"
    ]


def _of_masses(findings: Sequence[Finding]) -> list[str]:
    """What gives way under weights that nobody measured."""
    loaded = (finding for finding in findings if hasattr(finding.effect, "load_at"))
    names = [finding.label for finding in loaded if "torque" not in finding.effect.needs]
    if any(getattr(finding.effect, "bodies", ()) for finding in findings):
        return [
            f"{', '.join(names)}: the arm's file states no masses, so that no bending, no bearing and no stand was tried, "
            "which may look like it"
        ]
    return [f"{', '.join(names)}: U takes the masses in the arm's file as exact"] if names else []


def _clock(extended: Fit) -> list[str]:
    """A clock that does not count from the moment at which the arm was switched on."""
    conditions = extended.problem.measurements.conditions
    time = conditions.time
    if time is None or np.ptp(time) == 0.0:
        return []
    back = 0 if conditions.session is not None else int((np.diff(time) < 0).sum())
    if 0 < back <= RESTARTS < len(time):
        return [f"time_s goes back in the file ({back} times): a clock that starts anew needs labels in the column session"]
    if 0.0 <= time.min() < LATE * np.ptp(time):
        return []
    starts, answer = ("late", "cannot be seen here") if time.min() > 0.0 else ("below 0", "does nothing before")
    return [f"time_s starts {starts}: a warm-up counts from 0, the moment of switching on, and {answer}"]


def _too_good(extended: Fit) -> list[str]:
    """Residuals far smaller than the stated noise."""
    if extended.chi2_stated is None or not too_good(extended):
        return []
    found, dof = extended.chi2_stated
    return [f"the residuals are far smaller than the stated noise (χ² {found:.0f} of {dof:.0f}): is it stated too large?"]
