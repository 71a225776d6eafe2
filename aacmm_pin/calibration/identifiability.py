"""What the data determine, in words and by observability indices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.arm import rigid_motions, spread_postures
from aacmm_pin.calibration.linearisation import Point
from aacmm_pin.calibration.problem import FRAME_WIDTHS, Prediction, Problem
from aacmm_pin.effects import listed

NEGLIGIBLE_PART = 0.02
"""Smaller parts of a combination are not mentioned."""
OTHER_POSTURES = 200
LEAST_POINT_MOTION = 1e-6
"""A direction moves a point if one width does so by more (RMS over postures) [m]: redescriptions of
the arm move it by 1e-9 m, what records leave open by 1e-4 m and more.
"""


@dataclass(frozen=True, eq=False)
class Undetermined:
    """Directions that the records leave open, orthonormal (P, k) [scales], the frame's included."""

    problem: Problem
    point: Point
    directions: Array

    @cached_property
    def spread(self) -> Array:
        """Standard deviations of the parameters (p, k) [units]."""
        widths = self.problem.widths
        span, size, _ = np.linalg.svd(self.directions[: widths.size], full_matrices=False)
        return np.asarray(widths[:, None] * span[:, size > NEGLIGIBLE_PART])

    @cached_property
    def tip_spread(self) -> Array:
        """The part of :attr:`spread` that moves the tip in the base (p, k) [units], without motions
        of a session's frame or, if the references do not place the base, of the whole arm.
        """
        if not self.spread.size:
            return self.spread
        prediction = self._prediction_elsewhere(on_tip=True)
        jacobian = prediction.jacobian[:, :3, : self.problem.widths.size].copy()
        for _, entries in self.problem.vector.of_sessions():
            jacobian[:, :, entries] = 0.0
        base_may_move = self.problem.external or not self.problem.measurements.known.any()
        return _moving_span(self.spread, jacobian, prediction.tips if base_may_move else None)

    @cached_property
    def target_directions(self) -> Array:
        """Those that move the targets in the references' frame (P, k) [scales]; others describe the
        same arm.
        """
        if not self.directions.size:
            return self.directions
        prediction = self._prediction_elsewhere(on_tip=False)
        jacobian = prediction.jacobian[:, :3] * self.problem.scales
        frame_is_open = not self.problem.measurements.known.any()
        free_points = prediction.tips if frame_is_open else None
        return _moving_span(self.directions, jacobian, free_points)

    @cached_property
    def frame_is_open(self) -> bool:
        """Whether the records leave the placement of the base open."""
        if not self.problem.external:
            return False
        p = self.problem.widths.size
        motion = self.target_directions[p : p + 6] * FRAME_WIDTHS[:, None]
        return bool(np.abs(motion).max(initial=0.0) > LEAST_POINT_MOTION)

    @property
    def tied_to_frame(self) -> tuple[str, ...]:
        """Parameters of the arm that records determine only together with the base."""
        p = self.problem.widths.size
        names = self.problem.names
        rows = _sparse_combinations(self.problem, self.directions)
        with_frame = rows[:, p : p + 6].any(axis=1)
        of_arm = rows[with_frame, :p].any(axis=0)
        return tuple(names[k] for k in np.flatnonzero(of_arm))

    @property
    def words(self) -> tuple[str, ...]:
        """Combinations that neither records nor a stated uncertainty determine."""
        rows = _sparse_combinations(self.problem, self.directions)
        return tuple(_combination_in_words(row, self.problem.names) for row in rows)

    def _prediction_elsewhere(self, *, on_tip: bool) -> Prediction:
        """Of targets, or of tips, at postures over the whole range."""
        records = self.problem.measurements
        model = self.problem.model.with_effects(*self.problem.vector.effects)
        arm = model.restricted_to_known_range().arm
        q = spread_postures(arm, OTHER_POSTURES, records.q)
        drawn = records.take(np.arange(OTHER_POSTURES) % records.n)
        conditions = drawn.conditions
        if on_tip and conditions.marker is not None:
            conditions = replace(conditions, marker=np.full(OTHER_POSTURES, "", dtype=object))
        elsewhere = self.problem.of(replace(drawn, q=q, conditions=conditions))
        return elsewhere.predict(self.point.x, self.point.frame)


