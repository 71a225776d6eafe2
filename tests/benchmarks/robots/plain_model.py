"""A plain model of a robot, to compare with: geometry, frame and target, one free function of the
angle of each joint, and gravity at joints 2 and 3. NumPy and SciPy alone.

Each function has the values of hats, 200 per turn, as parameters. The values of one function have a
common standard deviation. The evidence chooses the standard deviations and the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tests.benchmarks.robots.robot import NOMINAL, RANGES, Array, Measured, chain, rms

HAT = 2 * np.pi / 200
"""Between the tops of hats [rad]."""
UNIT = 1e-4
"""Of angles of functions [rad]."""
PRIOR = np.repeat([1.0, 3e-3, 1e3, 10.0, 1e4], [12, 12, 3, 3, 3])
"""Standard deviations of a, d [mm], alpha, zero [rad], target [mm], rotation [rad] and translation
[mm] of the frame.
"""
ROUGH_NOISE = 0.1
"""Of the recalibration without functions [mm]."""
NOISES = np.geomspace(0.02, 0.5, 40)
"""Standard deviations of a coordinate to choose from [mm]."""
AMPLITUDES = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Standard deviations of the values of a function to choose from; 0 omits it."""
ROUNDS = 3
PLACES = (*(f"encoder:{j}" for j in range(1, 7)), "load:2", "load:3")


@dataclass(frozen=True, eq=False)
class Geometry:
    """Rows, zeros [rad], target [mm], and frame of the base."""

    rows: Array
    zeros: Array
    target: Array
    turn: Array
    shift: Array

    def residuals(self, data: Measured) -> tuple[Array, Array, Array]:
        """Residuals (n, 3), columns of the geometry (n, 3, 33) and of angles (n, 3, 6) [mm]."""
        arm = chain(data.q + self.zeros, self.rows, self.target)
        columns = np.einsum("ij,njk->nik", self.turn, arm.columns())
        angles = np.einsum("ij,nkj->nik", self.turn, arm.turned_by_joints())
        return data.coordinates - arm.tips @ self.turn.T - self.shift, columns, angles

    def moved(self, step: Array) -> Geometry:
        """By the amplitudes of the columns."""
        rows, turn, shift = step[:18].reshape(3, 6).T, step[27:30], step[30:]
        angle = np.linalg.norm(turn)
        k = np.cross(np.eye(3), turn / (angle or 1.0))  # its matrix
        rotation = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        return Geometry(
            self.rows + rows,
            self.zeros + step[18:24],
            self.target + step[24:27],
            self.turn @ rotation,
            self.shift + self.turn @ shift,
        )


def recalibrated(data: Measured) -> Geometry:
    """Gauss-Newton from the arm file, a target at the flange and a rigid registration."""
    tips = chain(data.q, NOMINAL, np.zeros(3)).tips
    middle, seen = tips.mean(0), data.coordinates.mean(0)
    u, _, vt = np.linalg.svd((tips - middle).T @ (data.coordinates - seen))
    turn = (u * [1.0, 1.0, np.linalg.det(u @ vt)] @ vt).T
    fit = Geometry(NOMINAL, np.zeros(6), np.zeros(3), turn, seen - turn @ middle)
    weights = np.diag(ROUGH_NOISE / PRIOR)
    total = np.zeros(len(PRIOR))  # what the priors pull back; those of the frame hardly do
    for _ in range(6):
        left, columns, _ = fit.residuals(data)
        a = np.vstack([columns.reshape(-1, len(PRIOR)), weights])
        step = np.linalg.lstsq(a, np.r_[left.ravel(), -weights @ total], rcond=None)[0]
        fit, total = fit.moved(step), total + step
    return fit


def _functions(q: Array, angles: Array) -> list[Array]:
    """Columns of each place (3 n, …) in units of 100 µrad."""
    n, found = len(q), []
    for j, (low, high) in enumerate(RANGES):
        tops = np.arange(low, high + HAT, HAT)
        hats = np.maximum(0.0, 1 - np.abs(q[:, j, None] - tops) / HAT)
        found.append((j, hats))
    links = [q[:, 1:k].sum(1) for k in (2, 3, 4)]
    for j, beyond in ((1, links), (2, links[1:])):
        found.append((j, np.column_stack([f(angle) for angle in beyond for f in (np.cos, np.sin)])))
    return [UNIT * (angles[:, :, j, None] * f[:, None]).reshape(3 * n, -1) for j, f in found]


