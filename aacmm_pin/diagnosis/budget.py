"""The budget: the mean square of what the nominal arm gets wrong, as a sum of parts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.calibration import Fit, geometric_parameters, rms, rms_residual
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import DiscrepancySize, SharedError

GEOMETRY = "geometry"
STRUCTURE = "structure without a name"
SHARED = "shared by postures"
BEYOND = "unexplained scatter"
NOISE = "noise"
SIGNIFICANT = 3.0
"""Scatter beyond the stated noise is a part of its own from so many times its u on."""
UNDONE = 0.05
"""A displacement of which less than this part of its square counts is undone by others."""


@dataclass(frozen=True)
class BudgetPart(Shown):
    """One part of the mean square residual of the nominal arm.

    Attributes:
        part: ``geometry``, ``structure without a name``, ``noise``, ``shared by postures`` (an
            error that records of one posture share) or ``unexplained scatter`` (more than the
            stated noise); or the labels of the causes of one place, or of places whose
            displacements oppose one another, joined by ``+``.
        mean_square: of the residuals [m²]; below zero for geometry, if all other parts are more
            than the whole.
        u: standard uncertainty of the mean square [m²].
    """

    part: str
    mean_square: float
    u: float
    share: float = 0.0
    causes: tuple[str, ...] = ()

    @property
    def rms(self) -> float:
        """Root of the mean square [m]; 0 below zero."""
        return float(np.sqrt(max(self.mean_square, 0.0)))

    @property
    def u_rms(self) -> float:
        """Standard uncertainty of this root [m]: propagated; at most the root of u, which holds
        near zero.
        """
        by_slope = self.u / (2.0 * self.rms) if self.rms else math.inf
        return min(by_slope, math.sqrt(self.u))


def budget_of(
    choice: Choice, nominal: Fit, structure: Sequence[DiscrepancySize], shared: SharedError | None
) -> tuple[BudgetPart, ...]:
    """The parts of the mean square residual of the nominal arm: geometry, places and structure by
    size, what records share, noise.

    Of the displacement ``D`` of a place at the posterior mean, what recalibration leaves counts:
    ``mean(D · ΣD)``, summed over all places and structure. The noise is the mean square that these
    leave, for as many free parameters as the nominal arm has. The geometry is the rest.
    """
    used = choice.fit.used
    nominal_square = rms_residual(nominal, used) ** 2
    dof = max(choice.posterior.median_model.dof, 1.0)
    remaining_square = rms(np.linalg.norm(choice.deviations[used, :3], axis=1)) ** 2
    noise_square = remaining_square * max(nominal.chi2.dof, 1.0) / dof
    named_parts = _parts_of_places_and_structure(choice, structure)
    parts = sorted(named_parts, key=lambda part: -part.mean_square)
    if shared is not None:
        shared_square = min(shared.rms**2, noise_square)
        group_count = max(choice.noise.count.size, 1)
        u_shared = shared_square * math.sqrt(2.0 / group_count)
        parts.append(BudgetPart(SHARED, shared_square, u_shared))
        noise_square -= shared_square
    relative_u = math.sqrt(2.0 / dof)
    stated_square = choice.fit.noise_rms**2 if choice.fit.noise_is_stated else noise_square
    beyond_stated = noise_square - stated_square > SIGNIFICANT * noise_square * relative_u
    if beyond_stated and noise_square > THRESHOLDS.much_more**2 * stated_square:
        parts.append(BudgetPart(BEYOND, noise_square - stated_square, noise_square * relative_u))
        noise_square = stated_square
    parts.append(BudgetPart(NOISE, noise_square, noise_square * relative_u))
    geometry_square = nominal_square - sum(part.mean_square for part in parts)
    u_geometry = math.hypot(*(part.u for part in parts))
    parts.insert(0, BudgetPart(GEOMETRY, geometry_square, u_geometry))
    return tuple(replace(part, share=part.mean_square / nominal_square) for part in parts)


def _parts_of_places_and_structure(
    choice: Choice, structure: Sequence[DiscrepancySize]
) -> Iterator[BudgetPart]:
    """A part for each place, or for places that oppose one another; the structure last."""
    design, model = choice.design, choice.posterior.median_model
    arm = choice.fit.problem.model.arm
    coefficients_of_causes = {
        k: design.weights(k) @ model.estimate[model.entries[k]] for k in choice.causes
    }
    blocks_by_place = defaultdict[int, list[int]](list)
    for block in coefficients_of_causes:
        if not geometric_parameters(arm, choice.variant(block)):
            blocks_by_place[int(choice.candidates.block_places[block])].append(block)
    coefficients_of_structure = model.step - sum(coefficients_of_causes.values())
    coefficients_of_structure[: design.nuisances] = 0.0
    coefficients_of_places = [
        sum(coefficients_of_causes[k] for k in blocks) for blocks in blocks_by_place.values()
    ]
    coefficients = np.stack([*coefficients_of_places, coefficients_of_structure], axis=1)
    displacements = choice.displacement(coefficients)
    products = np.einsum("nij,nik->jk", displacements, displacements) / len(displacements)
    place_squares = products.sum(axis=1)
    blocks_of = [*blocks_by_place.values()]
    for places in _places_joined_if_opposed(products):
        blocks = [k for place in places for k in blocks_of[place]]
        labels = design.labels(blocks)
        mean_square = float(place_squares[places].sum())
        u = abs(mean_square) * _relative_u(choice, blocks)
        yield BudgetPart(" + ".join(labels), mean_square, u, causes=labels)
    if structure and place_squares[-1] > 0.0:
        u = 2.0 * math.sqrt(place_squares[-1]) * math.hypot(*(part.u for part in structure))
        yield BudgetPart(STRUCTURE, float(place_squares[-1]), u)


def _places_joined_if_opposed(products: Array) -> list[list[int]]:
    """Groups of places, by the mean products of their displacements, the structure's last (p + 1, p
    + 1): a place joins the one that nearly undoes its displacement.
    """
    groups = [[place] for place in range(len(products) - 1)]
    while len(groups) > 1:
        own_squares = [products[np.ix_(group, group)].sum() for group in groups]
        parts_left = [
            products[group].sum() / own if own else 1.0
            for group, own in zip(groups, own_squares, strict=True)
        ]
        most_undone = int(np.argmin(parts_left))
        if parts_left[most_undone] > UNDONE:
            break
        group = groups.pop(most_undone)
        opposed_group = min(groups, key=lambda other: products[np.ix_(group, other)].sum())
        opposed_group += group
    return groups


def _relative_u(choice: Choice, blocks: Sequence[int]) -> float:
    """Relative standard uncertainty of the mean square of some causes, in units of the noise: ``2
    √(βᵀ I Σ I β) / βᵀ I β``, I the information beside all that is refitted.
    """
    model = choice.posterior.median_model
    causes_alone = choice.posterior.causes_alone
    entries_alone = np.r_[tuple(causes_alone.entries[k] for k in blocks)]
    entries = np.r_[tuple(model.entries[k] for k in blocks)]
    estimate = model.estimate[entries]
    gradient = causes_alone.information[np.ix_(entries_alone, entries_alone)] @ estimate
    variance = float(gradient @ model.covariance[np.ix_(entries, entries)] @ gradient)
    mean_square = float(gradient @ estimate)
    return 2.0 * math.sqrt(variance) / mean_square if mean_square > 0.0 else 0.0
