"""What is unknown, and what the records would be if it had certain values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.chain import exp, skew
from aacmm_pin.calibration.jacobian import Columns
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.state import State
from aacmm_pin.measurements.records import Measurements

FRAME_WIDTHS = np.array([10.0, 10.0, 10.0, 1.0, 1.0, 1.0])
"""The reference frame has no prior; these only scale its columns, wide enough that it takes up what it can [m, rad]."""
OF_WIDTH = 1e-3
"""Step of a difference, as a part of the parameter's width."""
UNTOLD_VARIANCE = 1e-9
"""A combination of correlated parameters with less variance than this, each of unit variance, was not told."""
FRAME = ("frame.x", "frame.y", "frame.z", "frame.rx", "frame.ry", "frame.rz")


@dataclass(frozen=True, eq=False)
class Frame:
    """Placement of the arm's base in the frame of the references: ``x_reference = R x_base + t``."""

    rotation: Array
    shift: Array

    @staticmethod
    def identity() -> Frame:
        """The two frames are one."""
        return Frame(np.eye(3), np.zeros(3))

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the base in the frame of the references."""
        return np.asarray(points @ self.rotation.T + self.shift)

    def back(self, points: Array) -> Array:
        """Points (n, 3) of the frame of the references in the base."""
        return np.asarray((points - self.shift) @ self.rotation)

    def moved(self, step: Array) -> Frame:
        """With the base moved by a twist (6,), v then ω, in its own axes [m, rad]."""
        motion = exp(step[None])[0]
        return Frame(self.rotation @ motion[:3, :3], self.rotation @ motion[:3, 3] + self.shift)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Tips in the frame of the references, and their derivative.

    Attributes:
        tips: (n, 3) [m].
        jacobian: by the unknown parameters, last the base's twist where the frame is unknown (n, 3, p) [m/unit].
    """

    tips: Array
    jacobian: Array


@dataclass(frozen=True, eq=False)
class Problem:
    """An arm, its records, and which effects have unknown values.

    Attributes:
        model: arm and effects that stay as they are.
        vector: the unknown parameters, without the frame; their values are where the search starts.
        widths: how far each parameter may be off before anything was measured (p,) [units].
        stated: (p,) True where that is a stated standard uncertainty; elsewhere it is a bound so wide that it hardly pulls.
        correlation: of the stated widths with one another (p, p); one on the diagonal.
        measurements: the records.
        setup: how they were taken.
        known_from: fingerprints of the records that the arm's file knows its parameters from.
    """

    model: ErrorModel
    vector: ParameterVector
    widths: Array
    stated: NDArray[np.bool_]
    correlation: Array
    measurements: Measurements
    setup: Setup
    known_from: tuple[str, ...] = ()

    @property
    def external(self) -> bool:
        """Whether the references stand in an unknown frame, whose six columns come last."""
        return self.setup.external

    @property
    def names(self) -> list[str]:
        """Names of all columns, the frame's included."""
        return self.vector.names + (list(FRAME) if self.external else [])

    @cached_property
    def scales(self) -> Array:
        """Width of every column, the frame's included."""
        return np.concatenate([self.widths, FRAME_WIDTHS if self.external else []])

    @property
    def start(self) -> Array:
        """Values at the start, which are the prior's mean too (p,)."""
        return self.vector.values

    @cached_property
    def prior(self) -> Array:
        """Rows that say what is known of the parameters beforehand, in units of the widths (p, p); none for the frame.

        A combination without variance is one that earlier records did not tell: it is known as its parameters are.
        """
        variances, combinations = np.linalg.eigh(self.correlation)
        return np.asarray(combinations.T / np.sqrt(np.where(variances > UNTOLD_VARIANCE, variances, 1.0))[:, None])

    def beside_prior(self, x: Array) -> Array:
        """Residuals of those rows at ``x`` (p,)."""
        return np.asarray(self.prior @ ((x - self.start) / self.widths))

    @cached_property
    def _fixed(self) -> Array:
        """Values of the effects that stay as they are."""
        return np.array([value for effect in self.model.effects for value in effect.values])

    @cached_property
    def _columns(self) -> Columns:
        records, arm = self.measurements, self.model.arm
        drawn = State(arm, records.q, records.conditions, arm.chain.tip)
        return Columns.of(drawn, (*self.model.effects, *self.vector.effects))

    @cached_property
    def reading_covariance(self) -> Array:
        """``J J^T`` per joint: the tip's covariance for one unit of variance in each reading (n, nq, 3, 3) [m²/rad²]."""
        jacobian = self.model.arm.jacobian(self.measurements.q)
        return np.asarray(np.einsum("nij,nkj->njik", jacobian, jacobian))

    def predict(self, x: Array, frame: Frame, looked_at: Array | None = None) -> Prediction:
        """What the records should be with the parameters ``x``.

        Args:
            x: values (p,).
            frame: where the base is in the frame of the references.
            looked_at: take the derivative of these points of the last body (n, 3), in the frame of the references, instead
                of that of the tips [m].
        """
        state = self._columns.at(np.concatenate([self._fixed, x]))
        seen = state if looked_at is None else replace(state, looked_at=frame.back(looked_at))
        jacobian = self._columns.jacobian(seen)[:, :, self._fixed.size :]
        tips = frame.apply(state.position)
        if self.external:
            turns = -skew(seen.position)
            of_all = [jacobian, np.broadcast_to(np.eye(3), turns.shape), turns]
            columns = np.concatenate([part.transpose(1, 2, 0) for part in of_all], axis=1)
            jacobian = (frame.rotation @ columns.reshape(3, -1)).reshape(columns.shape).transpose(2, 0, 1)
        return Prediction(tips, jacobian)

    def tips(self, x: Array, frame: Frame) -> Array:
        """Tips (n, 3) alone of what :meth:`predict` gives [m]."""
        return frame.apply(self._columns.at(np.concatenate([self._fixed, x])).position)

    def bends(self, x: Array) -> bool:
        """Whether the arm bends under weight with the parameters ``x`` (p,)."""
        return self._columns.bends(np.concatenate([self._fixed, x]))

    def answer_of_bending(self, x: Array, frame: Frame, prediction: Prediction) -> Array:
        """What the derivative of the tips leaves out: a turned arm bends otherwise (n, 3, columns) [m/unit].

        By central differences, for the parameters that displace all records alike: others turn it by too little to matter.
        """
        answer, fixed = np.zeros_like(prediction.jacobian), self._fixed
        for k in self._columns.alike - fixed.size:
            if k >= 0:
                step = OF_WIDTH * self.widths[k] * np.eye(x.size)[k]
                numeric = self.tips(x + step, frame) - self.tips(x - step, frame)
                answer[:, :, k] = numeric / (2 * step[k]) - prediction.jacobian[:, :, k]
        return answer

    def of(self, measurements: Measurements) -> Problem:
        """The same problem with other records."""
        return replace(self, measurements=measurements)


def registered(tips: Array, references: Array, rounds: int = 60) -> Frame:
    """The frame that brings ``tips`` onto ``references`` (n, 3) with the least sum of distances, deaf to wild records.

    Kabsch's solution (Acta Cryst. A32, 1976), weighted anew by the inverse distances (Weiszfeld). With fewer than three
    records the rotation is the least that does.
    """
    weights, before = np.ones(len(tips)), np.inf
    frame = Frame.identity()
    for _ in range(rounds):
        share = weights / weights.sum()
        middle, target = share @ tips, share @ references
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
