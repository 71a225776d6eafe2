"""The posterior over sets of causes, and what is read off it."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.diagnosis.linear_model import Conditional
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.thresholds import THRESHOLDS


@dataclass(frozen=True, eq=False)
class Posterior:
    """Sets of blocks that were visited, with their weights.

    Attributes:
        weights: of each set of blocks, the largest first; they add up to one.
        disagreement: largest difference of an inclusion probability between the two searches.
    """

    space: ModelSpace
    weights: Mapping[Blocks, float]
    disagreement: float

    @property
    def agree(self) -> bool:
        """Whether the searches from the two starts agree."""
        return self.disagreement <= THRESHOLDS.agreement

    @property
    def top(self) -> Blocks:
        """The most probable set."""
        return next(iter(self.weights))

    @property
    def noise(self) -> RecordNoise:
        """Noise of the records."""
        return self.space.gram.noise

    @property
    def log_density(self) -> float:
        """Log posterior of the most probable set with the noise, up to a constant of these records;
        an error that postures share has the prior odds of all covariates.
        """
        of_noise = self.noise.log_density(self.space.likelihood.dof)
        if self.noise.ratio:
            of_noise += float(np.log(1.0 - THRESHOLDS.library))
        return self.space.marginal(self.top).log_posterior + of_noise

    @cached_property
    def inclusion(self) -> Array:
        """Inclusion probability of each candidate (candidates,)."""
        return inclusion(self.space, self.weights)

    def probability(self, block: int) -> float:
        """Inclusion probability of a block's candidate."""
        return float(self.inclusion[self.space.candidates.owner(block)])

    @cached_property
    def median(self) -> Blocks:
        """The median probability model: the candidates more probable than not (Barbieri, Berger
        2004, Ann. Stat. 32).

        It has only the most probable form of each place, with its most probable variants.
        """
        owner = self.space.candidates.owner
        weights = self._at_places
        best_variants: dict[frozenset[int], frozenset[int]] = {}
        for blocks in sorted(weights, key=lambda blocks: (-weights[blocks], sorted(blocks))):
            form = frozenset(map(owner, blocks))
            best_variants.setdefault(form, blocks)
        likeliest_forms = [next(iter(forms)) for forms in self.forms.values()]
        acting = itertools.chain.from_iterable(best_variants[form] for form in likeliest_forms)
        return tuple(sorted(k for k in acting if self.probability(k) >= THRESHOLDS.named))

    @cached_property
    def forms(self) -> dict[int, dict[frozenset[int], float]]:
        """Of each place, by its number, the probability of each form, the most probable first.

        A form is the set of the candidates that act there together, whatever their variants.
        """
        candidates = self.space.candidates
        forms_of_place = defaultdict[int, dict[frozenset[int], float]](dict)
        for blocks, weight in self._at_places.items():
            place = int(candidates.block_places[min(blocks)])
            forms = forms_of_place[place]
            form = frozenset(map(candidates.owner, blocks))
            forms[form] = forms.get(form, 0.0) + weight
        return {
            place: dict(sorted(forms.items(), key=lambda form: (-form[1], sorted(form[0]))))
            for place, forms in sorted(forms_of_place.items())
        }

    @cached_property
    def _at_places(self) -> dict[frozenset[int], float]:
        """Probability of each set of blocks that act at one place together, and no others there."""
        places = self.space.candidates.block_places.tolist()
        weights = defaultdict[frozenset[int], float](float)
        for blocks, weight in self.weights.items():
            for place in {places[k] for k in blocks}:
                weights[frozenset(k for k in blocks if places[k] == place)] += weight
        return weights

    def beside(self, blocks: Blocks, kept: Sequence[int] | None = None) -> Conditional:
        """The linear model with a set, or its blocks ``kept``, at the set's best widths and
        amplitude.
        """
        best = self.space.marginal(blocks).best
        return self.space.conditional(best if kept is None else best.of(kept))

    @cached_property
    def top_model(self) -> Conditional:
        """The linear model with the most probable set."""
        return self.beside(self.top)

    @cached_property
    def median_model(self) -> Conditional:
        """The linear model with the median set."""
        return self.beside(self.median)

    def without(self, block: int) -> Conditional:
        """The linear model with the median set without one of its blocks."""
        return self.beside(self.median, [k for k in self.median if k != block])

    @cached_property
    def by_strength(self) -> list[int]:
        """Blocks of the median probability model, the most needed first."""
        log_posteriors_without = self.space.removals(self.median)
        order = np.argsort(log_posteriors_without, kind="stable").tolist()
        return [self.median[k] for k in order]

    @cached_property
    def causes(self) -> dict[tuple[str, ...], float]:
        """Probability of each set of causes, by their labels, the most probable first."""
        candidates = self.space.candidates
        probability = defaultdict[tuple[str, ...], float](float)
        for blocks, weight in self.weights.items():
            owners = {candidates.owner(k) for k in blocks if candidates.is_cause(k)}
            labels = tuple(candidates.design.names[owner] for owner in sorted(owners))
            probability[labels] += weight
        ordered = sorted(probability, key=lambda labels: -probability[labels])
        return {labels: min(probability[labels], 1.0) for labels in ordered}

    def beyond(self, named: Collection[str]) -> float:
        """Probability that a cause acts which is not among the named."""
        expected = set(named)
        others = (
            weight for labels, weight in self.causes.items() if not expected.issuperset(labels)
        )
        return min(float(sum(others)), 1.0)

    def instead(self, owner: int) -> Array:
        """Probability that each candidate is in the set and ``owner`` is not (candidates,)."""
        owner_of = self.space.candidates.owner
        sets_without = {
            blocks: weight
            for blocks, weight in self.weights.items()
            if owner not in map(owner_of, blocks)
        }
        return inclusion(self.space, sets_without)

    @cached_property
    def causes_alone(self) -> Conditional:
        """The linear model with the median set's causes, without covariates and background."""
        best = self.space.marginal(self.median).best
        causes = filter(self.space.candidates.is_cause, self.median)
        return self.space.conditional(best.of([*causes])._replace(amplitude=0))

    def uncertainty_of_the_set(self, block: int) -> Array:
        """By how much a cause's covariance is larger than beside the other causes of the median
        probability model alone (q, q), in units of the design's scales.

        Other sets, and structure, leave another estimate: law of total variance, about that with
        these causes alone.
        """
        entries = self.causes_alone.entries[block]
        alone = self.causes_alone.covariance[entries, entries]
        values, vectors = np.linalg.eigh(self._covariances_over_sets[block] - alone)
        return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)

    @cached_property
    def _covariances_over_sets(self) -> dict[int, Array]:
        """Mean covariance of each cause in the sets worth listing that hold it, about the estimate
        with the causes alone; of sets whose log posterior is known.
        """
        alone = self.causes_alone
        sums = {k: 0.0 * alone.covariance[entries, entries] for k, entries in alone.entries.items()}
        weights = dict.fromkeys(alone.blocks, 0.0)
        for blocks, weight in self.weights.items():
            if weight < THRESHOLDS.worth_listing or not self.space.is_evaluated(blocks):
                continue
            model = self.beside(blocks)
            covariance = model.covariance
            for k in set(blocks) & weights.keys():
                entries = model.entries[k]
                difference = model.estimate[entries] - alone.estimate[alone.entries[k]]
                square = np.outer(difference, difference)
                sums[k] += weight * (covariance[entries, entries] + square)
                weights[k] += weight
        return {k: sums[k] / max(weights[k], THRESHOLDS.worth_listing) for k in alone.blocks}


