"""The arm going round a working point, with the accuracy of each posture."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from meshcat.geometry import Sphere

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM, count
from aacmm_pin.accuracy import ELLIPSOID_COVERAGE_FACTOR, AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import WRIST, ConfigurationCircle, PosturesAtPoint
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    evenly_selected,
    round_down,
)
from aacmm_pin.report.scenes.robot_bodies import BodyStyle, bodies_of
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene
from aacmm_pin.report.scenes.stage import (
    draw_ball,
    draw_ghosts,
    flat,
    in_front,
    joint_texts,
    place_in_first_posture,
    place_text,
    placed_at,
    prisms,
    slider_in_words,
    stage,
)

ELLIPSOID = "#cc79a7"
"""Colour of the ellipsoid."""
SEEN = 0.14
"""Largest half-length of a drawn ellipsoid, over the size of the scene."""
THIN = 1e-4
"""Least thickness of an ellipsoid over its length."""
GHOSTS = 5
"""Postures drawn thin behind the shown one."""
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

    The path of the elbow, or without elbow of the joint that moves most, has the colour of the
    accuracy volume within limits, and is grey outside. A magnified 95 % coverage ellipsoid of the
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
    q, bodies = circle.q[members], bodies_of(circle.arm, body_style)
    path, path_name = _path_of(circle)
    points = np.vstack([bodies.outline(circle.q), path])
    names = {WRIST: "wrist", circle.arm.tip: "tip"}
    reached_point = f"{names.get(circle.at, circle.at)} at {place_text(circle.point)}"
    curves = count(int(circle.component.max()), "closed curve")
    caption = (
        f"{len(circle.q)} postures on {curves} reach the point. Of these postures, "
        f"{circle.within_limits.sum()} are within the joint limits."
    )
    scene = stage(
        f"{circle.arm.name}: {reached_point}", caption, bodies, points, circle.point[None]
    )
    within = " within the joint limits" if len(inside) else ""
    postures_in_words = f"postures{within}, one closed curve after the other"
    scene.notes.insert(0, slider_in_words(len(members), len(eligible), postures_in_words))
    draw_ghosts(scene, bodies.radius, bodies.corners(circle.q[evenly_selected(eligible, GHOSTS)]))
    draw_ball(scene, "point", "working point", 0.75 * bodies.radius, circle.point)
    colours = np.tile(to_rgb(GREY), (len(circle.q), 1))
    colours[inside] = to_rgb(BLUE)
    moves = place_in_first_posture(bodies, q, scene)
    texts = {"component": [str(number) for number in circle.component[members]]}
    if isinstance(circle, ConfigurationCircle):
        texts["swivel angle"] = [f"{angle:.1f}°" for angle in circle.swivel[members] / DEG]
    texts |= joint_texts(circle.arm, q)
    if accuracy is not None and len(inside):
        volume, rows = accuracy.volume / MM3, np.searchsorted(inside, members)
        scene.bar = ColourBar.of(VOLUME_LABEL, volume, VOLUME_COLOURS)
        colours[inside] = scene.bar.colours(volume)
        scene_size = float(np.ptp(points, axis=0).max())
        moves["accuracy"] = _draw_ellipsoids(scene, circle.point, accuracy, scene_size)[rows]
        texts["volume"] = [f"{volume:.4g} mm³" for volume in volume[rows]]
        texts["uncertainty u"] = [f"{u:.1f} µm" for u in accuracy.u[rows] / UM]
    _draw_path(scene, circle, path, path_name, colours, 0.4 * bodies.radius)
    scene.frames = Frames(moves, texts, colours[members])
    return scene


def _path_of(circle: PosturesAtPoint) -> tuple[Array, str]:
    """The path (n, 3) [m] of the elbow, else of the joint whose origin moves most; its name."""
    if isinstance(circle, ConfigurationCircle):
        return circle.components.swivel.elbow(circle.q), "the elbow"
    axes = circle.arm.chain.moving_axes()
    _, origin = circle.arm.chain.walk(circle.q)
    widest = int(np.linalg.norm(np.ptp(origin[axes], axis=1), axis=1).argmax())
    return origin[axes[widest]], f"joint {widest + 1}"


def _neighbours(circle: PosturesAtPoint, members: Index) -> Index:
    """Numbers of the postures at both ends of each piece of the path, (pieces, 2)."""
    pairs = [np.empty((0, 2), dtype=np.intp)]
    curves = getattr(circle, "curves", ())
    if isinstance(circle, ConfigurationCircle):
        curves = circle.components.curves
    for number in np.unique(circle.component[members]):
        along = members[circle.component[members] == number]
        if curves and curves[number - 1].closed:
            along = np.append(along, along[0])
        pairs.append(np.column_stack([along[:-1], along[1:]]))
    return np.concatenate(pairs)


def _draw_path(
    scene: Scene, circle: PosturesAtPoint, path: Array, name: str, colours: Array, radius: float
) -> None:
    pairs = _neighbours(circle, evenly_selected(np.arange(len(circle.q)), PATH_POINTS))
    is_within = circle.within_limits[pairs].all(axis=1)
    within, outside = pairs[is_within], pairs[~is_within]
    if len(outside):
        line = prisms(path[outside[:, 0]], path[outside[:, 1]], 0.4 * radius)
        scene["path/outside"].set_object(line, flat(GREY))
        scene.explain(GREY, f"path of {name}, outside the joint limits", "line")
    if len(within):
        start, end = path[within[:, 0]], path[within[:, 1]]
        line = prisms(start, end, radius, colours=colours[within])
        scene["path/within"].set_object(line, flat(by_vertex=True))
        if scene.bar is None:
            scene.explain(BLUE, f"path of {name}, within limits", "line")
    if scene.bar is not None:
        coloured = f"path of {name}" if len(pairs) else "slider"
        scene.notes.insert(0, f"The colour bar holds for the {coloured} within the joint limits.")


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
    scene["accuracy"].set_transform(placements[0])
    scene.explain(ELLIPSOID, "uncertainty ellipsoid of the posture", "area")
    scene.notes.insert(
        0,
        "The ellipsoid at the point covers 95 % of position errors "
        f"(k = {ELLIPSOID_COVERAGE_FACTOR:.2f}). The ellipsoid is magnified {factor:g} times.",
    )
    return placements
