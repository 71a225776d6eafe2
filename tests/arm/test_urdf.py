"""The generated URDF against two parsers that share no code with it, and against the files that are
kept of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, ArmFile, bundled_arms, load_arm_file
from aacmm_pin.arm.dh_to_urdf import SHORTEST_DRAWN, urdf_text
from tests.oracle import close, placements

pytestmark = pytest.mark.fast

KEPT = Path(__file__).parents[2] / "urdf"


def limits(arm: ArmFile) -> Array:
    return np.array([row.limits for row in arm.joints if not row.fixed])


def configurations(arm: ArmFile, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(*limits(arm).T, (n, arm.dh.nq))


@pytest.fixture
def parsed(arm_file, tmp_path) -> yourdfpy.URDF:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_text(arm_file), encoding="utf-8")
    return yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)


def test_kept_files_are_the_generated_texts():
    assert sorted(path.stem for path in KEPT.glob("*.urdf")) == bundled_arms()
    for name in bundled_arms():
        assert (KEPT / f"{name}.urdf").read_bytes() == urdf_text(load_arm_file(name)).encode()


def test_pinocchio_and_yourdfpy_agree_with_the_table(arm_file, parsed, rng):
    arm, q = Arm.from_file(arm_file), configurations(arm_file, rng, 100)
    for at in ("tip", "frame5"):
        close(arm.poses(q, at).position, arm.positions(q, at), 1e-12)
    assert len(parsed.actuated_joint_names) == arm_file.dh.nq
    by_pinocchio = {at: arm.poses(q, at).placement for at in ("tip", "frame5")}
    for k, each in enumerate(q):
        parsed.update_cfg(each)
        for at, expected in by_pinocchio.items():
            close(parsed.get_transform(at), expected[k], 1e-12)


def test_joints_limits_masses_and_centres_survive(arm_file, parsed):
    model = pin.buildModelFromXML(urdf_text(arm_file))
    assert model.nq == model.nv == arm_file.dh.nq
    stated = limits(arm_file)
    np.testing.assert_array_equal(
        np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]), stated
    )
    np.testing.assert_array_equal(
        [[j.limit.lower, j.limit.upper] for j in parsed.actuated_joints], stated
    )
    masses = {
        f"frame{n}": (row.mass_kg, [c * MM for c in row.com_mm or (0, 0, 0)])
        for n, row in enumerate(arm_file.joints, start=1)
        if row.mass_kg is not None
    }
    bodies = {
        name: link.inertial for name, link in parsed.link_map.items() if link.inertial is not None
    }
    assert {
        name: (body.mass, body.origin[:3, 3].tolist()) for name, body in bodies.items()
    } == masses


def drawn_tubes(robot: yourdfpy.URDF) -> list[tuple[Array, Array]]:
    """Both ends of every cylinder in the base."""
    tubes = []
    for name, link in robot.link_map.items():
        for visual in link.visuals:
            if visual.geometry.cylinder is not None:
                place, half = (
                    robot.get_transform(name) @ visual.origin,
                    visual.geometry.cylinder.length / 2,
                )
                tubes.append(
                    (place[:3, 3] - half * place[:3, 2], place[:3, 3] + half * place[:3, 2])
                )
    return tubes


def test_every_length_is_drawn_from_end_to_end(arm_file, parsed):
    tubes, missing = drawn_tubes(parsed), []
    frames = placements(Arm.from_file(arm_file), np.zeros((1, arm_file.dh.nq)))[0]
    for n, row in enumerate(arm_file.joints, start=1):
        x, z, start, end = *frames[n - 1][:3, [0, 2, 3]].T, frames[n][:3, 3]
        knee = start + (z * row.d_mm if arm_file.convention == "standard-dh" else x * row.a_mm) * MM
        for piece in ((start, knee), (knee, end)):
            found = any(
                np.allclose(piece, tube, atol=1e-9) or np.allclose(piece[::-1], tube, atol=1e-9)
                for tube in tubes
            )
            if np.linalg.norm(piece[1] - piece[0]) > SHORTEST_DRAWN and not found:
                missing.append(f"row {n}: {piece[0]} to {piece[1]}")
    assert missing == []
