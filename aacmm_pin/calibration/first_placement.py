"""First placement of targets and base: the nearest for the arm as described.

Base Y, b and offset t of a target are in ``r = Y (p + A t) + b``, for references r, tips p and axes
A of the last body. With W = Yᵀ this is ``W r = p + A t + c``; without t and c, a quadratic form of
W is left. Its minima over the rotations are searched from those of a cube. Orientations S state
``Aᵀ W S = X``, the constant axes of the target (robot-world and hand-eye calibration, Shah 2013),
linear in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm import exp, skew
from aacmm_pin.calibration.problem import (
    MOST_REWEIGHTINGS,
    SETTLED_PART,
    Frame,
    Problem,
    inverse_distances,
)
from aacmm_pin.measurements import orientation

BASINS = 3
"""So many of the lowest minima are compared by sums of distances, which gross errors hardly
change.
"""
ROTATION_TOLERANCE = 0.05
MOST_NEWTON_STEPS = 40
"""Five to twenty do."""
STANDS = 1e-6
"""A smaller step over the rotations is none [rad]."""
NEARER = 2.0
"""Orientations do not count if positions alone bring tips so many times nearer."""
PLACEMENT_RANK_RATIO = 1e-10
"""Offsets with a smaller part of the information stay zero."""


TINY = 1e-300

_Form = tuple[Array, Array]
"""H (9, 9) and h (9,) of ``wᵀ H w - 2 hᵀ w``, a sum of squares but for a constant, of the numbers w
of W.
"""


class _Place(NamedTuple):
    """Rotation W, weights of the positions (n,), and sum of all distances [m]."""

    rotation: Array
    weights: Array
    total: float


def placed(problem: Problem, tips: Array, by_offset: Array) -> tuple[Frame, Array]:
    """Frame, and offsets of the targets (m,) [m], with the least sum of distances.

    Args:
        problem: with three or more records with coordinates.
        tips: by the arm as described, in its base (n, 3) [m].
        by_offset: derivative of the tips by the offsets (n, 3, m).
    """
    records = problem.measurements
    stating = records.known
    positions = _Positions.of(
        tips[stating], records.reference[stating], by_offset[stating], problem.external
    )
    if not problem.external:
        place = _weighted([positions], np.eye(3), turning=False)
    else:
        place = _nearest([positions])
        if problem.turns and problem.targets:
            together = _nearest([positions, _Turns.of(problem, positions.spread)])
            near = np.median(positions.distances(together.rotation, together.weights))
            nearest = np.median(positions.distances(place.rotation, place.weights))
            place = together if near < NEARER * nearest else place
    solution, _ = positions.solved(place.rotation, place.weights)
    offsets, shift = np.split(solution, [by_offset.shape[2]])
    rotation = place.rotation.T
    return Frame(rotation, positions.middle + (rotation @ shift if shift.size else 0.0)), offsets


@dataclass(frozen=True, eq=False)
class _Positions:
    """Tips (n, 3), references about a ``middle`` (n, 3), and derivatives by t and, in an unknown
    frame, c (n, 3, m + 3).
    """

    tips: Array
    references: Array
    linear: Array
    middle: Array

    @staticmethod
    def of(tips: Array, references: Array, by_offset: Array, external: bool) -> _Positions:
        if not external:
            return _Positions(tips, references, by_offset, np.zeros(3))
        by_shift = np.broadcast_to(np.eye(3), (len(tips), 3, 3))
        middle = references.mean(axis=0)
        return _Positions(
            tips, references - middle, np.concatenate([by_offset, by_shift], axis=2), middle
        )

    @property
    def n(self) -> int:
        return len(self.tips)

    @property
    def spread(self) -> float:
        squares = np.square(self.references).sum(axis=1)
        return float(np.sqrt(squares.mean()))

    def form(self, weights: Array) -> _Form:
        m = self.linear.shape[2]
        by_rotation = np.einsum("ij,nk->nijk", np.eye(3), self.references).reshape(self.n, 3, 9)
        columns = np.concatenate([self.linear, by_rotation, self.tips[:, :, None]], axis=2)
        root = np.sqrt(weights)[:, None, None]
        rows = (root * columns).reshape(3 * self.n, -1)
        gram = rows.T @ rows
        inverse = np.linalg.pinv(gram[:m, :m], PLACEMENT_RANK_RATIO, hermitian=True)
        eliminated = gram[m:, :m] @ inverse @ gram[:m, m:]
        left = gram[m:, m:] - eliminated
        return left[:9, :9], left[:9, 9]

    def solved(self, rotation: Array, weights: Array) -> tuple[Array, Array]:
        """What is linear (m + 3,) for this W, and what it leaves (n, 3) [m]."""
        deviations = self.references @ rotation.T - self.tips
        root = np.sqrt(weights)[:, None]
        rows = (root[:, :, None] * self.linear).reshape(3 * self.n, -1)
        solution, *_ = np.linalg.lstsq(rows, (root * deviations).ravel(), PLACEMENT_RANK_RATIO)
        linear = np.asarray(solution, dtype=np.float64)
        return linear, deviations - self.linear @ linear

    def distances(self, rotation: Array, weights: Array) -> Array:
        _, deviations = self.solved(rotation, weights)
        return np.asarray(np.linalg.norm(deviations, axis=1))


@dataclass(frozen=True, eq=False)
class _Turns:
    """Derivative of ``Aᵀ W S`` by W, over a lever (n, 9, 9) [m], and each record's target (n,)."""

    by_rotation: Array
    target: Index

    @staticmethod
    def of(problem: Problem, lever: float) -> _Turns:
        records = problem.measurements
        oriented = records.oriented
        assert records.orientation is not None  # the caller looks at orientations
        axes = problem.model.arm.chain.walk(records.q[oriented])[0][-1]
        stated = orientation.matrices(records.orientation[oriented])
        by_rotation = lever * np.einsum("nji,nkl->niljk", axes, stated)
        labels = records.conditions.labels("marker")[oriented]
        target = np.array([problem.targets.index(label) for label in labels], dtype=np.intp)
        return _Turns(by_rotation.reshape(-1, 9, 9), target)

    @property
    def n(self) -> int:
        return len(self.target)

    def form(self, weights: Array) -> _Form:
        root = np.sqrt(weights)[:, None, None]
        rows = (root * self._about_means(weights)).reshape(-1, 9)
        return rows.T @ rows, np.zeros(9)

    def distances(self, rotation: Array, weights: Array) -> Array:
        deviations = self._about_means(weights) @ rotation.ravel()
        return np.asarray(np.linalg.norm(deviations, axis=1))

    def _about_means(self, weights: Array) -> Array:
        weight = np.bincount(self.target, weights)[:, None, None]
        total = np.zeros((len(weight), 9, 9))
        np.add.at(total, self.target, weights[:, None, None] * self.by_rotation)
        mean = total / weight
        return self.by_rotation - mean[self.target]


