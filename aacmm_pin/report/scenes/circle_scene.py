"""The arm going round a working point, with the accuracy of every posture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from meshcat.geometry import Sphere, TriangularMeshGeometry

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures.configurations import WRIST, ConfigurationCircle
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.numbers import count
from aacmm_pin.report.plots.circle import evenly, neighbours
from aacmm_pin.report.plots.style import BLUE, GREY, VERMILLION, VOLUME_COLOURS, VOLUME_LABEL
from aacmm_pin.report.scenes.accuracy_set import AccuracySet, Shape
from aacmm_pin.report.scenes.arm_parts import GHOST, Bodies
from aacmm_pin.report.scenes.arm_scene import (
    TO_SCALE,
    draw_ghosts,
    joint_texts,
    moving,
    place_text,
    put_ball,
    surroundings,
    view_of,
)
from aacmm_pin.report.scenes.legend import ColourBar, Legend, Swatch
from aacmm_pin.report.scenes.scene import Frames, Scene
from aacmm_pin.report.scenes.shapes import ahead, flat, placed_at, prisms

SET = "#cc79a7"
"""Colour of the accuracy at the point."""
GHOSTS = 5
"""Postures drawn thin behind the one that is shown."""
MOST_FRAMES = 360
"""Postures on the slider; of more, every so-manieth."""
PATH_POINTS = 480
"""Points of the drawn path; of more, every so-manieth."""
MOST_MESHES = 450_000
"""Bytes that shapes may take which change from posture to posture; fewer postures are shown where they would take more."""


def circle_scene(
    circle: PosturesAtPoint,
    accuracy: AccuracyVolume | None = None,
    *,
    shape: Shape = "ellipsoid",
    most_frames: int = MOST_FRAMES,
) -> Scene:
    """The arm in every posture within limits that reaches a point, one after the other; where none is, in every posture.

    The path of the elbow (or, for an arm without one, of the joint that goes about most) is coloured by accuracy volume
    where it is within limits and grey outside; at the point stands the accuracy of the posture, magnified.

    Args:
        circle: a :class:`aacmm_pin.ConfigurationCircle`, or the postures of another arm.
        accuracy: ``circle_accuracy(circle)``: of the configurations within limits.
        shape: ``ellipsoid``, the 95 % coverage ellipsoid, or ``zonotope``, all that bounded parameters can do together.
        most_frames: postures on the slider.

    Raises:
        AacmmError: there is no configuration; ``most_frames`` below 3.
        ShapeError: ``accuracy`` was worked out for other configurations.
        UnknownNameError: no such shape.
    """
    if not len(circle.q):
        raise AacmmError(f"{circle}; nothing to show")
    if most_frames < 3:
        raise AacmmError(f"most_frames is {most_frames}, expected at least 3")
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    eligible = inside if len(inside) else np.arange(len(circle.q))
    bodies = Bodies(circle.arm)
    points = bodies.corners(circle.q).reshape(-1, 3)
    shown = None
    if accuracy is not None and len(inside):
        shown = AccuracySet.of(accuracy, shape, circle.point, float(np.ptp(points, axis=0).max()))
        most_frames = min(most_frames, _most_meshes(shown))
    members = _thinned(circle.component, eligible, most_frames)

    scene = Scene(f"{circle.arm.name}: {_place(circle)}", _caption(circle))
    swatches = surroundings(scene, bodies, points)
    put_ball(scene, "point", VERMILLION, 0.75 * bodies.radius, circle.point)
    draw_ghosts(scene, bodies.radius, bodies.corners(circle.q[evenly(eligible, GHOSTS)]))
    colours, bar = np.tile(to_rgb(GREY), (len(circle.q), 1)), None
    colours[inside] = to_rgb(BLUE)
    if shown is not None:
        bar = ColourBar.of(VOLUME_LABEL, shown.accuracy.volume / MM3, VOLUME_COLOURS)
        colours[inside] = bar.colours(shown.accuracy.volume / MM3)
    path, name = _drawn_path(scene, circle, colours, 0.4 * bodies.radius)
    rows = np.searchsorted(inside, members)
    more, choices = ({}, {}) if shown is None else _accuracy_frames(scene, shown, rows)
    scene.frames = Frames(
        moving(bodies, circle.q[members], scene) | more,
        _texts(circle, members, accuracy if shown else None, rows),
        [to_hex(colour) for colour in colours[members]],
        choices=choices,
    )
    scene.legend = _legend(circle, name, bar, shown, swatches, _on_slider(len(members), eligible, len(inside)))
    scene.view = view_of(bodies, np.vstack([points, path]), circle.point)
    return scene


def _place(circle: PosturesAtPoint) -> str:
    what = {WRIST: "wrist", circle.arm.tip: "tip"}.get(circle.at, circle.at)
    return f"{what} at {place_text(circle.point)}"


def _caption(circle: PosturesAtPoint) -> str:
    within, components = int(circle.within_limits.sum()), int(circle.component.max())
    return (
        f"{len(circle.q)} configurations on {count(components, 'component')} reach this point, "
        f"{within} of them within the joint limits."
    )


def _most_meshes(shown: AccuracySet) -> int:
    """So many frames that shapes which change do not make the page heavy."""
    if shown.shape == "ellipsoid":
        return MOST_FRAMES
    vertices, faces = shown.zonotope(len(shown.accuracy.q) // 2)
    return max(3, int(MOST_MESHES / ((12 * len(vertices) + 12 * len(faces) + 700) * 4 / 3)))


def _thinned(component: Index, members: Index, most: int) -> Index:
    """At most about ``most`` of the ``members``, or three a component, evenly along each component."""
    step = -(-len(members) // most)
    lines = [members[component[members] == number] for number in np.unique(component[members])]
    return np.concatenate([some[:: max(1, min(step, len(some) // 3))] for some in lines])


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


def _drawn_path(scene: Scene, circle: PosturesAtPoint, colours: Array, radius: float) -> tuple[Array, str]:
    """Draw the path's pieces within and outside limits; the path, and its name, "" where the postures are single ones."""
    path, name = _path_of(circle)
    pairs = neighbours(circle, _thinned(circle.component, np.arange(len(circle.q)), PATH_POINTS), path)
    works = circle.within_limits[pairs].all(axis=1)
    (start, end), (a, b) = pairs[works].T, pairs[~works].T
    if len(start):
        within = prisms(path[start], path[end], radius, colours=colours[pairs[works]])
        scene["path/within"].set_object(within, flat(by_vertex=True))
    if len(a):
        scene["path/outside"].set_object(prisms(path[a], path[b], 0.4 * radius), flat(GREY))
    return path, name if len(pairs) else ""


