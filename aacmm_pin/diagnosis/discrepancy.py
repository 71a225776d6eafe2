"""Covariates that structure depends on, as effects that an arm file can have: described, and not named."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import calibrated
from aacmm_pin.calibration.calibrated_arm import calibrated_model, joined
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.fit import fit as fit_of
from aacmm_pin.calibration.linear_system import assemble
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.model_extension import ProblemOf, free
from aacmm_pin.effects.discrepancy import Carrier, Discrepancy, Part
from aacmm_pin.effects.error_model import ErrorModel

FACTORS = 10
"""So many independent factors stand for the covariance of a background, beside the size of the whole; with 20 u is off by
10 %, and the file is twice as large."""
BACKGROUND = "all that was recorded"
"""What a background depends on."""

Described = tuple[str, Carried]
"""Name of a covariate, and the way in which it acts."""


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Effects, and what is known of their parameters together.

    Attributes:
        effects: with values and u.
        covariance: of all their parameters, in their order (p, p) [their units].
    """

    effects: tuple[Discrepancy, ...]
    covariance: Array

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [parameter.name for effect in self.effects for parameter in effect.parameters()]


def lost(described: Sequence[Described]) -> list[str]:
    """Covariates that no arm file can have, for new records do not have them: labels, torques, unknown columns."""
    return list(dict.fromkeys(name for name, way in described if way.smooth is None))


def discrepancy_effects(
    described: Sequence[Described],
    estimate: Array,
    covariance: Array,
    rotation: Array | None = None,
    taken: Collection[str] = (),
) -> Coefficients:
    """One effect for each covariate that new records have too, see :func:`lost` for the others.

    With an estimate of zero and the covariance of the prior they are effects to be estimated, beside geometry and causes.

    Args:
        described: covariates, each with its variant.
        estimate: coefficients of their functions, those of each on all axes together, one covariate after the other (p,)
            [m, rad, m/m].
        covariance: of these (p, p).
        rotation: axes of the base in the frame of the references (3, 3), along whose axes the tip shifts in the room; None
            where the two frames are one.
        taken: labels of effects that the arm has already: another one has a number behind its name.
    """
    rows, effects, labels = list[Array](), list[Discrepancy](), set(taken)
    for (name, way), place in zip(described, _places(described), strict=True):
        if way.smooth is None:
            continue
        own = np.zeros((place.stop - place.start, len(estimate)))
        own[:, place] = _as_effects(way, rotation)
        u = np.sqrt(np.maximum(np.diag(own @ covariance @ own.T), 0.0))
        effect = _new(name, (_part(way),), len(own), labels).at(own @ estimate, u)
        rows.append(own)
        effects.append(effect)
        labels.add(effect.label)
    every = np.concatenate([np.zeros((0, len(estimate))), *rows])
    return Coefficients(tuple(effects), every @ covariance @ every.T)


def background_effect(
    described: Sequence[Described],
    weights: Array,
    estimate: Array,
    covariance: Array,
    rotation: Array | None = None,
    taken: Collection[str] = (),
) -> Coefficients:
    """A background of many covariates as one effect: its size, 1 ± u, and :data:`FACTORS` factors, each 0 ± 1.

    Ten principal axes of its covariance have a tenth of the variance: all are alike. So the factors are orthogonal
    combinations of all axes, drawn at random, as large as all axes together. Over such draws the mean square of u is right
    at every posture; in one draw u is off by 15 % (standard deviation).

    Args:
        described: covariates, each with one of its variants; :func:`lost` ones are left out.
        weights: coefficients of all their functions, as in :func:`discrepancy_effects`, for each direction of the background
            (p, r) [m, rad, m/m].
        estimate: of the directions (r,), not all zero.
        covariance: of these, positive definite (r, r).
        rotation, taken: see :func:`discrepancy_effects`.
    """
    size_u, factors = _factors(estimate, covariance)
    directions = np.column_stack([weights @ estimate, _rounded(weights @ factors)])
    parts = []
    for (_, way), place in zip(described, _places(described), strict=True):
        if way.smooth is not None:
            rows = _as_effects(way, rotation) @ directions[place]
            parts.append(replace(_part(way), directions=tuple(map(tuple, rows.tolist()))))
    size = directions.shape[1]
    values, u = np.eye(size)[0], np.ones(size)
    u[0] = size_u
    return Coefficients((_new(BACKGROUND, tuple(parts), size, taken).at(values, u),), np.diag(np.square(u)))


