"""Base and targets of unknown place are found from any placement, whatever few postures
there are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import calibrate, solver
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import Conditions, ErrorModel
from aacmm_pin.measurements import Measurements
from tests.again import again
from tests.arm_files import by_table

NOISE = 1e-4
"""Of each coordinate [m], which leaves RMS distances of √3 times as much."""
TURN_NOISE = 2e-4
UNKNOWN = {"reference_frame": "external", "target": "unknown", "hold_out": False}


def table(*rows: tuple[float, float, float, float]) -> Arm:
    return by_table("positioner", rows, 360.0)


def seen(
    arm: Arm,
    q: Array,
    rng: np.random.Generator,
    *,
    target: float,
    posed: bool = True,
    markers: tuple[str, ...] = (),
) -> Measurements:
    """Records of targets so far from the tip [m], and of their axes, in some frame."""
    n, label = len(q), np.arange(len(q)) % max(1, len(markers))
    origin, axes = arm.positions(q), arm.chain.walk(q)[0][-1]
    offset = rng.normal(size=(label.max() + 1, 3))
    offset *= target / np.linalg.norm(offset, axis=1)[:, None]
    base, own = (
        Rotation.random(rng=rng).as_matrix(),
        Rotation.random(label.max() + 1, rng=rng).as_matrix(),
    )
    at = (origin + np.einsum("nij,nj->ni", axes, offset[label])) @ base.T + rng.uniform(
        -3.0, 3.0, 3
    )
    turned = Rotation.from_matrix(base @ axes @ own[label]) * Rotation.from_rotvec(
        rng.normal(0.0, TURN_NOISE, (n, 3))
    )
    return Measurements.of(
        q,
        at + rng.normal(0.0, NOISE, at.shape),
        orientation=turned.as_quat()[:, [3, 0, 1, 2]] if posed else None,
        conditions=Conditions(
            n, marker=np.array(markers, dtype=object)[label] if markers else None
        ),
    )


def grid(first: int, second: int) -> Array:
    """Postures of two joints, the second once round."""
    one, other = np.linspace(-30.0, 30.0, first), np.arange(second) * 360.0 / second
    return DEG * np.array([(a, b) for a in one for b in other])


def random_arm(joints: int, rng: np.random.Generator) -> Arm:
    lengths, angles = (
        rng.uniform(-500.0, 500.0, (joints, 2)),
        rng.uniform(-180.0, 180.0, (joints, 2)),
    )
    return table(*np.hstack([lengths, angles]).tolist())


@pytest.mark.parametrize("posed", [True, False])
@pytest.mark.parametrize("shape", [(3, 6), again((5, 8))])
def test_a_symmetric_grid_of_a_positioner(shape, posed):
    """By its nominal tip alone, which the second joint does not move, the base would stand
    anywhere.
    """
    arm = table((0.0, 0.0, -90.0, 0.0), (0.0, -475.0, 0.0, -90.0))
    for seed in range(2):
        data = seen(arm, grid(*shape), np.random.default_rng(seed), target=0.84, posed=posed)
        assert 1.0e-4 < calibrate(arm, data, **UNKNOWN).rms < 2.0e-4


@pytest.mark.parametrize("joints", [2, 6, again(3)])
def test_random_arms_and_markers(joints, sino6, rng):
    for _ in range(2):
        arm = sino6 if joints == 6 else random_arm(joints, rng)
        low, high = np.clip(arm.limits, -np.pi, np.pi).T
        q = rng.uniform(low, high, (50, joints))
        for markers in ((), ("left", "right")):
            for posed in (True, False):
                data = seen(arm, q, rng, target=0.3, posed=posed, markers=markers)
                # Gross errors.
                data.reference[::10] += rng.normal(0.0, 0.3, data.reference[::10].shape)
                found = calibrate(arm, data, **UNKNOWN)
                assert 1.0e-4 < found.rms < 2.0e-4
                assert found.fit.excluded.sum() == 5


def test_the_start_is_the_end_if_the_arm_is_right(sino6, rng):
    """But for the noise; and orientations that contradict each other do not lead it astray."""
    low, high = np.clip(sino6.limits, -np.pi, np.pi).T
    data = seen(sino6, rng.uniform(low, high, (40, 6)), rng, target=0.2)
    for orientation in (data.orientation, data.orientation[:, [1, 2, 3, 0]]):
        setup = Setup.of(sino6, "external", "unknown")
        records = replace(data, orientation=orientation)
        problem = problem_of(ErrorModel(sino6), records, "geometry", setup)
        start = solver.initial_point(problem, observations_of(records, setup))
        off = np.linalg.norm(start.prediction.tips - records.reference, axis=1)
        assert np.median(off) < 3 * NOISE
        offset = start.x[[name.startswith("stylus_offset") for name in problem.vector.names]]
        assert np.linalg.norm(offset) == pytest.approx(0.2, abs=0.3 * MM)
