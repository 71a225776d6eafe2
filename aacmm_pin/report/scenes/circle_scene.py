"""The arm going round a working point, with the accuracy of each posture shown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from meshcat.geometry import Sphere

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM, count
from aacmm_pin.accuracy import ELLIPSOID_COVERAGE_FACTOR, AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import WRIST, ConfigurationCircle, PosturesAtPoint
from aacmm_pin.report.plots.circle import evenly, neighbours
from aacmm_pin.report.plots.style import BLUE, GREY, VOLUME_COLOURS, VOLUME_LABEL, round_down
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene, Swatch
from aacmm_pin.report.scenes.stage import (
    Bodies,
    ahead,
    draw_ball,
    draw_ghosts,
    flat,
    joint_texts,
    moving,
    place_text,
    placed_at,
    prisms,
    stage,
)

ELLIPSOID = "#cc79a7"
"""Colour of the accuracy at the point."""
SEEN = 0.14
"""Half the length at which the longest ellipsoid is drawn at most, in sizes of the scene."""
THIN = 1e-4
"""Thickness given to an ellipsoid that has none, in its lengths."""
GHOSTS = 5
"""Postures drawn thin behind the one that is shown."""
MOST_CIRCLE_FRAMES = 360
"""Postures on the slider; of more, every so-manieth."""
PATH_POINTS = 480
"""Points of the drawn path; of more, every so-manieth."""


def circle_scene(circle: PosturesAtPoint, accuracy: AccuracyVolume | None = None) -> Scene:
    """Make an animation of the arm through all postures within limits that reach a point.

    If no posture is within limits, the animation shows all postures. The path of the elbow has the
    colour of the accuracy volume within limits, and is grey outside. For an arm without elbow, the
    scene shows the path of the joint that moves most. A magnified 95 % coverage ellipsoid of the
    posture is at the point.

    Args:
        circle: a :class:`aacmm_pin.ConfigurationCircle`, or the postures of another arm.
        accuracy: ``circle_accuracy(circle)``, the accuracy of the postures within limits.

    Raises:
        AacmmError: the circle has no posture.
        ShapeError: ``accuracy`` is for other postures.
    """
    if not len(circle.q):
        raise AacmmError(f"{circle}; expected one posture or more")
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    eligible = inside if len(inside) else np.arange(len(circle.q))
    members = _thinned(circle.component, eligible, MOST_CIRCLE_FRAMES)
    rows, bodies = np.searchsorted(inside, members), Bodies(circle.arm)
    path, name = _path_of(circle)
    points = np.vstack([bodies.corners(circle.q).reshape(-1, 3), path])
    scene = stage(
        f"{circle.arm.name}: {_place(circle)}", _caption(circle), bodies, points, circle.point[None]
    )
    scene.notes.insert(0, _on_slider(len(members), eligible, len(inside)))
    draw_ghosts(scene, bodies.radius, bodies.corners(circle.q[evenly(eligible, GHOSTS)]))
    draw_ball(scene, "point", "working point", 0.75 * bodies.radius, circle.point)
    colours = np.tile(to_rgb(GREY), (len(circle.q), 1))
    colours[inside] = to_rgb(BLUE)
    moves, texts = moving(bodies, circle.q[members], scene), _texts(circle, members)
    if accuracy is not None and len(inside):
        volume = accuracy.volume / MM3
        scene.bar = ColourBar.of(VOLUME_LABEL, volume, VOLUME_COLOURS)
        colours[inside] = scene.bar.colours(volume)
        moves["accuracy"] = _draw_ellipsoids(
            scene, circle.point, accuracy, float(np.ptp(points, axis=0).max())
        )[rows]
        texts["volume"] = [f"{size:.4g} mm³" for size in volume[rows]]
        texts["uncertainty u"] = [f"{u:.1f} µm" for u in accuracy.u[rows] / UM]
    _draw_path(scene, circle, path, name, colours, 0.4 * bodies.radius)
    scene.frames = Frames(moves, texts, [to_hex(colour) for colour in colours[members]])
    return scene


def _place(circle: PosturesAtPoint) -> str:
    names = {WRIST: "wrist", circle.arm.tip: "tip"}
    return f"{names.get(circle.at, circle.at)} at {place_text(circle.point)}"


def _caption(circle: PosturesAtPoint) -> str:
    curves = count(int(circle.component.max()), "closed curve")
    return (
        f"{len(circle.q)} postures on {curves} reach the point. Of these postures, "
        f"{circle.within_limits.sum()} are within the joint limits."
    )


def _thinned(component: Index, members: Index, most: int) -> Index:
    """At most about ``most`` of the ``members``, or three a component, evenly along each
    component.
    """
    step = -(-len(members) // most)
    of_member, thinned = component[members], []
    for number in np.unique(of_member):
        line = members[of_member == number]
        thinned.append(line[:: max(1, min(step, len(line) // 3))])
    return np.concatenate(thinned)


def _path_of(circle: PosturesAtPoint) -> tuple[Array, str]:
    """The point of the arm whose path shows the circle, (n, 3) [m], and its name.

    The elbow where the arm has one; else the origin of that joint that goes about most.
    """
    if isinstance(circle, ConfigurationCircle):
        return circle.components.swivel.elbow(circle.q), "the elbow"
    axes = circle.arm.chain.moving_axes()
    _, origin = circle.arm.chain.walk(circle.q)
    widest = int(np.linalg.norm(np.ptp(origin[axes], axis=1), axis=1).argmax())
    return origin[axes[widest]], f"joint {widest + 1}"


def _draw_path(
    scene: Scene, circle: PosturesAtPoint, path: Array, name: str, colours: Array, radius: float
) -> None:
    """The pieces of the path (n, 3) [m] within and outside limits; single postures have none."""
    pairs = neighbours(
        circle, _thinned(circle.component, np.arange(len(circle.q)), PATH_POINTS), path
    )
    works = circle.within_limits[pairs].all(axis=1)
    (start, end), (a, b) = pairs[works].T, pairs[~works].T
    if len(a):
        scene["path/outside"].set_object(prisms(path[a], path[b], 0.4 * radius), flat(GREY))
        scene.swatches.insert(0, Swatch(GREY, f"path of {name}, outside the joint limits", "line"))
    if len(start):
        within = prisms(path[start], path[end], radius, colours=colours[pairs[works]])
        scene["path/within"].set_object(within, flat(by_vertex=True))
        if scene.bar is None:
            scene.swatches.insert(0, Swatch(BLUE, f"path of {name}, within limits", "line"))
    if scene.bar is not None:
        what = f"path of {name}" if len(pairs) else "slider"
        scene.notes.insert(0, f"The colour bar holds for the {what} within the joint limits.")


def _draw_ellipsoids(scene: Scene, centre: Array, accuracy: AccuracyVolume, size: float) -> Array:
    """Placements (n, 4, 4) [m] that make a unit sphere the ellipsoid of each configuration in a
    scene of ``size`` [m].
    """
    variances, vectors = np.linalg.eigh(accuracy.covariance)
    half = ELLIPSOID_COVERAGE_FACTOR * np.sqrt(np.maximum(variances, 0.0))
    factor = round_down(SEEN * size / max(float(half.max()), 1e-12))
    vectors[np.linalg.det(vectors) < 0, :, 0] *= -1.0
    drawn = factor * np.maximum(half, THIN * half.max(axis=1, keepdims=True))
    placements = placed_at(np.tile(centre, (len(vectors), 1)))
    placements[:, :3, :3] = vectors * drawn[:, None, :]
    scene["accuracy"].set_object(Sphere(1.0), ahead(ELLIPSOID, 0.6))
    scene["accuracy"].set_transform(placements[0])
    scene.swatches.insert(0, Swatch(ELLIPSOID, "uncertainty ellipsoid of the posture", "area"))
    words = (
        "The ellipsoid at the point covers 95 % of position errors "
        f"(k = {ELLIPSOID_COVERAGE_FACTOR:.2f}). The ellipsoid is magnified {factor:g} "
        "times."
    )
    scene.notes.insert(0, words)
    return placements


def _texts(circle: PosturesAtPoint, members: Index) -> dict[str, Sequence[str]]:
    """What is read out of the ``members``, beside their accuracy."""
    texts: dict[str, Sequence[str]] = {
        "component": [str(number) for number in circle.component[members]]
    }
    if isinstance(circle, ConfigurationCircle):
        degrees = circle.swivel[members] / DEG
        texts["swivel angle"] = [f"{angle:.1f}°" for angle in degrees]
    return texts | joint_texts(circle.arm, circle.q[members])


def _on_slider(frames: int, eligible: Index, within: int) -> str:
    some = "" if frames == len(eligible) else f"{frames} of "
    which = " within the joint limits" if within else ""
    return (
        f"The slider shows {some}the {len(eligible)} postures{which}, one closed curve after the "
        "other."
    )