def together(*found: Coefficients) -> Coefficients:
    """Effects of several sources, independent of one another."""
    effects = [effect for each in found for effect in each.effects]
    return Coefficients(tuple(effects), block_diag(*(each.covariance for each in found)))


def with_discrepancy(model: ErrorModel, found: Coefficients) -> ErrorModel:
    """The model with these effects too, and what is known of their parameters together, independent of the others'."""
    arm = _knowing(model.arm, found.names, found.covariance)
    return ErrorModel(arm, (*model.effects, *found.effects))


def described_model(known: ErrorModel, choice: Choice, problem_of: ProblemOf, background: bool) -> ErrorModel:
    """The extended arm, refitted with the discrepancy as effects: covariates are estimated, the background is held.

    Args:
        known: the arm as it was, whose labels are taken.
        choice: what was found.
        problem_of: the calibration problem with causes estimated, and with others held.
        background: whether the background is there.
    """
    design, posterior, fit = choice.design, choice.posterior, choice.design.fit
    rotation = fit.solution.point.frame.rotation if fit.problem.external else None
    left, taken = posterior.left, {effect.label for effect in known.effects}
    ways = [(choice.covariate(k).name, choice.way(k)) for k in choice.covariates]
    widths = [left.scale[left.places[k]] * design.scales[design.blocks[k].columns] for k in choice.covariates]
    prior = np.square(np.concatenate([np.empty(0), *widths]))
    named = discrepancy_effects(ways, np.zeros(prior.size), np.diag(prior), rotation, taken)
    taken |= {effect.label for effect in named.effects}
    held = _background(choice, rotation, taken) if background else None
    causes = [free(effect) for effect in choice.effects]
    refit = fit_of(problem_of([*causes, *named.effects], held.effects if held else ()), used=choice.fit.used)
    return calibrated_beside(refit, held) if held else calibrated_model(refit)


def _background(choice: Choice, rotation: Array | None, taken: Collection[str]) -> Coefficients:
    """The background at its most probable amplitude."""
    design, base = choice.design, choice.posterior.left.base
    columns, weights = base.gram.products.background
    blocks = [k for k, b in enumerate(design.blocks) if b.candidate >= design.causes]
    first = base.nuisances
    inverse = np.linalg.inv(base.factor[first:, first:])
    return background_effect(
        [(choice.covariate(k).name, choice.way(k)) for k in blocks],
        design.scales[columns][:, None] * weights,
        choice.posterior.left.step[first : len(base.factor)],
        choice.posterior.left.variance * inverse.T @ inverse,
        rotation,
        taken,
    )


def calibrated_beside(fit: Fit, found: Coefficients) -> ErrorModel:
    """The calibrated arm of a fit that held these effects, with what their uncertainty does to the estimates.

    The estimates answer to the coefficients by ``R = ∂x/∂β``: with the covariance ``K`` of the fit and ``Σ`` of the
    coefficients, that of both is ``[[K + R Σ Rᵀ, R Σ], [Σ Rᵀ, Σ]]``. If they counted as independent, what both can explain
    would be uncertain twice.

    Args:
        fit: of a problem that has the effects among those that stay as they are.
        found: the effects.
    """
    model = calibrated_model(fit)
    names, inside = _known_together(model.arm, found.names)
    place = {name: number for number, name in enumerate(fit.problem.vector.names)}
    answers = np.concatenate([_answers(fit, found), np.zeros((1, len(found.covariance)))])
    response = answers[[place.get(name, -1) for name in names]]
    across = response @ found.covariance
    joint = np.block([[inside + across @ response.T, across], [across.T, found.covariance]])
    return ErrorModel(_knowing(model.arm, [*names, *found.names], joint), model.effects)