def inclusion(space: ModelSpace, weights: Mapping[Blocks, float]) -> Array:
    """Inclusion probability of each candidate (candidates,)."""
    probability = np.zeros(len(space.candidates.design.names))
    for blocks, weight in weights.items():
        probability[[space.candidates.owner(k) for k in blocks]] += weight
    return np.minimum(probability, 1.0)


def best_of_candidates(candidates: Candidates, values: Array) -> dict[int, int]:
    """Of each candidate its block with the largest of ``values`` (blocks,), the best candidate
    first; none whose blocks all have minus infinity.
    """
    best: dict[int, int] = {}
    for k in np.argsort(-values, kind="stable").tolist():
        if np.isfinite(values[k]):
            best.setdefault(candidates.owner(k), k)
    return best


def weights_of(
    values: Mapping[Blocks, float], reach: float = THRESHOLDS.reach
) -> dict[Blocks, float]:
    """Weights of sets by their log posteriors, largest first; without sets out of reach."""
    best = max(values.values())
    within_reach = {blocks: value for blocks, value in values.items() if value > best - reach}
    ordered = sorted(within_reach, key=lambda blocks: (-within_reach[blocks], blocks))
    weights = {blocks: float(np.exp(within_reach[blocks] - best)) for blocks in ordered}
    total = sum(weights.values())
    return {blocks: weight / total for blocks, weight in weights.items()}
