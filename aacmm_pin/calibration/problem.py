"""What is unknown, and the records that its values predict."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.arm import exp, skew
from aacmm_pin.calibration.least_squares import Prior
from aacmm_pin.calibration.parameter_vector import Columns, ParameterVector
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import Effect, ErrorModel, State, StylusOffset
from aacmm_pin.measurements import Measurements, orientation

FRAME_WIDTHS = np.array([10.0, 10.0, 10.0, 1.0, 1.0, 1.0])
"""The reference frame has no prior; these only scale its columns [m, rad]."""
DETERMINED_VARIANCE = 1e-9
"""Least variance of a determined combination of correlated parameters of unit variance."""
FIXED_PRECISION = 1e4
"""A fixed direction moves by one over this of its width if the records pull it by u."""
COLUMNS_AT_ONCE = 50
MOST_REWEIGHTINGS = 60
SETTLED_PART = 1e-3
"""Rounds of weights end when the sum of distances falls by less than this part."""
NO_WIDTHS = np.empty(0)
FRAME = ("frame.x", "frame.y", "frame.z", "frame.rx", "frame.ry", "frame.rz")


@dataclass(frozen=True, eq=False)
class Frame:
    """Placement of the arm's base in the frame of the references: ``x_reference = R x_base + t``.

    Attributes:
        rotation, shift: R (3, 3) and t (3,) [m].
        targets: axes of each target whose orientation was measured, in those of the tip (k, 3, 3).
    """

    rotation: Array
    shift: Array
    targets: Array = field(default_factory=lambda: np.empty((0, 3, 3)))

    @staticmethod
    def identity(targets: int = 0) -> Frame:
        """For so many targets."""
        of_targets = np.tile(np.eye(3), (targets, 1, 1))
        return Frame(np.eye(3), np.zeros(3), of_targets)

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the base, in the frame of the references."""
        return points @ self.rotation.T + self.shift

    def back(self, points: Array) -> Array:
        """Points (n, 3) of the frame of the references, in the base."""
        return (points - self.shift) @ self.rotation

    def moved(self, step: Array) -> Frame:
        """With the base moved by a twist, v then ω, in its axes; behind it turns of the targets in
        theirs [m, rad]: (6 + 3 k,), or (3 k,) if the base stays.
        """
        base, turns = np.split(step, [step.size - 3 * len(self.targets)])
        motion = exp(base.reshape(-1, 6))[0] if base.size else np.eye(4)
        targets = self.targets
        if turns.size:
            twists = np.pad(turns.reshape(-1, 3), ((0, 0), (3, 0)))
            targets = targets @ exp(twists)[:, :3, :3]
        rotation = self.rotation @ motion[:3, :3]
        shift = self.rotation @ motion[:3, 3] + self.shift
        return Frame(rotation, shift, targets)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Tips in the frame of the references, and their derivative.

    Attributes:
        poses: tips (n, 3) [m]; with orientations (n, 6), then the turn from the stated one to the
            target's, in the references' axes, zero if none is stated [rad].
        jacobian: by the unknown parameters, then the base's twist if the frame is unknown, then the
            turns of the targets (n, 3 or 6, p) [m/unit, rad/unit].
    """

    poses: Array
    jacobian: Array

    @property
    def tips(self) -> Array:
        """(n, 3) [m]."""
        return self.poses[:, :3]


@dataclass(frozen=True, eq=False)
class Problem:
    """An arm, its records, and which effects have unknown values.

    Attributes:
        model: what stays.
        vector: the unknown parameters, without the frame; the search starts at their values.
        widths: how far each parameter may be off beforehand (p,) [units].
        stated: whether that is a stated standard uncertainty, not a wide bound (p,).
        correlation: of the stated widths (p, p).
        earlier_records: fingerprints of the records behind the arm's file.
        targets: labels of targets with unknown orientation, whose turns are the last columns.
        asked: sets and names of parameters, and causes.
        candidates: number of the last effects, which a search may give up again.
        fixed: directions in which the parameters stay at their start (k, p) [widths].
    """

    model: ErrorModel
    vector: ParameterVector
    widths: Array
    stated: Mask
    correlation: Array
    measurements: Measurements
    setup: Setup
    earlier_records: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    asked: tuple[str | Effect, ...] = ()
    candidates: int = 0
    fixed: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def turns(self) -> bool:
        """Whether there are orientations: residuals of six numbers."""
        return self.measurements.orientation is not None

    @property
    def from_earlier(self) -> bool:
        """Whether the prior is from an earlier calibration."""
        return bool(self.earlier_records and self.setup.prior and self.stated.any())

    @property
    def external(self) -> bool:
        """Whether the frame of the references is unknown."""
        return self.setup.external

    @property
    def tip_on_target(self) -> bool:
        """Whether the tip is placed on a target of unknown place."""
        has_offset = any(
            isinstance(effect, StylusOffset) and effect.marker is None
            for effect in self.vector.effects
        )
        return self.setup.target == "unknown" and has_offset

    @property
    def names(self) -> list[str]:
        """Of all columns, the frame's included."""
        names = [*self.vector.names]
        if self.external:
            names += FRAME
        for label in self.targets:
            suffix = f":{label}" if label else ""
            names += [f"target.{axis}{suffix}" for axis in ("rx", "ry", "rz")]
        return names

    @cached_property
    def scales(self) -> Array:
        """Width of every column, the frame's included."""
        of_frame = FRAME_WIDTHS if self.external else np.zeros(0)
        of_targets = np.ones(3 * len(self.targets))
        return np.concatenate([self.widths, of_frame, of_targets])

    @property
    def start(self) -> Array:
        """Values at the start, the prior's mean (p,)."""
        return self.vector.values

    @cached_property
    def prior_rows(self) -> Array:
        """In units of the widths (p + k, p); none for the frame.

        Earlier records did not determine a combination without variance: it has the widths of its
        parameters.
        """
        variances, combinations = np.linalg.eigh(self.correlation)
        determined = np.where(variances > DETERMINED_VARIANCE, variances, 1.0)
        rows = combinations.T / np.sqrt(determined)[:, None]
        if not self.fixed.size:
            return rows
        return np.concatenate([rows, FIXED_PRECISION * self.fixed])

    def prior(self, x: Array, more: Array = NO_WIDTHS) -> Prior:
        """Of all columns, at the parameters ``x`` (p,); behind them ``more`` (q,) widths."""
        scales = np.concatenate([self.scales, more])
        of_frame = np.zeros((0, self.scales.size - x.size))
        rows = block_diag(self.prior_rows, of_frame, np.eye(more.size))
        rows = np.pad(rows, ((0, 0), (0, 1)))
        rows[: len(self.prior_rows), -1] = self.prior_rows @ ((x - self.start) / self.widths)
        stated = rows.copy()
        stated[: x.size, np.flatnonzero(~self.stated)] = 0.0
        return Prior(rows, scales, stated)

    @cached_property
    def _nominal_state(self) -> State:
        arm, records = self.model.arm, self.measurements
        return State(arm, records.q, records.conditions, arm.chain.tip, with_rotation=self.turns)

    @cached_property
    def _columns(self) -> Columns:
        return Columns.of(self._nominal_state, self.vector.effects, self.model.effects)

    def reading_jacobian(self, x: Array, frame: Frame) -> Array:
        """∂(target)/∂(readings) (n, 3 or 6, nq) [m/rad] in the references' axes, by the nominal arm
        with targets at the values ``x`` (p,).
        """
        effects = (*self.model.effects, *self.vector.at(x))
        of_targets = [effect for effect in effects if isinstance(effect, StylusOffset)]
        state = Columns.of(self._nominal_state, (), of_targets).at(np.zeros(0))
        shifts, turns = self.model.arm.chain.jacobian(state.rotation, state.origin, state.position)
        shifts = self.model.arm.by_readings(frame.rotation @ shifts)
        if not self.turns:
            return shifts
        turns = self.model.arm.by_readings(frame.rotation @ turns)
        turns = turns * self.measurements.oriented[:, None, None]
        return np.concatenate([shifts, turns], axis=1)

    def predict(self, x: Array, frame: Frame, looked_at: Array | None = None) -> Prediction:
        """The records with the parameters ``x`` (p,).

        ``looked_at``: points of the last body (n, 3) [m], in the references' frame, for the
        derivative instead of the tips.
        """
        state = self._columns.at(x)
        at_points = state
        if looked_at is not None:
            at_points = replace(state, looked_at=frame.back(looked_at))
        frame_columns = len(FRAME) if self.external else 0
        jacobian = self._columns.jacobian(at_points, frame_columns)
        if self.external:
            jacobian[:, :3, -6:-3] = np.eye(3)
            jacobian[:, :3, -3:] = -skew(at_points.position)
            jacobian[:, 3:, -3:] = np.eye(3, jacobian.shape[1] - 3).T
            _rotate(frame.rotation, jacobian)
        poses = self._poses(state, frame)
        if self.turns:
            is_target = np.arange(len(self.targets)) == self._target[:, None]
            orientations = self._orientations(state, frame)
            by_turns = is_target[:, None, :, None] * orientations[:, :, None, :]
            by_turns = np.pad(by_turns.reshape(state.n, 3, -1), ((0, 0), (3, 0), (0, 0)))
            jacobian = np.concatenate([jacobian, by_turns], axis=2)
            jacobian[:, 3:] = orientation.inverse_left_jacobian(poses[:, 3:]) @ jacobian[:, 3:]
        return Prediction(poses, jacobian)

    def poses(self, x: Array, frame: Frame) -> Array:
        """Poses alone of :meth:`predict` (n, 3 or 6) [m, rad]."""
        return self._poses(self._columns.at(x), frame)

    def _poses(self, state: State, frame: Frame) -> Array:
        tips = frame.apply(state.position)
        if not self.turns:
            return tips
        turns = orientation.rotation_vectors(
            self._orientations(state, frame), self._stated_orientations
        )
        return np.hstack([tips, np.where(self.measurements.oriented[:, None], turns, 0.0)])

    def _orientations(self, state: State, frame: Frame) -> Array:
        """Of the targets, in the axes of the references (n, 3, 3)."""
        tips = frame.rotation @ state.rotation[-1]
        return np.asarray(tips @ frame.targets[self._target] if self.targets else tips)

    def with_targets(self, x: Array, frame: Frame) -> Frame:
        """The frame with each target turned to the mean of its stated orientations."""
        state = self._columns.at(x)
        tips = frame.rotation @ state.rotation[-1]
        in_tip_axes = tips.transpose(0, 2, 1) @ self._stated_orientations
        targets = np.zeros((len(self.targets), 3, 3))
        for k in range(len(targets)):
            of_target = self.measurements.oriented & (self._target == k)
            targets[k] = orientation.mean(in_tip_axes[of_target])
        return replace(frame, targets=targets)

    @cached_property
    def _stated_orientations(self) -> Array:
        stated = self.measurements.orientation
        return np.empty((0, 3, 3)) if stated is None else orientation.matrices(stated)

    @cached_property
    def _target(self) -> Index:
        """Number of each record's target among :attr:`targets` (n,); 0 without one."""
        marker = self.measurements.conditions.labels("marker")
        numbers = np.zeros(marker.size, dtype=np.intp)
        for k, label in enumerate(self.targets):
            numbers[marker == label] = k
        return numbers

    def of(self, measurements: Measurements) -> Problem:
        """The same problem with other records."""
        return replace(self, measurements=measurements)


