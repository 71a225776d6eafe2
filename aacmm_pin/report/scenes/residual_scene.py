"""Residuals where they are: lines from each target, or stated place, towards the tip, and the arm
in its posture.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_hex

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import MM, count
from aacmm_pin.calibration import Calibration, Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.report.numbers import lengths
from aacmm_pin.report.plots.residual_vectors import (
    MODEL_WORDS,
    deviations_of,
    magnification_of,
    model_named,
    models,
    postures_of,
    rms_of,
    some_of,
)
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene
from aacmm_pin.report.scenes.stage import (
    TO_SCALE,
    Bodies,
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

SIZE_COLOURS = "plasma"
FOOT = 0.005
"""Radius of the foot of a residual's spike, in sizes of the scene."""
PER_SECOND = 4.0


def residual_scene(result: Calibration | Diagnosis, model: str | None = None) -> Scene:
    """Make a scene of the magnified residuals of one model, with the arm in the postures of the
    records.

    A line leads from each target towards the tip. For a diagnosis, a target is the stated place;
    without a stated place, the target is the estimate from all records of the seat. The slider
    shows the records from the largest residual to the smallest.

    Args:
        result: the calibration or the diagnosis.
        model: ``before`` or ``after`` for a calibration; ``simulation`` (nominal arm),
            ``recalibrated`` or ``extended`` for a diagnosis. The default is ``after`` or
            ``extended``.

    Raises:
        UnknownNameError: the model is unknown.
    """
    arm, fits = result.model.arm, models(result)
    last, judge = [*fits.items()][-1]
    name = model or last
    fit = model_named(result, name)
    start = "target" if isinstance(result, Calibration) else "reference"
    frame, records = fit.point.frame, fit.problem.measurements
    off = {which: _distances_mm(result, one) for which, one in fits.items()}
    chosen = some_of(np.flatnonzero(judge.used))
    chosen = chosen[np.argsort(-off[name][chosen], kind="stable")]
    # In the base, where the arm is drawn.
    deviation = deviations_of(result, fit)[chosen] @ frame.rotation
    target = frame.back(fit.point.prediction.tips[chosen]) - deviation
    factor = magnification_of(target, deviation)
    ends = target + factor * deviation
    q, bodies = records.q[chosen], Bodies(arm)
    points = np.vstack([bodies.corners(q).reshape(-1, 3), target, ends])
    size = float(np.ptp(points, axis=0).max())

    scene = stage(
        f"{arm.name}: residuals, {MODEL_WORDS.get(name, name)}",
        _caption(result, judge, chosen),
        bodies,
        points,
        target,
    )
    draw_ghosts(scene, bodies.radius, map(frame.back, postures_of(judge)))
    size_mm = off[name][chosen]
    scene.bar = ColourBar.of(f"distance between tip and {start} [mm]", size_mm, SIZE_COLOURS)
    colours = scene.bar.colours(size_mm)
    spikes = prisms(target, ends, FOOT * size, 0.0, np.repeat(colours[:, None], 2, axis=1))
    scene["residuals"].set_object(spikes, flat(by_vertex=True))
    draw_ball(scene, "record", f"{start} of this record", 1.6 * FOOT * size, target[0])
    scene.notes = [
        f"Each spike is a residual, from the {start} towards the tip, magnified {factor:g} times.",
        "The slider shows the residuals, the largest first.",
        TO_SCALE.replace("Lengths are", "The arm is"),
    ]
    texts = {"row": [str(row) for row in records.row[chosen]]}
    seats = np.full(records.n, "") if records.conditions.seat is None else records.conditions.seat
    texts["seat"] = [str(seat or "–") for seat in seats[chosen]]
    texts[start] = [place_text(place) for place in target]
    for which, distances in off.items():
        words = f"residual, {MODEL_WORDS.get(which, which)}"
        texts[words] = [f"{distance:.4f} mm" for distance in distances[chosen]]
    texts |= joint_texts(arm, q)
    del texts["limits"]
    moves = moving(bodies, q, scene) | {"record": placed_at(target)}
    scene.frames = Frames(
        moves, texts, [to_hex(colour) for colour in colours], per_second=PER_SECOND
    )
    return scene


def _distances_mm(result: Calibration | Diagnosis, fit: Fit) -> Array:
    """Of tip and target, or stated place, for each record (n,)."""
    deviation = deviations_of(result, fit)
    return np.asarray(np.linalg.norm(deviation, axis=1) / MM)


def _caption(result: Calibration | Diagnosis, judge: Fit, chosen: Index) -> str:
    rms = rms_of(result)
    sizes = ", ".join(
        f"{size} ({MODEL_WORDS.get(which, which)})"
        for which, size in zip(rms, lengths(rms.values()), strict=True)
    )
    excluded = int(judge.excluded.sum())
    without = f", without {count(excluded, 'excluded record')}" if excluded else ""
    return (
        f"The scene shows {len(chosen)} of {int(judge.used.sum())} used records{without}. The RMS "
        f"residual of all used records is {sizes}."
    )
