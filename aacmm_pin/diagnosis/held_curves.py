"""Effects that a refit holds: error curves have the values and the uncertainty of the posterior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Fit, HeldEffects
from aacmm_pin.diagnosis.design_matrix import displacements
from aacmm_pin.effects import Effect

if TYPE_CHECKING:
    from aacmm_pin.diagnosis.choice import Choice


def held_effects(fit: Fit, effects: Sequence[Effect], covariance: Array) -> HeldEffects:
    """Effects with a joint covariance (q, q) [units] beside the fit that held them."""
    responses = [fit.response(displacements(fit, [effect])) for effect in effects]
    return HeldEffects(tuple(effects), covariance, np.concatenate(responses, axis=1))


def held_curves(choice: Choice, fit: Fit, effects: Sequence[Effect]) -> HeldEffects:
    """The curves of the median probability model beside the refit."""
    model = choice.posterior.median_model
    of_label = {choice.variant(k).label: k for k in choice.causes}
    places = [model.places[of_label[effect.label]] for effect in effects]
    entries = np.concatenate([np.arange(place.start, place.stop) for place in places])
    scales = np.concatenate([[t.typical for t in effect.terms] for effect in effects])
    covariance = model.covariance[np.ix_(entries, entries)] * np.outer(scales, scales)
    ends = np.cumsum([len(effect.terms) for effect in effects])[:-1]
    u = np.split(np.sqrt(np.diag(covariance)), ends)
    with_u = [effect.at(effect.values, own) for effect, own in zip(effects, u, strict=True)]
    return held_effects(fit, with_u, covariance)
