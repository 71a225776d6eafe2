"""What warmth does to lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.chain import axis, end
from aacmm_pin.effects.effect import Displacement, Effect, Term, twist
from aacmm_pin.effects.state import State


@dataclass(frozen=True)
class ThermalExpansion(Effect):
    """Lengths grow with temperature: ``δl = α (T - T0) l``, of the whole arm or of one body; T0 from the arm file.

    Unit 1/K; typical 12e-6 (steel) to 24e-6 (aluminium), 1e-6 carbon. Source: ISO 1:2022. Needs ``temperature_c``, or
    ``temperature1_c …`` of each row: that of the body which moves with it, d and a of the row in standard DH, d of the
    row and a of the next in modified DH. What stands before row 1 has the mean of the rows.
    A body beside the whole arm has what it grows more, below zero where it grows less. Confused with: the scale of the
    reference, ``link_length`` and ``joint_distance`` where the temperature hardly changes; the whole arm with one tube.
    """

    link: int | None = None
    cause: ClassVar[str] = "thermal_expansion"
    needs: ClassVar[tuple[str, ...]] = ("temperature",)
    terms: ClassVar[tuple[Term, ...]] = (
        Term("", "1/K", 2e-5, "expansion_per_k", read_in=("µm/(m·K)", 1e-6), positive=True),
    )

    def displacements(self, state: State) -> list[Displacement]:
        """Each length of the chain per kelvin, times what the record is warmer."""
        rows = range(state.arm.chain.rows + 1) if self.link is None else [state.known_row(self.link)]
        found = []
        for row in rows:
            warmer = self._warmer(state, row)
            found += growth_of_body(state, row, warmer[:, None])
        return found

    def _warmer(self, state: State, row: int) -> Array:
        conditions, reference = state.conditions, state.arm.reference_temperature
        if conditions.link_temperature is not None and 1 <= row <= conditions.link_temperature.shape[1]:
            return np.asarray(conditions.link_temperature[:, row - 1] - reference)
        if conditions.link_temperature is not None and conditions.temperature is None:
            return np.asarray(conditions.link_temperature.mean(axis=1) - reference)  # the stand: nobody measured it
        return np.asarray(conditions.require("temperature", self.label) - reference)


def growth_of_body(state: State, row: int, growth: Array) -> list[Displacement]:
    """The lengths of body ``row`` (0: what stands before row 1).

    Args:
        growth: relative, per unit of each parameter (n, p) [1/unit].
    """
    found = []
    for place in (axis(row), end(row)) if row else (end(0),):
        length = _length_before(state, place)
        if length.any():
            shifts = length[:, None] * growth[:, None]
            found.append(Displacement(place, twist(shifts)))
    return found


def _length_before(state: State, place: int) -> Array:
    """The constant shift from the place before to ``place``, in its own axes; a joint turns it only where it is along z."""
    constant = state.arm.chain.constant[place]
    return np.asarray(constant[:3, :3].T @ constant[:3, 3])
