"""Results of repeated postures, in words and for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from aacmm_pin._support.units import MM, count
from aacmm_pin.calibration import FEWEST_CYCLES, MISFIT, Repeatability
from aacmm_pin.report.numbers import lengths, p_equals, percent


def repeatability_in_words(repeats: Repeatability | None) -> str:
    """Repeatability and drift, compared with the residual; "" without repeats."""
    if repeats is None:
        return ""
    x, y, z = lengths(repeats.sd)
    sentences = [
        f"{len(repeats.posture)} records repeat {count(repeats.cycles.size, 'posture')}. "
        f"The pooled standard deviation is {x} in x, {y} in y and {z} in z."
    ]
    if repeats.rp.size:
        low, middle, high = lengths(np.quantile(repeats.rp, (0.0, 0.5, 1.0)))
        sentences.append(
            "RP is the pose repeatability of ISO 9283: the mean distance from the barycentre plus "
            "3 standard deviations of the distances. For "
            f"{count(repeats.rp.size, 'posture')} with {FEWEST_CYCLES} or more repeats, RP is "
            f"{low} to {high}, with a median of {middle}. RP includes the noise of the instrument."
        )
        if np.isfinite(repeats.reference_u):
            u, rp = lengths([repeats.reference_u, repeats.rp_of_references])
            sentences.append(
                f"The stated noise of the references alone, {u} for each coordinate, gives an RP "
                f"of {rp}."
            )
    if repeats.drift is not None:
        change, p = float(np.linalg.norm(repeats.drift.change)), repeats.drift.p_value
        over = "time" if repeats.is_timed else "the order of the rows"
        tested = f"{p_equals(p)}, threshold {MISFIT:g}"
        sentences.append(
            f"The repeats drift over {over}: by {lengths([change])[0]} from the first to the last "
            f"({tested})."
            if p < MISFIT
            else f"The repeats show no significant drift over {over} ({tested})."
        )
    scatter, residual = lengths([repeats.rms, repeats.rms_residual])
    share = percent((repeats.rms / repeats.rms_residual) ** 2)
    sentences.append(
        f"The RMS distance of the repeats from the mean of their posture is {scatter}. The RMS "
        f"residual after calibration is {residual}. The scatter of the repeats is {share} of the "
        "mean square residual; no calibration of the geometry removes this part."
    )
    return " ".join(sentences)


def repeatability_in_json(repeats: Repeatability | None) -> dict[str, Any] | None:
    """The numbers; None without repeats."""
    if repeats is None:
        return None
    drift = repeats.drift
    return {
        "postures": repeats.cycles.size,
        "records": len(repeats.posture),
        "sd_mm": repeats.sd / MM,
        "rms_mm": repeats.rms / MM,
        "rp_mm": repeats.rp / MM,
        "drift_mm": None if drift is None else drift.change / MM,
        "drift_p_value": None if drift is None else drift.p_value,
        "drift_over": "time" if repeats.is_timed else "rows",
        "residual_mm": repeats.rms_residual / MM,
    }