def _rotate(rotation: Array, columns: Array) -> None:
    """In place: a copy of all columns would double the memory."""
    for first in range(0, columns.shape[2], COLUMNS_AT_ONCE):
        some = columns[:, :, first : first + COLUMNS_AT_ONCE].transpose(1, 2, 0)
        for half in range(0, len(some), 3):
            some[half : half + 3] = np.tensordot(rotation, some[half : half + 3], 1)


def inverse_distances(distance: Array) -> Array:
    """Weights (n,) of the next round of a least sum of distances (Weiszfeld)."""
    return 1.0 / np.maximum(distance, 1e-3 * np.median(distance) + 1e-9)


def registered(tips: Array, references: Array) -> Frame:
    """The frame with the least sum of distances of ``tips`` and ``references`` (n, 3): Kabsch's
    solution (Acta Cryst. A32, 1976), weighted anew; for fewer than three records with the least
    rotation.
    """
    weights = np.ones(len(tips))
    total_before = np.inf
    frame = Frame.identity()
    for _ in range(MOST_REWEIGHTINGS):
        share = weights / weights.sum()
        tip_mean = share @ tips
        reference_mean = share @ references
        weighted_tips = (tips - tip_mean) * share[:, None]
        left, _, right = np.linalg.svd((references - reference_mean).T @ weighted_tips)
        no_mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        rotation = left @ no_mirror @ right
        frame = Frame(rotation, reference_mean - rotation @ tip_mean)
        distance = np.linalg.norm(frame.apply(tips) - references, axis=1)
        if abs(total_before - distance.sum()) < SETTLED_PART * distance.sum():
            break
        total_before = distance.sum()
        weights = inverse_distances(distance)
    return frame