def _nearest(parts: Sequence[_Positions | _Turns]) -> _Place:
    form = _sum([part.form(np.ones(part.n)) for part in parts])
    cube = scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    rotations, values = _descended(form, cube)
    distinct: list[Array] = []
    for rotation in rotations[np.argsort(values)]:
        if all(np.linalg.norm(rotation - other) > ROTATION_TOLERANCE for other in distinct):
            distinct.append(rotation)
    places = [_weighted(parts, rotation) for rotation in distinct[:BASINS]]
    return min(places, key=lambda place: place.total)


def _weighted(
    parts: Sequence[_Positions | _Turns], rotation: Array, *, turning: bool = True
) -> _Place:
    """Weighted anew by the inverse distances (Weiszfeld)."""
    weights = [np.ones(part.n) for part in parts]
    before = np.inf
    for _ in range(MOST_REWEIGHTINGS):
        distances = [
            part.distances(rotation, weight) for part, weight in zip(parts, weights, strict=True)
        ]
        total = float(sum(distance.sum() for distance in distances))
        if abs(before - total) < SETTLED_PART * total:
            break
        before = total
        weights = [*map(inverse_distances, distances)]
        if turning:
            form = _sum([part.form(weight) for part, weight in zip(parts, weights, strict=True)])
            rotation = _descended(form, rotation[None])[0][0]
    return _Place(rotation, weights[0], total)


def _descended(form: _Form, rotations: Array) -> tuple[Array, Array]:
    """The minima of ``wᵀ H w - 2 hᵀ w`` near each rotation (k, 3, 3), and its values there (k,).

    Newton's method over turns ω, which add ``[ω] W + [ω]² W / 2``: damped, with absolute
    curvatures, so that no step goes up (Dauphin et al. 2014).
    """
    quadratic, linear = form

    def value(w: Array) -> Array:
        form = (w @ quadratic - 2.0 * linear) * w
        return np.asarray(form.sum(axis=1))

    values = value(rotations.reshape(-1, 9))
    damping = np.full(len(rotations), 1e-6)
    for _ in range(MOST_NEWTON_STEPS):
        by_turn = (skew(np.eye(3)) @ rotations[:, None]).reshape(-1, 3, 9)
        pull = rotations.reshape(-1, 9) @ quadratic - linear
        slope = (by_turn @ pull[:, :, None])[:, :, 0]
        bent = rotations @ pull.reshape(-1, 3, 3).transpose(0, 2, 1)
        trace = np.trace(bent, axis1=1, axis2=2)[:, None, None]
        curvature = (
            by_turn @ quadratic @ by_turn.transpose(0, 2, 1)
            + 0.5 * (bent + bent.transpose(0, 2, 1))
            - trace * np.eye(3)
        )
        curvatures, along = np.linalg.eigh(curvature)
        sizes = np.abs(curvatures) + damping[:, None] * np.trace(quadratic) + TINY
        step = -(along @ ((slope[:, None] @ along)[:, 0] / sizes)[:, :, None])[:, :, 0]
        step /= np.maximum(1.0, np.linalg.norm(step, axis=1))[:, None]
        trial = exp(np.hstack([np.zeros_like(step), step]))[:, :3, :3] @ rotations
        tried = value(trial.reshape(-1, 9))
        lower = tried < values
        rotations = np.where(lower[:, None, None], trial, rotations)
        values = np.where(lower, tried, values)
        damping = np.where(lower, damping / 10.0, damping * 10.0)
        if np.abs(step).max() < STANDS:
            break
    return rotations, values


def _sum(forms: list[_Form]) -> _Form:
    wholes, parts = zip(*forms, strict=True)
    return np.sum(wholes, axis=0), np.sum(parts, axis=0)
