"""A parameter of the model of an arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.plausible import WIDEST_HALF_WIDTHS

Scope = Literal["arm", "session", "record"]


@dataclass(frozen=True)
class Parameter(Shown):
    """Model parameter with an unknown error.

    Attributes:
        name: unique in the arm, such as ``d3`` or ``encoder_noise4``.
        kind: such as ``a``, ``d``, ``alpha``, ``theta_offset``, ``encoder``.
        joint: DH row or joint, from 1; None for the whole arm.
        unit: SI.
        value: stated [unit].
        half_width: largest possible error [unit]; None if not stated.
        u: standard uncertainty [unit].
        scope: one error for the ``arm``, or a new one in each ``session`` or ``record``.
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
        """Return a parameter within ± half_width, with u = half_width/√3 (0 for None).

        Source: rectangular distribution, JCGM 100:2008, 4.3.7.
        """
        u = (half_width or 0.0) / math.sqrt(3.0)
        return Parameter(name, kind, joint, unit, value, half_width, u)


def wide_half_width_notes(parameters: Sequence[Parameter]) -> list[Note]:
    """Notes on half-widths larger than those of an arm as assembled."""
    notes = []
    for unit, shown in (("m", "mm"), ("rad", "°")):
        stated = {p.name: p.half_width or 0.0 for p in parameters if p.unit == unit}
        wide = {name: width for name, width in stated.items() if width > WIDEST_HALF_WIDTHS[unit]}
        if wide:
            data = {"parameters": [*wide], "most": max(wide.values()), "unit": shown}
            notes.append(Note("half_widths_large", data))
    return notes