def _accuracy_frames(scene: Scene, shown: AccuracySet, rows: Index) -> tuple[dict[str, Array], dict[str, list[str]]]:
    """The accuracy of each frame: placements of one body, or the name of one of many bodies."""
    if shown.shape == "ellipsoid":
        placements = shown.ellipsoids()[rows]
        scene["accuracy"].set_object(Sphere(1.0), ahead(SET, 0.6))
        scene["accuracy"].set_transform(placements[0])
        return {"accuracy": placements}, {}
    scene["accuracy"].set_transform(placed_at(shown.centre[None])[0])
    for row in rows:
        scene[f"accuracy/{row}"].set_object(TriangularMeshGeometry(*shown.zonotope(row)), ahead(SET, 0.6, flat_faces=True))
    return {}, {"accuracy": [str(row) for row in rows]}


def _texts(
    circle: PosturesAtPoint, members: Index, accuracy: AccuracyVolume | None, rows: Index
) -> dict[str, Sequence[str]]:
    """What is read out of the ``members``, which are the ``rows`` of the accuracy."""
    texts: dict[str, Sequence[str]] = {"component": [str(number) for number in circle.component[members]]}
    if isinstance(circle, ConfigurationCircle):
        texts["swivel angle"] = [f"{angle / DEG:.1f}°" for angle in circle.swivel[members]]
    texts |= joint_texts(circle.arm, circle.q[members])
    if accuracy is not None:
        texts["volume"] = [f"{volume:.4g} mm³" for volume in accuracy.volume[rows] / MM3]
        texts["uncertainty u"] = [f"{u:.1f} µm" for u in accuracy.u[rows] / UM]
    return texts


def _legend(
    circle: PosturesAtPoint, name: str, bar: ColourBar | None, shown: AccuracySet | None, stage: list[Swatch], slider: str
) -> Legend:
    """Of the path, the point, its accuracy, and the ``stage`` around them."""
    swatches, notes = [], []
    if name and bar is None and circle.within_limits.any():
        swatches.append(Swatch(BLUE, f"path of {name}, within limits", "line"))
    if name and not circle.within_limits.all():
        swatches.append(Swatch(GREY, f"path of {name}, outside limits", "line"))
    if shown is not None:
        swatches.append(Swatch(SET, f"accuracy of this posture ({shown.shape})", "area"))
        notes.append(f"{f'The path of {name}' if name else 'The slider'} has the colours of the bar within limits.")
        notes.append(f"The body at the point is {shown.words}.")
    swatches += [Swatch(VERMILLION, "working point"), Swatch(GHOST, "other postures", "line")]
    return Legend([*swatches, *stage], [] if bar is None else [bar], [*notes, slider, TO_SCALE])


def _on_slider(frames: int, eligible: Index, within: int) -> str:
    some = "" if frames == len(eligible) else f"{frames} of "
    which = " within limits" if within else ""
    return f"The slider goes through {some}the {len(eligible)} configurations{which}, component by component."
