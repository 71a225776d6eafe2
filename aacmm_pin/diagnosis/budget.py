"""The budget: the mean square of what the nominal arm gets wrong, as a sum of parts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.calibration import Fit, geometric_parameters, rms, rms_residual
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.gram_matrix import numbers_of
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
    noise = remaining_square * max(nominal.chi2.dof, 1.0) / dof
    parts = sorted(_displacing(choice, structure), key=lambda part: -part.mean_square)
    if shared is not None:
        of_posture = min(shared.rms**2, noise)
        groups = max(choice.noise.count.size, 1)
        parts.append(BudgetPart(SHARED, of_posture, of_posture * math.sqrt(2.0 / groups)))
        noise -= of_posture
    relative_u = math.sqrt(2.0 / dof)
    stated = choice.fit.noise_rms**2 if choice.fit.noise_is_stated else noise
    significant = noise - stated > SIGNIFICANT * noise * relative_u
    if significant and noise > THRESHOLDS.much_more**2 * stated:
        parts.append(BudgetPart(BEYOND, noise - stated, noise * relative_u))
        noise = stated
    parts.append(BudgetPart(NOISE, noise, noise * relative_u))
    of_geometry = nominal_square - sum(part.mean_square for part in parts)
    parts.insert(0, BudgetPart(GEOMETRY, of_geometry, math.hypot(*(part.u for part in parts))))
    return tuple(replace(part, share=part.mean_square / nominal_square) for part in parts)


def _displacing(choice: Choice, structure: Sequence[DiscrepancySize]) -> Iterator[BudgetPart]:
    design, model = choice.design, choice.posterior.median_model
    arm = choice.fit.problem.model.arm
    of_causes = {k: design.weights(k) @ model.estimate[model.entries[k]] for k in choice.causes}
    members = defaultdict[int, list[int]](list)
    for block in of_causes:
        if not geometric_parameters(arm, choice.variant(block)):
            members[int(choice.candidates.of_blocks[block])].append(block)
    of_structure = model.step - sum(of_causes.values())
    of_structure[: design.nuisances] = 0.0
    of_places = [sum(of_causes[k] for k in blocks) for blocks in members.values()]
    displacements = choice.displacement(np.stack([*of_places, of_structure], axis=1))
    products = np.einsum("nij,nik->jk", displacements, displacements) / len(displacements)
    shares = products.sum(axis=1)
    blocks_of = [*members.values()]
    for places in _not_opposed(products):
        blocks = [k for place in places for k in blocks_of[place]]
        labels = design.labels(blocks)
        mean_square = float(shares[places].sum())
        u = abs(mean_square) * _relative_u(choice, blocks)
        yield BudgetPart(" + ".join(labels), mean_square, u, causes=labels)
    if structure and shares[-1] > 0.0:
        u = 2.0 * math.sqrt(shares[-1]) * math.hypot(*(part.u for part in structure))
        yield BudgetPart(STRUCTURE, float(shares[-1]), u)


def _not_opposed(products: Array) -> list[list[int]]:
    """Groups of places, by the mean products of their displacements, the structure's last (p + 1, p
    + 1): a place joins the one that nearly undoes its displacement.
    """
    groups = [[place] for place in range(len(products) - 1)]
    while len(groups) > 1:
        shares = [products[group].sum() for group in groups]
        squares = [products[np.ix_(group, group)].sum() for group in groups]
        least = min(range(len(groups)), key=lambda k: shares[k] / squares[k] if squares[k] else 1.0)
        if shares[least] > UNDONE * squares[least]:
            break
        group = groups.pop(least)
        partner = min(groups, key=lambda other: products[np.ix_(group, other)].sum())
        partner += group
    return groups


def _relative_u(choice: Choice, blocks: Sequence[int]) -> float:
    """Relative standard uncertainty of the mean square of some causes, in units of the noise: ``2
    √(βᵀ I Σ I β) / βᵀ I β``, I the information beside all that is refitted.
    """
    model = choice.posterior.median_model
    alone = choice.posterior.causes_alone
    of_blocks = numbers_of([alone.entries[k] for k in blocks])
    entries = numbers_of([model.entries[k] for k in blocks])
    estimate = model.estimate[entries]
    gradient = alone.information[np.ix_(of_blocks, of_blocks)] @ estimate
    variance = float(gradient @ model.covariance[np.ix_(entries, entries)] @ gradient)
    size = float(gradient @ estimate)
    return 2.0 * math.sqrt(variance) / size if size > 0.0 else 0.0