@dataclass(frozen=True, eq=False)
class Plain:
    """The fitted model.

    Attributes:
        amplitudes: of the function of each of :data:`PLACES` [100 µrad].
        noise_mm: standard deviation of a coordinate.
        rms_mm, recalibrated_mm: RMS residual of the fitted records, with and without functions.
    """

    geometry: Geometry
    values: Array
    amplitudes: Array
    noise_mm: float
    rms_mm: float
    recalibrated_mm: float

    @staticmethod
    def fitted(data: Measured) -> Plain:
        geometry = recalibrated(data)
        left, design, ends = _linear(geometry, data)
        evidence = _Evidence(
            design.T @ design, design.T @ left, float(left @ left), len(left), ends
        )
        best = evidence.maximised()
        values = evidence.solved(best)[1]
        return Plain(
            geometry,
            values,
            best.amplitudes,
            best.noise,
            rms((left - design @ values).reshape(-1, 3)),
            rms(left.reshape(-1, 3)),
        )

    def rms_new_mm(self, data: Measured) -> float:
        """RMS residual of new records of the same robot in the same frame."""
        left, design, _ = _linear(self.geometry, data)
        return rms((left - design @ self.values).reshape(-1, 3))

    def curve(self, joint: int) -> tuple[Array, Array]:
        """Angles of the tops of hats of a joint, and the function there [rad]."""
        low, high = RANGES[joint - 1]
        sizes = [len(np.arange(a, b + HAT, HAT)) for a, b in RANGES]
        start = len(PRIOR) + sum(sizes[: joint - 1])
        tops = np.arange(low, high + HAT, HAT)
        return tops, UNIT * self.values[start : start + len(tops)]


def _linear(geometry: Geometry, data: Measured) -> tuple[Array, Array, list[int]]:
    """Residuals, columns of all places, and where each place ends."""
    left, columns, angles = geometry.residuals(data)
    blocks = [columns.reshape(-1, len(PRIOR)) * PRIOR, *_functions(data.q, angles)]
    return left.ravel(), np.hstack(blocks), np.cumsum([b.shape[1] for b in blocks]).tolist()


@dataclass(frozen=True, eq=False)
class _Choice:
    amplitudes: Array
    noise: float


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Of ``left ~ design @ values`` from the normal equations."""

    normal: Array
    right: Array
    square: float
    count: int
    ends: list[int]

    def solved(self, choice: _Choice) -> tuple[float, Array]:
        """Logarithm of the evidence, and the values."""
        scale = np.repeat([1.0, *choice.amplitudes], np.diff([0, *self.ends]))
        keep = scale > 0
        weight = scale[keep] / choice.noise
        precision = self.normal[np.ix_(keep, keep)] * np.outer(weight, weight)
        precision[np.diag_indices_from(precision)] += 1.0
        factor = cho_factor(precision, lower=True)
        right = self.right[keep] * weight / choice.noise
        solution = cho_solve(factor, right)
        values = np.zeros(len(scale))
        values[keep] = solution * scale[keep]
        misfit = self.square / choice.noise**2 - right @ solution
        determinant = np.log(np.diag(factor[0])).sum()
        return -0.5 * misfit - determinant - self.count * np.log(choice.noise), values

    def maximised(self) -> _Choice:
        """Noise and amplitudes in turns, each on its grid."""
        best = _Choice(np.ones(len(self.ends) - 1), 0.05)
        for _ in range(ROUNDS):
            tried = [replace(best, noise=float(noise)) for noise in NOISES]
            best = max(tried, key=lambda choice: self.solved(choice)[0])
            for place in range(len(best.amplitudes)):
                tried = []
                for amplitude in AMPLITUDES:
                    amplitudes = best.amplitudes.copy()
                    amplitudes[place] = amplitude
                    tried.append(replace(best, amplitudes=amplitudes))
                best = max(tried, key=lambda choice: self.solved(choice)[0])
        return best
