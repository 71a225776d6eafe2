"""How fast this package is beside the plain ways to the same numbers, both measured in one run.

Skipped by a plain ``pytest``; run by ``pytest tests/benchmarks --benchmark-only``.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.spatial import ConvexHull

from aacmm_pin._support.checks import Array
from aacmm_pin._support.compiled import ALWAYS, VARIABLE
from aacmm_pin.accuracy import zonotope
from aacmm_pin.accuracy.workspace import map_workspace
from aacmm_pin.arm.arm import Arm

CONFIGURATIONS, VOLUMES = 100_000, 10_000
OF_C = {"sensitivities": 2.0, "volumes": 1.5}
"""How many times as long as the plain loop in C it may take."""
CELLS, SECTORS = 48, 12
SAMPLE = 80
"""Sectors of cells that the plain way works out; its time is scaled to the whole map."""
RESTARTS = 20
DRAWS = 1000


def medians(*works: Callable[[], object], times: int = 5) -> list[float]:
    """Median CPU time of each, done in turns so that other work on the machine meets all alike [s]."""
    seconds: list[list[float]] = [[] for _ in works]
    for _ in range(times):
        for work, taken in zip(works, seconds, strict=True):
            start = time.process_time()
            work()
            taken.append(time.process_time() - start)
    return [statistics.median(taken) for taken in seconds]


# --- (1) forward kinematics with 24 sensitivities


def pinocchio_loop(arm: Arm, q: Array, frame: int) -> tuple[Array, Array]:
    """Position and kinematic regressor of every configuration, in a loop as plain as can be."""
    model, data = arm.model, arm.model.createData()
    positions, regressors = np.empty((len(q), 3)), np.empty((len(q), 6, 36))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k])
        positions[k] = pin.updateFramePlacement(model, data, frame).translation
        regressors[k] = pin.computeFrameKinematicRegressor(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    return positions, regressors


@dataclass(frozen=True)
class PlainC:
    """The loops of ``peers/kernels.c`` for an arm in standard DH."""

    loop: Callable[[str], Callable[..., None]]
    rows: Array

    def sensitivities(self, q: Array) -> tuple[Array, Array]:
        n, rows = q.shape
        position, columns = np.empty((n, 3)), np.empty((n, 3, 4 * rows))
        self.loop("sensitivities")(n, rows, self.rows, q, position, columns)
        return position, columns

    def volumes(self, generators: Array) -> Array:
        volume = np.empty(len(generators))
        self.loop("volumes")(len(generators), generators.shape[2], generators, volume)
        return volume


def test_sensitivities_and_volumes(
    benchmark: BenchmarkFixture,
    sino6: Arm,
    rng: np.random.Generator,
    say: Callable[[str], None],
    c_loop: Callable[[str], Callable[..., None]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(VARIABLE, ALWAYS)  # as in a process that has worked for a while
    q = rng.uniform(*sino6.limits.T, (CONFIGURATIONS, 6))
    frame, dh = sino6.model.getFrameId("tip"), sino6.require_dh("")
    in_c, widths = PlainC(c_loop, dh.values()), np.array([p.half_width for p in sino6.parameters])

    def volumes_in_c() -> Array:
        return in_c.volumes(in_c.sensitivities(q[:VOLUMES])[1] * widths)

    def volumes() -> Array:
        return zonotope.volume(dh.sensitivity(q[:VOLUMES]) * widths)

    position, columns = benchmark.pedantic(lambda: dh.position_and_sensitivity(q), rounds=1, warmup_rounds=1)
    for mine, theirs in zip((position, columns), in_c.sensitivities(q), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)
    np.testing.assert_allclose(volumes(), volumes_in_c(), rtol=1e-12)
    positions, regressors = pinocchio_loop(sino6, q[:200], frame)
    np.testing.assert_allclose(position[:200], positions, atol=1e-12)
    np.testing.assert_allclose(sino6.poses(q[:200]).placement_sensitivity, regressors[:, :3], atol=1e-12)
    mine, c, loop = medians(
        lambda: dh.position_and_sensitivity(q), lambda: in_c.sensitivities(q), lambda: pinocchio_loop(sino6, q, frame)
    )
    volume, volume_in_c = medians(volumes, volumes_in_c)
    ratios = {"sensitivities": mine / c, "volumes": volume / volume_in_c}
    benchmark.extra_info |= {"of C": ratios, "ratio": loop / mine}
    say(
        f"positions and 24 sensitivities of {CONFIGURATIONS} configurations: {mine * 1e3:.1f} ms, C {c * 1e3:.1f} ms, ratio "
        f"{mine / c:.2f}; Pinocchio in a loop {loop * 1e3:.1f} ms, ratio {loop / mine:.2f}\n"
        f"sensitivities and volumes of {VOLUMES}: {volume * 1e3:.1f} ms, C {volume_in_c * 1e3:.1f} ms, "
        f"ratio {volume / volume_in_c:.2f}"
    )
    assert all(ratio <= OF_C[what] for what, ratio in ratios.items())
    assert loop / mine >= 4.0


# --- (2) the map, beside inverse kinematics by iteration and volumes by Monte Carlo


@dataclass(frozen=True)
class PlainWay:
    """Closed-loop inverse kinematics of wrist and swivel by damped least squares, and hulls of moved models."""

    arm: Arm
    wrist: int
    elbow: int

    @staticmethod
    def of(arm: Arm) -> PlainWay:
        return PlainWay(arm, arm.model.getFrameId("frame5"), arm.model.getFrameId("frame3"))

    def configuration(self, point: Array, swivel: float, rng: np.random.Generator) -> Array | None:
        """A configuration inside the limits with the wrist at ``point`` and the elbow at ``swivel``, or None."""
        model, data = self.arm.model, self.arm.model.createData()
        lower, upper = model.lowerPositionLimit, model.upperPositionLimit
        axis = point / np.linalg.norm(point)
        top = np.array([0.0, 0.0, 1.0]) - axis * axis[2]
        top /= np.linalg.norm(top)
        side = np.cross(axis, top)
        for _ in range(RESTARTS):
            q = np.zeros(6)
            q[:4] = rng.uniform(lower[:4], upper[:4])
            for _ in range(60):
                pin.computeJointJacobians(model, data, q)
                wrist = pin.updateFramePlacement(model, data, self.wrist).translation
                elbow = pin.updateFramePlacement(model, data, self.elbow).translation
                u, v = top @ elbow, side @ elbow
                turn = (swivel - np.arctan2(v, u) + np.pi) % (2 * np.pi) - np.pi
                error = np.append(point - wrist, turn)
                if np.abs(error).max() < 1e-8:
                    q[:4] = lower[:4] + (q[:4] - lower[:4]) % (2 * np.pi)
                    if (q[:4] <= upper[:4] + 1e-9).all():
                        return q
                    break
                jacobian = np.empty((4, 4))
                jacobian[:3] = pin.getFrameJacobian(model, data, self.wrist, pin.LOCAL_WORLD_ALIGNED)[:3, :4]
                moved = pin.getFrameJacobian(model, data, self.elbow, pin.LOCAL_WORLD_ALIGNED)[:3, :4]
                jacobian[3] = (u * side - v * top) @ moved / (u * u + v * v)
                step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-8 * np.eye(4), error)
                q[:4] += step * min(1.0, 0.5 / np.abs(step).max())
        return None

    def volume(self, q: Array, rng: np.random.Generator) -> float:
        """Hull of the wrist under draws of all placement errors, each draw a model of its own [m³]."""
        model = self.arm.model.copy()
        data = model.createData()
        nominal = [placement.copy() for placement in self.arm.model.jointPlacements]
        widths = np.array([p.half_width for p in self.arm.parameters]).reshape(6, 4)
        wrists = np.empty((DRAWS, 3))
        for k, errors in enumerate(rng.uniform(-1.0, 1.0, (DRAWS, 6, 4)) * widths):
            for row, (a, d, alpha, theta) in enumerate(errors[:5], start=1):  # row i stands in the placement of joint i + 1
                step = pin.SE3(pin.exp3(np.array([alpha, 0.0, theta])), np.array([a, 0.0, d]))
                model.jointPlacements[row + 1] = nominal[row + 1] * step
            pin.forwardKinematics(model, data, q)
            wrists[k] = pin.updateFramePlacement(model, data, self.wrist).translation
        return float(ConvexHull(wrists).volume)


def test_map_of_48_by_48_cells_and_12_sectors(
    benchmark: BenchmarkFixture, sino6: Arm, rng: np.random.Generator, say: Callable[[str], None]
) -> None:
    started = time.perf_counter()
    result = benchmark.pedantic(
        lambda: map_workspace(sino6, (CELLS, CELLS), SECTORS, progress=False), rounds=1, iterations=1
    )
    mine = time.perf_counter() - started
    data = result.data
    plain, found, works = PlainWay.of(sino6), 0, 0
    inverse = hulls = 0.0
    for number in rng.choice(CELLS * CELLS * SECTORS, SAMPLE, replace=False):  # also out of reach: who would know before?
        i, k, sector = np.unravel_index(number, (CELLS, CELLS, SECTORS))
        point = np.array([float(data["x_mm"][i]), 0.0, float(data["z_mm"][k])]) * 1e-3
        start = time.perf_counter()
        q = plain.configuration(point, float(np.radians(data["sector_deg"][sector])), rng)
        inverse += time.perf_counter() - start
        works += int(data["sector_works"][i, k, sector])
        if q is None:
            continue
        found += 1
        assert data["sector_works"][i, k, sector]
        start = time.perf_counter()
        volume = plain.volume(q, rng)
        hulls += time.perf_counter() - start
        assert 0 < volume * 1e9 < float(data["worst_mm3"][i, k]) * 1.01  # draws fill the zonotope from inside
    scale = CELLS * CELLS * SECTORS / SAMPLE
    theirs = (inverse + hulls) * scale
    benchmark.extra_info["ratio"] = theirs / mine
    say(
        f"map of {CELLS} × {CELLS} cells × {SECTORS} sectors: {mine:.1f} s; by iteration and Monte Carlo {theirs:.0f} s "
        f"({inverse * scale:.0f} s inverse kinematics, {hulls * scale:.0f} s hulls; scaled from {SAMPLE} sectors, "
        f"{found} found of {works} that work), ratio {theirs / mine:.0f}"
    )
    assert found >= 0.7 * works
    assert theirs / mine >= 100
