"""The bodies of an arm: the meshes of its URDF, simplified for small pages, or tubes and joints."""

from __future__ import annotations

import logging
import os
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.colors import to_hex
from meshcat.geometry import Sphere, TriangularMeshGeometry

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.file_problems import first_few
from aacmm_pin.arm import Arm
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.scenes.scene import Scene
from aacmm_pin.report.scenes.stage import TIP_COLOUR, placed_at, put, rod, solid

if TYPE_CHECKING:
    import yourdfpy

Meshes = dict[tuple[int, str], Any]
"""Meshes of trimesh by body and colour."""
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
TUBE, JOINT, STYLUS, BASE_FLANGE = "#8d99a6", "#22395c", "#b8bec6", "#4a4a4f"
DRAWN = 0.3
"""Shorter tubes, in radii, are hidden in a joint."""
STYLUS_WIDTH, HALF_JOINT = 0.4, 1.9
"""Radius of the last body, and half length of a joint, in radii of the tubes."""
TO_SCALE = "Lengths of the arm are to scale, but thicknesses of tubes and joints are not."


def draw_bodies(
    scene: Scene, lines: ArmLines, style: BodyStyle, opacity: float = TRANSLUCENT
) -> None:
    """Put the bodies of an arm into a scene, below ``arm/body i``, whose transform moves them.

    Sticks replace the meshes if the URDF is missing or has none; notes name omitted parts.
    """
    meshes, remarks = _meshes_of(lines.arm) if style == "meshes" else ({}, [])
    for (body, colour), mesh in meshes.items():
        shape = TriangularMeshGeometry(mesh.vertices, mesh.faces)
        material = solid(colour, opacity, flatShading=True)
        scene[f"arm/body {body}/{colour[1:]}"].set_object(shape, material)
    if not meshes:
        _draw_sticks(scene, lines)
    tip = scene[f"arm/body {len(lines.ends) - 1}/tip"]
    put(tip, Sphere(0.55 * lines.radius), placed_at(lines.ends[-1]), solid(TIP_COLOUR))
    what = "The bodies are the meshes of the URDF, simplified." if meshes else TO_SCALE
    scene.notes += [what, *remarks]


def moves_of(lines: ArmLines, q: Array) -> dict[str, Array]:
    """Placements (n, 4, 4) of the moving bodies at ``q`` (n, nq), by path in the scene."""
    placements = lines.placements(q)
    return {f"arm/body {body}": placements[body] for body in range(1, len(placements))}


def _draw_sticks(scene: Scene, lines: ArmLines) -> None:
    arm_chain, radius, origin = lines.arm.chain, lines.radius, np.zeros(3)
    up = np.array([0.0, 0.0, radius])
    put(scene["arm/body 0/foot"], *rod(-0.8 * up, origin, 3.4 * radius), solid(BASE_FLANGE))
    for body, (place, end) in enumerate(zip(lines.bodies, lines.ends, strict=True)):
        node, material, thickness = scene[f"arm/body {body}"], solid(TUBE), radius
        if body == len(lines.ends) - 1:
            material, thickness = solid(STYLUS), STYLUS_WIDTH * radius
        if np.linalg.norm(end) > DRAWN * radius:
            put(node["tube"], *rod(origin, end, thickness), material)
            put(node["corner"], Sphere(thickness), placed_at(end), material)
        joint = arm_chain.moved[place]
        if joint >= 0:
            shape, placement = rod(-HALF_JOINT * up, HALF_JOINT * up, 1.45 * radius)
            if arm_chain.slides[joint]:
                shape.radialSegments = 4  # a square bar
            put(node["joint"], shape, placement, solid(JOINT))
    scene.explain(STYLUS, "last body", "line")
    scene.explain(JOINT, "joints (cylinders along their axes)", "area")
    scene.explain(TUBE, "tubes", "line")


def _meshes_of(arm: Arm) -> tuple[Meshes, list[str]]:
    """The meshes of a URDF in the axes of their bodies, and remarks on those that are missing."""
    import trimesh

    urdf = Path(arm.urdf_file.urdf.file) if arm.dh is None else Path()
    robot, remarks = _loaded(urdf) if urdf.is_file() else (None, [])
    if robot is None:
        return {}, remarks
    body_of_link = {robot.joint_map[name].child: k for k, name in enumerate(arm.joint_names, 1)}
    base_to_body = np.linalg.inv(ArmLines(arm.uncorrected).placements(np.zeros((1, arm.nq)))[:, 0])
    parts = defaultdict(list)
    graph = robot.scene.graph
    for node in graph.nodes_geometry:
        placement, name = graph[node]
        link = node
        while link in graph.transforms.parents and link not in body_of_link:
            link = graph.transforms.parents[link]
        body = body_of_link.get(link, 0)
        shape = robot.scene.geometry[name]
        mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        mesh.apply_transform(base_to_body[body] @ placement)
        visual = shape.visual
        rgba = visual.material.main_color if visual.kind == "texture" else visual.main_color
        parts[body, to_hex((np.asarray(rgba[:3]) / 255).tolist())].append(mesh)
    joined = {key: trimesh.util.concatenate(meshes) for key, meshes in parts.items()}
    return _simplified(joined), remarks


def _loaded(urdf: Path) -> tuple[yourdfpy.URDF | None, list[str]]:
    """The robot of a URDF, or None without meshes, and remarks on meshes that are missing."""
    import yourdfpy  # half a second
    from yourdfpy.urdf import filename_handler_magic

    paths: dict[str, str] = {}

    def path_of_mesh(fname: str) -> str:
        paths[fname] = str(filename_handler_magic(fname, dir=str(urdf.parent)))
        return paths[fname]

    logger = logging.getLogger("yourdfpy")
    level = logger.level
    logger.setLevel(logging.ERROR)  # the scene notes missing meshes
    try:
        robot = yourdfpy.URDF.load(str(urdf), filename_handler=path_of_mesh)
    except Exception as error:  # whatever a reader of a mesh format raises
        last = [urdf.name, *paths][-1]
        return None, [f"yourdfpy cannot read the mesh {last}: {error}."]
    finally:
        logger.setLevel(level)
    missing = [name for name, path in paths.items() if not os.path.isfile(path)]
    remarks = []
    if missing:
        names = first_few(missing, NAMED_MESHES)
        remarks = [f"{urdf.name} names meshes that do not exist: {names}."]
    return (robot if len(missing) < len(paths) else None), remarks


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