def _moving_span(directions: Array, jacobian: Array, free_points: Array | None) -> Array:
    """Span of directions (p, k), of unit variance, that moves points, by their derivative (n, 3,
    p), but for rigid motions of ``free_points`` (n, 3) [m].
    """
    motion = (jacobian @ directions).reshape(-1, directions.shape[1])
    if free_points is not None:
        basis = np.linalg.qr(rigid_motions(free_points).reshape(-1, 6))[0]
        motion = motion - basis @ (basis.T @ motion)
    _, size, combined = np.linalg.svd(motion / np.sqrt(len(jacobian)), full_matrices=False)
    return np.asarray(directions @ combined[size > LEAST_POINT_MOTION].T)


@dataclass(frozen=True)
class Observability(Shown):
    """Observability indices of the directions that a data set determines (Sun, Hollerbach 2008).

    From the singular values σ of the tips' sensitivity, each parameter in units of its typical
    error, n records: O1 = (Πσ)^(1/m)/√n (Borm, Menq), O2 = σ_min/σ_max, O3 = σ_min, O4 =
    σ_min²/σ_max, O5 = 1/Σ(1/σ). Larger is better.
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float
    directions: int

    @staticmethod
    def of(jacobian: Array, records: int) -> Observability:
        """From the sensitivity (rows, p) [m], without nuisances, in typical errors."""
        values = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.zeros(1)
        values = values[values > 1e-9 * values[0]]
        if not values.size:
            return Observability(0.0, 0.0, 0.0, 0.0, 0.0, 0)
        low = float(values[-1])
        high = float(values[0])
        o1 = float(np.exp(np.mean(np.log(values))) / np.sqrt(records))
        o5 = float(1.0 / np.sum(1.0 / values))
        return Observability(o1, low / high, low, low**2 / high, o5, values.size)


def _sparse_combinations(problem: Problem, directions: Array) -> Array:
    """Combinations (k, p) [units] that span ``directions`` (p, k) [scales], with many zeros."""
    # 1 mm and 1 mrad are comparable; other parameters are so by their widths.
    typical = np.full(len(problem.names), 1e-3)
    for k, parameter in enumerate(problem.vector.parameters):
        if parameter.unit not in ("m", "rad"):
            typical[k] = problem.widths[k]
    rows = (directions * problem.scales[:, None] / typical[:, None]).T.copy()
    for k in range(len(rows)):  # Gauss–Jordan, full pivoting
        remaining = np.abs(rows[k:])
        i, j = divmod(int(np.argmax(remaining)), remaining.shape[1])
        rows[[k, k + i]] = rows[[k + i, k]]
        rows[k] /= rows[k, j]
        others = np.arange(len(rows)) != k
        rows[others] -= rows[others, j][:, None] * rows[k]
    largest = np.abs(rows).max(axis=1, keepdims=True, initial=1e-300)
    rows[np.abs(rows) < NEGLIGIBLE_PART * largest] = 0.0
    return np.asarray(rows * typical)


def _combination_in_words(combination: Array, names: list[str]) -> str:
    parts = np.flatnonzero(combination)
    members = [names[i] for i in parts]
    if len(members) == 1:
        return f"{members[0]} is not determined"
    if len(members) == 2:
        ratio = combination[parts[1]] / combination[parts[0]]
        if abs(abs(ratio) - 1) < NEGLIGIBLE_PART:
            determined = "sum" if ratio < 0 else "difference"
            return f"only the {determined} of {listed(members)} is determined"
    return f"only a combination of {listed(members)} is determined"
