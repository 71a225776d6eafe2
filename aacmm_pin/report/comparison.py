"""What a comparison of arms with a measurement file says."""

from __future__ import annotations

import math
from collections.abc import Iterator

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Comparison
from aacmm_pin.report.numbers import count


def comparison_notes(found: Comparison, arm: str) -> Iterator[str]:
    """The errors before and after in a line, with warnings; ``arm`` is the name of the last."""
    if found.is_of_other_frame:
        yield (
            f"warning: references are not compared: the tip is {found.rms[-1] / MM:.0f} mm "
            f"from them (RMS). They are in another frame than the base of {arm}, of another "
            "point, or the angles are in another unit or of another arm"
        )
        return
    what = {
        "reference": f"distance from {count(found.count, 'reference')}",
        "bar length": f"error of {count(found.count, 'bar length')}",
        "seat": f"distance from the mean of the touches of {count(found.count, 'seat')} without "
        "coordinates",
    }[found.kind]
    if not math.isnan(found.u):
        what = f"{what}, themselves with u = {found.u / MM:.4f} mm"
    yield f"{what}: RMS {_sizes(found.rms)}; largest {_sizes(found.largest)}"
    if found.is_worse:
        yield (
            "warning: this arm and its effects make it worse; aacmm-pin diagnose says what "
            "has changed"
        )


def _sizes(sizes: list[float]) -> str:
    names = ["before", "after"] if len(sizes) > 1 else ["by this arm"]
    pairs = zip(sizes, names, strict=True)
    return ", ".join(f"{size / MM:.4f} mm {name}" for size, name in pairs)
