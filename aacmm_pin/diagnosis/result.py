"""What a diagnosis gives back."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note, Shown, report
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.units import MM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Fit, geometric_parameters, rms, rms_residual
from aacmm_pin.diagnosis.budget import BudgetPart
from aacmm_pin.diagnosis.candidates import is_change
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.design_matrix import typical_of
from aacmm_pin.diagnosis.held_out_gain import Brought, Gain, HeldOut, cause_gain
from aacmm_pin.diagnosis.nonlinear_parameters import nonlinear_interval
from aacmm_pin.diagnosis.significance import Alias, aliases_of, family_wise_p_value, retained
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import Unexplained
from aacmm_pin.effects import Effect, ErrorModel, slides, values_with_u

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from aacmm_pin.diagnosis.verdict import Verdict

SEVERAL_JOINTS = 2
"""From so many joints on the columns have the wrong sign: it is no other cause."""


@dataclass(frozen=True, eq=False)
class Finding(Shown):
    """A cause that the model lacks.

    Attributes:
        effect: the cause with its estimated values and u.
        parameters: described values with u: name -> (value, u).
        probability: of all sets of causes that hold it.
        p_value: family-wise.
        retained_fraction: of its effect that recalibration leaves.
        brought: what it brings on held-out records; None without these, if too few groups show the
            cause, and for a value of the geometry, which recalibration moves too.
        inner: order, time constant or time that these records determine, with u: name -> (value,
            u).
        slides: True if its joint slides, so that its values in rad are metres.
        beside: the same cause of the whole arm, to which its values add; None if that was not
            estimated.
        was: the cause as it was known before; None if new.
    """

    effect: Effect
    parameters: dict[str, tuple[float, float]]
    probability: float
    p_value: float
    retained_fraction: float
    aliases: tuple[Alias, ...]
    brought: Brought | None = None
    inner: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    slides: bool = False
    beside: Effect | None = None
    was: Effect | None = None

    @property
    def cause(self) -> str:
        """Name of the cause."""
        return self.effect.cause

    @property
    def joint(self) -> int | None:
        """DH row, or None for causes of the whole arm."""
        return self.effect.row

    @property
    def borne_out(self) -> bool:
        """Whether it clearly improves predictions of held-out records, or no group can tell."""
        return self.brought is None or self.brought.low > 0.0

    @property
    def gone(self) -> bool:
        """Whether it is a known cause of which nothing is left beyond its U (k = 2)."""
        expanded_u = COVERAGE_FACTOR * np.array(self.effect.u)
        within = np.abs(self.effect.values) <= expanded_u
        return self.was is not None and bool(within.all())

    @property
    def below_zero(self) -> tuple[str, ...]:
        """Keys of values that are negative beyond their U (k = 2), but physically positive."""
        values = np.array(self.effect.values)
        if self.beside is not None:
            values = values + self.beside.values
        highest = values + COVERAGE_FACTOR * np.array(self.effect.u)
        terms = zip(self.effect.terms, highest, strict=True)
        return tuple(term.key for term, value in terms if term.positive and value < 0.0)

    @property
    def label(self) -> str:
        """Cause and place."""
        return self.effect.label

    def __str__(self) -> str:
        return str(report().diagnosis_page.finding_line(self))


@dataclass(frozen=True)
class Place:
    """A joint, body, seat or target, with the quantity that an error there depends on.

    Attributes:
        forms: probability of each set of causes that may act there together, a tuple of labels,
            most probable first.
    """

    effect: Effect
    probability: float
    forms: Mapping[tuple[str, ...], float]

    @property
    def depends_on(self) -> str:
        """``angle``, ``load``, ``approach``, ``temperature`` or ``time``; else the name of the only
        cause.
        """
        return self.effect.function_of or self.effect.cause

    @property
    def form_is_open(self) -> bool:
        """True if a cause certainly acts there, but no form is more probable than all others."""
        most_probable = max(self.forms.values())
        return self.probability >= THRESHOLDS.settled and most_probable < THRESHOLDS.named


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """The result of a diagnosis: the causes of error, the extended arm, and its gain.

    Attributes:
        verdict, doubts: see :func:`aacmm_pin.diagnosis.verdict.judged`.
        no_better: True if held-out records do not clearly confirm that the causes improve
            predictions.
        contradicted: stated places that the records contradict.
        findings: causes, strongest first; last, geometric values beyond their stated uncertainty.
        model: recalibrated arm with the causes, if these improve the predictions of held-out
            records.
        before: fit of the set-up alone, with the arm before the diagnosis.
        recalibrated: fit with refitted geometry.
        extended: fit with refitted geometry and the causes.
        of_model: fit of ``model``, with its placement of the base; not ``extended`` if the model
            has no causes, or has the discrepancy.
        held_out: residuals of records that neither chose the causes nor entered the fit, or None.
        unexplained: structure in the residuals without a cause.
        noise: RMS residual expected from noise alone [m].
        visible: number of causes that the records would show at typical magnitude, and of all
            tried.
        assumed: notes about assumptions and about changes of the records.
        budget: parts of the mean square residual of the nominal arm, whose sum is the whole.
    """

    findings: tuple[Finding, ...]
    model: ErrorModel
    before: Fit
    recalibrated: Fit
    extended: Fit
    of_model: Fit
    choice: Choice
    held_out: Gain | None
    unexplained: Unexplained
    noise: float
    visible: tuple[int, int]
    assumed: tuple[Note, ...]
    no_better: bool
    contradicted: tuple[Note, ...]
    budget: tuple[BudgetPart, ...]
    doubts: tuple[str, ...] = ()
    verdict: Verdict = "inconclusive"

    @property
    def otherwise(self) -> tuple[str, ...]:
        """The causes that a diagnosis with the excluded records would name."""
        return self.choice.otherwise

    @property
    def below_zero(self) -> list[Effect]:
        """The causes with a negative value that is physically impossible."""
        return [finding.effect for finding in self.findings if finding.below_zero]

    @property
    def reversed_torques(self) -> bool:
        """True if the torque columns have the opposite sign: several joints yield to measured
        torques in the impossible direction, none in the possible one.
        """
        effects = [f.effect for f in self.findings if "torque" in f.effect.needs]
        return len(effects) >= SEVERAL_JOINTS and all(e in self.below_zero for e in effects)

    def geometric(self, finding: Finding) -> bool:
        """Whether a finding is a value of the geometry of the arm."""
        return bool(geometric_parameters(self.model.arm, finding.effect))

    def cause(self, label: str) -> Effect | None:
        """The cause with this label; None for a covariate."""
        causes = (variants[0] for variants in self.choice.library)
        return next((cause for cause in causes if cause.label == label), None)

    @property
    def alternatives(self) -> dict[tuple[str, ...], float]:
        """The probability of each set of causes, a tuple of labels, the most probable first."""
        return self.choice.posterior.causes

    @property
    def places(self) -> tuple[Place, ...]:
        """The places where a cause may act, most probable first; equally probable ones along the
        arm.
        """
        names = self.choice.design.names
        places = []
        for sets_of_blocks in self.choice.posterior.forms.values():
            probability_of_labels = {
                tuple(names[k] for k in sorted(blocks)): probability
                for blocks, probability in sets_of_blocks.items()
            }
            effect = self.cause(next(iter(probability_of_labels))[0])
            probability = min(sum(probability_of_labels.values()), 1.0)
            if effect is not None and probability >= THRESHOLDS.worth_listing:
                places.append(Place(effect, probability, probability_of_labels))

        def order(place: Place) -> tuple[float, float, str]:
            """By thousandths of the probability, along the arm, by label."""
            row = place.effect.row
            rounded = round(place.probability, 3)
            return -rounded, math.inf if row is None else row, place.effect.label

        return tuple(sorted(places, key=order))

    @property
    def cannot_tell_apart(self) -> list[tuple[str, ...]]:
        """The groups of causes in which the most probable set and another probable set differ."""
        most_probable, *others = self.alternatives.items()
        labels_of_best = set(most_probable[0])
        rival_sets = [set(labels) for labels, share in others if share >= THRESHOLDS.rival]
        differences = [
            tuple(sorted(labels_of_best ^ rival))
            for rival in rival_sets
            if labels_of_best - rival and rival - labels_of_best
        ]
        return [*dict.fromkeys(differences)]

    @property
    def more(self) -> float:
        """The probability that a cause acts that is not among the findings."""
        named = [finding.label for finding in self.findings]
        return self.choice.posterior.beyond(named)

    @property
    def not_saved(self) -> list[str]:
        """The covariates of the discrepancy that new records, and so arm files, cannot have:
        labels, torques, unknown columns.
        """
        choice = self.choice
        blocks = [k for k in choice.covariates if choice.way(k).smooth is None]
        return list(dict.fromkeys(choice.covariate(k).name for k in blocks))

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """The assumptions and limits of the result."""
        return tuple(report().diagnosis_notes.notes_of(self))

    @cached_property
    def residual_groups(self) -> pd.DataFrame:
        """The table of :func:`~aacmm_pin.report.residual_tables.residuals_by_group`."""
        by_group = report().residual_tables.residuals_by_group
        return cast("pd.DataFrame", by_group(self.before, self.recalibrated, self.extended))

    @property
    def converged(self) -> bool:
        """True if the fits of the recalibrated and the extended arm converged."""
        return not self.converge_note

    @property
    def converge_note(self) -> str:
        """The messages of the fits that did not converge; "" if all converged."""
        fits = {"recalibrated": self.recalibrated, "extended": self.extended}
        stuck = [f"{name}: {fit.message}" for name, fit in fits.items() if not fit.converged]
        return "; ".join(stuck)

    @property
    def _fits(self) -> dict[str, Fit]:
        return {
            "nominal": self.before,
            "recalibrated": self.recalibrated,
            "extended": self.extended,
        }

    @property
    def rms(self) -> dict[str, float]:
        """The RMS residual of the used records [m]: ``nominal`` (arm before the diagnosis),
        ``recalibrated``, ``extended`` and ``noise`` (expected from noise alone).
        """
        used = self.extended.used
        sizes = {name: rms_residual(fit, used) for name, fit in self._fits.items()}
        return sizes | {"noise": self.noise}

    @property
    def turns(self) -> dict[str, float] | None:
        """The RMS rotation between stated and computed orientations, for each model [rad]; None
        without.
        """
        used = self.extended.used & self.extended.observations.oriented
        if not used.any():
            return None
        return {name: rms(fit.turns[used]) for name, fit in self._fits.items()}

    @property
    def excluded(self) -> pd.DataFrame:
        """The records with gross errors: row, residual [mm], reason."""
        excluded = self.extended.excluded
        deviation = self.extended.system.deviation[excluded]
        table = pd.DataFrame({"row": self.extended.problem.measurements.row[excluded]})
        table["residual_mm"] = np.linalg.norm(deviation, axis=1) / MM
        return table.assign(reason=str(Note("outlier")))

    def __str__(self) -> str:
        return str(report().diagnosis_page.diagnosis_line(self))

    def summary(self) -> dict[str, Any]:
        """The content of the JSON file, of schema ``aacmm-pin/diagnosis/1``."""
        return dict(report().diagnosis_json.diagnosis_to_dict(self))

    def plot(self, finding: int = 0, ax: Axes | None = None) -> Axes:
        """Plot a cause with the partial residuals of the records.

        Without causes, the plot shows the covariate of the residuals; without a covariate, the
        parts of the residual of the nominal arm.

        Args:
            finding: index of the finding, from 0 (the strongest cause).
            ax: axes; default a new pyplot figure.

        Raises:
            AacmmError: the diagnosis has no finding with this index.
        """
        return cast("Axes", report().plots.plot_diagnosis(self, finding, ax))


def too_good(extended: Fit) -> bool:
    """Whether residuals are far smaller than the noise, though no scatter was added to it."""
    return bool(chi2_cdf(*extended.chi2) <= THRESHOLDS.too_good)


def findings_of(model: ErrorModel, choice: Choice, held_out: HeldOut) -> list[Finding]:
    """The causes, strongest first, with the values of the last refit; geometric values last."""
    findings = [_finding(model, choice, held_out, block) for block in choice.causes]
    return sorted(findings, key=lambda f: bool(geometric_parameters(model.arm, f.effect)))


def _finding(model: ErrorModel, choice: Choice, held_out: HeldOut, block: int) -> Finding:
    """The cause of a block, with its values, probability, aliases and gain."""
    by_identity = {estimate[0].identity: estimate for estimate in estimated(choice)}
    # Of several effects with one label the new one comes last.
    by_label = {estimate[0].label: estimate for estimate in by_identity.values()}
    variant = choice.variant(block)
    effect, covariance = by_identity.get(variant.identity, by_label[variant.label])
    # Other sets of causes give other values (law of total variance).
    term_count = len(effect.terms)
    typical = typical_of(effect)
    between_sets = choice.posterior.uncertainty_of_the_set(block)[:term_count, :term_count]
    covariance = covariance + np.outer(typical, typical) * between_sets
    u = np.sqrt(np.diag(covariance))
    effect = effect.at(effect.values, tuple(u))
    reported, nonlinear_values = effect, {}
    interval = nonlinear_interval(choice, block, effect)
    if interval is not None:
        name = effect.nonlinear.field
        nonlinear_values = {name: (float(getattr(effect, name)), interval.u)}
        if not is_change(variant):
            reported = effect.nonlinear.with_coverage_interval(
                effect, interval.low, interval.high, choice.fit.problem.measurements
            )
    known_before = (
        old
        for old in model.effects
        if old.label == effect.label
        and (old.identity == effect.identity or old.identity not in by_identity)
    )
    without_block = choice.posterior.without(block)
    is_geometric = bool(geometric_parameters(model.arm, effect))
    whole_arm = None
    if effect.place is not None and effect.cause in by_label:
        whole_arm, _ = by_label[effect.cause]
    return Finding(
        effect=reported,
        parameters=values_with_u(effect, covariance),
        probability=choice.posterior.probability(block),
        p_value=family_wise_p_value(choice.candidates, without_block, block),
        retained_fraction=retained(without_block, block),
        aliases=tuple(aliases_of(choice.posterior, choice.library, block)),
        brought=None if is_geometric else cause_gain(choice, held_out, block),
        inner=nonlinear_values,
        slides=slides(effect, choice.fit.problem.model.arm),
        beside=whole_arm,
        was=next(known_before, None),
    )


def estimated(choice: Choice) -> Iterator[tuple[Effect, Array]]:
    """Every effect of the last fit with u and covariance; undetermined ones with the prior
    widths.
    """
    fit = choice.fit
    undetermined_directions = fit.unknown * fit.problem.scales[:, None]
    for effect, entries in zip(fit.effects, fit.problem.vector.slices, strict=True):
        from_prior = undetermined_directions[entries] @ undetermined_directions[entries].T
        covariance = fit.covariance[entries, entries] + from_prior
        u = np.sqrt(np.diag(covariance))
        yield effect.at(effect.values, tuple(u)), covariance
    if choice.curves is not None:
        for effect in choice.curves.effects:
            yield effect, choice.curves.of_effect(effect)
