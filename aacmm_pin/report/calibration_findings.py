"""What a calibration found, in sentences and tables for people; the numbers are those of :class:`Calibration`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration, HeldOut
from aacmm_pin.calibration.problem import geometric_parameters
from aacmm_pin.effects import StylusOffset
from aacmm_pin.effects.labels import in_words, values_in_words

WORTH = 0.05
"""A calibration whose held-out residuals fall by less than this part has not helped."""
DIGITS = {"mm": "z.5f", "rad": "z.7f"}
"""Formats of values."""
MISFIT = 1e-3
"""χ² with less chance than this, or with more than one minus this, does not fit the stated noise."""


def verdict(result: Calibration) -> str:
    """One sentence: whether the calibration helps, by records that it never saw where there are some."""
    name = result.model.arm.name
    fitted = f"{result.rms_before / MM:.4f} mm before, {result.rms / MM:.4f} mm after"
    if not result.held_out:
        return f"{name}: the records it was fitted to are off by {fitted} (RMS); nothing was held out, so this may flatter."
    held = result.held_out[-1]
    gain = 1.0 - held.rms_after / held.rms_before
    seen = f"{held.rms_before / MM:.4f} mm before, {held.rms_after / MM:.4f} mm after"
    if gain >= WORTH:
        word = f"Calibration helps {name}: {_held_words(held)} it never saw are off by {seen} (RMS), {100 * gain:.0f} % less"
    else:
        word = f"Calibration does not help {name}: {_held_words(held)} it never saw are off by {seen} (RMS)"
    return f"{word}; the records it was fitted to by {fitted}."


def _held_words(held: HeldOut) -> str:
    return "blocks of joint space" if held.kind == "blocks" else held.kind


def fit_in_words(result: Calibration) -> str:
    """What χ² says about the model and the stated noise."""
    judged, p = result.fit.chi2_stated, result.p_value
    if judged is None or p is None:
        if result.fit.stated:
            return "There are no more numbers than parameters, so nothing can be said about the fit."
        why = "The noise was not stated in full, so χ² cannot judge the model"
        if not result.fit.scatters:
            return f"{why}; what was stated of it is enough for these residuals."
        return (
            f"{why}: beyond what was stated the residuals show {result.fit.unmodelled / MM:.4f} mm per coordinate, noise "
            "and what the model lacks together."
        )
    numbers = f"χ² = {judged[0]:.0f} with {judged[1]:.0f} degrees of freedom, p = {p:.2g}"
    if p < MISFIT:
        what = "Something is not in this model; diagnose looks for what it is."
        return f"The residuals are larger than the stated noise explains: {numbers}. {what}"
    if p > 1.0 - MISFIT:
        return f"The residuals are smaller than the stated noise: {numbers}. The noise is stated too large."
    return f"The residuals are what the stated noise explains: {numbers}."


def frame_in_words(result: Calibration) -> str:
    """Where the base is in the frame of the references; "" where the two are one."""
    if not result.fit.problem.external:
        return ""
    frame = result.fit.solution.point.frame
    x, y, z = frame.shift / MM
    return (
        f"The base stands at ({x:.4f}, {y:.4f}, {z:.4f}) mm in the frame of the references, its axes in that frame are "
        f"x {_axis(frame.rotation[:, 0])}, y {_axis(frame.rotation[:, 1])}, z {_axis(frame.rotation[:, 2])}; turned by "
        f"{np.arccos(np.clip((np.trace(frame.rotation) - 1) / 2, -1, 1)) / DEG:.4f}° in all."
    )


def _axis(direction: Array) -> str:
    return "(" + ", ".join(f"{component:.6f}" for component in direction) + ")"


def stated_half_widths(result: Calibration) -> Array:
    """How far off each parameter was said to be, ± (p,) [SI]; nan where nobody said it, or said that it is exact.

    The half-width of the arm file, or k u with k = 2 of a cause with a standard uncertainty.
    """
    problem = result.fit.problem
    found: list[float] = []
    for effect in problem.estimated:
        of_arm = geometric_parameters(problem.model.arm, effect)
        found += [p.half_width or COVERAGE_FACTOR * p.u for p in of_arm or effect.parameters()]
    return np.array([width or np.nan for width in found])


def parameter_table(result: Calibration) -> pd.DataFrame:
    """:attr:`Calibration.parameters` with ``stated``, how far off each was said to be, and ``beyond``.

    ``beyond`` is True where the change exceeds √(stated² + U²): the two values disagree, E_n > 1 (ISO/IEC 17043, B.3.1.3).
    """
    table = result.parameters
    stated = stated_half_widths(result) / np.where(table["unit"] == "mm", MM, 1.0)
    return table.assign(stated=stated, beyond=np.abs(table["change"]) > np.hypot(stated, table["U"]))


def readable_parameters(result: Calibration) -> pd.DataFrame:
    """The same for reading: value with its unit as text; changes and uncertainties in µm and µrad, see column ``in``."""
    table = parameter_table(result)
    small = [small_unit(unit) for unit in table["unit"]]
    factor = np.array([f for _, f in small])
    values = zip(table["after"], table["unit"], strict=True)
    readable = {
        "parameter": table["parameter"],
        "value": [f"{value:{DIGITS.get(unit, '.6g')}} {unit}".removesuffix(" 1") for value, unit in values],
        "in": [unit for unit, _ in small],
    }
    readable |= {name: table[name] * factor for name in ("change", "stated", "u", "U")}
    return pd.DataFrame(readable | {"known": table["known"], "beyond": table["beyond"]})


def sizes_table(result: Calibration) -> pd.DataFrame:
    """RMS distance of tip and target before and after [mm], of the records of the fit and of those left out of it."""
    rows = [("used in the fit", result.rms_before / MM, result.rms / MM)]
    rows += [(f"left out, {_held_words(held)}", held.rms_before / MM, held.rms_after / MM) for held in result.held_out]
    return pd.DataFrame(rows, columns=["records", "before [mm]", "after [mm]"])


def small_unit(unit: str) -> tuple[str, float]:
    """The unit of changes of a parameter, and how many of it make one of ``unit``."""
    if unit == "mm":
        return "µm", 1e3
    return ("µ" + unit if unit.startswith("rad") else "10⁻⁶" + unit.removeprefix("1")), 1e6


def decimals(table: pd.DataFrame) -> str:
    """Format of the changes and uncertainties of :func:`readable_parameters`: two digits of the smaller u, 1 at least."""
    u = table["u"].to_numpy()
    smaller = float(np.quantile(u[u > 0], 0.25)) if (u > 0).any() else 1.0
    return f"z.{min(6, max(1, 1 - int(np.floor(np.log10(smaller)))))}f"


def causes_in_words(result: Calibration) -> list[str]:
    """Estimated causes of error as people state them, amplitude and phase of a wave such as, with their U (k = 2)."""
    found, first = [], 0
    problem = result.fit.problem
    for effect in problem.effects(result.fit.solution.point.x):
        own = slice(first, first + len(effect.terms))
        first = own.stop
        if geometric_parameters(problem.model.arm, effect):
            continue
        jacobian = effect.described_jacobian()
        u = np.sqrt(np.diag(jacobian @ result.covariance[own, own] @ jacobian.T))
        values = {key: (value, float(s)) for (key, value), s in zip(effect.described().items(), u, strict=True)}
        found.append(f"{in_words(effect)}: {values_in_words(values)}")
    return found


def not_in_urdf(result: Calibration) -> list[str]:
    """Labels of the effects for which a URDF has no place."""
    return [e.label for e in result.model.effects if not (isinstance(e, StylusOffset) and e.marker is None)]


def comment(result: Calibration, data: str, when: str) -> str:
    """The lines in front of a calibrated arm file: from which data, when, how good, and how to read what follows.

    Args:
        result: the calibration.
        data: the file that was used, as the user named it.
        when: date (UTC).
    """
    used, left = int(result.fit.used.sum()), int(result.fit.excluded.sum())
    held = "".join(f", {h.rms_after / MM:.4f} mm on held-out {_held_words(h)}" for h in result.held_out)
    lines = [
        f"Calibrated by aacmm-pin on {when} (UTC) from {data}: {used} records used, {left} excluded.",
        f"RMS distance of tip and target: {result.rms_before / MM:.4f} mm before, {result.rms / MM:.4f} mm after{held}.",
        fit_in_words(result),
        *(f"Note: {line}." for line in result.notes),
        *(f"Not told by these data: {line}." for line in result.undetermined),
        "",
        "How to read it: values are those after calibration. [covariance] holds the standard uncertainties (SI: m, rad)",
        "of the parameters it names, and their correlations: row i is that of parameter i with those before it. It",
        "overrides [joints.uncertainty], the half-widths from before, which stay for parameters that it does not name.",
    ]
    return "\n".join(lines)


def calibration_summary(result: Calibration, data: str, seed: int) -> dict[str, Any]:
    """Schema ``aacmm-pin/calibration/1`` of :meth:`Calibration.summary`, with what it was made from.

    Args:
        result: the calibration.
        data: the measurement file.
        seed: of the generator that chose the held-out records.
    """
    problem, table = result.fit.problem, parameter_table(result)
    summary = result.summary()
    stated = [None if np.isnan(width) else float(width) for width in table["stated"]]
    for row, width, beyond in zip(summary["parameters"], stated, table["beyond"], strict=True):
        row |= {"stated": width, "beyond_stated": bool(beyond)}
    frame = result.fit.solution.point.frame
    placement = {"origin_mm": (frame.shift / MM).tolist(), "rotation": frame.rotation.tolist()}
    return summary | {
        "data": data,
        "seed": seed,
        "verdict": verdict(result),
        "base_in_reference_frame": placement if problem.external else None,
    }
