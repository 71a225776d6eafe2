"""From an arm and measurements to a verdict, its causes, an extended model and the gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.progress import Progress
from aacmm_pin._support.threads import one_blas_thread
from aacmm_pin.calibration.calibrate import contradicted_places, counted_once, notes_of
from aacmm_pin.calibration.calibrated_arm import calibrated_model
from aacmm_pin.calibration.cross_validation import enough_postures, parts_of
from aacmm_pin.calibration.fit import Fit, fit
from aacmm_pin.calibration.input_mistakes import first_fit
from aacmm_pin.calibration.parameters import found_anew, length_held, problem_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.setup import ReferenceFrame, Setup, Target, checked_input
from aacmm_pin.diagnosis.candidates import candidates, known_causes, not_tried
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.diagnosis.cross_validation import Gain, gain_of, survivors
from aacmm_pin.diagnosis.evidence import Conditional
from aacmm_pin.diagnosis.findings import UNLIKELY, estimated, findings_of
from aacmm_pin.diagnosis.model_extension import Choice, ProblemOf, choose, free, in_its_place, refitted
from aacmm_pin.diagnosis.result import LIKELIER, SETTLED, Diagnosis, Finding, described, no_better, too_good
from aacmm_pin.diagnosis.significance import InPairs, Place, Strength, in_pairs, look_alikes, strengths, visible
from aacmm_pin.diagnosis.undetected import Other, Others, known_alone, others_beside
from aacmm_pin.diagnosis.unexplained import Unexplained, unexplained_by
from aacmm_pin.diagnosis.verdict import doubts_of, verdict_of
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import COLUMNS
from aacmm_pin.effects.drift_and_hysteresis import ZeroDrift
from aacmm_pin.effects.error_model import ErrorModel, GivenCause, GivenModel, as_causes
from aacmm_pin.effects.gravity import LoadedEffect
from aacmm_pin.effects.labels import listed, probability, values_in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import GivenRecords, Measurements

MUCH_MORE = 1.15
"""Residuals larger by this than the stated noise, beyond chance, are not explained by what was found."""
PLAIN_ENCODER = 3e-5
"""Noise of a reading that a plain encoder has where none is stated [rad]."""
NOTHING = 1e-12
"""Residuals smaller than this were never measured [m]."""
RESTARTS = 5
"""A clock that goes back more often than this is of records in another order."""
LATE = 10.0
"""A clock is no time since switching on if it starts later than so many times what the records cover."""


@one_blas_thread
def diagnose(
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
    hold_out: bool = True,
    extra_causes: Sequence[GivenCause] = (),
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> Diagnosis:
    """Show what the simulation gets wrong, name the cause, extend the model, measure the gain.

    The residuals are judged after geometry, reference frame and unknown points have been refitted, each record by its own
    noise. Causes compete by their evidence, with priors on their physical magnitude; they are admitted one by one, all
    ranked again each time, looked back at, and tried in pairs; p-values are family-wise. Structure over a covariate
    competes as well, so that what no cause explains is said to be that. The gain is measured on groups of records that had
    no part in choosing or fitting.

    Args:
        model: the arm, with the effects that are known of it.
        measurements: the records.
        reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise: see
            :func:`aacmm_pin.calibration.calibrate`.
        hold_out: measure the gain.
        extra_causes: causes to try besides, at places or with inner values (orders, times, other fields) that are not
            tried anyway; causes of your own are, once they are registered (:func:`aacmm_pin.effects.register`). They
            compete with the others, by the ``typical`` size of their terms; their values do not count.
        rng: for the draws behind p-values and intervals, and the groups left out; default seed 1.
        progress: show bars in a notebook, or on stderr at a terminal; or a function such as ``tqdm`` that wraps the groups
            left out.

    Raises:
        AacmmError, UnknownNameError, MissingConditionError: see :func:`aacmm_pin.calibration.calibrate`.
    """
    model, measurements = checked_input(model, measurements)
    extra = as_causes(extra_causes, model, measurements.conditions.present)
    setup = Setup.of(model.arm, reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise)
    measurements, repeated = counted_once(measurements)
    if prior and model.arm.unexplained and model.arm.covariance is not None:
        # What was not explained then is partly in the parameters, and would be missing from the cause that is found now.
        model = model.without_covariance
        repeated.append(
            f"the calibration of {model.arm.name} left something unexplained ({model.arm.unexplained}): what it states of "
            "the parameters is not used"
        )
    rng = rng or np.random.default_rng(1)
    problem = _extensible(model, measurements, setup)
    recalibrated = first_fit(problem([]))
    if not np.nanmax(np.abs(recalibrated.solution.system.deviation), initial=0.0) > NOTHING:
        few = recalibrated.problem.scales.size >= 3 * measurements.n
        why = "they are too few, unless the noise is stated" if few else "is the file filled in?"
        raise AacmmError(f"{measurements.source}: all {measurements.n} records agree with the fitted arm exactly: {why}")
    kind, parts = parts_of(recalibrated, rng)
    library = candidates(model, measurements, recalibrated.problem, extra)
    choice = choose(problem, recalibrated, library, covariates(model.arm, measurements), parts, progress is True)
    choice, pairs, strong = _judged(_surviving(choice, problem), problem, rng)
    # Parts are left out by postures, which says nothing of what depends on time.
    of_time = {k for k in choice.causes if "time" in choice.variant(k).needs}
    improbable = {s.block for s in strong if s.block in of_time and s.probability < UNLIKELY}
    left_out = frozenset(choice.question.owner(k) for k in improbable)
    if improbable:  # a part of structure that no cause explains, and harm at another time
        kept = tuple(k for k in choice.admitted if k not in improbable)
        choice, pairs, strong = _judged(_with_only(choice, problem, kept), problem, rng)
    used, setup, alone = choice.fit.used, recalibrated.problem.setup, recalibrated
    before, recalibrated = (fit(asked, used=used) for asked in (problem_of(model, measurements, [], setup), problem([])))
    held = gain_of(choice, before, kind, rng, progress, left_out) if hold_out and enough_postures(measurements) else None
    if choice.held is not choice.gram:
        choice.held.products.release()
    found = findings_of(model, choice, strong)
    # Without a finding nothing explains what the recalibrated arm alone excludes.
    places = dict.fromkeys(place for one in (choice.fit, *([] if found else [alone])) for place in contradicted_places(one))
    if held is not None and not found:
        held = held.of_nothing()
    notes = [*_rivals(choice, pairs), *repeated]
    result = _concluded(model, choice, before, recalibrated, strong, held, found, tuple(places), notes)
    choice.gram.products.release()
    return result


def _judged(choice: Choice, problem: ProblemOf, rng: np.random.Generator) -> tuple[Choice, list[InPairs], list[Strength]]:
    """The choice with new causes in the place of known ones, its pairs, and how sure each block is."""
    choice = replace(choice, fit=in_its_place(problem, choice))
    pairs = in_pairs(choice)
    return choice, pairs, strengths(choice, _excess(choice.fit), pairs, rng)


def _extensible(model: ErrorModel, measurements: Measurements, setup: Setup) -> ProblemOf:
    """The calibration problem with some causes estimated too. What the arm is known to have is refitted with the geometry,
    within what is stated of it; freely where nothing is, or where it is itself among the causes, for it may have changed.
    """
    known = {effect.identity: effect for effect in known_causes(model, measurements, setup)}
    others = (
        effect for effect in model.effects if effect.identity not in known and not found_anew(effect, setup, measurements)
    )
    untold = [effect.at(effect.values, free(effect).u) for effect in others]
    held = length_held(problem_of(model, measurements, ["geometry", *untold, *known.values()], setup))
    setup = replace(setup, held=held)

    def problem(causes: Sequence[Effect], gone: Sequence[Effect] = ()) -> Problem:
        freed = [
            replace(cause, values=known[cause.identity].values) if cause.identity in known else cause for cause in causes
        ]
        found = {cause.key for cause in (*causes, *gone)}
        places = {cause.label for cause in causes if cause.inner and cause.identity not in known}
        within = [effect for effect in known.values() if effect.key not in found]
        beside = [effect.at(effect.values, free(effect).u) for effect in within if effect.label in places]
        within = [effect for effect in within if effect.label not in places]
        asked = problem_of(model, measurements, ["geometry", *untold, *within, *beside, *freed], setup)
        return replace(asked, candidates=len(beside) + len(freed))

    return problem


def _concluded(
    model: ErrorModel,
    choice: Choice,
    before: Fit,
    recalibrated: Fit,
    strong: list[Strength],
    held: Gain | None,
    findings: list[Finding],
    contradicted: tuple[str, ...],
    notes: list[str],
) -> Diagnosis:
    """What a choice of causes says, beside the arm as it was and recalibrated."""
    extended = choice.fit
    named = [finding.label for finding in findings]
    unexplained = unexplained_by(choice, strong, held, bool(findings))
    told = {finding.label for finding in findings if finding.probability >= SETTLED}
    structure = bool(unexplained.depends_on) or unexplained.branches is not None or _excess(extended) > 0.0
    shown, others = visible(choice), others_beside(choice, named)
    otherwise = (*choice.otherwise, *(effect.label for effect in choice.effects if effect.label not in named))
    worse = no_better(model.arm, findings, held)
    doubts = doubts_of(findings, unexplained.left, others.probability, shown, otherwise, worse, contradicted)
    return Diagnosis(
        verdict=verdict_of(findings, structure, doubts, (recalibrated, extended)),
        doubts=doubts,
        others=others,
        otherwise=otherwise,
        contradicted=contradicted,
        findings=tuple(findings),
        model=_as_found(extended, findings, unexplained),
        before=before,
        recalibrated=recalibrated,
        extended=extended,
        choice=choice,
        held_out=held,
        unexplained=unexplained,
        cannot_tell_apart=tuple(pair for pair in look_alikes(choice) if not told.intersection(pair)),
        noise=extended.distance_of(extended.stated_noise),
        visible=shown,
        notes=(
            *notes_of(extended),
            *_not_tried(choice),
            *_otherwise(choice),
            *_below_zero(findings),
            *([] if unexplained.branches else _beside(others)),
            *_alone(choice),
            *_since(findings, recalibrated),
            *_of_masses(findings),
            *_slopes(findings),
            *(f"{f.label}: its values come on top of those of {f.beside.label}" for f in findings if f.beside),
            *_changed(findings, model.effects, choice),
            *(text for effect in model.effects for text in effect.to_be_told(choice.fit.problem.measurements.conditions)),
            *_size(extended),
            *_clock(extended),
            *_too_good(extended),
            *notes,
        ),
    )


def _not_tried(choice: Choice) -> list[str]:
    """Columns that the file lacks, and what could not be tried without them; one line."""
    lacking = not_tried(choice.library, choice.fit.problem.measurements).items()
    each = [f"no {COLUMNS[need]}: {listed([c.words for c in causes])} not tried" for need, causes in lacking]
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
        if isinstance(effect, ZeroDrift) and effect.until_s is not None:
            yield (
                f"{effect.label}: these records hardly tell its time constant; after {effect.until_s:.4g} s, when they "
                "end, it may stop or go on, which is in u then: take records later, too"
            )


def _as_found(extended: Fit, findings: Sequence[Finding], left: Unexplained) -> ErrorModel:
    """The arm, whose effects have the fields that were found, such as between which times a slip was; and what is left.

    Where the noise was not stated, and no structure was found, the scatter is the noise.
    """
    model, found = calibrated_model(extended), {finding.effect.identity: finding.effect for finding in findings}
    each = ((e, found.get(e.identity, e)) for e in model.effects)
    scatter = [model.arm.unexplained] if extended.stated and model.arm.unexplained else []
    arm = model.arm.with_unexplained("; ".join([*left.in_words, *scatter]))
    return ErrorModel(arm, tuple(replace(f, values=e.values, u=e.u, inner_u=e.inner_u) for e, f in each))


def _beside(others: Others) -> list[str]:
    """What acts beside the causes that were found, if that is likelier than not."""
    if others.probability < LIKELIER:
        return []
    each = [f"{other.label} ({_chance(other)})" for other in others.likeliest]
    such = f", such as {listed(each, 'or')}" if each else ""
    return [
        f"with probability {probability(others.probability)} something acts that is not named, for it was not found surely "
        f"enough{such}"
    ]


def _chance(other: Other) -> str:
    """How probable it is, and what it would change."""
    changes = f"; {other.changed} would change by {other.change:.2g} u" if other.change > 0.0 else ""
    return f"probability {probability(other.probability)}{changes}"


def _alone(choice: Choice) -> Iterator[str]:
    """Values that are what they are only if nothing else of their joint's angle acts."""
    for one, several in groupby(known_alone(choice), lambda found: found[0].label):
        _, others, ratios = zip(*several, strict=True)
        yield (
            f"{one}: its values hold if no {listed([other.label for other in others], 'or')} acts beside it; with one of "
            f"usual size, which these records hardly tell, their u is up to {max(ratios):.0f} times as large"
        )


