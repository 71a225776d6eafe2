"""From an arm and measurements to a verdict, causes, an extended model and the gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.display import Note
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
from aacmm_pin.calibration.parameters import is_reestimated, require_scale
from aacmm_pin.calibration.setup import checked_input
from aacmm_pin.diagnosis.budget import budget_of
from aacmm_pin.diagnosis.candidates import candidates, known_causes
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.diagnosis.held_out_gain import Gain, gain_of, held_out_distances
from aacmm_pin.diagnosis.model_extension import ProblemOf, choose, described_model, free
from aacmm_pin.diagnosis.result import Diagnosis, Finding, findings_of
from aacmm_pin.diagnosis.significance import visible
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import Unexplained, unexplained_by
from aacmm_pin.diagnosis.verdict import judged
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
    approach_derived = measurements.conditions.approach is None and measurements.in_order
    if approach_derived:
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
    problem_with = _problem_with_causes(model, measurements, setup)
    first_recalibration = first_fit(problem_with([]))
    _require_residuals(measurements, first_recalibration)
    notes += mistakes_of(first_recalibration)
    kind_of_fold, fold_of_record = fold_numbers(first_recalibration, rng)
    library = candidates(model, measurements, first_recalibration.problem, extra)
    all_covariates = covariates(model.arm, measurements)
    choice = choose(
        problem_with, first_recalibration, library, all_covariates, fold_of_record, progress is True
    )
    used = choice.fit.used
    nominal = fit(problem_of(model, measurements, [], first_recalibration.problem.setup), used=used)
    recalibrated = fit(problem_with([]), used=used)
    notes += session_notes(recalibrated)
    if approach_derived and any(isinstance(effect, JointHysteresis) for effect in choice.effects):
        notes.append(Note("approach_from_time"))
    if model.arm.masses is None:
        notes.append(Note("masses_not_stated", {"arm": model.arm.name}))
    holds_out = hold_out and enough_postures(measurements)
    held_out = held_out_distances(choice, nominal, kind_of_fold, progress) if holds_out else {}
    findings = findings_of(model, choice, held_out)
    held_out_gain = gain_of(choice, held_out, kind_of_fold, rng)
    if held_out_gain is not None and not findings:
        held_out_gain = held_out_gain.without_causes()
    unexplained = unexplained_by(choice, held_out_gain, bool(findings))
    # Without a finding nothing explains what the recalibrated arm alone excludes.
    judged_fits = [choice.fit] if findings else [choice.fit, first_recalibration]
    contradicted = {
        replace(note, data={**note.data, "deviations": None}): note  # each place once
        for judged_fit in judged_fits
        for note in contradiction_notes(judged_fit)
    }
    budget = budget_of(choice, nominal, unexplained.discrepancy, unexplained.shared_by_postures)
    no_better = _no_better(model.arm, findings, held_out_gain, bool(choice.covariates))
    if no_better:
        extended, of_model = calibrated_model(recalibrated), recalibrated
    elif with_discrepancy:
        extended, of_model = described_model(model, choice, problem_with)
    else:
        extended, of_model = calibrated_model(choice.fit, choice.curves), choice.fit
    result = Diagnosis(
        findings=tuple(findings),
        model=_as_found(extended, choice.fit.noise_is_stated, findings, unexplained),
        before=nominal,
        recalibrated=recalibrated,
        extended=choice.fit,
        of_model=of_model,
        choice=choice,
        held_out=held_out_gain,
        unexplained=unexplained,
        noise=choice.fit.noise_rms,
        visible=visible(choice.posterior),
        assumed=tuple(notes),
        no_better=no_better,
        contradicted=tuple(contradicted.values()),
        budget=budget,
    )
    return judged(result)


def _no_better(
    arm: Arm, findings: Sequence[Finding], held_out_gain: Gain | None, has_structure: bool
) -> bool:
    """Whether held-out records are not predicted better beyond doubt with the causes.

    Values of the geometry, which the recalibrated arm has too, and places of seats do not count.
    If structure was found, it is enough that each cause is borne out.
    """
    if held_out_gain is None or held_out_gain.beyond_doubt:
        return False
    causes = [
        f for f in findings if not (corrects_seat(f.effect) or geometric_parameters(arm, f.effect))
    ]
    borne_out = has_structure and all(f.brought is not None and f.borne_out for f in causes)
    return bool(causes) and not borne_out


def _require_residuals(measurements: Measurements, recalibrated: Fit) -> None:
    """Raise if the recalibrated arm leaves no residual at all."""
    if np.nanmax(np.abs(recalibrated.system.deviation), initial=0.0) > NOTHING:
        return
    too_few = recalibrated.problem.scales.size >= 3 * measurements.n
    remedy = "more records, or the noise" if too_few else "measured values in the file"
    raise AacmmError(
        f"{measurements.source}: all {measurements.n} records agree with the fitted arm exactly; "
        f"expected {remedy}"
    )


def _problem_with_causes(model: ErrorModel, measurements: Measurements, setup: Setup) -> ProblemOf:
    """What makes the calibration problem with some causes estimated too, or others held.

    Known causes are refitted within their stated u, but freely if nothing is stated, or if a cause
    of the same name is estimated: they may have changed.
    """
    stated_causes = {effect.identity: effect for effect in known_causes(model, measurements, setup)}
    causes_unstated = [
        _with_wide_prior(effect)
        for effect in model.effects
        if not isinstance(effect, Discrepancy)
        and effect.identity not in stated_causes
        and not is_reestimated(effect, setup, measurements)
    ]

    def problem(
        causes: Sequence[Effect],
        held_causes: Sequence[Effect] = (),
        removed: Sequence[Effect] = (),
    ) -> Problem:
        causes_from_stated = [
            replace(c, values=stated_causes.get(c.identity, c).values) for c in causes
        ]
        new_causes = [cause for cause in causes if cause.identity not in stated_causes]
        labels_of_new = {cause.label for cause in new_causes if cause.nonlinear.field}
        keys_replaced = {cause.key for cause in (*causes, *removed)}
        other_known = [
            effect for effect in stated_causes.values() if effect.key not in keys_replaced
        ]
        known_freed = [
            _with_wide_prior(effect) for effect in other_known if effect.label in labels_of_new
        ]
        known_within_u = [effect for effect in other_known if effect.label not in labels_of_new]
        model_with_held = replace(model, effects=(*model.effects, *held_causes))
        added_last = [*known_freed, *causes_from_stated]
        estimated: list[str | Effect] = ["geometry", *causes_unstated, *known_within_u, *added_last]
        calibration = problem_of(model_with_held, measurements, estimated, setup)
        return replace(calibration, candidates=len(added_last))

    require_scale(problem([]))
    return problem


def _with_wide_prior(effect: Effect) -> Effect:
    """The effect at its values, which many typical magnitudes may change."""
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
