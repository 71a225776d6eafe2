"""Sentences about the comparison of arms with a measurement file."""

from __future__ import annotations

import math

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Comparison
from aacmm_pin.report.numbers import count


def comparison_in_words(found: Comparison, first: str) -> str:
    """The errors by each arm in a line; ``first`` names the first of two arms. "" if the references
    are of another frame.
    """
    if found.is_of_other_frame:
        return ""
    what = {
        "reference": f"distance from {count(found.count, 'reference')}",
        "bar length": f"error of {count(found.count, 'bar length')}",
        "seat": "distance of records from the mean of their seat, of "
        f"{count(found.count, 'seat')} without coordinates",
    }[found.kind]
    if not math.isnan(found.u):
        what = f"{what} (their u: {found.u / MM:.4f} mm)"
    names = [first, "by this arm"][-len(found.rms) :]
    return f"{what}: RMS {_sizes(found.rms, names)}; largest {_sizes(found.largest, names)}"


def comparison_warning(found: Comparison, arm: str) -> str:
    """A probable mistake, with the name of the last ``arm``; "" if there is none."""
    if found.is_of_other_frame:
        return (
            "references are not compared: their RMS distance from the tip is "
            f"{found.rms[-1] / MM:.0f} mm. The references are not in the base of {arm} or are "
            "of another point, or the angles are in another unit or of another arm; run "
            "aacmm-pin check"
        )
    if found.is_worse:
        return (
            "the correction makes the errors larger; run aacmm-pin diagnose to find what has "
            "changed"
        )
    return ""


def _sizes(sizes: list[float], names: list[str]) -> str:
    pairs = zip(sizes, names, strict=True)
    return ", ".join(f"{size / MM:.4f} mm {name}" for size, name in pairs)
