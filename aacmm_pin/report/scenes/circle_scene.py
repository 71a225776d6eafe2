"""The arm going round a working point, with the accuracy of each posture."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from meshcat.geometry import Sphere

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM, count
from aacmm_pin.accuracy import ELLIPSOID_COVERAGE_FACTOR, AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import WRIST, ConfigurationCircle, PosturesAtPoint
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    evenly_selected,
    round_down,
)
from aacmm_pin.report.scenes.bodies import BodyStyle, draw_bodies, moves_of
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene
from aacmm_pin.report.scenes.stage import (
    by_vertex,
    draw_ball,
    in_front,
    joint_texts,
    place_text,
    placed_at,
    prisms,
    size_of,
    stage,
)

ELLIPSOID = "#cc79a7"
"""Colour of the ellipsoid."""
SEEN = 0.14
"""Largest half-length of a drawn ellipsoid, over the size of the scene."""
THIN = 1e-4
"""Least thickness of an ellipsoid over its length."""
MOST_CIRCLE_FRAMES = 360
"""Postures on the slider, evenly selected."""
PATH_POINTS = 480
"""Points of the drawn path, evenly selected."""


def circle_scene(
    circle: PosturesAtPoint,
    accuracy: AccuracyVolume | None = None,
    *,
    body_style: BodyStyle = "meshes",
) -> Scene:
    """Make an animation of the arm through all postures within limits that reach a point, or all
    postures if none is within limits.

    The path of the joint that moves most, such as the elbow, has the colour of the accuracy volume
    within limits, and is grey outside. A magnified 95 % coverage ellipsoid of the
    posture is at the point.

    Args:
        circle: a :class:`aacmm_pin.ConfigurationCircle`, or the postures of another arm.
        accuracy: ``circle_accuracy(circle)``, of the postures within limits.
        body_style: see :func:`arm_scene`.

    Raises:
        AacmmError: the circle has no posture.
        ShapeError: ``accuracy`` is for other postures.
    """
    if not len(circle.q):
        raise AacmmError(f"{circle}; expected one posture or more")
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    eligible = inside if len(inside) else np.arange(len(circle.q))
    members = evenly_selected(eligible, MOST_CIRCLE_FRAMES)
    q, lines = circle.q[members], ArmLines(circle.arm)
    path, path_name = _path_of(circle)
    points = np.vstack([lines.corners(circle.q).reshape(-1, 3), path])
    names = {WRIST: "wrist", circle.arm.tip: "tip"}
    place = f"{names.get(circle.at, circle.at)} at {place_text(circle.point)}"
    curves = count(int(circle.component.max()), "closed curve")
    caption = (
        f"{len(circle.q)} postures on {curves} reach the point. Of these postures, "
        f"{circle.within_limits.sum()} are within the joint limits."
    )
    scene = stage(f"{circle.arm.name}: {place}", caption, lines, points, circle.point[None])
    draw_bodies(scene, lines, body_style)
    part = "" if len(members) == len(eligible) else f"{len(members)} of "
    within = " within the joint limits" if len(inside) else ""
    scene.notes.insert(
        0,
        f"The slider shows {part}the {len(eligible)} postures{within}, one closed curve after the "
        "other.",
    )
    draw_ball(scene, "point", "working point", 0.75 * lines.radius, circle.point)
    colours = np.tile(to_rgb(GREY), (len(circle.q), 1))
    colours[inside] = to_rgb(BLUE)
    moves = moves_of(lines, q)
    texts = {"component": [str(number) for number in circle.component[members]]}
    if isinstance(circle, ConfigurationCircle):
        texts["swivel angle"] = [f"{angle:.1f}°" for angle in circle.swivel[members] / DEG]
    texts |= joint_texts(circle.arm, q)
    if accuracy is not None and len(inside):
        volume, rows = accuracy.volume / MM3, np.searchsorted(inside, members)
        scene.bar = ColourBar(VOLUME_LABEL, volume, VOLUME_COLOURS)
        colours[inside] = scene.bar.colours
        moves["accuracy"] = _draw_ellipsoids(scene, circle.point, accuracy, size_of(points))[rows]
        texts["volume"] = [f"{volume:.4g} mm³" for volume in volume[rows]]
        texts["uncertainty u"] = [f"{u:.1f} µm" for u in accuracy.u[rows] / UM]
        scene.notes.insert(0, "The colour bar holds for postures within the joint limits.")
    elif len(inside):
        scene.explain(BLUE, f"path of {path_name}, within limits", "line")
    if not circle.within_limits.all():
        scene.explain(GREY, f"path of {path_name}, outside the joint limits", "line")
    pieces = _pieces(circle)
    if len(pieces):
        start, end = path[pieces[:, 0]], path[pieces[:, 1]]
        thickness = np.where(circle.within_limits[pieces].all(axis=1), 0.4, 0.16)
        drawn_path = prisms(start, end, thickness * lines.radius, colours=colours[pieces])
        scene["path"].set_object(drawn_path, by_vertex())
    scene.frames = Frames(moves, texts, colours[members])
    return scene


def _path_of(circle: PosturesAtPoint) -> tuple[Array, str]:
    """The path (n, 3) [m] of the joint whose origin moves most, and its name."""
    axes = circle.arm.chain.moving_axes()
    _, origin = circle.arm.chain.walk(circle.q)
    widest = int(np.linalg.norm(np.ptp(origin[axes], axis=1), axis=1).argmax())
    return origin[axes[widest]], f"joint {widest + 1}"


def _pieces(circle: PosturesAtPoint) -> Index:
    """Numbers of the postures at both ends of each piece of the path, (pieces, 2)."""
    curves = getattr(circle, "curves", ())
    if isinstance(circle, ConfigurationCircle):
        curves = circle.components.curves
    members = evenly_selected(np.arange(len(circle.q)), PATH_POINTS)
    pieces = []
    for number in np.unique(circle.component):
        along = members[circle.component[members] == number]
        ring = np.column_stack([along, np.roll(along, -1)])
        pieces.append(ring if curves and curves[number - 1].closed else ring[:-1])
    return np.concatenate(pieces)


def _draw_ellipsoids(scene: Scene, centre: Array, accuracy: AccuracyVolume, size: float) -> Array:
    """Draw a unit sphere; return the placements (n, 4, 4) [m] that make it each posture's
    ellipsoid.
    """
    variances, vectors = np.linalg.eigh(accuracy.covariance)
    half = ELLIPSOID_COVERAGE_FACTOR * np.sqrt(np.maximum(variances, 0.0))
    factor = round_down(SEEN * size / max(float(half.max()), 1e-12))
    vectors[np.linalg.det(vectors) < 0, :, 0] *= -1.0
    drawn_half = factor * np.maximum(half, THIN * half.max(axis=1, keepdims=True))
    placements = placed_at(np.tile(centre, (len(vectors), 1)))
    placements[:, :3, :3] = vectors * drawn_half[:, None, :]
    scene["accuracy"].set_object(Sphere(1.0), in_front(ELLIPSOID, 0.6))
    scene.explain(ELLIPSOID, "uncertainty ellipsoid of the posture", "area")
    scene.notes.insert(
        0,
        "The ellipsoid at the point covers 95 % of position errors "
        f"(k = {ELLIPSOID_COVERAGE_FACTOR:.2f}). The ellipsoid is magnified {factor:g} times.",
    )
    return placements
