"""What a diagnosis gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Mask
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Fit, geometric_parameters, rms
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.cross_validation import Brought, Gain
from aacmm_pin.diagnosis.discrepancy import described_by, lost
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import Unexplained
from aacmm_pin.effects import Effect, ErrorModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Verdict = Literal["explained", "no-discrepancy", "ambiguous", "unexplained", "inconclusive"]


@dataclass(frozen=True, eq=False)
class Finding(Shown):
    """A cause that the simulation lacks.

    Attributes:
        effect: the cause with its estimated values and u.
        parameters: described values with u: name -> (value, u).
        probability: of all sets of causes that hold it.
        p_value: family-wise.
        retained_fraction: of its effect that recalibration leaves.
        aliases: causes with a similar effect in these records.
        brought: what it brings on held-out records; None where too few groups say something of it,
            and of a value of the geometry, which recalibration moves as well.
        inner: order, time constant or time that these records told, with u: name -> (value, u).
        slides: True where its joint slides, so that its values in rad are metres.
        beside: the same cause of the whole arm, on top of which its values come; None where that
            was not estimated.
        was: the cause as the arm was known to have it before; None where it is new.
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
        """Whether held-out records are predicted better with it beyond doubt, as far as there are
        groups to ask.
        """
        return self.brought is None or self.brought.low > 0.0

    @property
    def gone(self) -> bool:
        """Whether it is a cause that was known, and of which nothing is left beyond its U
        (k = 2).
        """
        expanded_u = COVERAGE_FACTOR * np.array(self.effect.u)
        within = np.abs(self.effect.values) <= expanded_u
        return self.was is not None and bool(within.all())

    @property
    def below_zero(self) -> tuple[str, ...]:
        """Keys of values that are negative beyond their U (k = 2), though nature has them above
        zero only.
        """
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
        return str(report().diagnosis_line.finding_line(self))


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """What the simulation gets wrong, why, and how much better it is when it knows.

    Attributes:
        verdict, doubts: see :func:`aacmm_pin.diagnosis.verdict.verdict_of` and ``doubts_of`` there.
        otherwise: what would be found if excluded records counted.
        contradicted: stated places that the records contradict.
        findings: causes, strongest first; geometric values beyond their stated uncertainty last.
        model: the arm recalibrated, with the causes found; without them where it does not predict
            held-out records better.
        before: the arm as it was, set-up fitted; recalibrated: geometry refitted; extended: with
            the causes.
        choice: the search behind it.
        held_out: residuals of records left out of choosing and fitting, or None.
        unexplained: structure without a cause.
        noise: RMS that the noise alone would give [m].
        visible: how many causes of typical magnitude these records would have shown, and of how
            many.
        assumed: notes of the calibration, and of what was done with the records before.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    model: ErrorModel
    before: Fit
    recalibrated: Fit
    extended: Fit
    choice: Choice
    held_out: Gain | None
    unexplained: Unexplained
    noise: float
    visible: tuple[int, int]
    assumed: tuple[Note, ...]
    doubts: tuple[str, ...]
    otherwise: tuple[str, ...]
    contradicted: tuple[Note, ...]

    def geometric(self, finding: Finding) -> bool:
        """Whether a finding is a value of the arm's own geometry."""
        return bool(geometric_parameters(self.model.arm, finding.effect))

    @property
    def no_better(self) -> bool:
        """Whether causes were added with which held-out records are not predicted better beyond
        doubt.
        """
        return "no better" in self.doubts

    def cause(self, label: str) -> Effect | None:
        """The cause that a label of this result names, as it was tried first; None for a
        covariate.
        """
        causes = (variants[0] for variants in self.choice.library)
        return next((cause for cause in causes if cause.label == label), None)

    @property
    def alternatives(self) -> dict[tuple[str, ...], float]:
        """Probability of each set of causes, by their labels, the most probable first; they add up
        to one.
        """
        return self.choice.posterior.causes

    @property
    def cannot_tell_apart(self) -> list[tuple[str, ...]]:
        """Causes of which one set has some and another set, which cannot be excluded, has others
        instead.
        """
        best, *others = self.alternatives.items()
        acting = set(best[0])
        rivals = [set(labels) for labels, share in others if share >= THRESHOLDS.rival]
        exchanged = [
            tuple(sorted(acting ^ rival)) for rival in rivals if acting - rival and rival - acting
        ]
        return [*dict.fromkeys(exchanged)]

    @property
    def more(self) -> float:
        """Probability that a cause acts that is not among the findings."""
        named = [finding.label for finding in self.findings]
        return self.choice.posterior.beyond(named)

    @property
    def not_saved(self) -> list[str]:
        """Covariates of the discrepancy that no arm file can have."""
        return lost(described_by(self.choice, self.choice.covariates))

    @cached_property
    def notes(self) -> tuple[Note, ...]:
        """What was assumed, and what limits what is stated."""
        return tuple(report().diagnosis_notes.notes_of(self))

    @cached_property
    def residual_groups(self) -> pd.DataFrame:
        """See :func:`~aacmm_pin.report.residual_tables.residuals_by_group`."""
        by_group = report().residual_tables.residuals_by_group
        return cast("pd.DataFrame", by_group(self.before, self.recalibrated, self.extended))

    @property
    def converged(self) -> bool:
        """Whether every search that the verdict rests on ended at a minimum."""
        return not self.converge_note

    @property
    def converge_note(self) -> str:
        """What held up a search that did not converge; "" where all did."""
        fits = {"recalibrated": self.recalibrated, "extended": self.extended}
        stuck = [f"{name}: {fit.message}" for name, fit in fits.items() if not fit.converged]
        return "; ".join(stuck)

    @property
    def _fits(self) -> dict[str, Fit]:
        """The three models by name."""
        return {
            "simulation": self.before,
            "recalibrated": self.recalibrated,
            "extended": self.extended,
        }

    @property
    def rms(self) -> dict[str, float]:
        """RMS of the used records by simulation, recalibrated and extended model, and by noise
        alone [m].
        """
        used = self.extended.used
        sizes = {name: _rms_residual(fit, used) for name, fit in self._fits.items()}
        return sizes | {"noise": self.noise}

    @property
    def turns(self) -> dict[str, float] | None:
        """RMS turn of the used records from their stated orientations, by each model [rad]; None
        where none is stated.
        """
        used = self.extended.used & self.extended.observations.oriented
        if not used.any():
            return None
        return {name: rms(fit.turns[used]) for name, fit in self._fits.items()}

    @property
    def excluded(self) -> pd.DataFrame:
        """Records that cannot belong even with the causes known: row, residual [mm], reason."""
        out = self.extended.excluded
        deviation = self.extended.system.deviation[out]
        table = pd.DataFrame({"row": self.extended.problem.measurements.row[out]})
        table["residual_mm"] = np.linalg.norm(deviation, axis=1) / MM
        return table.assign(reason=str(Note("outlier")))

    def __str__(self) -> str:
        return str(report().diagnosis_line.diagnosis_line(self))

    def summary(self) -> dict[str, Any]:
        """Schema ``aacmm-pin/diagnosis/1``."""
        return dict(report().diagnosis_json.diagnosis_to_dict(self))

    def plot(self, finding: int = 0, ax: Axes | None = None) -> Axes:
        """The strongest cause through what the records say of it; where none was found, what the
        residuals depend on; where they depend on nothing, their size by the three models.

        Args:
            finding: number of another finding, from 0.
            ax: axes; without them a new pyplot figure is made.

        Raises:
            AacmmError: there is no such finding.
        """
        return cast("Axes", report().plots.plot_diagnosis(self, finding, ax))


def too_good(extended: Fit) -> bool:
    """Whether the residuals are far smaller than the noise, though no scatter was added to it."""
    return bool(chi2_cdf(*extended.chi2) <= THRESHOLDS.too_good)


def _rms_residual(fit: Fit, used: Mask) -> float:
    """RMS distance of tip and target over the ``used`` records (n,) [m]."""
    deviation = fit.system.deviation[used]
    return rms(np.linalg.norm(deviation, axis=1))
