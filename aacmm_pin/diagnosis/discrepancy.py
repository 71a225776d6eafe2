"""Covariates that structure depends on, as effects that an arm file can have."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Fit, calibrated_model
from aacmm_pin.calibration.estimation import fit as fit_of
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.design_matrix import held_effects
from aacmm_pin.diagnosis.model_extension import ProblemOf
from aacmm_pin.effects import Carrier, Discrepancy, Effect, ErrorModel, Part

FACTORS = 10
"""So many independent factors stand for the covariance of a background, beside its size; with 20 u
is off by 10 %, and the file is twice as large.
"""
EVERYTHING = "all that was recorded"
"""What a background depends on."""

Described = tuple[str, Carried]
"""Name of a covariate, and the way in which it acts."""


def described_by(choice: Choice, blocks: Iterable[int]) -> list[Described]:
    """Names and ways of some blocks."""
    return [(choice.covariate(block).name, choice.way(block)) for block in blocks]


def lost(described: Sequence[Described]) -> list[str]:
    """Covariates that new records, and so arm files, cannot have: labels, torques, unknown
    columns.
    """
    names = [name for name, way in described if way.smooth is None]
    return list(dict.fromkeys(names))


def described_model(
    nominal: ErrorModel, choice: Choice, problem_of: ProblemOf, background: bool
) -> tuple[ErrorModel, Fit]:
    """The extended arm, and its refit with the discrepancy as effects: covariates are estimated,
    the ``background`` is held. Their labels are none of the nominal arm.
    """
    taken = {effect.label for effect in nominal.effects}
    covariates = described_by(choice, choice.covariates)
    model, design = choice.posterior.median_model, choice.design
    prior_u = []
    for k in choice.covariates:
        scales = design.scales[design.blocks[k].columns]
        prior_u.append(model.scale[model.entries[k]] * scales)
    named = covariate_effects(covariates, prior_u, taken)
    taken |= {effect.label for effect in named}
    held, covariances = list[Effect](), list[Array]()
    if choice.curves is not None:
        held += choice.curves.effects
        covariances.append(choice.curves.covariance)
    if background:
        held.append(_background(choice, taken))
        covariances.append(np.diag(np.square(held[-1].u)))
    causes = choice.with_values(choice.effects)
    estimated = [effect for effect in causes if not effect.free_form]
    refit = fit_of(problem_of([*estimated, *named], held), used=choice.fit.used)
    if not held:
        return calibrated_model(refit), refit
    beside = held_effects(refit, held, block_diag(*covariances))
    refit = replace(refit, added_covariance=beside.added_covariance)
    return calibrated_model(refit, beside), refit


def _background(choice: Choice, taken: Collection[str]) -> Discrepancy:
    design = choice.design
    model = choice.posterior.median_model
    directions = model.base.gram.directions
    blocks = [k for k, block in enumerate(design.blocks) if block.candidate >= design.causes]
    described = described_by(choice, blocks)
    in_si = design.scales[directions.columns][:, None] * directions.weights
    return background_effect(described, in_si, *model.background, taken)


def covariate_effects(
    described: Sequence[Described],
    prior_u: Sequence[Array | float],
    taken: Collection[str] = (),
) -> list[Discrepancy]:
    """Effects to be estimated, one for each covariate that new records have too, see :func:`lost`.

    Args:
        described: covariates, each with its variant.
        prior_u: for each, prior standard deviations of its functions' coefficients, on all axes
            together (q,) [m, rad, m/m].
        taken: labels that others have: a number is added to the name.
    """
    effects = list[Discrepancy]()
    labels = set(taken)
    for (name, way), of_covariate in zip(described, prior_u, strict=True):
        if way.smooth is None:
            continue
        u = coefficients_of_effect(way) * of_covariate
        effect = _new(name, (_part(way),), len(u), labels)
        effects.append(effect.at(effect.values, u))
        labels.add(effect.label)
    return effects


def background_effect(
    described: Sequence[Described],
    weights: Array,
    estimate: Array,
    covariance: Array,
    taken: Collection[str] = (),
) -> Discrepancy:
    """A background of many covariates as one effect: its size, 1 ± u, and :data:`FACTORS` factors,
    each 0 ± 1.

    Its covariance has no few large axes: ten have a tenth of the variance. So the factors are
    random orthogonal combinations of all axes, as large as all together. Over such draws the mean
    square of u is right at every posture; in one draw u is off by 15 % (standard deviation).

    Args:
        described: covariates, each with one of its variants; :func:`lost` ones are left out.
        weights: coefficients of all their functions, one covariate after the other, for each
            direction of the background (p, r) [m, rad, m/m].
        estimate: of the directions (r,), not all zero.
        covariance: of these, positive definite (r, r).
    """
    size_u, factors = _factors(estimate, covariance)
    directions = np.column_stack([weights @ estimate, _rounded(weights @ factors)])
    parts = []
    sizes = [way.functions.shape[1] * Carrier(way.carrier).axes for _, way in described]
    divided = np.split(directions, np.cumsum(sizes)[:-1])
    for (_, way), of_covariate in zip(described, divided, strict=True):
        if way.smooth is not None:
            rows = coefficients_of_effect(way)[:, None] * of_covariate
            parts.append(replace(_part(way), directions=tuple(map(tuple, rows.tolist()))))
    values = np.zeros(directions.shape[1])
    u = np.ones(directions.shape[1])
    values[0], u[0] = 1.0, size_u
    return _new(EVERYTHING, tuple(parts), len(values), taken).at(values, u)


def _factors(estimate: Array, covariance: Array) -> tuple[float, Array]:
    """u of the size of the whole, 1, and factors that are independent of it (r, factors).

    ``Σ = u² d dᵀ + L (1 - v vᵀ) Lᵀ`` with ``Σ = L Lᵀ``, ``v = u L⁻¹ d`` of length one.
    """
    root = np.linalg.cholesky(covariance)
    along = solve_triangular(root, estimate, lower=True)
    size_u = 1.0 / float(np.linalg.norm(along))
    directions = len(estimate) - 1
    factors = min(FACTORS, directions)
    drawn = np.random.default_rng(0).standard_normal((len(estimate), factors))
    axes, _ = np.linalg.qr(np.column_stack([along, drawn]))
    return size_u, np.asarray(root @ axes[:, 1:] * np.sqrt(directions / max(factors, 1)))


def _rounded(numbers: Array) -> Array:
    """To three significant digits: u has two."""
    size = np.maximum(np.abs(numbers), np.finfo(float).tiny)
    digits = np.floor(np.log10(size)) - 2.0
    unit = 10.0**digits
    return np.round(numbers / unit) * unit


def coefficients_of_effect(way: Carried) -> Array:
    """Factors from coefficients of a covariate, for functions of root mean square one, to an
    effect's (q,).
    """
    return np.repeat(1.0 / way.size, Carrier(way.carrier).axes)


def _part(way: Carried) -> Part:
    return Part(Carrier(way.carrier), way.smooth or ())


def _new(name: str, parts: tuple[Part, ...], size: int, taken: Collection[str]) -> Discrepancy:
    effect = Discrepancy(name, parts, size)
    number = 1
    while effect.label in taken:
        number += 1
        effect = replace(effect, covariate=f"{name} ({number})")
    return effect
