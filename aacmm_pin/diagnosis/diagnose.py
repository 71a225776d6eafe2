"""From an arm and measurements to a verdict, causes, an extended model and the gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.notes import Note
from aacmm_pin._support.progress import Progress
from aacmm_pin._support.threads import one_blas_thread
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import (
    Fit,
    Problem,
    ReferenceFrame,
    Setup,
    Target,
    calibrated_model,
    first_fit,
    geometric_parameters,
    in_first_frame,
    mistakes_of,
    problem_of,
    session_notes,
)
from aacmm_pin.calibration.calibrate import contradiction_notes, counted_once
from aacmm_pin.calibration.cross_validation import enough_postures, fold_numbers
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import is_reestimated, length_to_hold
from aacmm_pin.calibration.setup import checked_input
from aacmm_pin.diagnosis.budget import BEYOND, SHARED, STRUCTURE, budget_of
from aacmm_pin.diagnosis.candidates import candidates, known_causes
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.diagnosis.discrepancy import described_model
from aacmm_pin.diagnosis.findings import findings_of
from aacmm_pin.diagnosis.held_out_gain import Gain, gain_of, predicted_folds
from aacmm_pin.diagnosis.model_extension import ProblemOf, choose, free
from aacmm_pin.diagnosis.result import Diagnosis, Finding
from aacmm_pin.diagnosis.significance import visible
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import Unexplained, exceeds_noise, unexplained_by
from aacmm_pin.diagnosis.verdict import Evidence, doubts_of, verdict_of
from aacmm_pin.effects import (
    Discrepancy,
    Effect,
    ErrorModel,
    GivenCause,
    GivenModel,
    JointHysteresis,
    as_causes,
    corrects_seat,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import GivenRecords, Measurements

NOTHING = 1e-12
"""Residuals smaller than this were never measured [m]."""


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
    with_discrepancy: bool = False,
    extra_causes: Sequence[GivenCause] = (),
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> Diagnosis:
    """Find the causes of error that explain the residuals, extend the model, and measure the gain.

    A linear model explains the residuals by five parts: refitted geometry and reference frame,
    known causes, a set of new causes, a discrepancy, and noise. All probabilities come from one
    posterior over sets of causes. The extended arm has every cause with a probability above 0.5.
    Held-out records, which neither the choice of the set nor the linear fit uses, give the gain.

    Args:
        model: the arm, with the known causes of error if any.
        measurements: the records; of more than 8000, so many are used, with a note.
        reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise:
            see :func:`aacmm_pin.calibration.calibrate`.
        hold_out: measure the gain on held-out records.
        with_discrepancy: include the discrepancy in the extended arm, if new records can have the
            same covariates.
        extra_causes: more causes to try, at places or with nonlinear parameters (orders, times,
            other fields) that are not tried by default. Registered causes of your own
            (:func:`aacmm_pin.effects.register`) need no entry. The prior uses the ``typical``
            magnitude of their terms, not their values.
        rng: random generator for intervals and held-out groups; default seed 1.
        progress: True for a progress bar in a notebook or on stderr, or a function such as
            ``tqdm``.

    Raises:
        AacmmError, UnknownNameError, MissingConditionError: see
            :func:`aacmm_pin.calibration.calibrate`.
    """
    model, measurements = checked_input(model, measurements)
    extra = as_causes(extra_causes, model, measurements.conditions.present)
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
    measurements, notes = counted_once(measurements)
    derived = measurements.conditions.approach is None and measurements.in_order
    if derived:
        measurements = measurements.with_approach_from_order()
    if measurements.n > THRESHOLDS.most_records:
        data = {"used": THRESHOLDS.most_records, "of": measurements.n}
        notes.append(Note("records_spread", data))
        rows = np.linspace(0, measurements.n - 1, THRESHOLDS.most_records)
        measurements = measurements.take(np.round(rows).astype(np.intp))
    measurements, setup = in_first_frame(model, measurements, setup)
    if prior and model.arm.unexplained and model.arm.covariance is not None:
        # What was not explained then is partly in the parameters, and would be missing from the
        # cause that is found now.
        model = model.without_covariance
        notes.append(
            Note("prior_ignored", {"arm": model.arm.name, "unexplained": model.arm.unexplained})
        )
    rng = rng or np.random.default_rng(1)
    problem = _with_causes(model, measurements, setup)
    alone = first_fit(problem([]))
    _require_residuals(measurements, alone)
    notes += mistakes_of(alone)
    kind, fold_of_record = fold_numbers(alone, rng)
    library = candidates(model, measurements, alone.problem, extra)
    all_covariates = covariates(model.arm, measurements)
    choice = choose(problem, alone, library, all_covariates, fold_of_record, progress is True)
    used = choice.fit.used
    before = fit(problem_of(model, measurements, [], alone.problem.setup), used=used)
    recalibrated = fit(problem([]), used=used)
    notes += session_notes(recalibrated)
    if derived and any(isinstance(effect, JointHysteresis) for effect in choice.effects):
        notes.append(Note("approach_from_time"))
    if model.arm.masses is None:
        notes.append(Note("masses_not_stated", {"arm": model.arm.name}))
    apart = hold_out and enough_postures(measurements)
    folds = predicted_folds(choice, before, kind, progress) if apart else []
    findings = findings_of(model, choice, folds)
    held = gain_of(choice, folds, kind, rng) if folds else None
    if held is not None and not findings:
        held = held.without_causes()
    unexplained = unexplained_by(choice, held, bool(findings))
    # Without a finding nothing explains what the recalibrated arm alone excludes.
    judged = [choice.fit] if findings else [choice.fit, alone]
    contradicted = {
        replace(note, data={**note.data, "deviations": None}): note
        for one in judged
        for note in contradiction_notes(one)
    }
    named = [finding.label for finding in findings]
    budget = budget_of(choice, before, unexplained.discrepancy, unexplained.shared_by_postures)
    without_name = (STRUCTURE, SHARED, BEYOND)
    nameless = sum(part.mean_square for part in budget if part.part in without_name)
    if choice.fit.noise_is_stated:
        nameless += budget[-1].mean_square - choice.fit.noise_rms**2
    sure = {f.label for f in findings if f.probability >= THRESHOLDS.settled and f.borne_out}
    evidence = Evidence(
        findings=tuple(findings),
        structure=unexplained.structure or exceeds_noise(choice.fit),
        structure_left=unexplained.left,
        more=choice.posterior.beyond(named),
        visible=visible(choice.posterior),
        otherwise=choice.otherwise,
        no_better=_no_better(model.arm, findings, held, bool(choice.covariates)),
        contradicted=tuple(contradicted.values()),
        agree=choice.posterior.agree,
        fits=(recalibrated, choice.fit),
        named=sum(part.mean_square for part in budget if sure.intersection(part.causes)),
        nameless=max(nameless, 0.0),
    )
    doubts = doubts_of(evidence)
    if evidence.no_better:
        extended, of_model = calibrated_model(recalibrated), recalibrated
    elif with_discrepancy:
        extended, of_model = described_model(model, choice, problem)
    else:
        extended, of_model = calibrated_model(choice.fit, choice.curves), choice.fit
    return Diagnosis(
        verdict=verdict_of(evidence, doubts),
        findings=tuple(findings),
        model=_as_found(extended, choice.fit.noise_is_stated, findings, unexplained),
        before=before,
        recalibrated=recalibrated,
        extended=choice.fit,
        of_model=of_model,
        choice=choice,
        held_out=held,
        unexplained=unexplained,
        noise=choice.fit.noise_rms,
        visible=evidence.visible,
        assumed=tuple(notes),
        doubts=doubts,
        otherwise=choice.otherwise,
        contradicted=evidence.contradicted,
        budget=budget,
    )


def _no_better(arm: Arm, findings: Sequence[Finding], held: Gain | None, structure: bool) -> bool:
    """Whether held-out records are not predicted better beyond doubt with the causes.

    Values of the geometry, which the recalibrated arm has too, and places of seats do not count.
    Beside ``structure`` it is enough that each cause is borne out.
    """
    if held is None or held.beyond_doubt:
        return False
    causes = [
        f for f in findings if not (corrects_seat(f.effect) or geometric_parameters(arm, f.effect))
    ]
    borne_out = structure and all(f.brought is not None and f.borne_out for f in causes)
    return bool(causes) and not borne_out


def _require_residuals(measurements: Measurements, recalibrated: Fit) -> None:
    if np.nanmax(np.abs(recalibrated.system.deviation), initial=0.0) > NOTHING:
        return
    few = recalibrated.problem.scales.size >= 3 * measurements.n
    why = "more records, or the noise" if few else "measured values in the file"
    raise AacmmError(
        f"{measurements.source}: all {measurements.n} records agree with the fitted arm exactly; "
        f"expected {why}"
    )


def _with_causes(model: ErrorModel, measurements: Measurements, setup: Setup) -> ProblemOf:
    """The calibration problem with some causes estimated too.

    Known causes are refitted within their stated u, but freely if nothing is stated, or if a cause
    of the same name is estimated: they may have changed.
    """
    stated_causes = {effect.identity: effect for effect in known_causes(model, measurements, setup)}
    unstated = [
        _freed(effect)
        for effect in model.effects
        if not isinstance(effect, Discrepancy)
        and effect.identity not in stated_causes
        and not is_reestimated(effect, setup, measurements)
    ]

    def problem(
        setup: Setup,
        causes: Sequence[Effect],
        held_causes: Sequence[Effect] = (),
        gone: Sequence[Effect] = (),
    ) -> Problem:
        freed = [replace(c, values=stated_causes.get(c.identity, c).values) for c in causes]
        new = [cause for cause in causes if cause.identity not in stated_causes]
        places = {cause.label for cause in new if cause.nonlinear.field}
        keys = {cause.key for cause in (*causes, *gone)}
        unchanged = [effect for effect in stated_causes.values() if effect.key not in keys]
        beside = [_freed(effect) for effect in unchanged if effect.label in places]
        within = [effect for effect in unchanged if effect.label not in places]
        with_held = replace(model, effects=(*model.effects, *held_causes))
        taken_out = [*beside, *freed]
        estimated: list[str | Effect] = ["geometry", *unstated, *within, *taken_out]
        asked = problem_of(with_held, measurements, estimated, setup)
        return replace(asked, candidates=len(taken_out))

    length = length_to_hold(problem(setup, []))
    return partial(problem, replace(setup, held_length=length))


def _freed(effect: Effect) -> Effect:
    return effect.at(effect.values, free(effect).u)


def _as_found(
    model: ErrorModel, stated: bool, findings: Sequence[Finding], unexplained: Unexplained
) -> ErrorModel:
    """The arm, whose effects have the fields that were found, such as the times around a slip; and
    what is left. If the noise was not stated, and no structure was found, the scatter is the noise.
    """
    with_fields = {finding.effect.identity: finding.effect for finding in findings}
    effects = [
        replace(
            with_fields.get(effect.identity, effect),
            values=effect.values,
            u=effect.u,
            nonlinear_u=effect.nonlinear_u,
        )
        for effect in model.effects
    ]
    sentences = [str(note) for note in unexplained.notes]
    if stated and model.arm.unexplained:
        sentences.append(model.arm.unexplained)
    arm = model.arm.with_unexplained("; ".join(sentences))
    return ErrorModel(arm, tuple(effects))