def _known_together(arm: Arm, others: Collection[str]) -> tuple[list[str], Array]:
    """Names of the parameters that the arm knows together, but for ``others``, and their covariance (p, p)."""
    known = arm.covariance
    known = None if known is None else known.restricted(name for name in known.parameters if name not in others)
    if known is None:
        return [], np.zeros((0, 0))
    u = np.array(known.standard_uncertainty_si)
    return list(known.parameters), known.matrix_of_correlation() * np.outer(u, u)


def _answers(fit: Fit, found: Coefficients) -> Array:
    """How the estimates of a fit answer to one unit of each coefficient of effects that it held (p, q)."""
    solution, problem = fit.solution, fit.problem
    point = solution.point
    rest = tuple(effect for effect in problem.model.effects if effect not in found.effects)
    columns = []
    for number, effect in enumerate(found.effects):
        for k, u in enumerate(effect.u):
            step = u or effect.terms[k].typical
            values = np.array(effect.values)
            values[k] += step
            others = (*found.effects[:number], effect.at(values), *found.effects[number + 1 :])
            moved = replace(problem, model=replace(problem.model, effects=(*rest, *others)))
            poses = moved.predict(point.x, point.frame).poses
            system = assemble(replace(point.prediction, poses=poses), solution.noise, point.seats, solution.weights)
            change = solution.system.jacobian.T @ (system.residual - solution.system.residual)
            columns.append(-(solution.scaled @ (solution.scaled.T @ change)) / step)
    return np.column_stack(columns)[: problem.vector.size]


def _knowing(arm: Arm, names: list[str], covariance: Array) -> Arm:
    """The arm that knows these parameters together, beside what it knows of others."""
    known = joined(arm, names, covariance, "" if arm.covariance is None else arm.covariance.records)
    file = None if arm.file is None else arm.file.model_copy(update={"covariance": known})
    return replace(arm, parameters=calibrated(arm.parameters, known), covariance=known, file=file)


def _factors(estimate: Array, covariance: Array) -> tuple[float, Array]:
    """u of the size of the whole, 1, and factors that are independent of it (r, factors).

    ``Σ = u² d dᵀ + L (1 - v vᵀ) Lᵀ`` with ``Σ = L Lᵀ``, ``v = u L⁻¹ d`` of length one.
    """
    root = np.linalg.cholesky(covariance)
    along = solve_triangular(root, estimate, lower=True)
    size_u = 1.0 / float(np.linalg.norm(along))
    rest = len(estimate) - 1
    factors = min(FACTORS, rest)
    drawn = np.random.default_rng(0).standard_normal((len(estimate), factors))
    axes, _ = np.linalg.qr(np.column_stack([along, drawn]))
    return size_u, np.asarray(root @ axes[:, 1:] * np.sqrt(rest / max(factors, 1)))


def _rounded(numbers: Array) -> Array:
    """To three significant digits: u has two."""
    unit = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(numbers), 1e-300))) - 2.0)
    return np.asarray(np.round(numbers / unit) * unit, dtype=np.float64)


def _places(described: Sequence[Described]) -> list[slice]:
    """Where the coefficients of each are."""
    ends = np.cumsum([0, *(way.functions.shape[1] * Carrier(way.carrier).axes for _, way in described)]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]


def _as_effects(way: Carried, rotation: Array | None) -> Array:
    """What makes coefficients of an effect, along the axes of the base, of those of a covariate (q, q)."""
    axes = np.eye(Carrier(way.carrier).axes)
    if rotation is not None and way.carrier == "room":
        axes = rotation.T
    return np.asarray(np.kron(np.diag(1.0 / way.size), axes), dtype=np.float64)


def _part(way: Carried) -> Part:
    return Part(Carrier(way.carrier), way.smooth or ())


def _new(name: str, parts: tuple[Part, ...], size: int, taken: Collection[str]) -> Discrepancy:
    """A discrepancy of value zero with a label that is not taken."""
    names = (name if number == 1 else f"{name} ({number})" for number in count(1))
    return next(found for each in names if (found := Discrepancy(each, parts, size)).label not in taken)
