"""The door: from an arm and measurements to a verdict, its causes, an extended model and the gain."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin.arm import Arm
from aacmm_pin.blas import one_blas_thread
from aacmm_pin.calibration.calibrate import ReferenceFrame, encoder_of, notes_of
from aacmm_pin.calibration.evidence import StatedNoise
from aacmm_pin.calibration.fit import Fit, fit
from aacmm_pin.calibration.fold import calibrated_model
from aacmm_pin.calibration.problem import OF_KIND, Problem
from aacmm_pin.calibration.unknowns import Target, problem_of
from aacmm_pin.checks import Array
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.diagnosis.findings import Strength, look_alikes, strengths
from aacmm_pin.diagnosis.gain import gain_of, parts_of, survivors
from aacmm_pin.diagnosis.library import candidates
from aacmm_pin.diagnosis.model import Choice, ProblemOf, choose, free
from aacmm_pin.diagnosis.next_measurements import next_measurements
from aacmm_pin.diagnosis.result import SETTLED, Diagnosis, Finding, Verdict, described
from aacmm_pin.diagnosis.show import groups_table, moved_geometry, predicted_covariance
from aacmm_pin.diagnosis.unexplained import Unexplained, unexplained_by
from aacmm_pin.effects import Effect
from aacmm_pin.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning import advice

UNLIKELY = 0.2
"""A cause less probable than this, beside what did not survive its held-out test, is not named."""


@one_blas_thread
def diagnose(
    model: Arm | ErrorModel,
    measurements: Measurements,
    *,
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
    hold_out: bool = True,
    rng: np.random.Generator | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] | None = None,
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
        rng: for the draws behind p-values and intervals, and the groups left out; default seed 1.
        progress: wraps the groups left out, such as ``tqdm``.

    Raises:
        AacmmError, UnknownNameError, MissingConditionError: see :func:`aacmm_pin.calibration.calibrate`.
    """
    rng = rng or np.random.default_rng(1)
    if reference_frame not in get_args(ReferenceFrame):
        raise UnknownNameError("reference frame", reference_frame, list(get_args(ReferenceFrame)))
    model = ErrorModel.of(model)
    if measurements.nq != model.arm.nq:
        own, theirs = model.arm.nq, measurements.nq
        raise AacmmError(f"{measurements.source} has angles of {theirs} joints, {model.arm.name} has {own}")
    noise = StatedNoise(encoder_of(model.arm, encoder_noise), reference_noise, probe_noise, length_noise)
    external = reference_frame == "external"

    def problem(parameters: Sequence[str | Effect]) -> Problem:
        return problem_of(model, measurements, parameters, prior=prior, target=target, external=external)

    recalibrated = fit(problem(["geometry"]), noise)
    kind, parts = parts_of(recalibrated, rng)
    library = candidates(model.arm, measurements, recalibrated.problem)
    others = covariates(model.arm, measurements)
    choice = choose(lambda effects: problem(["geometry", *effects]), noise, recalibrated, library, others, parts)
    choice = _surviving(choice, lambda effects: problem(["geometry", *effects]), noise, rng)
    extended = choice.fit
    before = fit(problem([]), noise, used=extended.used)
    recalibrated = fit(problem(["geometry"]), noise, used=extended.used)
    strong = strengths(choice.question, choice.gram, choice.admitted, choice.design.names, rng)
    held = gain_of(choice, before, kind, rng, progress) if hold_out else None
    findings = _findings(choice, strong) + _geometry(choice)
    unexplained = unexplained_by(choice, strong, held)
    groups = look_alikes(choice.question, choice.gram, choice.design.names, choice.design.causes)
    shown = predicted_covariance(before, *_prior_predictive(model, before))
    verdict = _verdict(findings, unexplained)

    def plan(cause: Effect, other: str) -> str:
        return advice(
            model,
            (cause, other),
            measurements,
            reference_frame=reference_frame,
            target=target,
            prior=prior,
            encoder_noise=encoder_noise,
            reference_noise=reference_noise,
            probe_noise=probe_noise,
            length_noise=length_noise,
        )

    return Diagnosis(
        verdict=verdict,
        findings=tuple(findings),
        model=calibrated_model(extended, noise.encoder),
        before=before,
        recalibrated=recalibrated,
        extended=extended,
        choice=choice,
        held_out=held,
        unexplained=unexplained,
        cannot_tell_apart=tuple(tuple(group) for group in groups),
        simulation_groups=groups_table(before, shown),
        extended_groups=groups_table(extended, _noise(extended)),
        noise=float(np.sqrt(np.trace(_stated(extended)[extended.used], axis1=1, axis2=2).mean())),
        next_measurements=next_measurements(verdict, findings, unexplained, plan),
        notes=tuple(notes_of(extended, noise)),
    )


