"""The arm going round a working point, with the accuracy of every posture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from matplotlib.colors import to_hex, to_rgb
from meshcat.geometry import Sphere, TriangularMeshGeometry

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM3, UM
from aacmm_pin.accuracy.configuration_choice import paired
from aacmm_pin.accuracy.volume import AccuracyVolume
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.postures.configurations import WRIST, ConfigurationCircle
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.plots.style import BLUE, GREY, U_NAME, VERMILLION, VOLUME_COLOURS, VOLUME_LABEL
from aacmm_pin.report.scenes.accuracy_set import AccuracySet, Shape
from aacmm_pin.report.scenes.arm_parts import GHOST, Bodies
from aacmm_pin.report.scenes.arm_scene import (
    ARM_SWATCHES,
    TO_SCALE,
    angle_labels,
    angle_texts,
    broken_text,
    moving,
    place_text,
    placed_at,
    view_of,
)
from aacmm_pin.report.scenes.circle_path import path_of, runs, thinned
from aacmm_pin.report.scenes.frames import ChangingMesh, Frames
from aacmm_pin.report.scenes.legend import ColourBar, Legend, Swatch
from aacmm_pin.report.scenes.meshes import ahead, flat, solid, tube
from aacmm_pin.report.scenes.scene import Scene
from aacmm_pin.report.scenes.stage import set_stage

Quantity = Literal["volume", "u"]
SET = "#cc79a7"
MOST_FRAMES = 360
"""Postures on the slider; of more, every so-manieth."""
PATH_POINTS = 720
"""Points of the drawn path; of more, every so-manieth."""
MOST_MESHES = 450_000
"""Bytes that shapes may take which change from posture to posture; fewer postures are shown where they would take more."""


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
    if not len(circle.q):
        raise AacmmError(f"{circle}; nothing to show")
    if quantity not in get_args(Quantity):
        raise UnknownNameError("quantity", quantity, list(get_args(Quantity)))
    if most_frames < 3 or ghosts < 0:
        raise AacmmError(f"most_frames is {most_frames}, ghosts is {ghosts}; expected at least 3 and 0")
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    bodies = Bodies.of(circle.arm)
    points = bodies.corners(circle.q).reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    shown = None
    if accuracy is not None and len(accuracy.q):
        shown = AccuracySet.of(accuracy, shape, circle.point, size)
        most_frames = _fewer(most_frames, shown)
    eligible = np.arange(len(circle.q)) if outside or not len(inside) else inside
    members = thinned(circle.component, eligible, most_frames)

    scene = Scene(f"{circle.arm.name}: {_place(circle)}", _caption(circle))
    bodies.draw(scene)
    _draw_ghosts(scene, bodies, circle, inside, ghosts)
    scene["point"].set_object(Sphere(0.75 * bodies.radius), ahead(VERMILLION))
    scene["point"].set_transform(placed_at(circle.point[None])[0])
    bar, colours = _colours(circle, accuracy, inside, quantity)
    path, name = path_of(circle)
    name = name if _draw_path(scene, circle, path, colours, 0.4 * bodies.radius) else ""
    more, meshes = ({}, []) if shown is None else _accuracy_frames(scene, shown, members, inside)
    scene.frames = Frames(
        moving(bodies, circle.q[members], scene) | more,
        _labels(circle, accuracy),
        _readings(circle, accuracy, members, inside),
        [to_hex(colours[i]) for i in members],
        start=int(np.argmax(circle.within_limits[members])),
        meshes=meshes,
    )
    scene.legend = _legend(circle, name, bar, shown, set_stage(scene, points), _on_slider(circle, members, eligible))
    scene.view = view_of(bodies, np.vstack([points, path]), circle.point)
    return scene


def _place(circle: PosturesAtPoint) -> str:
    what = {WRIST: "wrist", circle.arm.tip: "tip"}.get(circle.at, circle.at)
    return f"{what} at {place_text(circle.point)}"


def _caption(circle: PosturesAtPoint) -> str:
    within, count = int(circle.within_limits.sum()), int(circle.component.max())
    return (
        f"{len(circle.q)} configurations on {count} component{'s' * (count > 1)} reach this point, "
        f"{within} of them within the joint limits."
    )


def _fewer(most_frames: int, shown: AccuracySet) -> int:
    """So many frames that shapes which change do not make the page heavy."""
    if shown.shape == "ellipsoid":
        return most_frames
    vertices, faces = shown.zonotope(len(shown.accuracy.q) // 2)
    return max(3, min(most_frames, int(MOST_MESHES / ((12 * len(vertices) + 6 * len(faces)) * 4 / 3))))


def _draw_ghosts(scene: Scene, bodies: Bodies, circle: PosturesAtPoint, inside: Index, ghosts: int) -> None:
    pool = inside if len(inside) else np.arange(len(circle.q))
    chosen = pool[np.unique(np.linspace(0, len(pool), ghosts, endpoint=False, dtype=np.intp))]
    for number, line in enumerate(bodies.corners(circle.q[chosen]), start=1):
        scene[f"ghosts/{number}"].set_object(tube(line, 0.3 * bodies.radius), solid(GHOST, 0.45))


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


def _draw_path(scene: Scene, circle: PosturesAtPoint, path: Array, colours: Array, radius: float) -> bool:
    """Draw it; False where there is none, because the postures are single ones."""
    members = thinned(circle.component, np.arange(len(circle.q)), PATH_POINTS)
    stretches = runs(circle, members, path)
    for number, run in enumerate(stretches, start=1):
        if run.works:
            line = tube(path[run.members], radius, colours[run.members])
            scene[f"path/within {number}"].set_object(line, flat(by_vertex=True))
        else:
            scene[f"path/outside {number}"].set_object(tube(path[run.members], 0.4 * radius), flat(GREY))
    return bool(stretches)


def _accuracy_frames(
    scene: Scene, shown: AccuracySet, members: Index, inside: Index
) -> tuple[dict[str, Array], list[ChangingMesh]]:
    """The accuracy of each frame, not shown where the posture is outside the limits."""
    place = {int(number): i for i, number in enumerate(inside)}
    rows = [place.get(int(number)) for number in members]
    first = next((row for row in rows if row is not None), 0)
    if shown.shape == "ellipsoid":
        every = shown.ellipsoids()
        scene["accuracy"].set_object(Sphere(1.0), ahead(SET, 0.6))
        scene["accuracy"].set_transform(every[first])
        return {"accuracy": np.stack([np.full((4, 4), np.nan) if row is None else every[row] for row in rows])}, []
    meshes = [None if row is None else shown.zonotope(row) for row in rows]
    vertices, faces = shown.zonotope(first)
    scene["accuracy"].set_object(TriangularMeshGeometry(vertices, faces), ahead(SET, 0.6))
    scene["accuracy"].set_transform(placed_at(shown.centre[None])[0])
    return {}, [ChangingMesh("accuracy", meshes)]


def _labels(circle: PosturesAtPoint, accuracy: AccuracyVolume | None) -> list[str]:
    swivel = ["swivel angle"] if isinstance(circle, ConfigurationCircle) else []
    return ["component", *swivel, *angle_labels(circle.arm), "limits", *(["volume", "uncertainty u"] if accuracy else [])]


def _readings(circle: PosturesAtPoint, accuracy: AccuracyVolume | None, members: Index, inside: Index) -> list[list[str]]:
    numbers = np.full((len(circle.q), 2), np.nan)
    if accuracy is not None:
        numbers[inside] = np.column_stack([accuracy.volume / MM3, accuracy.u / UM])
    rows = []
    for i in members:
        row = [str(circle.component[i])]
        if isinstance(circle, ConfigurationCircle):
            row.append(f"{circle.swivel[i] / DEG:.1f}°")
        row += [*angle_texts(circle.arm, circle.q[i]), broken_text(circle.broken[i])]
        if accuracy is not None:
            volume, u = numbers[i]
            row += ["–", "–"] if np.isnan(u) else [f"{volume:.4g} mm³", f"{u:.1f} µm"]
        rows.append(row)
    return rows


def _legend(
    circle: PosturesAtPoint,
    name: str,
    bar: ColourBar | None,
    shown: AccuracySet | None,
    stage: Sequence[Swatch],
    on_slider: str,
) -> Legend:
    works, all_work = bool(circle.within_limits.any()), bool(circle.within_limits.all())
    swatches = [Swatch(BLUE, f"path of {name}, within limits", "line")] if name and works and bar is None else []
    if name and not all_work:
        swatches.append(Swatch(GREY, f"path of {name}, outside limits", "line"))
    swatches.append(Swatch(VERMILLION, "working point"))
    notes = [f"{f'The path of {name}' if name else 'The slider'} has the colours of the bar within limits."] if bar else []
    if shown is not None:
        swatches.append(Swatch(SET, f"accuracy of this posture ({shown.shape})", "area"))
        notes.append(f"The body at the point is {shown.words}.")
    swatches += [Swatch(GHOST, "other postures", "line"), *ARM_SWATCHES, *stage]
    notes.append(on_slider)
    notes.append(TO_SCALE)
    return Legend(swatches, [] if bar is None else [bar], notes)


def _on_slider(circle: PosturesAtPoint, members: Index, eligible: Index) -> str:
    some = "" if len(members) == len(eligible) else f"{len(members)} of "
    which = " within limits" if circle.within_limits[members].all() else ""
    return f"The slider goes through {some}the {len(eligible)} configurations{which}, component by component."
