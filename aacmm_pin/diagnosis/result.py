"""What a diagnosis gives back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown, report
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameter_vector import geometric_parameters
from aacmm_pin.diagnosis.branches import Branches
from aacmm_pin.diagnosis.candidates import not_tried
from aacmm_pin.diagnosis.cross_validation import Brought, Gain
from aacmm_pin.diagnosis.discrepancy import lost
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.diagnosis.residual_tables import residuals_by_group
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import SharedError, Unexplained
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import COLUMNS
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.labels import probability as in_digits
from aacmm_pin.effects.labels import values_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCHEMA = "aacmm-pin/diagnosis/1"
TOO_GOOD = 1e-6
"""Residuals that are so much smaller than the stated noise have less chance than this."""
Verdict = Literal["explained", "no-discrepancy", "ambiguous", "unexplained", "inconclusive"]
Doubt = Literal[
    "contradicted references",
    "few causes shown",
    "cause not named",
    "below zero",
    "cause not borne out",
    "no better",
    "structure left",
    "more causes",
    "starts disagree",
]
"""What keeps a diagnosis from being ``explained`` or ``no-discrepancy``."""


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
        brought: what it brings on held-out records; None where too few groups say something of it, and of a value of the
            geometry, which recalibration moves as well.
        inner: order, time constant or time that these records told, with u: name -> (value, u).
        slides: True where its joint slides, so that its values in rad are metres.
        beside: the same cause of the whole arm, on top of which its values come; None where that was not estimated.
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
        """Whether held-out records are predicted better with it beyond doubt, as far as there are groups to ask."""
        return self.brought is None or self.brought.low > 0.0

    @property
    def gone(self) -> bool:
        """Whether it is a cause that was known, and of which nothing is left beyond its U (k = 2)."""
        known = zip(self.effect.values, self.effect.u, strict=True)
        return self.was is not None and all(abs(value) <= COVERAGE_FACTOR * u for value, u in known)

    @property
    def below_zero(self) -> tuple[str, ...]:
        """Keys of values that are negative beyond their U (k = 2), though nature has them above zero only."""
        whole = np.array(self.effect.values) + (0.0 if self.beside is None else np.array(self.beside.values))
        known = zip(self.effect.terms, whole, self.effect.u, strict=True)
        return tuple(term.key for term, value, u in known if term.positive and value + COVERAGE_FACTOR * u < 0.0)

    @property
    def label(self) -> str:
        """Cause and place."""
        return self.effect.label

    def __str__(self) -> str:
        values = values_in_words(self.effect, self.parameters, self.slides)
        if (waves := self.effect.spectrum()) is not None:
            values = "waves per turn: " + ", ".join(f"{n:.3g} ({a:.2g} rad)" for n, a in waves[:4])
        return f"{self.label} (probability {in_digits(self.probability)}{', ' + values if values else ''})"


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """What the simulation gets wrong, why, and how much better it is when it knows.

    Attributes:
        verdict, doubts: see :func:`aacmm_pin.diagnosis.verdict.verdict_of` and ``doubts_of`` there.
        otherwise: what would be found if excluded records counted.
        contradicted: stated places that the records contradict, in words.
        findings: causes, strongest first; geometric values beyond their stated uncertainty last.
        model: the arm recalibrated, with the causes found; without them where it does not predict held-out records better.
        before: the arm as it was, set-up fitted; recalibrated: geometry refitted; extended: with the causes.
        choice: the search behind it.
        held_out: residuals of records left out of choosing and fitting, or None.
        unexplained: structure without a cause.
        noise: RMS that the noise alone would give [m].
        visible: how many causes of typical magnitude these records would have shown, and of how many.
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
    assumed: tuple[str, ...]
    doubts: tuple[Doubt, ...]
    otherwise: tuple[str, ...]
    contradicted: tuple[str, ...]

    def geometric(self, finding: Finding) -> bool:
        """Whether a finding is a value of the arm's own geometry."""
        return bool(geometric_parameters(self.model.arm, finding.effect))

    @property
    def no_better(self) -> bool:
        """Whether causes were added with which held-out records are not predicted better beyond doubt."""
        return no_better(self.model.arm, self.findings, self.held_out)

    def cause(self, label: str) -> Effect | None:
        """The cause that a label of this result names, as it was tried first; None for a covariate."""
        return next((variants[0] for variants in self.choice.library if variants[0].label == label), None)

    @property
    def alternatives(self) -> dict[tuple[str, ...], float]:
        """Probability of each set of causes, by their labels, the most probable first; they add up to one."""
        return self.choice.posterior.causes

    @property
    def cannot_tell_apart(self) -> list[tuple[str, ...]]:
        """Causes of which one set has some and another set, which cannot be excluded, has others instead."""
        best, *others = self.alternatives.items()
        rivals = [set(labels) for labels, share in others if share >= THRESHOLDS.rival]
        exchanged = [tuple(sorted(rival ^ set(best[0]))) for rival in rivals]
        return [labels for labels in dict.fromkeys(exchanged) if len(labels) > 1]

    @property
    def more(self) -> float:
        """Probability that a cause acts that is not among the findings."""
        return self.choice.posterior.beyond([finding.label for finding in self.findings])

    @property
    def not_saved(self) -> list[str]:
        """Covariates of the discrepancy that no arm file can have."""
        return lost([(self.choice.covariate(k).name, self.choice.way(k)) for k in self.choice.covariates])

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, and what limits what is stated."""
        return tuple(report().diagnosis_notes.notes_of(self))

    @cached_property
    def next_measurements(self) -> str:
        """What would settle what is open, in a sentence; where two causes are alike, with the command that plans it."""
        return str(report().next_measurements.next_measurements(self))

    @cached_property
    def residual_groups(self) -> pd.DataFrame:
        """See :func:`~aacmm_pin.diagnosis.residual_tables.residuals_by_group`."""
        return residuals_by_group(self.before, self.recalibrated, self.extended)

    @property
    def converged(self) -> bool:
        """Whether every search that the verdict rests on ended at a minimum."""
        return not self.converge_note

    @property
    def converge_note(self) -> str:
        """What held up a search that did not converge; "" where all did."""
        fits = {"recalibrated": self.recalibrated, "extended": self.extended}
        return "; ".join(f"{name}: {fit.solution.held_up}" for name, fit in fits.items() if not fit.solution.converged)

    @property
    def _fits(self) -> dict[str, Fit]:
        """The three models by name."""
        return {"simulation": self.before, "recalibrated": self.recalibrated, "extended": self.extended}

    @property
    def rms(self) -> dict[str, float]:
        """RMS of the used records by simulation, recalibrated and extended model, and by noise alone [m]."""
        used = self.extended.used
        deviations = {name: fit.solution.system.deviation[used] for name, fit in self._fits.items()}
        return {name: rms(np.linalg.norm(each, axis=1)) for name, each in deviations.items()} | {"noise": self.noise}

    @property
    def turns(self) -> dict[str, float] | None:
        """RMS turn of the used records from their stated orientations, by each model [rad]; None where none is stated."""
        used = self.extended.used & self.extended.observations.oriented
        return {name: rms(fit.turns[used]) for name, fit in self._fits.items()} if used.any() else None

    @property
    def excluded(self) -> pd.DataFrame:
        """Records that cannot belong even with the causes known: row, residual [mm], reason."""
        records, out = self.extended.problem.measurements, self.extended.excluded
        distance = np.linalg.norm(self.extended.solution.system.deviation[out], axis=1) / MM
        return pd.DataFrame(
            {"row": records.row[out], "residual_mm": distance, "reason": "outlier: farther off than the noise allows"}
        )

    def __str__(self) -> str:
        sizes = self.rms
        text = (
            f"{self.verdict}: RMS {sizes['simulation'] / MM:.4f} mm simulated, {sizes['recalibrated'] / MM:.4f} mm "
            f"recalibrated, {sizes['extended'] / MM:.4f} mm extended, {sizes['noise'] / MM:.4f} mm by noise alone"
        )
        text = "; ".join([text, *map(str, self.findings), *self.unexplained.in_words, *self.contradicted])
        if self.held_out is not None:
            low, high = self.held_out.interval
            text += f"; gain on held-out {self.held_out.kind} {self.held_out.gain:.2f} ({low:.2f} to {high:.2f})"
        if self.no_better:
            text += "; the extended arm does not predict held-out records better than the recalibrated arm"
        return text

    def summary(self) -> dict[str, Any]:
        """Schema ``aacmm-pin/diagnosis/1``."""
        return {
            "schema": SCHEMA,
            "arm": self.model.arm.name,
            "verdict": self.verdict,
            "doubts": list(self.doubts),
            "converged": self.converged,
            "converge_note": self.converge_note,
            "records": {
                "used": int(self.extended.used.sum()),
                "excluded": [
                    {"row": int(r["row"]), "reason": r["reason"], "residual_mm": float(r["residual_mm"])}
                    for r in self.excluded.to_dict("records")
                ],
            },
            "rms_mm": {name: value / MM for name, value in self.rms.items()},
            "rms_rad": self.turns,
            "findings": [_finding(f) for f in self.findings],
            "held_out": None if self.held_out is None else _held_out(self.held_out),
            "alternatives": [
                {"causes": list(labels), "probability": probability} for labels, probability in self.alternatives.items()
            ],
            "agreement": {
                "total_variation": self.choice.posterior.total_variation,
                "agree": self.choice.posterior.agree,
            },
            "discrepancy": [
                {
                    "covariate": each.covariate,
                    "rms_mm": each.rms / MM,
                    "u_mm": each.u / MM,
                    "probability": each.probability,
                }
                for each in self.unexplained.discrepancy
            ],
            "unexplained": {
                "p_value": self.unexplained.p_value,
                "threshold": self.unexplained.threshold,
                "depends_on": list(self.unexplained.depends_on),
                "acts_on": self.unexplained.acts_on,
                "smooth_correction_gain": self.unexplained.gain,
                "groups": [asdict(group) for group in self.unexplained.groups],
                "branches": _branches(self.unexplained.branches),
                "scattered_readings": [
                    {
                        "joint": each.joint,
                        **_amount("scatter", each.scatter, each.slides),
                        "rms_mm": each.at_tips / MM,
                        "log_likelihood_ratio": each.log_ratio,
                        "p_value": each.p_value,
                    }
                    for each in self.unexplained.readings
                ],
                "shared_by_postures": _shared_error(self.unexplained.shared_by_postures),
            },
            "not_tried": [
                {"column": COLUMNS[need], "causes": [cause.cause for cause in causes]}
                for need, causes in not_tried(self.choice.library, self.extended.problem.measurements).items()
            ],
            "cannot_tell_apart": [list(group) for group in self.cannot_tell_apart],
            "next_measurements": self.next_measurements,
            "notes": list(self.notes),
        }

    def plot(self, finding: int = 0, ax: Axes | None = None) -> Axes:
        """The strongest cause through what the records say of it; where none was found, what the residuals depend on; where
        they depend on nothing, their size by the three models.

        Args:
            finding: number of another finding, from 0.
            ax: axes; without them a new pyplot figure is made.

        Raises:
            AacmmError: there is no such finding.
        """
        return cast("Axes", report().plots.plot_diagnosis(self, finding, ax))


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "cause": finding.cause,
        "joint": finding.joint,
        **{name: getattr(finding.effect, name) for name in _inner_fields(finding.effect)},
        **_spectrum(finding.effect),
        "probability": finding.probability,
        "p_value": finding.p_value,
        "retained_fraction": finding.retained_fraction,
        "held_out": None
        if finding.brought is None
        else {"gain": finding.brought.gain, "gain_ci95": list(finding.brought[1:])},
        "parameters": _with_u(finding.parameters),
        "below_zero": list(finding.below_zero),
        "inner": _with_u(finding.inner),
        "aliases": [_alias(a) for a in finding.aliases],
    }


def _alias(alias: Alias) -> dict[str, Any]:
    effect = alias.effect
    site = None if effect is None else effect.site()
    return {
        "cause": alias.label if effect is None else effect.cause,
        "joint": None if effect is None else effect.row,
        **({site: effect.place} if effect is not None and site not in (None, "joint") else {}),
        "correlation": alias.correlation,
        "probability": alias.probability,
    }


def _with_u(values: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float | None]]:
    return {name: {"value": value, "u": u if math.isfinite(u) else None} for name, (value, u) in values.items()}


def _spectrum(effect: Effect) -> dict[str, Any]:
    waves = effect.spectrum()
    return {} if waves is None else {"spectrum": [{"order": order, "amplitude_rad": size} for order, size in waves]}


def _inner_fields(effect: Effect) -> list[str]:
    names = [name for name in effect.structure() if name not in ("joint", "bodies")]
    return [name for name in names if getattr(effect, name) not in (None, ())]


def _branches(branches: Branches | None) -> dict[str, Any] | None:
    if branches is None:
        return None
    size = _amount("half_width", branches.half_width, branches.slides)
    return {"joint": branches.joint, **size, "log_likelihood_ratio": branches.log_ratio}


def _shared_error(error: SharedError | None) -> dict[str, Any] | None:
    return None if error is None else {"rms_mm": error.rms / MM, "times_a_record": error.times, "p_value": error.p_value}


def _amount(name: str, value: float, slides: bool) -> dict[str, float]:
    """An amount of a joint with its unit in its name."""
    return {f"{name}_mm": value / MM} if slides else {f"{name}_rad": value}


def _held_out(gain: Gain) -> dict[str, Any]:
    return {
        "kind": gain.kind,
        "groups": gain.groups,
        "rms_mm": {
            "simulation": rms(gain.simulation) / MM,
            "recalibrated": rms(gain.recalibrated) / MM,
            "extended": rms(gain.extended) / MM,
        },
        "gain": gain.gain,
        "gain_ci95": list(gain.interval),
        "excluded_counted": gain.excluded,
        "gross_errors": gain.gross_errors,
    }


def no_better(arm: Arm, findings: Sequence[Finding], held: Gain | None) -> bool:
    """Whether there are causes among the findings with which held-out records are not predicted better beyond doubt.

    Values of the geometry are in the recalibrated arm as well, and places of seats in neither.
    """
    causes = [f for f in findings if not (geometric_parameters(arm, f.effect) or f.effect.corrects_seat)]
    return bool(causes) and held is not None and not held.beyond_doubt


def described(effect: Effect, covariance: Array) -> dict[str, tuple[float, float]]:
    """Described values of an effect with u, from the covariance of its parameters (p, p)."""
    jacobian = effect.described_jacobian()
    u = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian), 0.0))
    return {k: (v, float(s)) for (k, v), s in zip(effect.described().items(), u, strict=True)}


def too_good(extended: Fit) -> bool:
    """Whether the residuals are far smaller than the stated noise."""
    return extended.chi2_stated is not None and bool(chi2_cdf(*extended.chi2_stated) <= TOO_GOOD)
