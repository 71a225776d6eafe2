"""What no cause explains, as smooth functions of what was recorded: described, and not named."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.chain import BASE, axis
from aacmm_pin.arm.file import DiscrepancyEntry, DiscrepancyPart
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis, twist
from aacmm_pin.effects.smooth_functions import Cosines, Smooth, as_filed, as_read, needs_of, product_of
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

CARRIERS = re.compile(r"room|target|lengths|(before|angle|slide) [1-9]\d{0,2}")
"""What the functions may act on, see :class:`Carrier`."""
DIGITS = 7
"""Significant digits of a direction in a file: 1e-7 of any displacement is far below the noise of any arm."""
TYPICAL = {"angle": ("rad", 4e-5), "lengths": ("1", 2e-5), "target": ("m", 1e-3)}
"""Unit and usual magnitude of a coefficient, by what it acts on; of all others those of a shift of the tip."""
SHIFT = ("m", 2e-5)


@dataclass(frozen=True)
class Carrier:
    """What the functions of a discrepancy act on.

    Attributes:
        name: ``room`` (the tip shifts along the axes of the base), ``target`` (along those of the last body),
            ``before j`` (along those of the body before row j), ``angle j`` (the angle of row j; ``slide j`` of one that
            slides), ``lengths`` (the distance of the tip from the base grows).
    """

    name: str

    def __post_init__(self) -> None:
        if not CARRIERS.fullmatch(self.name):
            expected = "expected room, target, before j, angle j, slide j or lengths, j the number of a row"
            raise AacmmError(f"a discrepancy acts on {self.name!r}, {expected}")

    @property
    def what(self) -> str:
        """The name without the row."""
        return self.name.partition(" ")[0]

    @property
    def row(self) -> int:
        """Row of a joint; only of carriers that have one."""
        return int(self.name.partition(" ")[2])

    @property
    def axes(self) -> int:
        """How many coefficients each function has."""
        return 1 if self.what in ("angle", "slide", "lengths") else 3

    @property
    def in_words(self) -> str:
        """What is off."""
        row = self.name.partition(" ")[2]
        words = {
            "room": "the tip shifts in the room",
            "target": "the target sits elsewhere on the last body",
            "before": f"the tip shifts along the body before joint {row}",
            "angle": f"the angle of joint {row} is off",
            "slide": f"the position of joint {row} is off",
            "lengths": "all lengths grow",
        }
        return words[self.what]

    @property
    def quantities(self) -> dict[str, float]:
        """What it changes: names with unit, and how many SI units one of them is."""
        if self.what in ("angle", "slide"):
            return {f"delta{self.row}_{'urad' if self.what == 'angle' else 'um'}": 1e-6}
        return {"growth_um_per_m": 1e-6} if self.what == "lengths" else dict.fromkeys(("x_mm", "y_mm", "z_mm"), MM)

    @property
    def typical(self) -> tuple[str, float]:
        """Unit of a coefficient, and its usual magnitude [that unit]."""
        return TYPICAL.get(self.what, SHIFT)

    def displacement(self, state: State, shifts: Array) -> Displacement:
        """The place that moves, by ``shifts`` along the axes of the carrier (n, axes, p) [m, rad, m/m per unit]."""
        if self.what in ("angle", "slide"):
            return about_axis(state, self.row, shifts[:, 0])
        if self.what == "lengths":
            return Displacement(BASE, twist(state.position[:, :, None] * shifts))
        last = state.arm.chain.tip
        place = {"room": BASE, "target": last}.get(self.what)
        return Displacement(axis(state.known_row(self.row)) - 1 if place is None else place, twist(shifts))


@dataclass(frozen=True)
class Part:
    """Functions of a discrepancy on one carrier.

    Attributes:
        carrier: what they act on.
        functions: products with one function of each of these; () for the constant 1.
        directions: coefficients of the functions, those of each on all axes together, per unit of each parameter
            (functions · axes, p); () where each coefficient is a parameter.
    """

    carrier: Carrier
    functions: tuple[Smooth, ...]
    directions: tuple[tuple[float, ...], ...] = field(default=(), repr=False)

    @property
    def coefficients(self) -> int:
        """How many coefficients the functions have on all axes."""
        return self.carrier.axes * math.prod(each.number for each in self.functions)

    def displacement(self, state: State) -> Displacement:
        """By one unit of each parameter."""
        each = np.array(self.directions) if self.directions else np.eye(self.coefficients)
        of_functions = each.reshape(-1, self.carrier.axes, each.shape[1])
        return self.carrier.displacement(state, np.tensordot(product_of(self.functions, state), of_functions, 1))

    def filed(self) -> DiscrepancyPart:
        """The part as an arm file has it."""
        return DiscrepancyPart(
            acts_on=self.carrier.name,
            functions=[as_filed(each) for each in self.functions],
            directions=tuple(tuple(float(f"{x:.{DIGITS}g}") for x in row) for row in self.directions),
        )


@dataclass(frozen=True)
class Discrepancy(Effect):
    """What no cause explains: smooth functions of what was recorded, with coefficients that a fit gave them.

    It is described and not named: it is no candidate of a diagnosis, which holds it as the arm's file states it, as a
    calibration does. Outside the range of the records that it was fitted to, functions of time, temperature and ranks stay
    as they are at its ends.

    Attributes:
        covariate: what it depends on, such as ``joint 2 × joint 4``.
        parts: the functions and what they act on. Several of them share the parameters.
        size: number of parameters.
    """

    covariate: str
    parts: tuple[Part, ...] = field(repr=False)
    size: int
    cause: ClassVar[str] = "discrepancy"

    def __post_init__(self) -> None:
        """Check that all parts have the same parameters."""
        alone = len(self.parts) == 1 and not self.parts[0].directions
        if alone and self.size != self.parts[0].coefficients:
            raise AacmmError(f"{self.label}: {self.size} values, expected {self.parts[0].coefficients} coefficients")
        for part in () if alone else self.parts:
            if len(part.directions) != part.coefficients or {*map(len, part.directions)} != {self.size}:
                expected = (
                    f"directions of {part.coefficients} coefficients with {self.size} numbers each, one for each value"
                )
                raise AacmmError(f"{self.label}: {part.carrier.name}: expected {expected}")
        super().__post_init__()

    @property
    def label(self) -> str:
        """What it depends on, and what it acts on."""
        return f"{self.cause}:{self.covariate}" + (f" on {self.parts[0].carrier.name}" if len(self.parts) == 1 else "")

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions that it is a function of."""
        return needs_of(self._functions)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The coefficients; of shared directions, their factors."""
        part = self.parts[0]
        unit, typical = ("1", 1.0) if part.directions else part.carrier.typical
        read_in = ("1", 1.0) if part.directions else None
        return tuple(Term(f"c{k}", unit, typical, f"c{k}", read_in=read_in) for k in range(1, self.size + 1))

    @property
    def _functions(self) -> list[Smooth]:
        return [each for part in self.parts for each in part.functions]

    def inner_in_words(self) -> list[str]:
        """What it depends on, and what is off."""
        alone = len(self.parts) == 1
        return [f"over {self.covariate}", *([self.parts[0].carrier.in_words] if alone else [])]

    def displacements(self, state: State) -> list[Displacement]:
        """The functions along the axes of their carriers."""
        return [part.displacement(state) for part in self.parts]

    def filed(self) -> DiscrepancyEntry:
        """The discrepancy as an arm file has it."""
        parts = [part.filed() for part in self.parts]
        u = self.u if any(self.u) else ()
        return DiscrepancyEntry(depends_on=self.covariate, parts=parts, values_si=self.values, standard_uncertainty_si=u)

    def to_be_told(self, conditions: Conditions) -> list[str]:
        """That readings are outside the range of time or temperature that it was fitted to."""
        found = dict[str, str]()
        for each in self._functions:
            if isinstance(each, Cosines) and each.of in self.needs:
                values = conditions.require(each.of, self.label)
                outside = int(((values < each.at_si[0]) | (values > each.at_si[-1])).sum())
                if outside:
                    where = f"the {each.of} that {self.label} was fitted to, {each.at_si[0]:.4g} to {each.at_si[-1]:.4g}"
                    found[each.of] = f"{outside} of {conditions.n} records are outside {where}: it stays as at the end"
        return list(found.values())


def discrepancy_of(entry: DiscrepancyEntry) -> Discrepancy:
    """The discrepancy that an arm file has.

    Raises:
        AacmmError: its functions, carriers or directions are none.
    """
    parts = tuple(
        Part(Carrier(part.acts_on), tuple(as_read(each) for each in part.functions), part.directions) for part in entry.parts
    )
    values, u = entry.values_si, entry.standard_uncertainty_si
    return Discrepancy(entry.depends_on, parts, len(values), values=values, u=u).require_plausible()
