"""Sentences on the comparison of arms with a measurement file."""

from __future__ import annotations

import math

from aacmm_pin._support.units import MM, count
from aacmm_pin.calibration import Comparison


def comparison_in_words(comparison: Comparison, first_arm: str) -> str:
    """The errors by each arm in a line; ``first_arm`` names the first. "" if the references are in
    another frame.
    """
    if comparison.is_of_other_frame:
        return ""
    kind_of_errors = {
        "reference": f"distance between tip and reference ({count(comparison.count, 'reference')}",
        "bar length": f"error of bar lengths ({count(comparison.count, 'bar')}",
        "seat": "distance between tip and mean of the seat "
        f"({count(comparison.count, 'seat')} without coordinates",
    }[comparison.kind]
    if not math.isnan(comparison.u):
        kind_of_errors = f"{kind_of_errors} with u = {comparison.u / MM:.4f} mm"
    names = [f"for {first_arm}", "after correction"][-len(comparison.rms) :]
    sizes = zip(names, comparison.rms, comparison.largest, strict=True)
    errors = [f"{r / MM:.4f} mm {name} (at most {most / MM:.4f} mm)" for name, r, most in sizes]
    return f"The RMS {kind_of_errors}) is {' and '.join(errors)}"


def comparison_warning(comparison: Comparison, arm: str) -> str:
    """A probable mistake, with the name of the last ``arm``; else ""."""
    if comparison.is_of_other_frame:
        return (
            "correct did not compare the references, because their RMS distance from the tip of "
            f"{arm} is {comparison.rms[-1] / MM:.0f} mm. Run aacmm-pin check, with "
            "--reference-frame external if the references are in another frame. The corrected "
            "coordinates are in the frame of the base"
        )
    if comparison.is_worse:
        return "the correction makes the errors larger; run aacmm-pin diagnose to find what changed"
    if comparison.is_far:
        times = comparison.rms[-1] / comparison.expected
        return (
            f"the RMS distance to the references is {times:.0f} times its standard uncertainty; "
            "run aacmm-pin check, and aacmm-pin diagnose to find what changed"
        )
    return ""
