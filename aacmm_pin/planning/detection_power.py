"""How well records distinguish causes: distances of their effects, and the probability of the right
decision.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.effects import Effect

EVIDENCE_DRAWS = 4000
"""Draws of records behind a probability."""
SAME_FRACTION = 1e-4
"""Part of the squared effect of one cause below which the other has the same effect."""
UNDETECTABLE = 1e-6
"""A cause whose squared effect, the noise being one, is smaller than this shows nothing."""


@dataclass(frozen=True, eq=False)
class Size:
    """How large a cause would be, in units of its typical magnitudes.

    Attributes:
        factor: the parameters are ``factor @ z`` (q, m), z with unit variance; one column where the
            values are stated.
        stated: whether the effect has values; a stated size may well be the typical one.
    """

    factor: Array
    stated: bool = False

    @staticmethod
    def of(effect: Effect) -> Size:
        """The effect's own values, or their magnitude in any direction; a typical one where all are
        zero.
        """
        typical = np.array([term.typical for term in effect.terms])
        scaled = np.array(effect.values) / typical
        directions = np.eye(scaled.size)
        if not scaled.any():
            return Size(directions)
        if effect.notation.phase_is_free(effect):
            magnitude = np.linalg.norm(scaled) / np.sqrt(scaled.size)
            return Size(directions * magnitude, stated=True)
        return Size(scaled[:, None], stated=True)

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Parameters of ``count`` draws of one size: in any direction, or the values with either
        sign (q, count).
        """
        z = rng.standard_normal((self.factor.shape[1], count))
        length = np.linalg.norm(z, axis=0)
        direction = z / length * np.sqrt(len(z))
        return np.asarray(self.factor @ direction)


@dataclass(frozen=True)
class Power(Shown):
    """How well two causes are distinguished.

    Attributes:
        one, other: ``T = min ‖G_k β_k - Z η - G_l β_l‖²``, the first cause true, and the second.
        alone: the same without the other cause, ``min ‖G_k β_k - Z η‖²``: the detectable effect
            of each.
        probability: of deciding for the right one of the two by their evidence.
    """

    one: float
    other: float
    alone: tuple[float, float]
    probability: float

    @property
    def least(self) -> float:
        """The smaller of the two distances, which decides."""
        return min(self.one, self.other)

    @property
    def undetectable(self) -> tuple[bool, bool]:
        """Which of the two has no detectable effect."""
        first, second = self.alone
        return first <= UNDETECTABLE, second <= UNDETECTABLE

    @property
    def open(self) -> tuple[bool, bool]:
        """Whether each has an effect that the other cannot have."""
        pairs = zip((self.one, self.other), self.alone, self.undetectable, strict=True)
        one, other = (
            not undetectable and t > SAME_FRACTION * alone for t, alone, undetectable in pairs
        )
        return one, other

    @property
    def same(self) -> bool:
        """One cause has the same effect as the other in these records, or none."""
        return not all(self.open)


def mimicking(r: Array, mine: slice, its: slice, factor: Array) -> Array:
    """Parameters of the other cause that do most nearly what ``factor`` (q, m) of this one does
    (q', m).
    """
    effect = r[:, mine] @ factor
    parameters, *_ = np.linalg.lstsq(r[:, its], effect, rcond=1e-12)
    return np.asarray(parameters)


def alone(r: Array, mine: slice, factor: Array) -> float:
    """``‖R_k F‖²``: the detectable effect of a cause."""
    effect = r[:, mine] @ factor
    return float(np.square(effect).sum())


def distance(r: Array, mine: slice, its: slice, factor: Array) -> float:
    """``min over β_l of ‖R_k F - R_l β_l‖²``, summed over the columns of F, see :class:`Size`."""
    effect = r[:, mine] @ factor
    mimicked = r[:, its] @ mimicking(r, mine, its, factor)
    return float(np.square(effect - mimicked).sum())


def power_of(
    r: Array, blocks: tuple[slice, slice], sizes: tuple[Size, Size], rng: np.random.Generator
) -> Power:
    """How well records with the triangle ``r`` (``S = RᵀR``) distinguish two blocks of its columns.

    The probability is that the evidence of the true cause is the larger one, each true in half of
    the cases. The evidence is that of a normal prior: with g = Rᵀy and prior variance w², ``½ gᵀ
    (S + I/w²)⁻¹ g - ½ log det(I + w² S)``. How large a cause may be is hardly known, so size alone
    must not decide: w lets each of the two show as much as the true one does, ``w² tr S = ‖R β‖²``.
    By :data:`EVIDENCE_DRAWS` draws of y.
    """
    probability = 0.0
    shows = []
    apart = []
    for true, (mine, size) in enumerate(zip(blocks, sizes, strict=True)):
        shows.append(alone(r, mine, size.factor))
        apart.append(distance(r, mine, blocks[1 - true], size.factor))
        effects = r[:, mine] @ size.drawn(EVIDENCE_DRAWS, rng)
        y = effects + rng.standard_normal((len(r), EVIDENCE_DRAWS))
        evidence = [_evidence(r[:, block], y, shows[true]) for block in blocks]
        better = evidence[true] - evidence[1 - true]
        tie = np.isclose(better, 0.0, atol=1e-6)
        right = np.where(tie, 0.5, better > 0)
        probability += 0.5 * float(right.mean())
    return Power(apart[0], apart[1], (shows[0], shows[1]), probability)


def _evidence(r: Array, y: Array, shows: float) -> Array:
    information = r.T @ r
    gradient = r.T @ y
    all_of_it = float(np.trace(information))
    if shows <= UNDETECTABLE or all_of_it <= UNDETECTABLE:
        return np.zeros(y.shape[1])
    variance = shows / all_of_it
    inside = np.eye(len(information)) + variance * information
    gain = variance * np.einsum("qd,qd->d", gradient, np.linalg.solve(inside, gradient))
    return np.asarray(0.5 * gain - 0.5 * np.linalg.slogdet(inside)[1])