def _rivals(choice: Choice, pairs: Sequence[InPairs]) -> list[str]:
    """Causes that look like two others together."""
    name = choice.design.names
    return [
        f"{' with '.join(name[choice.question.owner(k)] for k in pair.blocks)} may be {one} with {other} instead "
        f"(probability {share:.2g})"
        for pair in pairs
        for one, other, share in pair.rivals
    ]


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
    return ", ".join([values_in_words(effect, values, slides), *effect.inner_in_words()])


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
    loaded = (finding for finding in findings if isinstance(finding.effect, LoadedEffect))
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


def _surviving(choice: Choice, problem: ProblemOf) -> Choice:
    """The choice without what does not survive its held-out test, nor what something that did not is better at; refitted."""
    kept = survivors(choice, choice.admitted, choice.held)
    while kept:
        whole = Conditional.of(choice.gram, kept, choice.question.stated)
        sure = {k: Place.of(choice, whole, k).probability for k in kept}
        worst = min(kept, key=lambda k: sure[k])
        if sure[worst] >= UNLIKELY:
            break
        kept = tuple(k for k in kept if k != worst)
    return choice if kept == choice.admitted else _with_only(choice, problem, kept)


def _with_only(choice: Choice, problem: ProblemOf, kept: tuple[int, ...]) -> Choice:
    """The choice with some of its blocks alone, refitted."""
    effects = [choice.variant(k) for k in kept if k in choice.causes]
    return replace(choice, fit=refitted(problem, effects), admitted=kept)


def _excess(extended: Fit) -> float:
    """By how much χ² is larger than the stated noise explains, over the scatter found in its place; 0 where it is not.

    Of shifts or of turns. Where the noise of the encoders is not stated, they may have as much as plain ones.
    """
    if extended.chi2_stated is None or max(extended.unmodelled, extended.noise.scatters.turn) == 0.0:
        return 0.0
    off, explained = extended.solution.system.off, np.diagonal(extended.stated_noise, axis1=1, axis2=2)
    if extended.problem.setup.encoder_noise is None:
        point = extended.solution.point
        by_reading = extended.problem.reading_jacobian(point.x, point.frame)
        explained = explained + PLAIN_ENCODER**2 * np.square(by_reading).sum(axis=2)
    kinds = [(slice(3), extended.used), (slice(3, 6), extended.used & extended.observations.oriented)]
    much = any(np.square(off[some, of]).sum() > MUCH_MORE**2 * explained[some, of].sum() for of, some in kinds)
    chi2, dof = extended.chi2_stated
    return max(extended.dof * (1.0 - dof / chi2), 0.0) if much else 0.0
