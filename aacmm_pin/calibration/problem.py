"""What is unknown, and what the records would be if it had certain values."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.arm import exp, skew
from aacmm_pin.calibration.jacobian import Columns
from aacmm_pin.calibration.least_squares import Prior
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import Effect, ErrorModel, State, StylusOffset
from aacmm_pin.measurements import Measurements, orientation

FRAME_WIDTHS = np.array([10.0, 10.0, 10.0, 1.0, 1.0, 1.0])
"""The reference frame has no prior; these only scale its columns, wide enough that it takes up what
it can [m, rad]."""
OF_WIDTH = 1e-3
"""Step of a difference, as a part of the parameter's width."""
UNTOLD_VARIANCE = 1e-9
"""A combination of correlated parameters with less variance than this, each of unit variance, was
not told."""
HELD_PRECISION = 1e4
"""A parameter that is held may move by this part, inverted, of its width where the records pull it
by as much as u."""
COLUMNS_AT_ONCE = 50
"""Columns of the derivative that are turned into the frame of the references at once."""
NONE = np.empty(0)
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
        """The two frames are one, and so are those of the tip and of so many targets."""
        of_targets = np.tile(np.eye(3), (targets, 1, 1))
        return Frame(np.eye(3), np.zeros(3), of_targets)

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the base in the frame of the references."""
        return points @ self.rotation.T + self.shift

    def back(self, points: Array) -> Array:
        """Points (n, 3) of the frame of the references in the base."""
        return (points - self.shift) @ self.rotation

    def moved(self, step: Array) -> Frame:
        """With the base moved by a twist, v then ω, in its own axes; behind it turns of the targets
        in theirs [m, rad].

        ``step`` is (6 + 3 k,), or (3 k,) where the base stays.
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
        poses: tips (n, 3) [m]; of records with orientations (n, 6), behind them the turn from the
            stated orientation to that of the target, in the axes of the references, zero where none
            is stated [rad].
        jacobian: by the unknown parameters, last the base's twist where the frame is unknown and
            the turns of the targets (n, 3 or 6, p) [m/unit, rad/unit].
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
        model: arm and effects that stay as they are.
        vector: the unknown parameters, without the frame; their values are where the search starts.
        widths: how far each parameter may be off before anything was measured (p,) [units].
        stated: (p,) True where that is a stated standard uncertainty; elsewhere it is a bound so
            wide that it hardly pulls.
        correlation: of the stated widths with one another (p, p); one on the diagonal.
        measurements: the records.
        setup: how they were taken.
        known_from: fingerprints of the records that the arm's file knows its parameters from.
        targets: labels of the targets whose orientation on the tip is unknown; their turns are the
            last columns.
        asked: what was asked for: sets and names of parameters, causes.
        candidates: how many of the effects, the last ones, are those of a search that may choose
            again without them.
        held: directions in which the parameters stay where the search starts, in units of the
            widths (k, p).
    """

    model: ErrorModel
    vector: ParameterVector
    widths: Array
    stated: Mask
    correlation: Array
    measurements: Measurements
    setup: Setup
    known_from: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    asked: tuple[str | Effect, ...] = ()
    candidates: int = 0
    held: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def turns(self) -> bool:
        """Whether orientations are looked at, so that residuals have six numbers."""
        return self.measurements.orientation is not None

    @property
    def from_earlier(self) -> bool:
        """Whether the search starts within what an earlier calibration states."""
        return bool(self.known_from and self.setup.prior and self.stated.any())

    @property
    def external(self) -> bool:
        """Whether the references stand in an unknown frame, whose six columns come last."""
        return self.setup.external

    @property
    def tip_on_target(self) -> bool:
        """Whether the tip is placed on a target whose place on the last body nobody stated."""
        placed = (
            isinstance(effect, StylusOffset) and effect.marker is None
            for effect in self.vector.effects
        )
        return self.setup.target == "unknown" and any(placed)

    @property
    def names(self) -> list[str]:
        """Names of all columns, the frame's included."""
        names = [*self.vector.names]
        if self.external:
            names += FRAME
        for label in self.targets:
            place = f":{label}" if label else ""
            names += [f"target.{axis}{place}" for axis in ("rx", "ry", "rz")]
        return names

    @cached_property
    def scales(self) -> Array:
        """Width of every column, the frame's included."""
        of_frame = FRAME_WIDTHS if self.external else np.zeros(0)
        of_targets = np.ones(3 * len(self.targets))
        return np.concatenate([self.widths, of_frame, of_targets])

    @property
    def start(self) -> Array:
        """Values at the start, which are the prior's mean too (p,)."""
        return self.vector.values

    @cached_property
    def prior_rows(self) -> Array:
        """Rows that say what is known of the parameters beforehand, in units of the widths (p + k,
        p); none for the frame.

        A combination without variance is one that earlier records did not tell: it is known as its
        parameters are.
        """
        variances, combinations = np.linalg.eigh(self.correlation)
        told = np.where(variances > UNTOLD_VARIANCE, variances, 1.0)
        rows = combinations.T / np.sqrt(told)[:, None]
        if not self.held.size:
            return rows
        return np.concatenate([rows, HELD_PRECISION * self.held])

    def prior(self, x: Array, more: Array = NONE) -> Prior:
        """What is known beforehand of all columns, beside the parameters ``x`` (p,).

        Behind them are ``more`` (q,), each known within so much.
        """
        scales = np.concatenate([self.scales, more])
        not_known = np.zeros((0, self.scales.size - x.size))
        rows = np.pad(block_diag(self.prior_rows, not_known, np.eye(more.size)), ((0, 0), (0, 1)))
        rows[: len(self.prior_rows), -1] = self.prior_rows @ ((x - self.start) / self.widths)
        stated = rows.copy()
        stated[: x.size, np.flatnonzero(~self.stated)] = 0.0
        return Prior(rows, scales, stated)

    @cached_property
    def _drawn(self) -> State:
        """The arm as drawn in its records."""
        arm, records = self.model.arm, self.measurements
        return State(arm, records.q, records.conditions, arm.chain.tip, with_rotation=self.turns)

    @cached_property
    def _columns(self) -> Columns:
        return Columns.of(self._drawn, self.vector.effects, self.model.effects)

    def reading_jacobian(self, x: Array, frame: Frame) -> Array:
        """Derivative of each record's target by the readings (n, 3, nq) [m/rad], along the axes of
        the references.

        By the arm as drawn, with its targets where they sit. With orientations (n, 6, nq): one
        reading moves target and orientation together.

        Args:
            x: values of the parameters (p,); those of targets count.
            frame: where the base is in the frame of the references.
        """
        effects = [*self.model.effects, *(e.at(tuple(x[entries])) for e, entries in self.vector)]
        of_targets = [effect for effect in effects if isinstance(effect, StylusOffset)]
        state = Columns.of(self._drawn, (), of_targets).at(np.zeros(0))
        shifts, turns = self.model.arm.chain.jacobian(state.rotation, state.origin, state.position)
        shifts = self.model.arm.by_readings(frame.rotation @ shifts)
        if not self.turns:
            return shifts
        turns = self.model.arm.by_readings(frame.rotation @ turns)
        turns = turns * self.measurements.oriented[:, None, None]
        return np.concatenate([shifts, turns], axis=1)

    def predict(self, x: Array, frame: Frame, looked_at: Array | None = None) -> Prediction:
        """What the records should be with the parameters ``x``.

        Args:
            x: values (p,).
            frame: where the base is in the frame of the references.
            looked_at: take the derivative of these points of the last body (n, 3), in the frame of
                the references, instead of that of the tips [m].
        """
        state = self._columns.at(x)
        seen = state if looked_at is None else replace(state, looked_at=frame.back(looked_at))
        of_frame = len(FRAME) if self.external else 0
        jacobian = self._columns.jacobian(seen, of_frame)
        if self.external:
            jacobian[:, :3, -6:-3] = np.eye(3)
            jacobian[:, :3, -3:] = -skew(seen.position)
            jacobian[:, 3:, -3:] = np.eye(3, jacobian.shape[1] - 3).T
            _turn(frame.rotation, jacobian)
        poses = self._poses(state, frame)
        if self.turns:
            one = np.arange(len(self.targets)) == self._target[:, None]
            of_targets = one[:, None, :, None] * self._orientations(state, frame)[:, :, None, :]
            of_targets = np.pad(of_targets.reshape(state.n, 3, -1), ((0, 0), (3, 0), (0, 0)))
            jacobian = np.concatenate([jacobian, of_targets], axis=2)
            jacobian[:, 3:] = orientation.by_small_turn(poses[:, 3:]) @ jacobian[:, 3:]
        return Prediction(poses, jacobian)

    def poses(self, x: Array, frame: Frame) -> Array:
        """Poses alone of what :meth:`predict` gives (n, 3 or 6) [m, rad]."""
        return self._poses(self._columns.at(x), frame)

    def _poses(self, state: State, frame: Frame) -> Array:
        tips = frame.apply(state.position)
        if not self.turns:
            return tips
        turns = orientation.turns(self._orientations(state, frame), self._stated)
        return np.hstack([tips, np.where(self.measurements.oriented[:, None], turns, 0.0)])

    def _orientations(self, state: State, frame: Frame) -> Array:
        """Of the targets, in the axes of the references (n, 3, 3)."""
        tips = frame.rotation @ state.rotation[-1]
        return np.asarray(tips @ frame.targets[self._target] if self.targets else tips)

    def with_targets(self, x: Array, frame: Frame) -> Frame:
        """The frame with each target turned as the orientations that records state of it say on
        average.
        """
        state = self._columns.at(x)
        tip = frame.rotation @ state.rotation[-1]
        turned = tip.transpose(0, 2, 1) @ self._stated
        targets = np.zeros((len(self.targets), 3, 3))
        for k in range(len(targets)):
            of_target = self.measurements.oriented & (self._target == k)
            targets[k] = orientation.mean(turned[of_target])
        return replace(frame, targets=targets)

    @cached_property
    def _stated(self) -> Array:
        """Orientations that the records state (n, 3, 3)."""
        stated = self.measurements.orientation
        return np.empty((0, 3, 3)) if stated is None else orientation.matrices(stated)

    @cached_property
    def _target(self) -> Index:
        """Number of each record's target among those of unknown orientation (n,); 0 for records
        without one.
        """
        marker = self.measurements.conditions.marker
        numbers: Index = np.zeros(self.measurements.n, dtype=np.intp)
        if marker is not None:
            for k, label in enumerate(self.targets):
                numbers[marker == label] = k
        return numbers

    def bends(self, x: Array) -> bool:
        """Whether the arm bends under weight with the parameters ``x`` (p,)."""
        return self._columns.bends(x)

    def elastic_jacobian_correction(self, x: Array, frame: Frame, prediction: Prediction) -> Array:
        """What the derivative of the poses leaves out: a turned arm bends otherwise (n, 3 or 6,
        columns) [m/unit].

        By central differences, for the parameters that displace all records alike: others turn it
        by too little to matter.
        """
        correction = np.zeros_like(prediction.jacobian)
        for k in self._columns.alike:
            step = OF_WIDTH * self.widths[k] * np.eye(x.size)[k]
            numeric = self.poses(x + step, frame) - self.poses(x - step, frame)
            correction[:, :, k] = numeric / (2 * step[k]) - prediction.jacobian[:, :, k]
        return correction

    def of(self, measurements: Measurements) -> Problem:
        """The same problem with other records."""
        return replace(self, measurements=measurements)


