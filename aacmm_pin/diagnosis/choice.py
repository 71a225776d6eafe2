"""What a search for causes found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import filterfalse

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.calibration import Fit, HeldEffects
from aacmm_pin.diagnosis.candidates import Variants
from aacmm_pin.diagnosis.covariates import Carried, Covariate
from aacmm_pin.diagnosis.design_matrix import Design, held_effects, typical_of
from aacmm_pin.diagnosis.gram_matrix import Gram, gram_of
from aacmm_pin.diagnosis.linear_model import Conditional
from aacmm_pin.diagnosis.model_space import Blocks, Candidates
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.reading_scatter import ReadingScatter
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect

LEAST_SIZE = 1e-9
"""Directions whose whitening is smaller, relative to the largest, do not count."""


@dataclass(frozen=True, eq=False)
class Choice:
    """The result of a search for causes, at the point where the last refit ended. A *block* is one
    variant of a candidate, by its number in the design.

    Attributes:
        fit: refit of geometry and of the causes of the median probability model.
        posterior: over sets of blocks, linear at the most probable set.
        library, all_covariates: the candidates.
        folds: fold of the cross-validation of each record (n,).
        scatter: of readings beyond the stated noise; None where the records show none.
        otherwise: labels of causes and covariates that would be found if excluded records counted,
            where without these no cause is.
        curves: causes with many parameters, which the refit held; None without any.
        kept_alone: records that the arm recalibrated alone, by its own scatter, does not exclude
            (n,); None: the used ones.
    """

    fit: Fit
    posterior: Posterior
    library: tuple[Variants, ...]
    all_covariates: tuple[Covariate, ...]
    folds: Index
    scatter: ReadingScatter | None = None
    otherwise: tuple[str, ...] = ()
    curves: HeldEffects | None = None
    kept_alone: Mask | None = None

    @property
    def candidates(self) -> Candidates:
        """Candidates for a set."""
        return self.posterior.space.candidates

    @property
    def design(self) -> Design:
        """Columns of all candidates."""
        return self.candidates.design

    @property
    def counted(self) -> Mask:
        """Records that count when they are left out and predicted (n,): all but those that both
        arms exclude.

        A record that only the extended arm excludes may be one that its causes are wrong for. One
        that both exclude is a gross error: both arms are equally far from it, and a few such
        records would be all that a gain in RMS shows.
        """
        used = self.fit.used
        return used if self.kept_alone is None else used | self.kept_alone

    @property
    def gram_of_folds(self) -> Gram:
        """Inner products of all records, from which those of a fold can be subtracted: a seat with
        records in several folds has coordinates of its own in each.
        """
        of_all = self.posterior.space.gram
        if not seats_are_divided(self.folds, self.design.fit):
            return of_all
        numbers = np.unique(self.folds[self.design.fit.used]).tolist()
        divided = gram_of(self.design, self.noise, [self.folds == number for number in numbers])
        return replace(divided, origin=of_all)

    @cached_property
    def deviations(self) -> Array:
        """Deviations of all records beyond the median probability model and the background (n, 3),
        with orientations (n, 6) [m, rad].
        """
        return self.design.deviations(self.posterior.median_model.all_tips)

    def displacement(self, weights: Array) -> Array:
        """Displacement of the used records' tips by all columns times ``weights`` (columns, r) that
        recalibration leaves (n, 3, r) [m].
        """
        design, base = self.design, self.posterior.space.base(0)
        coefficients = weights.copy()
        with_residual = np.append(weights, np.zeros((1, weights.shape[1])), axis=0)
        coefficients[: design.nuisances] -= base.estimate(with_residual)
        moved = design.moved(coefficients, np.arange(len(design.tips)))
        unmoved = design.deviations(design.tips)
        changes = [
            design.deviations(design.tips + displacement) - unmoved
            for displacement in np.moveaxis(moved, 2, 0)
        ]
        return np.stack(changes, axis=2)[self.fit.used, :3]

    @cached_property
    def scatter_left(self) -> ReadingScatter:
        """Scatter of readings and tips beside the median probability model."""
        return self.scatter_beside(self.posterior.median_model)

    def scatter_beside(self, model: Conditional) -> ReadingScatter:
        """Scatter of readings and tips beside a set."""
        share_of_dof = min(max(model.dof, 1.0) / max(model.base.gram.free, 1), 1.0)
        deviations = self.design.deviations(model.all_tips)
        return ReadingScatter.of(self.design.fit, deviations, share_of_dof, self.noise)

    @cached_property
    def scatter_beside_top(self) -> ReadingScatter | None:
        """Scatter beside the most probable set; None where the stated noise was all there was."""
        if noise_is_known(self.design.fit):
            return None
        return self.scatter_beside(self.posterior.top_model)

    @property
    def log_density_of_scatter(self) -> float:
        """Term beside :attr:`Posterior.log_density` by which choices of different scatter are
        compared: log determinants of the whitening and of the nuisances' precision, and prior odds
        of each joint whose readings scatter.
        """
        space = self.posterior.space
        fit = self.design.fit
        noise = fit.noise if self.scatter is None else self.scatter
        sizes = np.linalg.svd(noise.whitening[fit.used], compute_uv=False)
        counted = sizes[sizes > LEAST_SIZE * sizes.max()]
        of_nuisances = np.log(np.diag(space.base(0).left.factor)).sum()
        log_density = space.gram.free * np.log(counted).mean() - of_nuisances
        scattered = 0 if self.scatter is None else np.count_nonzero(self.scatter.readings)
        return float(log_density + scattered * np.log(1.0 - THRESHOLDS.library))

    @property
    def noise(self) -> RecordNoise:
        """Noise of the records."""
        return self.posterior.noise

    @property
    def top_causes(self) -> Blocks:
        """Blocks of the most probable set that are causes."""
        return tuple(filter(self.candidates.is_cause, self.posterior.top))

    @property
    def causes(self) -> Blocks:
        """Blocks of the median probability model that are causes, the strongest first."""
        return tuple(filter(self.candidates.is_cause, self.posterior.by_strength))

    @property
    def covariates(self) -> Blocks:
        """Blocks of the median probability model that are covariates, the strongest first."""
        return tuple(filterfalse(self.candidates.is_cause, self.posterior.by_strength))

    @property
    def effects(self) -> list[Effect]:
        """Causes of the median probability model, the strongest first."""
        return [self.variant(k) for k in self.causes]

    def with_values(self, effects: Sequence[Effect]) -> list[Effect]:
        """Effects of the median set, or else of the most probable one, with their prior widths as
        u; those with many parameters at their posterior means, in the median set beside the other
        causes alone, for the extended arm has no covariates.
        """
        with_values = []
        for model in (self.posterior.causes_alone, self.posterior.top_model):
            causes = filter(self.candidates.is_cause, model.blocks)
            # A curve of another fineness has the same label.
            block_of = {(self.variant(k).label, len(self.variant(k).terms)): k for k in causes}
            if {(effect.label, len(effect.terms)) for effect in effects} <= block_of.keys():
                break
        for effect in effects:
            k = block_of[effect.label, len(effect.terms)]
            entries = model.entries[k]
            scales = typical_of(effect)
            u = model.scale[entries][: scales.size] * scales
            values = model.estimate[entries] * scales if effect.free_form else ()
            with_values.append(effect.at(values, u))
        return with_values

    def held_curves(self, fit: Fit, effects: Sequence[Effect]) -> HeldEffects:
        """Curves of the median probability model beside a refit that held them, with the values
        and the uncertainty of the posterior.
        """
        model = self.posterior.median_model
        block_of = {self.variant(k).label: k for k in self.causes}
        entries = np.r_[tuple(model.entries[block_of[effect.label]] for effect in effects)]
        scales = np.concatenate([*map(typical_of, effects)])
        covariance = model.covariance[np.ix_(entries, entries)] * np.outer(scales, scales)
        u = iter(np.sqrt(np.diag(covariance)))
        with_u = [effect.at(effect.values, [next(u) for _ in effect.terms]) for effect in effects]
        return held_effects(fit, with_u, covariance)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the causes and covariates of the median probability model."""
        return self.design.labels((*self.causes, *self.covariates))

    def in_one_fold(self, block: int) -> bool:
        """Whether a block moves only records of one fold, so that other folds say nothing of it."""
        moved = self.design.columns(block).any(axis=(1, 2))
        folds = self.folds[self.fit.used]
        folds_moved = self.folds[self.fit.used & moved]
        return len(set(folds_moved)) == 1 < len(set(folds))

    def covariate(self, block: int) -> Covariate:
        """The covariate of a block."""
        number = self.candidates.owner(block) - self.design.causes
        return self.all_covariates[number]

    def way(self, block: int) -> Carried:
        """How the covariate of a block acts."""
        variant = self.design.blocks[block].variant
        return self.covariate(block).variants[variant]

    def variant(self, block: int) -> Effect:
        """The effect of a block."""
        variant = self.design.blocks[block].variant
        return self.library[self.candidates.owner(block)][variant]


def noise_is_known(at: Fit) -> bool:
    """Whether the stated noise is all that the fit found."""
    return at.noise_is_stated and at.noise.scatters.of_targets == 0.0


def seats_are_divided(folds: Index, fit: Fit) -> bool:
    """Whether the records of a seat, or of seats that a bar connects, are in several folds (n,)."""
    touched = fit.observations.seat >= 0
    clusters = fit.observations.clusters[fit.observations.seat[touched]]
    clusters_and_folds = {*zip(clusters, folds[touched], strict=True)}
    return len(clusters_and_folds) > len(set(clusters))
