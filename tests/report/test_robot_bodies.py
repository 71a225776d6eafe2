"""Meshes of a URDF in the scenes: where yourdfpy has them, few enough for a page, and a note where
they are missing.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from scipy.spatial import cKDTree

from aacmm_pin import Arm, reaching_postures
from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Scene
from tests.again import again
from tests.oracle import postures
from tests.report.test_scenes import commands, decoded, mesh

PAGE = 5e6
"""Bytes that a page may have."""


def drawn(scene: Scene, frame: int) -> dict[str, Array]:
    """Vertices of all meshes of a frame in the base, by their colour (v, 3) [m]."""
    vertices: dict[str, list[Array]] = {}
    for path in commands(scene, "set_object"):
        body, _, name = path.removeprefix("arm/body ").partition("/")
        if name == "tip" or not path.startswith("arm/body"):
            continue
        placement = np.eye(4) if body == "0" else decoded(scene, f"arm/body {body}")[frame]
        own, _, _ = mesh(scene, path)
        vertices.setdefault(name, []).append(own @ placement[:3, :3].T + placement[:3, 3])
    return {name: np.vstack(parts) for name, parts in vertices.items()}


def loaded(robot: yourdfpy.URDF) -> Array:
    """Vertices of all meshes that yourdfpy has placed (v, 3) [m]."""
    placed = []
    for node in robot.scene.graph.nodes_geometry:
        placement, name = robot.scene.graph[node]
        vertices = robot.scene.geometry[name].vertices
        placed.append(vertices @ placement[:3, :3].T + placement[:3, 3])
    return np.vstack(placed)


@pytest.mark.parametrize("name", ["ur5", again("panda"), again("so101")])
def test_meshes_are_where_yourdfpy_has_them_and_fit_a_page(name, rng):
    arm = Arm.load(name)
    q = postures(arm, rng, 2)
    scene = scenes.arm_scene(arm, q)
    robot = yourdfpy.URDF.load(arm.urdf_file.urdf.file)
    for frame, row in enumerate(q):
        robot.update_cfg(dict(zip(arm.joint_names, row, strict=True)))
        vertices, parts = loaded(robot), drawn(scene, frame)
        ours = np.vstack([*parts.values()])
        assert cKDTree(vertices).query(ours)[0].max() < 1 * MM
        # What is smaller than a cell of the grid is not drawn.
        assert cKDTree(ours).query(vertices)[0].max() < 5 * MM
    assert len(parts) > 1  # colours
    assert len(scene.html()) < PAGE


def moved_by_calibration(arm: Arm) -> Arm:
    steps = np.zeros((arm.nq, 6))
    steps[2, 1] = 30 * MM
    return arm.with_placements(steps, None)


def test_meshes_follow_the_corrections_of_the_arm():
    arm, q = Arm.load("ur5"), np.zeros((1, 6))
    before = np.vstack([*drawn(scenes.arm_scene(arm, q), 0).values()])
    after = np.vstack([*drawn(scenes.arm_scene(moved_by_calibration(arm), q), 0).values()])
    shift = np.linalg.norm(after - before, axis=1)
    assert set(np.round(shift / MM, 3)) == {0.0, 30.0}


def opacities(scene: Scene) -> dict[str, float]:
    objects: dict[str, Any] = commands(scene, "set_object")
    return {
        path: each["object"]["materials"][0]["opacity"]
        for path, each in objects.items()
        if path.startswith("arm/body") and "tip" not in path
    }


def test_meshes_do_not_hide_what_a_scene_is_about():
    arm = Arm.load("ur5")
    place = arm.positions(np.full((1, 6), 0.5))[0]
    circle = reaching_postures(arm, place, axis=np.array([0.0, 0.0, -1.0]), count=12)
    assert set(opacities(scenes.arm_scene(arm, np.zeros((1, 6)))).values()) == {1.0}
    assert max(opacities(scenes.circle_scene(circle)).values()) < 0.5
    sticks = scenes.circle_scene(circle, body_style="sticks")
    assert set(opacities(sticks).values()) == {1.0}
    assert any("tubes" in swatch.text for swatch in sticks.swatches)


def without_meshes(folder: Path) -> Arm:
    urdf = folder / "ur5_robot.urdf"
    shutil.copy(Arm.load("ur5").urdf_file.urdf.file, urdf)
    return Arm.from_urdf(urdf, "tool0")


def test_missing_meshes_are_noted(tmp_path, caplog):
    scene = scenes.arm_scene(without_meshes(tmp_path), np.zeros((1, 6)))
    note = next(note for note in scene.notes if "base.dae" in note)
    assert "ur5_robot.urdf" in note
    assert not caplog.records
    assert "arm/body 1/joint" in commands(scene, "set_object")


def test_a_mesh_that_cannot_be_read_is_noted(tmp_path):
    arm = without_meshes(tmp_path)
    broken = tmp_path / "robots/ur_description/meshes/ur5/visual"
    broken.mkdir(parents=True)
    (broken / "base.dae").write_text("<COLLADA>no mesh</COLLADA>")
    scene = scenes.arm_scene(arm, np.zeros((1, 6)))
    assert any("base.dae" in note for note in scene.notes)
    assert "arm/body 1/joint" in commands(scene, "set_object")
