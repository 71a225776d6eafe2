"""Residuals where they are: lines from each stated place towards the tip, with the arm in the posture of the record."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.colors import to_hex

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.plots.residual_vectors import magnification_of, models, off_stated, postures_of, some_of
from aacmm_pin.report.plots.style import VERMILLION
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
from aacmm_pin.report.scenes.shapes import flat, placed_at, prisms

SIZE_COLOURS = "plasma"
FOOT = 0.005
"""Radius of the foot of a residual's spike, in sizes of the scene."""
PER_SECOND = 4.0


def diagnosis_scene(result: Diagnosis, model: str = "extended") -> Scene:
    """Residuals of a diagnosis by one of its models, magnified, and the arm in the postures of the records.

    Spikes go from each stated place towards the tip; where none is stated, from where the records of the seat put it.
    The slider goes from the largest residual to the smallest.

    Args:
        result: the diagnosis.
        model: ``simulation``, ``recalibrated`` or ``extended``.

    Raises:
        UnknownNameError: no such model.
    """
    fits = models(result)
    if model not in fits:
        raise UnknownNameError("model", model, list(fits))
    return _scene(result.model.arm, fits, model, result.extended, f"residuals of the {model} model")


def calibration_scene(result: Calibration, when: str = "after") -> Scene:
    """The same of a calibration.

    Args:
        result: the calibration.
        when: ``before``, by the arm as it was, or ``after``.

    Raises:
        UnknownNameError: ``when`` is something else.
    """
    fits = {"before": result.before, "after": result.fit}
    if when not in fits:
        raise UnknownNameError("when", when, list(fits))
    return _scene(result.model.arm, fits, when, result.fit, f"residuals {when} calibration")


def _scene(arm: Arm, fits: Mapping[str, Fit], name: str, judge: Fit, words: str) -> Scene:
    fit, frame = fits[name], fits[name].solution.point.frame
    records = fit.problem.measurements
    chosen = some_of(np.flatnonzero(judge.used))
    off = {which: np.linalg.norm(off_stated(one)[chosen], axis=1) / MM for which, one in fits.items()}
    order = np.argsort(-off[name], kind="stable")
    chosen, off = chosen[order], {which: sizes[order] for which, sizes in off.items()}
    deviation = off_stated(fit)[chosen] @ frame.rotation  # in the base, where the arm is drawn
    target = frame.back(fit.solution.point.prediction.tips[chosen]) - deviation
    factor = magnification_of(target, deviation)
    bar, bodies = ColourBar.of("distance of tip and stated place [mm]", off[name], SIZE_COLOURS), Bodies(arm)
    q = records.q[chosen]
    points = np.vstack([bodies.corners(q).reshape(-1, 3), target, target + factor * deviation])
    size = float(np.ptp(points, axis=0).max())

    scene = Scene(f"{arm.name}: {words}", _caption(judge, chosen, off))
    stage = surroundings(scene, bodies, points)
    draw_ghosts(scene, bodies.radius, map(frame.back, postures_of(judge)))
    colours = np.repeat(bar.colours(off[name])[:, None], 2, axis=1)
    spikes = prisms(target, target + factor * deviation, FOOT * size, 0.0, colours)
    scene["residuals"].set_object(spikes, flat(by_vertex=True))
    put_ball(scene, "record", VERMILLION, 1.6 * FOOT * size, target[0], opacity=0.7)
    seats = records.conditions.seat
    texts = {
        "row": [str(row) for row in records.row[chosen]],
        "seat": ["–"] * len(chosen) if seats is None else [str(seat or "–") for seat in seats[chosen]],
        "stated place": [place_text(place) for place in target],
        **{f"off, {which}": [f"{length:.4f} mm" for length in lengths] for which, lengths in off.items()},
        **joint_texts(arm, q),
    }
    texts.pop("limits")
    scene.frames = Frames(
        moving(bodies, q, scene) | {"record": placed_at(target)},
        texts,
        [to_hex(colour) for colour in bar.colours(off[name])],
        per_second=PER_SECOND,
    )
    marks = [Swatch(VERMILLION, "stated place of this record"), Swatch(GHOST, "other postures", "line"), *stage]
    notes = [
        f"Residuals are magnified {factor:g} times: a spike stands with its foot on the stated place and points to the tip.",
        "The slider goes from the largest residual to the smallest.",
        TO_SCALE.replace("Lengths are", "The arm is"),
    ]
    scene.legend = Legend(marks, [bar], notes)
    scene.view = view_of(bodies, points, target.mean(axis=0))
    return scene


def _caption(judge: Fit, chosen: Index, off: Mapping[str, Array]) -> str:
    sizes = ", ".join(f"{which} {np.sqrt(np.mean(np.square(values))):.4f} mm" for which, values in off.items())
    excluded = int(judge.excluded.sum())
    without = f"; {excluded} excluded" if excluded else ""
    return (
        f"{len(chosen)} of {int(judge.used.sum())} records are drawn{without}. RMS distance from the stated places, whose "
        f"own noise is in it: {sizes}."
    )
