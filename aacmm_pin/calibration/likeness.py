"""Whether records have anything to do with the arm: a wrong unit or a column in the wrong place is not a cause."""

from __future__ import annotations

import numpy as np
from scipy.linalg import orthogonal_procrustes

from aacmm_pin.calibration.fit import Fit
from aacmm_pin.checks import Array
from aacmm_pin.errors import AacmmError
from aacmm_pin.units import MM

UNLIKE = 0.03
"""Scatter about the best fit, as a part of what the tips scatter, beyond which records have nothing to do with the arm."""
ALIKE = 0.02
"""What a change of scale or handedness may leave, as a part of the same, to be named as what is wrong."""
UNITS = {1e-3: "in metres, in columns of mm", 1e3: "in mm, in columns of m", 1 / 25.4: "in inches"}
FEW = 6
"""With fewer records with coordinates anything can be turned and scaled to look alike."""


def require_likeness(after: Fit) -> None:
    """Refuse records that have nothing to do with the arm, whatever its parameters: no fit of them means anything.

    Raises:
        AacmmError: after the fit they are off by a large part of what the tips travel.
    """
    records = after.problem.measurements
    tips = after.problem.model.arm.positions(records.q)
    travel = float(np.sqrt(tips.var(axis=0).mean()))
    if after.unmodelled <= UNLIKE * travel:
        return
    guess = _guess(tips[records.known], records.reference[records.known]) or (
        "are the columns of angles and coordinates, their units and signs, the arm and the reference frame right?"
    )
    raise AacmmError(
        f"{records.source} does not fit this arm: {guess} (With the best parameters its records still scatter by "
        f"{after.unmodelled / MM:.0f} mm in each coordinate; the tips at these angles are spread over {travel / MM:.0f} mm.)"
    )


def _guess(tips: Array, reference: Array) -> str:
    """What is wrong, where another scale or handedness alone makes the tips (n, 3) out of the references (n, 3).

    The orthogonal Procrustes problem (Schönemann 1966), which allows mirror images.
    """
    if len(tips) < FEW:
        return ""
    tips, reference = tips - tips.mean(axis=0), reference - reference.mean(axis=0)
    turn, size = orthogonal_procrustes(reference, tips)
    scale = size / float(np.square(reference).sum() or np.inf)
    if np.linalg.norm(scale * reference @ turn - tips) > ALIKE * np.linalg.norm(tips):
        return ""
    factor, name = min(UNITS.items(), key=lambda unit: abs(np.log(unit[0] * scale)))
    mirrored = np.linalg.det(turn) < 0
    said = [f"its coordinates look as if given {name}; convert them"] if abs(factor * scale - 1.0) < ALIKE else []
    if mirrored:
        said.append("its coordinates are a mirror image of the tips: two columns exchanged, or one with the other sign?")
    if not said and abs(scale - 1.0) < ALIKE:
        said.append("its coordinates are the tips seen from another frame: is the reference frame external?")
    return ", and ".join(said)