def _surviving(choice: Choice, problem: ProblemOf, noise: StatedNoise, rng: np.random.Generator) -> Choice:
    """The choice without what does not survive its held-out test, nor what something that did not is better at; refitted."""
    kept = survivors(choice, choice.admitted, choice.held)
    if kept == choice.admitted:
        return choice
    while kept:
        strong = strengths(choice.question, choice.gram, kept, choice.design.names, rng)
        worst = min(strong, key=lambda s: s.probability)
        if worst.probability >= UNLIKELY:
            break
        kept = tuple(k for k in kept if k != worst.block)
    effects = [free(choice.variant(k)) for k in kept if k in choice.causes]
    return replace(choice, fit=fit(problem(effects), noise), admitted=kept)


def _findings(choice: Choice, strong: list[Strength]) -> list[Finding]:
    """The admitted causes with the values that the last refit gave them."""
    problem, x = choice.fit.problem, choice.fit.solution.point.x
    estimated: dict[str, tuple[Effect, Array]] = {}
    first = 0
    for effect in problem.effects(x):
        own = slice(first, first + len(effect.terms))
        first = own.stop
        estimated[effect.label] = (effect, choice.fit.covariance[own, own])
    found = []
    for strength in strong:
        if strength.block not in choice.causes:
            continue
        label = choice.variant(strength.block).label
        if label not in estimated:
            continue
        effect, covariance = estimated[label]
        effect = effect.at(effect.values, tuple(np.sqrt(np.diag(covariance))))
        found.append(
            Finding(
                effect.cause,
                effect.row,
                effect,
                described(effect, covariance),
                strength.probability,
                strength.p_value,
                strength.retained,
                strength.aliases,
            )
        )
    return found


def _geometry(choice: Choice) -> list[Finding]:
    """Geometric values beyond their stated uncertainty."""
    found = []
    for row in moved_geometry(choice).to_dict("records"):
        kind = next(k for k, c in OF_KIND.items() if c.cause == row["cause"]) if row["cause"] in _GEOMETRIC else ""
        if not kind:
            continue
        effect = OF_KIND[kind](joint=int(row["joint"]), values=(row["change"],), u=(row["u"],))  # type: ignore[call-arg]
        values = described(effect, np.array([[row["u"] ** 2]]))
        found.append(
            Finding(effect.cause, effect.row, effect, values, 1.0 - float(row["p_value"]), float(row["p_value"]), 1.0, ())
        )
    return found


_GEOMETRIC = {cause.cause for cause in OF_KIND.values()}


def _verdict(findings: list[Finding], unexplained: Unexplained) -> Verdict:
    if unexplained.depends_on:
        return "unexplained"
    if not findings:
        return "no-discrepancy"
    return "explained" if all(f.probability >= SETTLED for f in findings) else "ambiguous"


def _prior_predictive(model: ErrorModel, before: Fit) -> tuple[Array, Array]:
    records = before.problem.measurements
    state = before.problem.model.arm
    sensitivity = state.sensitivity(records.q)
    covariance = model.covariance()[: sensitivity.shape[2], : sensitivity.shape[2]]
    return before.solution.point.frame.rotation @ sensitivity, covariance


def _noise(at: Fit) -> Array:
    total = at.noise.copy()
    for observation in at.observations:
        total[observation.records] += observation.covariance()
    return total


def _stated(at: Fit) -> Array:
    """Noise without the scatter that was found beside it, where the noise is stated."""
    total = _noise(at)
    return total - at.unmodelled**2 * np.eye(3) if at.stated else total
