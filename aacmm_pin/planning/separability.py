"""Distances of effects, and the probability of the right decision."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.display import Shown
from aacmm_pin.effects import Effect

SAME_FRACTION = 1e-4
"""Below this part of the squared effect of a cause, another has the same effect."""
UNDETECTABLE = 1e-6
"""Squared effect over the noise, below which a cause is not detectable."""
FREQUENCIES = 0.15 * (np.arange(200) + 0.5)
"""Of a characteristic function, over the standard deviation: right to 1e-4."""
RANDOM_DIRECTIONS = 150
"""For a cause with three or more parameters: right to 0.02."""
CERTAIN = 12.0
"""A mean of so many standard deviations is positive for certain."""

Pair = tuple[int, int]


def size_of(effect: Effect) -> Array:
    """Size F (q, m) in typical magnitudes: parameters are F times a vector of unit variance.

    F has the values, their magnitude in any direction, or the typical magnitude if all are zero.
    """
    scaled = np.array(effect.values) / [term.typical for term in effect.terms]
    if not scaled.any():
        return np.eye(scaled.size)
    if effect.phase_is_free:
        return np.eye(scaled.size) * float(np.linalg.norm(scaled) / np.sqrt(scaled.size))
    return scaled[:, None]


class Separation(NamedTuple):
    """Distances of the effects of causes.

    Attributes:
        distances: ``min over β_l of ‖R_k F_k - R_l β_l‖²`` of cause k from l (causes, causes); F
            from :func:`size_of`.
        alone: ``‖R_k F_k‖²``, the detectable effect of each cause (causes,).
    """

    distances: Array
    alone: Array

    @staticmethod
    def of(r: Array, blocks: Sequence[slice], sizes: Sequence[Array]) -> Separation:
        """From the triangle ``r`` (``S = RᵀR``), with a block of columns of each cause."""
        effects = np.hstack([r[:, block] @ size for block, size in zip(blocks, sizes, strict=True)])
        first_columns = np.cumsum([0, *(size.shape[1] for size in sizes[:-1])])

        def squared_lengths(columns: Array) -> Array:
            return np.add.reduceat(np.square(columns).sum(axis=0), first_columns)

        distances = []
        for block in blocks:
            basis = scipy.linalg.orth(r[:, block], rcond=1e-12)
            not_imitated = effects - basis @ (basis.T @ effects)
            distances.append(squared_lengths(not_imitated))
        return Separation(np.stack(distances, axis=1), squared_lengths(effects))

    @property
    def detectable_pairs(self) -> list[Pair]:
        """Pairs of detectable causes."""
        detectable = np.flatnonzero(self.alone > UNDETECTABLE)
        return [*combinations(detectable.tolist(), 2)]

    @property
    def own_effects(self) -> Mask:
        """Whether cause k is detectable, and has effects that l cannot have (causes, causes)."""
        alone = self.alone[:, None]
        return (alone > UNDETECTABLE) & (self.distances > SAME_FRACTION * alone)

    def same(self, pair: Pair) -> bool:
        """Whether one can have every effect of the other, or is not detectable."""
        return not (self.own_effects[pair] and self.own_effects[pair[::-1]])

    def least(self, pair: Pair) -> float:
        """The smaller distance of a pair."""
        return float(min(self.distances[pair], self.distances[pair[::-1]]))

    def worst(self, pairs: Iterable[Pair]) -> Pair:
        """The pair with the smallest distance."""
        return min(pairs, key=self.least)


@dataclass(frozen=True)
class Power(Shown):
    """How well two causes are distinguished.

    Attributes:
        separation: of the two, if the first or the second is true.
        probability: of the right decision by evidence.
    """

    separation: Separation
    probability: float

    @property
    def least(self) -> float:
        """The smaller T, which decides."""
        return self.separation.least((0, 1))

    @property
    def inseparable(self) -> bool:
        """Whether the effects of one are none, or such as the other can have."""
        return self.separation.same((0, 1))


def power_of(r: Array, blocks: Sequence[slice], sizes: Sequence[Array]) -> Power:
    """How well records of triangle ``r`` distinguish two blocks of columns.

    The probability is that the true cause has the larger evidence, both as likely.
    """
    separation = Separation.of(r, blocks, sizes)
    first, second = separation.alone.tolist()
    one, other = (r[:, block] for block in blocks)
    if_first = _right_decision(one, other, sizes[0], first)
    if_second = _right_decision(other, one, sizes[1], second)
    return Power(separation, (if_first + if_second) / 2)


def _right_decision(true: Array, other: Array, size: Array, detectable: float) -> float:
    """Probability that the ``true`` cause (p, q), of this ``size``, has the larger evidence,
    averaged over directions of β.

    Both priors make the expected squared effect the ``detectable`` one of the true cause, so that
    size does not decide. The difference of evidences of ``y = R β + noise`` is a quadratic form.
    """
    gain, complexity = _evidence(true, detectable)
    other_gain, other_complexity = _evidence(other, detectable)
    weights, axes = np.linalg.eigh(gain - other_gain)
    means = axes.T @ true @ size @ _directions(size.shape[1])
    threshold = complexity - other_complexity
    right = [_exceeds(threshold, weights, np.square(mean)) for mean in means.T]
    return float(np.mean(right))


def _exceeds(threshold: float, weights: Array, noncentrality: Array) -> float:
    """Probability that ``Σ λ (z + δ)²`` exceeds a threshold: z standard normal, λ weights, δ²
    noncentrality (p,).

    By its characteristic function (Gil-Pelaez 1951, Biometrika 38; Imhof 1961, Biometrika 48).
    """
    mean = float(weights @ (1 + noncentrality)) - threshold
    spread = float(np.sqrt(2 * np.square(weights) @ (1 + 2 * noncentrality)))
    if spread < UNDETECTABLE:
        return 0.5
    if abs(mean) > CERTAIN * spread:
        return float(mean > 0)
    # Of the sum less the threshold, Π (1 - 2iλt)^-½ exp(iλδ²t / (1 - 2iλt)) exp(-it threshold)
    # is exp(i phase - decay).
    t = FREQUENCIES / spread
    two_lambda_t = 2 * np.outer(t, weights)
    square = 1 + np.square(two_lambda_t)
    damped = weights * noncentrality / square
    phase = 0.5 * np.arctan(two_lambda_t).sum(axis=1) + t * (damped.sum(axis=1) - threshold)
    decay = 0.25 * np.log(square).sum(axis=1) + t * (two_lambda_t * damped).sum(axis=1)
    integral = 2 * FREQUENCIES[0] * np.sum(np.sin(phase) * np.exp(-decay) / FREQUENCIES)
    return float(np.clip(0.5 + integral / np.pi, 0.0, 1.0))


def _evidence(r: Array, squared_effect: float) -> tuple[Array, float]:
    """Gain G (p, p) and complexity c of twice the log evidence ``yᵀ G y - c`` of y (p,), relative
    to no cause.

    The variance w² of the normal prior gives the expected ``squared_effect = w² tr S``, ``S =
    RᵀR``: ``G = R (S + I/w²)⁻¹ Rᵀ``, ``c = log det(I + w² S)``.
    """
    information = r.T @ r
    total = float(np.trace(information))
    if squared_effect <= UNDETECTABLE or total <= UNDETECTABLE:
        return np.zeros((len(r), len(r))), 0.0
    variance = squared_effect / total
    relative_information = np.eye(len(information)) + variance * information
    gain = variance * r @ np.linalg.solve(relative_information, r.T)
    _, log_determinant = np.linalg.slogdet(relative_information)
    return gain, float(log_determinant)


def _directions(count: int) -> Array:
    """Of length ``√count`` (count, m): even over half a circle, or random in more dimensions."""
    if count == 1:
        return np.ones((1, 1))
    if count == 2:
        angles = np.pi * np.arange(16) / 16
        return np.stack([np.cos(angles), np.sin(angles)]) * math.sqrt(2)
    z = np.random.default_rng(1).standard_normal((count, RANDOM_DIRECTIONS))
    return np.asarray(np.sqrt(count) * z / np.linalg.norm(z, axis=0))
