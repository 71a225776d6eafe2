"""What a diagnosis assumed, and what limits what it states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from aacmm_pin._support.notes import Note
from aacmm_pin.calibration.calibrate import notes_of as notes_of_fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis import (
    THRESHOLDS,
    Choice,
    Diagnosis,
    Doubt,
    Finding,
    Unexplained,
    estimated,
    not_tried,
    too_good,
)
from aacmm_pin.effects import (
    CONDITION_COLUMNS,
    Effect,
    cause_in_words,
    listed,
    name_in_words,
    probability,
    several_in_words,
    values_in_words,
    values_with_u,
)
from aacmm_pin.report.numbers import p_equals

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
    return [
        *notes_of_fit(extended),
        *_not_tried(choice),
        *_otherwise(choice),
        *_disagreement(result),
        *_below_zero(findings),
        *_since(findings, result.recalibrated),
        *_of_masses(findings),
        *_slopes(findings),
        *(
            Note("on_top", {"cause": f.label, "other": f.beside.label})
            for f in findings
            if f.beside
        ),
        *_changed(findings, known, choice),
        *(
            text
            for effect in known
            for text in effect.validity_notes(extended.problem.measurements.conditions)
        ),
        *_size(extended),
        *_clock(extended),
        *_too_good(extended),
        *result.assumed,
    ]


def doubts_in_words(result: Diagnosis) -> list[str]:
    """What keeps the verdict from being ``explained`` or ``no-discrepancy``, but for what is said
    of the causes.
    """
    return [str(note) for doubt in result.doubts if (note := _doubt(result, doubt))]


def _doubt(result: Diagnosis, doubt: Doubt) -> Note | None:
    """None where the verdict, or another doubt, says it.

    Raises:
        LookupError: a doubt has no sentence.
    """
    (seen, of), arm = result.visible, result.model.arm
    match doubt:
        case "contradicted references":
            return Note(
                "contradicted_references", {"places": "; ".join(map(str, result.contradicted))}
            )
        case "few causes shown":
            return Note("few_causes_shown", {"seen": seen, "of": of})
        case "cause not named":
            causes, records = (
                labels_in_words(result, result.otherwise),
                int(result.extended.excluded.sum()),
            )
            return Note("cause_not_named", {"causes": causes, "records": records})
        case "below zero":
            negative = [finding.effect for finding in result.findings if finding.below_zero]
            return Note("causes_below_zero", {"causes": several_in_words(negative, arm)})
        case "cause not borne out" if "no better" not in result.doubts:
            unconfirmed = [finding.effect for finding in result.findings if not finding.borne_out]
            return Note("causes_unconfirmed", {"causes": several_in_words(unconfirmed, arm)})
        case "structure left" if result.verdict != "unexplained":
            return Note("structure_left", {"chance": beside_threshold(result.unexplained)})
        case "starts disagree":
            return Note("starts_disagree")
        case "more causes":
            return Note(
                "more_causes",
                {"probability": probability(result.more), "threshold": THRESHOLDS.settled},
            )
        case "no better" | "cause not borne out" | "structure left":
            return None
    raise LookupError(doubt)


def beside_threshold(left: Unexplained) -> str:
    """The p-value of what is left, and below which something is: ``p = 0.02, threshold 0.001 beside
    what was named``.
    """
    where = (
        "where nothing was named"
        if left.threshold == THRESHOLDS.left_alone
        else "beside what was named"
    )
    return f"{p_equals(left.p_value)}, threshold {left.threshold:g} {where}"


def labels_in_words(result: Diagnosis, labels: Sequence[str]) -> str:
    """Causes and covariates that labels of the result name, in a row."""
    causes = [result.cause(label) for label in labels]
    pairs, arm = zip(labels, causes, strict=True), result.model.arm
    return listed(
        [
            f"dependence on {label}" if cause is None else name_in_words(cause, arm)
            for label, cause in pairs
        ]
    )


def _disagreement(result: Diagnosis) -> list[Note]:
    """Two halves of the starts that found different sets."""
    posterior = result.choice.posterior
    if posterior.agree:
        return []
    return [Note("explorations_disagree", {"difference": posterior.disagreement})]


def _not_tried(choice: Choice) -> list[Note]:
    """Columns that the file lacks, and what could not be tried without them."""
    lacking = not_tried(choice.library, choice.fit.problem.measurements).items()
    each = [
        f"no {CONDITION_COLUMNS[need]}: {listed([cause_in_words(c) for c in causes])} not tried"
        for need, causes in lacking
    ]
    return [Note("causes_not_tried", {"columns": "; ".join(each)})] if each else []


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
    now = {
        effect.identity: (effect, values_with_u(effect, covariance))
        for effect, covariance in estimated(choice)
    }
    found, of_known = (
        {effect.identity for effect in some} for some in ((f.effect for f in findings), known)
    )
    for f in findings:
        same = f.effect.identity in of_known
        others = (
            []
            if same
            else [old for old in known if old.label == f.label and old.identity not in found]
        )
        for old in others or [old for old in known if old.identity == f.effect.identity]:
            was = _in_words(old, values_with_u(old, np.diag(np.square(old.u))), f.slides)
            data = {"cause": f.label, "was": was}
            if f.gone:
                yield Note("known_cause_gone", data)
            elif same or old.identity not in now:
                yield Note(
                    "known_cause_changed",
                    {**data, "now": _in_words(f.effect, f.parameters, f.slides)},
                )
            else:
                yield Note(
                    "known_cause_beside", {**data, "now": _in_words(*now[old.identity], f.slides)}
                )


def _in_words(effect: Effect, values: dict[str, tuple[float, float]], slides: bool) -> str:
    """Values with U, and inner values."""
    return ", ".join([values_in_words(effect, values, slides), *effect.details])


def _size(extended: Fit) -> list[Note]:
    """The length on which all others rest."""
    held = extended.problem.setup.held
    return [] if held is None else [Note("size_taken", {"length": held.label})]


def _below_zero(findings: Sequence[Finding]) -> list[Note]:
    """Values that nature has above zero only."""
    each = [(finding.label, key) for finding in findings for key in finding.below_zero]
    return [Note("value_below_zero", {"cause": label, "value": key}) for label, key in each]


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
    """Residuals far smaller than the stated noise."""
    if extended.chi2_stated is None or not too_good(extended):
        return []
    found, dof = extended.chi2_stated
    return [Note("noise_too_large", {"chi2": found, "dof": dof})]
