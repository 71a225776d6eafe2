"""One parameter of an arm's model, with what is known of its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin._support.plausible import WIDEST_HALF_WIDTHS

Scope = Literal["arm", "session", "record"]


@dataclass(frozen=True)
class Parameter(Shown):
    """A model parameter whose true value differs from the stated one by an unknown error.

    Attributes:
        name: short and unique in its arm, such as ``d3`` or ``encoder_noise4``.
        kind: what it is, such as ``a``, ``d``, ``alpha``, ``theta_offset``, ``encoder``.
        joint: the DH row or joint that it belongs to, from 1; None for the whole arm.
        unit: SI unit, such as ``m`` or ``rad``.
        value: stated value [unit].
        half_width: bound of the error, value ± half_width [unit]; None where no bound is stated.
        u: standard uncertainty [unit].
        scope: ``arm`` (one error for all records), ``session`` (one for each session), ``record``
            (a new one each record).
    """

    name: str
    kind: str
    joint: int | None
    unit: str
    value: float
    half_width: float | None
    u: float
    scope: Scope = "arm"

    @staticmethod
    def bounded(
        name: str, kind: str, joint: int, unit: str, value: float, half_width: float | None
    ) -> Parameter:
        """A parameter known within ± half_width: rectangular distribution, u = half_width/√3 (JCGM
        100:2008, 4.3.7).

        Where no half-width is stated (None) the value counts as exact, u = 0.
        """
        u = (half_width or 0.0) / math.sqrt(3.0)
        return Parameter(name, kind, joint, unit, value, half_width, u)


def wide_half_width_notes(parameters: Sequence[Parameter]) -> list[Note]:
    """A note for lengths, and one for angles, whose half-widths are larger than those of an arm as
    assembled; none otherwise.
    """
    found = []
    for code, unit in (("length_half_widths_large", "m"), ("angle_half_widths_large", "rad")):
        stated = {p.name: p.half_width or 0.0 for p in parameters if p.unit == unit}
        wide = {name: width for name, width in stated.items() if width > WIDEST_HALF_WIDTHS[unit]}
        if wide:
            found.append(Note(code, {"parameters": [*wide], "most": max(wide.values())}))
    return found
