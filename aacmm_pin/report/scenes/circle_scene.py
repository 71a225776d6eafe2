"""The arm going round a working point, with the accuracy of every posture."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from meshcat.geometry import Sphere, TriangularMeshGeometry

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.postures.configurations import WRIST, ConfigurationCircle
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.plots.style import BLUE, GREY, U_NAME, VERMILLION, VOLUME_COLOURS, VOLUME_LABEL
from aacmm_pin.report.scenes.accuracy_set import AccuracySet, Shape
from aacmm_pin.report.scenes.arm_parts import GHOST, Bodies
from aacmm_pin.report.scenes.arm_scene import (
    TO_SCALE,
    angle_labels,
    angle_texts,
    broken_text,
    moving,
    place_text,
    surroundings,
    view_of,
)
from aacmm_pin.report.scenes.legend import ColourBar, Legend, Swatch
from aacmm_pin.report.scenes.scene import Frames, Scene
from aacmm_pin.report.scenes.shapes import ahead, flat, line, placed_at, prisms, solid

Quantity = Literal["volume", "u"]
SET = "#cc79a7"
MOST_FRAMES = 360
"""Postures on the slider; of more, every so-manieth."""
PATH_POINTS = 480
"""Points of the drawn path; of more, every so-manieth."""
MOST_MESHES = 450_000
"""Bytes that shapes may take which change from posture to posture; fewer postures are shown where they would take more."""
NEXT = 3.0
"""The ends of a line that nothing calls closed are joined where they are no farther apart than so many usual steps."""


def circle_scene(
    circle: PosturesAtPoint,
    accuracy: AccuracyVolume | None = None,
    *,
    shape: Shape = "ellipsoid",
    quantity: Quantity = "volume",
    ghosts: int = 5,
    outside: bool = False,
    most_frames: int = MOST_FRAMES,
) -> Scene:
    """The arm in every posture that reaches a point, one after the other.

    The path of the elbow (or, for an arm without one, of the joint that goes about most) is coloured by accuracy where it is
    within limits and grey outside; at the point stands the accuracy of the posture, magnified.

    Args:
        circle: a :class:`aacmm_pin.ConfigurationCircle`, or the postures of another arm.
        accuracy: ``circle_accuracy(circle)``: of the configurations within limits.
        shape: ``ellipsoid``, the 95 % coverage ellipsoid, or ``zonotope``, all that bounded parameters can do together.
        quantity: what colours the path: accuracy ``volume``, or standard uncertainty ``u``.
        ghosts: postures of the arm drawn thin behind it, evenly among those within limits.
        outside: put postures outside the limits on the slider too; where none is within, they are there anyway.
        most_frames: postures on the slider.

    Raises:
        AacmmError: there is no configuration; ``most_frames`` below 3 or ``ghosts`` below 0.
        ShapeError: ``accuracy`` was worked out for other configurations.
        UnknownNameError: no such shape or quantity.
    """
    _check(circle, quantity, most_frames, ghosts)
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    bodies = Bodies.of(circle.arm)
    points = bodies.corners(circle.q).reshape(-1, 3)
    size, shown = float(np.ptp(points, axis=0).max()), None
    if accuracy is not None and len(accuracy.q):
        shown = AccuracySet.of(accuracy, shape, circle.point, size)
        most_frames = min(most_frames, _most_meshes(shown))
    eligible = np.arange(len(circle.q)) if outside or not len(inside) else inside
    members = _thinned(circle.component, eligible, most_frames)

    scene = Scene(f"{circle.arm.name}: {_place(circle)}", _caption(circle))
    swatches = surroundings(scene, bodies, points)
    scene["point"].set_object(Sphere(0.75 * bodies.radius), ahead(VERMILLION))
    scene["point"].set_transform(placed_at(circle.point[None])[0])
    _draw_ghosts(scene, bodies, circle.q[inside] if len(inside) else circle.q, ghosts)
    bar, colours = _colours(circle, accuracy, inside, quantity)
    path, name = _drawn_path(scene, circle, colours, 0.4 * bodies.radius)
    more, choices = ({}, {}) if shown is None else _accuracy_frames(scene, shown, members, inside)
    scene.frames = Frames(
        moving(bodies, circle.q[members], scene) | more,
        _labels(circle, accuracy),
        _readings(circle, accuracy, members, inside),
        [to_hex(colours[i]) for i in members],
        start=int(np.argmax(circle.within_limits[members])),
        choices=choices,
    )
    about = _legend(circle, name, bar, shown, _on_slider(circle, members, eligible))
    scene.legend = replace(about, swatches=[*about.swatches, *swatches])
    scene.view = view_of(bodies, np.vstack([points, path]), circle.point)
    return scene


def _check(circle: PosturesAtPoint, quantity: str, most_frames: int, ghosts: int) -> None:
    if not len(circle.q):
        raise AacmmError(f"{circle}; nothing to show")
    if quantity not in get_args(Quantity):
        raise UnknownNameError("quantity", quantity, list(get_args(Quantity)))
    if most_frames < 3 or ghosts < 0:
        raise AacmmError(f"most_frames is {most_frames}, ghosts is {ghosts}; expected at least 3 and 0")


def _draw_ghosts(scene: Scene, bodies: Bodies, q: Array, ghosts: int) -> None:
    some = q[np.unique(np.linspace(0, len(q), ghosts, endpoint=False, dtype=np.intp))]
    for number, corners in enumerate(bodies.corners(some), start=1):
        scene[f"ghosts/{number}"].set_object(line(corners, 0.3 * bodies.radius), solid(GHOST, 0.45))


def _place(circle: PosturesAtPoint) -> str:
    what = {WRIST: "wrist", circle.arm.tip: "tip"}.get(circle.at, circle.at)
    return f"{what} at {place_text(circle.point)}"


def _caption(circle: PosturesAtPoint) -> str:
    within, count = int(circle.within_limits.sum()), int(circle.component.max())
    return (
        f"{len(circle.q)} configurations on {count} component{'s' * (count > 1)} reach this point, "
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


def _colours(
    circle: PosturesAtPoint, accuracy: AccuracyVolume | None, inside: Index, quantity: Quantity
) -> tuple[ColourBar | None, Array]:
    """The colour bar, and the colour of every configuration (n, 3) in [0, 1]."""
    colours = np.tile(to_rgb(GREY), (len(circle.q), 1))
    if accuracy is None or not len(inside):
        colours[inside] = to_rgb(BLUE)
        return None, colours
    label, values = (VOLUME_LABEL, accuracy.volume / MM3) if quantity == "volume" else (f"{U_NAME} [µm]", accuracy.u / UM)
    bar = ColourBar.of(label, values, VOLUME_COLOURS)
    colours[inside] = bar.colours(values)
    return bar, colours


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
    members = _thinned(circle.component, np.arange(len(circle.q)), PATH_POINTS)
    pairs = np.empty((0, 2), dtype=np.intp)
    for number in np.unique(circle.component[members]):
        mine = members[circle.component[members] == number]
        along = np.append(mine, mine[0]) if _closed(circle, int(number), path[mine]) else mine
        pairs = np.vstack([pairs, np.column_stack([along[:-1], along[1:]])])
    works = circle.within_limits[pairs].all(axis=1)
    (start, end), (a, b) = pairs[works].T, pairs[~works].T
    if len(start):
        within = prisms(path[start], path[end], radius, colours=colours[pairs[works]])
        scene["path/within"].set_object(within, flat(by_vertex=True))
    if len(a):
        scene["path/outside"].set_object(prisms(path[a], path[b], 0.4 * radius), flat(GREY))
    return path, name if len(pairs) else ""


def _closed(circle: PosturesAtPoint, number: int, line: Array) -> bool:
    if isinstance(circle, ConfigurationCircle):
        return bool(circle.components.curves[number - 1].closed)
    if len(line) < 3:
        return False
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return bool(np.linalg.norm(line[-1] - line[0]) <= NEXT * np.median(steps))


def _accuracy_frames(
    scene: Scene, shown: AccuracySet, members: Index, inside: Index
) -> tuple[dict[str, Array], dict[str, list[str]]]:
    """The accuracy of each frame, not shown where the posture is outside the limits: placements, or one of many bodies."""
    place = {int(number): i for i, number in enumerate(inside)}
    rows = [place.get(int(number)) for number in members]
    known = [row for row in rows if row is not None]
    if shown.shape == "ellipsoid":
        every = shown.ellipsoids()
        scene["accuracy"].set_object(Sphere(1.0), ahead(SET, 0.6))
        scene["accuracy"].set_transform(every[known[0] if known else 0])
        return {"accuracy": np.stack([np.full((4, 4), np.nan) if row is None else every[row] for row in rows])}, {}
    scene["accuracy"].set_transform(placed_at(shown.centre[None])[0])
    for row in known:
        scene[f"accuracy/{row}"].set_object(TriangularMeshGeometry(*shown.zonotope(row)), ahead(SET, 0.6, flat_faces=True))
    return {}, {"accuracy": ["" if row is None else str(row) for row in rows]}


def _labels(circle: PosturesAtPoint, accuracy: AccuracyVolume | None) -> list[str]:
    swivel = ["swivel angle"] if isinstance(circle, ConfigurationCircle) else []
    return ["component", *swivel, *angle_labels(circle.arm), "limits", *(["volume", "uncertainty u"] if accuracy else [])]


def _readings(circle: PosturesAtPoint, accuracy: AccuracyVolume | None, members: Index, inside: Index) -> list[list[str]]:
    texts = np.full((len(circle.q), 2), "–", dtype=object)
    if accuracy is not None:
        sizes = zip(accuracy.volume / MM3, accuracy.u / UM, strict=True)
        texts[inside] = [(f"{volume:.4g} mm³", f"{u:.1f} µm") for volume, u in sizes]
    rows = []
    for i in members:
        swivel = [f"{circle.swivel[i] / DEG:.1f}°"] if isinstance(circle, ConfigurationCircle) else []
        angles = [*angle_texts(circle.arm, circle.q[i]), broken_text(circle.broken[i])]
        rows.append([str(circle.component[i]), *swivel, *angles, *(texts[i] if accuracy is not None else [])])
    return rows


def _legend(circle: PosturesAtPoint, name: str, bar: ColourBar | None, shown: AccuracySet | None, on_slider: str) -> Legend:
    """Of the point, its path and its accuracy."""
    swatches = [Swatch(VERMILLION, "working point"), Swatch(GHOST, "other postures", "line")]
    notes = [f"{f'The path of {name}' if name else 'The slider'} has the colours of the bar within limits."] if bar else []
    if shown is not None:
        swatches.insert(1, Swatch(SET, f"accuracy of this posture ({shown.shape})", "area"))
        notes.append(f"The body at the point is {shown.words}.")
    if name and not circle.within_limits.all():
        swatches.insert(0, Swatch(GREY, f"path of {name}, outside limits", "line"))
    if name and circle.within_limits.any() and bar is None:
        swatches.insert(0, Swatch(BLUE, f"path of {name}, within limits", "line"))
    return Legend(swatches, [] if bar is None else [bar], [*notes, on_slider, TO_SCALE])


def _on_slider(circle: PosturesAtPoint, members: Index, eligible: Index) -> str:
    some = "" if len(members) == len(eligible) else f"{len(members)} of "
    which = " within limits" if circle.within_limits[members].all() else ""
    return f"The slider goes through {some}the {len(eligible)} configurations{which}, component by component."