def _turn(rotation: Array, columns: Array) -> None:
    """Turn columns (n, 3 or 6, p) in place, some at once: a copy of all would take as much memory
    as they do.
    """
    for first in range(0, columns.shape[2], COLUMNS_AT_ONCE):
        some = columns[:, :, first : first + COLUMNS_AT_ONCE].transpose(1, 2, 0)
        for half in range(0, len(some), 3):
            some[half : half + 3] = np.tensordot(rotation, some[half : half + 3], 1)


def registered(tips: Array, references: Array, rounds: int = 60) -> Frame:
    """The frame that brings ``tips`` onto ``references`` (n, 3) with the least sum of distances:
    robust to gross errors.

    Kabsch's solution (Acta Cryst. A32, 1976), weighted anew by the inverse distances (Weiszfeld).
    With fewer than three records the rotation is the least that does.
    """
    weights = np.ones(len(tips))
    before = np.inf
    frame = Frame.identity()
    for _ in range(rounds):
        share = weights / weights.sum()
        middle = share @ tips
        target = share @ references
        left, _, right = np.linalg.svd((references - target).T @ ((tips - middle) * share[:, None]))
        flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
        rotation = left @ flip @ right
        frame = Frame(rotation, target - rotation @ middle)
        distance = np.linalg.norm(frame.apply(tips) - references, axis=1)
        if abs(before - distance.sum()) < 1e-3 * distance.sum():
            break
        before = distance.sum()
        weights = 1.0 / np.maximum(distance, 1e-3 * np.median(distance) + 1e-9)
    return frame
