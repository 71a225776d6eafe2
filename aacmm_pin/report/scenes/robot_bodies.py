"""The meshes of an arm's URDF, loaded by yourdfpy and simplified for small pages."""

from __future__ import annotations

import logging
import os
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.colors import to_hex
from meshcat.geometry import TriangularMeshGeometry

from aacmm_pin._support.checks import Array
from aacmm_pin._support.file_problems import first_few
from aacmm_pin.arm import Arm
from aacmm_pin.report.scenes.scene import Scene, Swatch
from aacmm_pin.report.scenes.stage import Bodies, draw_tip, solid

if TYPE_CHECKING:
    import trimesh
    import yourdfpy

Meshes = dict[tuple[int, str], "trimesh.Trimesh"]
"""Meshes by body and colour."""
BodyStyle = Literal["meshes", "sticks"]
"""Meshes of the URDF, if any, or tubes and joints."""
OPAQUE, TRANSLUCENT = 1.0, 0.35
"""Opacity of the meshes; translucent in front of data."""
MOST_MESH_ROWS = 130_000
"""Vertices and faces of a scene; each has 16 characters on the page."""
FINEST, COARSER = 1e-3, 1.25
"""Side of the cells that merge vertices, over the robot's size, and its growth for too many
rows.
"""
NAMED_MESHES = 3
"""Missing files in a note."""


@dataclass(frozen=True, eq=False)
class MeshBodies(Bodies):
    """The meshes of the URDF, in the axes of their bodies, in place of tubes and joints."""

    meshes: Meshes = field(default_factory=dict)
    opacity: float = 1.0

    @property
    def swatches(self) -> list[Swatch]:
        """None: colours are those of the robot."""
        return []

    @property
    def notes(self) -> list[str]:
        """The sentences on the bodies."""
        return ["The bodies are the meshes of the URDF, simplified.", *self.remarks]

    def outline(self, q: Array) -> Array:
        """Corners of the boxes around the meshes."""
        meshes = self.meshes.items()
        boxes = [(body, np.array([*product(*mesh.bounds.T)])) for (body, _), mesh in meshes]
        return self.in_base(q, boxes).reshape(-1, 3)

    def draw(self, scene: Scene) -> None:
        """Put the meshes into a scene, below ``arm/body i`` each."""
        for (body, colour), mesh in self.meshes.items():
            shape = TriangularMeshGeometry(np.array(mesh.vertices), np.array(mesh.faces))
            material = solid(colour, self.opacity, flat=True)
            scene[f"arm/body {body}/{colour[1:]}"].set_object(shape, material)
        draw_tip(scene, self)


def bodies_of(arm: Arm, style: BodyStyle, opacity: float = TRANSLUCENT) -> Bodies:
    """The bodies of an arm; sticks if the URDF is missing or has no mesh."""
    urdf = Path(arm.urdf_file.urdf.file) if arm.dh is None else Path()
    if style == "sticks" or not urdf.is_file():
        return Bodies(arm)
    import yourdfpy  # half a second
    from yourdfpy.urdf import filename_handler_magic

    named: list[str] = []
    missing: list[str] = []

    def path_of_mesh(fname: str) -> str:
        path = str(filename_handler_magic(fname, dir=str(urdf.parent)))
        named.append(fname)
        if not os.path.isfile(path):
            missing.append(fname)
        return path

    logger = logging.getLogger("yourdfpy")
    level = logger.level
    logger.setLevel(logging.ERROR)  # the scene notes missing meshes
    try:
        robot = yourdfpy.URDF.load(str(urdf), filename_handler=path_of_mesh)
    except Exception as error:  # whatever a reader of a mesh format raises
        last = named[-1] if named else urdf.name
        return Bodies(arm, (f"yourdfpy cannot read the mesh {last}: {error}.",))
    finally:
        logger.setLevel(level)
    remarks: tuple[str, ...] = ()
    if missing:
        names = first_few(missing, NAMED_MESHES)
        remarks = (f"{urdf.name} names meshes that do not exist: {names}.",)
    if len(missing) == len(named):
        return Bodies(arm, remarks)
    return MeshBodies(arm, remarks, _simplified(_meshes_by_body(arm, robot)), opacity)


def _meshes_by_body(arm: Arm, robot: yourdfpy.URDF) -> Meshes:
    """Meshes in the axes of their bodies (0: base; i: after joint i)."""
    import trimesh

    number_of_joint = {name: number for number, name in enumerate(arm.joint_names, start=1)}
    joint_to = {joint.child: joint for joint in robot.robot.joints}

    def body_of(link: str) -> int:
        """Number of the last joint of the arm before a link; 0 without one."""
        while link in joint_to:
            joint = joint_to[link]
            if joint.name in number_of_joint:
                return number_of_joint[joint.name]
            link = joint.parent
        return 0

    bodies = Bodies(arm.uncorrected)
    base_to_body = np.linalg.inv(bodies.placements(np.zeros((1, arm.nq)))[:, 0])
    parts = defaultdict(list)
    graph = robot.scene.graph
    for node in graph.nodes_geometry:
        placement, name = graph[node]
        body = body_of(graph.transforms.parents[node])
        shape = robot.scene.geometry[name]
        vertices = trimesh.transform_points(shape.vertices, base_to_body[body] @ placement)
        visual = shape.visual
        rgba = visual.material.main_color if visual.kind == "texture" else visual.main_color
        colour = to_hex((np.asarray(rgba[:3]) / 255).tolist())
        parts[body, colour].append((vertices, shape.faces))
    meshes = {}
    for key, shapes in parts.items():
        joined = trimesh.util.append_faces(*zip(*shapes, strict=True))
        meshes[key] = trimesh.Trimesh(*joined, process=False)
    return meshes


def _simplified(meshes: Meshes) -> Meshes:
    """Merge vertices in one cell of a grid, as coarse as :data:`MOST_MESH_ROWS` demands."""
    cell = FINEST * max(float(np.ptp(mesh.bounds, axis=0).max()) for mesh in meshes.values())
    simple = dict(meshes)
    while sum(len(mesh.vertices) + len(mesh.faces) for mesh in simple.values()) > MOST_MESH_ROWS:
        for key, mesh in meshes.items():
            coarse = mesh.copy()
            coarse.vertices = mesh.vertices / cell
            coarse.merge_vertices(digits_vertex=0)
            coarse.update_faces(coarse.nondegenerate_faces() & coarse.unique_faces())
            coarse.remove_unreferenced_vertices()
            coarse.vertices = coarse.vertices * cell
            simple[key] = coarse
        cell *= COARSER
    return {key: mesh for key, mesh in simple.items() if len(mesh.faces)}
