"""Causes with many parameters, such as error curves, which a refit holds: their values are those of
the posterior, with what they add to the uncertainty of all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Fit, lower_factor
from aacmm_pin.effects import Effect

if TYPE_CHECKING:
    from aacmm_pin.diagnosis.choice import Choice


@dataclass(frozen=True, eq=False)
class HeldCurves:
    """Curves beside a fit that held them.

    Attributes:
        effects: at their posterior means, with u.
        covariance: of all their parameters (q, q) [units].
        response: derivative of the fit's estimates by them (p, q) [units].
    """

    effects: tuple[Effect, ...]
    covariance: Array
    response: Array

    @staticmethod
    def of(choice: Choice, fit: Fit, effects: Sequence[Effect]) -> HeldCurves:
        """The curves of the median probability model beside the refit."""
        model = choice.posterior.median_model
        of_label = {choice.variant(k).label: k for k in choice.causes}
        places = [model.places[of_label[effect.label]] for effect in effects]
        entries = np.concatenate([np.arange(place.start, place.stop) for place in places])
        scales = np.concatenate([[t.typical for t in effect.terms] for effect in effects])
        covariance = model.covariance[np.ix_(entries, entries)] * np.outer(scales, scales)
        ends = np.cumsum([len(effect.terms) for effect in effects])[:-1]
        u = np.split(np.sqrt(np.diag(covariance)), ends)
        with_u = zip(effects, u, strict=True)
        curves = tuple(effect.at(effect.values, u_of_curve) for effect, u_of_curve in with_u)
        return HeldCurves(curves, covariance, _response(choice, fit, effects) / scales)

    @property
    def added_covariance(self) -> Array:
        """What their uncertainty adds to the covariance of the fit's estimates (p, p) [units]."""
        return self.response @ self.covariance @ self.response.T

    def of_effect(self, effect: Effect) -> Array:
        """Covariance of the parameters of one of them (q, q) [units]."""
        ends = np.cumsum([len(curve.terms) for curve in self.effects])
        number = [curve.label for curve in self.effects].index(effect.label)
        entries = slice(ends[number] - len(effect.terms), ends[number])
        return self.covariance[entries, entries]


def _response(choice: Choice, fit: Fit, effects: Sequence[Effect]) -> Array:
    """Derivative of the fit's estimates by the parameters of curves that it holds, each over its
    typical magnitude (p, q) [units].

    ``-(M + P)⁻¹ C`` with the products M of what the fit estimates, their prior P, and the products
    C with the curves.
    """
    model = choice.posterior.median_model
    design = choice.design
    held = {effect.label for effect in effects}
    others = [k for k in model.blocks if choice.candidates.is_cause(k)]
    of_curves = {choice.variant(k).label: k for k in others}
    others = [k for k in others if choice.variant(k).label not in held]
    columns = [np.eye(design.width)[:, : design.nuisances]]
    names = [design.fit.problem.names[k] for k in design.kept]
    units = [design.scales[: design.nuisances]]
    for k in others:
        block, effect = design.blocks[k], choice.variant(k)
        columns.append(design.weights(k))
        names += [parameter.name for parameter in effect.parameters()]
        typical = np.array([term.typical for term in effect.terms])
        units.append(typical)
        extra = block.size - typical.size  # of a known cause that it changes
        names += extra * [""]
        units.append(np.ones(extra))
    estimated = np.concatenate(columns, axis=1)
    products = model.base.gram.matrix[:-1, :-1]
    prior = np.zeros(estimated.shape[1])
    precisions = np.concatenate([[], *(model.scale[model.places[k]] ** -2.0 for k in others)])
    prior[design.nuisances :] = precisions
    blocks = [design.blocks[of_curves[effect.label]] for effect in effects]
    cross = np.concatenate([block.of_rows(estimated.T @ products) for block in blocks], axis=1)
    information = estimated.T @ products @ estimated + np.diag(prior)
    factor = lower_factor(information, np.diag(information))
    answer = -cho_solve((factor, True), cross) * np.concatenate(units)[:, None]
    response = np.zeros((fit.problem.scales.size, answer.shape[1]))
    row = {name: number for number, name in enumerate(fit.problem.names)}
    for name, answer_of_name in zip(names, answer, strict=True):
        if name in row:
            response[row[name]] += answer_of_name
    return response
