"""Residuals as lines from each target, or stated place, towards the tip, and the arm."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Calibration, Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import evenly_selected, round_down
from aacmm_pin.report.residual_tables import model_named, models
from aacmm_pin.report.scenes.bodies import BodyStyle, draw_bodies, moves_of
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene
from aacmm_pin.report.scenes.stage import (
    by_vertex,
    draw_ball,
    joint_texts,
    place_text,
    placed_at,
    prisms,
    size_of,
    stage,
)

LONGEST_VECTOR = 0.08
"""Length of nearly all residuals, as part of the picture."""
MOST_VECTORS = 400
"""Residuals to draw; evenly selected from more."""
SIZE_COLOURS = "plasma"
FOOT = 0.005
"""Radius of a spike's foot over the size of the scene."""
PER_SECOND = 4.0


def residual_scene(
    result: Calibration | Diagnosis,
    model: str | None = None,
    *,
    body_style: BodyStyle = "meshes",
) -> Scene:
    """Make a scene of the magnified residuals of one model, with the arm in the records' postures,
    from the largest residual to the smallest.

    A line leads from each target towards the tip. For a diagnosis, a target is the stated place, or
    without one the estimate from all records of the seat.

    Args:
        model: ``before`` or ``after`` (default) for a calibration; ``nominal``, ``recalibrated`` or
            ``extended`` (default) for a diagnosis.
        body_style: see :func:`arm_scene`.

    Raises:
        UnknownNameError: the model is unknown.
    """
    arm, fits = result.model.arm, models(result)
    name = model or [*fits][-1]
    fit, last_fit = model_named(result, name), [*fits.values()][-1]
    distances_mm = {
        of_model: np.linalg.norm(_deviations(result, model_fit), axis=1) / MM
        for of_model, model_fit in fits.items()
    }
    chosen = evenly_selected(np.flatnonzero(last_fit.used), MOST_VECTORS)
    chosen = chosen[np.argsort(-distances_mm[name][chosen], kind="stable")]
    # In the base, where the arm is drawn.
    frame, records = fit.point.frame, fit.problem.measurements
    deviation = _deviations(result, fit)[chosen] @ frame.rotation
    target = frame.back(fit.point.prediction.tips[chosen]) - deviation
    usual = float(np.quantile(np.linalg.norm(deviation, axis=1), 0.95)) or 1e-12
    factor = round_down(LONGEST_VECTOR * (size_of(target) or 1.0) / usual)
    ends = target + factor * deviation
    q, lines = records.q[chosen], ArmLines(arm)
    points = np.vstack([lines.corners(q).reshape(-1, 3), target, ends])
    caption = f"The scene shows {len(chosen)} of {int(last_fit.used.sum())} used records."
    scene = stage(f"{arm.name}: residuals, {name}", caption, lines, points, target)
    draw_bodies(scene, lines, body_style)
    scene.bar = ColourBar(
        "distance between tip and target [mm]", distances_mm[name][chosen], SIZE_COLOURS
    )
    colours, foot = scene.bar.colours, FOOT * size_of(points)
    of_spikes = np.repeat(colours[:, None], 2, axis=1)
    spikes = prisms(target, ends, foot, point=True, colours=of_spikes)
    scene["residuals"].set_object(spikes, by_vertex())
    draw_ball(scene, "record", "target of this record", 1.6 * foot, target[0])
    scene.notes = [
        f"Each spike is a residual, from the target towards the tip, magnified {factor:g} times.",
        "The slider shows the residuals, the largest first.",
        *scene.notes,
    ]
    seats = records.conditions.labels("seat")
    texts = {
        "row": [str(row) for row in records.row[chosen]],
        "seat": [str(seat or "–") for seat in seats[chosen]],
        "target": [place_text(place) for place in target],
    }
    for of_model, distances in distances_mm.items():
        texts[f"residual, {of_model}"] = [f"{mm:.4f} mm" for mm in distances[chosen]]
    moves = moves_of(lines, q) | {"record": placed_at(target)}
    scene.frames = Frames(moves, texts | joint_texts(arm, q), colours, per_second=PER_SECOND)
    return scene


def _deviations(result: Calibration | Diagnosis, fit: Fit) -> Array:
    """Residuals (n, 3) [m]; of a diagnosis from the stated, else the estimated place of the
    seat.
    """
    if isinstance(result, Calibration):
        return fit.system.deviation
    records = fit.problem.measurements
    from_reference = fit.point.prediction.tips - records.reference
    return np.where(records.known[:, None], from_reference, fit.system.deviation)
