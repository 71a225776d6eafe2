"""What a comparison of arms with a measurement file says."""

from __future__ import annotations

import math

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Comparison
from aacmm_pin.report.numbers import count


def comparison_in_words(found: Comparison, first: str) -> str:
    """The errors by each arm in a line; ``first`` says which arm the first of two is. Nothing if
    the references are of another frame.
    """
    if found.is_of_other_frame:
        return ""
    what = {
        "reference": f"distance from {count(found.count, 'reference')}",
        "bar length": f"error of {count(found.count, 'bar length')}",
        "seat": f"distance from the mean of the touches of {count(found.count, 'seat')} without "
        "coordinates",
    }[found.kind]
    if not math.isnan(found.u):
        what = f"{what}, themselves with u = {found.u / MM:.4f} mm"
    names = [first, "by this arm"][-len(found.rms) :]
    return f"{what}: RMS {_sizes(found.rms, names)}; largest {_sizes(found.largest, names)}"


def comparison_warning(found: Comparison, arm: str) -> str:
    """What may be wrong, of which ``arm`` is the name of the last; nothing if all seems well."""
    if found.is_of_other_frame:
        return (
            f"references are not compared: the tip is {found.rms[-1] / MM:.0f} mm from them (RMS). "
            f"They are in another frame than the base of {arm}, of another point, or the angles "
            "are in another unit or of another arm; aacmm-pin check names common mistakes"
        )
    if found.is_worse:
        return "this arm and its effects make it worse; aacmm-pin diagnose says what has changed"
    return ""


def _sizes(sizes: list[float], names: list[str]) -> str:
    pairs = zip(sizes, names, strict=True)
    return ", ".join(f"{size / MM:.4f} mm {name}" for size, name in pairs)
