"""Sentences on the comparison of arms with a measurement file."""

from __future__ import annotations

import math

from aacmm_pin._support.units import MM, count
from aacmm_pin.calibration import Comparison


def comparison_in_words(found: Comparison, first: str) -> str:
    """The errors by each arm in a line; ``first`` names the first. "" if the references are in
    another frame.
    """
    if found.is_of_other_frame:
        return ""
    what = {
        "reference": f"distance between tip and reference ({count(found.count, 'reference')}",
        "bar length": f"error of bar lengths ({count(found.count, 'bar')}",
        "seat": "distance between tip and mean of the seat "
        f"({count(found.count, 'seat')} without coordinates",
    }[found.kind]
    if not math.isnan(found.u):
        what = f"{what} with u = {found.u / MM:.4f} mm"
    names = [f"for {first}", "after correction"][-len(found.rms) :]
    sizes = zip(names, found.rms, found.largest, strict=True)
    errors = [f"{r / MM:.4f} mm {name} (at most {most / MM:.4f} mm)" for name, r, most in sizes]
    return f"The RMS {what}) is {' and '.join(errors)}"


def comparison_warning(found: Comparison, arm: str) -> str:
    """A probable mistake, with the name of the last ``arm``; else ""."""
    if found.is_of_other_frame:
        return (
            "correct did not compare the references, because their RMS distance from the tip of "
            f"{arm} is {found.rms[-1] / MM:.0f} mm. Run aacmm-pin check, with --reference-frame "
            "external if the references are in another frame. The corrected coordinates are in the "
            "frame of the base"
        )
    if found.is_worse:
        return "the correction makes the errors larger; run aacmm-pin diagnose to find what changed"
    if found.is_far:
        times = found.rms[-1] / found.expected
        return (
            f"the RMS distance to the references is {times:.0f} times its standard uncertainty; "
            "run aacmm-pin check, and aacmm-pin diagnose to find what changed"
        )
    return ""
