"""What no cause explains, as smooth functions of what was recorded: described, and not named."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, DiscrepancyEntry, DiscrepancyPart, axis
from aacmm_pin.effects.conditions import CONDITION_UNITS, Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis, twist
from aacmm_pin.effects.environment import growth_of_body
from aacmm_pin.effects.smooth_functions import (
    Cosines,
    Smooth,
    as_filed,
    as_read,
    needs_of,
    product_of,
)
from aacmm_pin.effects.state import State
from aacmm_pin.effects.tube import tubes
from aacmm_pin.errors import AacmmError

OF_ROW = r"(before|angle|slide|tube) [1-9]\d{0,2}"
CARRIERS = re.compile(f"room|target|lengths|tubes|{OF_ROW}")
"""What the functions may act on, see :class:`Carrier`."""
DIRECTION_DIGITS = 7
"""Significant digits of a direction in a file: 1e-7 of any displacement is far below the noise of
any arm.
"""
OF_TIP = dict.fromkeys(("x_mm", "y_mm", "z_mm"), MM)
GROWTH = {"growth_um_per_m": 1e-6}


class Kind(NamedTuple):
    """A kind of carriers, whose row stands for ``{row}``.

    Attributes:
        code: of the note that says what is off.
        quantities: what it changes: names with unit, and how many SI units one of them is.
        unit: of a coefficient.
        typical: usual magnitude of a coefficient [that unit].
    """

    code: str
    quantities: dict[str, float]
    unit: str
    typical: float


CARRIER_KINDS = {
    "room": Kind("tip_shifts_in_room", OF_TIP, "m", 2e-5),
    "target": Kind("target_elsewhere", OF_TIP, "m", 1e-3),
    "before": Kind("tip_shifts_before_joint", OF_TIP, "m", 2e-5),
    "angle": Kind("joint_angle_off", {"delta{row}_urad": 1e-6}, "rad", 4e-5),
    "slide": Kind("joint_position_off", {"delta{row}_um": 1e-6}, "m", 2e-5),
    "lengths": Kind("lengths_grow", GROWTH, "1", 2e-5),
    "tubes": Kind("tubes_grow", GROWTH, "1", 2e-5),
    "tube": Kind("tube_grows", GROWTH, "1", 2e-5),
}
"""By the name of a carrier without its row."""


@dataclass(frozen=True)
class Carrier:
    """The quantity that the functions of a discrepancy change.

    Attributes:
        name: one of the names below.

    The names are:

    - ``room``: translation of the tip along the axes of the base.
    - ``target``: translation of the tip along the axes of the last body.
    - ``before j``: translation of the tip along the axes of the body before row j.
    - ``angle j``, ``slide j``: angle or position of joint j.
    - ``lengths``: distance of the tip from the base.
    - ``tubes``, ``tube j``: length of all tubes, or of the body of row j.
    """

    name: str

    def __post_init__(self) -> None:
        if not CARRIERS.fullmatch(self.name):
            raise AacmmError(
                f"acts_on is {self.name!r}; expected room, target, lengths, tubes, or one of "
                "before, angle, slide, tube with the number of a row"
            )

    @property
    def what(self) -> str:
        """The name without the row."""
        return self.name.partition(" ")[0]

    @property
    def kind(self) -> Kind:
        """The common properties of all carriers with the same name without row."""
        return CARRIER_KINDS[self.what]

    @property
    def row(self) -> int:
        """The row of the joint; only for carriers with a row."""
        return int(self.name.partition(" ")[2])

    @property
    def axes(self) -> int:
        """The number of coefficients of each function."""
        return len(self.kind.quantities)

    @property
    def in_words(self) -> str:
        """The changed quantity as text."""
        _, _, row = self.name.partition(" ")
        return str(Note(self.kind.code, {"row": row}))

    @property
    def quantities(self) -> dict[str, float]:
        """The names of the changed quantities, with their units in SI."""
        names = map(self._with_row, self.kind.quantities)
        return dict(zip(names, self.kind.quantities.values(), strict=True))

    def _with_row(self, text: str) -> str:
        return text.format(row=self.name.partition(" ")[2])

    def displacements(self, state: State, shifts: Array) -> list[Displacement]:
        """Return the displacements of the places that move.

        Args:
            state: the arm in n records.
            shifts: displacements along the axes of the carrier ``(n, axes, p)`` [m, rad, m/m per
                unit].
        """
        if self.what in ("angle", "slide"):
            return [about_axis(state, self.row, shifts[:, 0])]
        if self.what in ("tube", "tubes"):
            rows = tubes(state.arm) if self.what == "tubes" else [state.known_row(self.row)]
            return [moved for row in rows for moved in growth_of_body(state, row, shifts[:, 0])]
        if self.what == "lengths":
            shifts = state.position[:, :, None] * shifts
        return [Displacement(self._place(state), twist(shifts))]

    def _place(self, state: State) -> int:
        """The place along whose axes the tip shifts."""
        if self.what == "before":
            return axis(state.known_row(self.row)) - 1
        return state.arm.chain.tip if self.what == "target" else BASE


@dataclass(frozen=True)
class Part:
    """One part of a discrepancy: functions of covariates that change one quantity.

    Attributes:
        carrier: the quantity that the functions change.
        functions: sets of functions whose products the part uses; () for the constant 1.
        directions: coefficients of the functions for one unit of each parameter, function by
            function, ``(functions · axes, p)``; () if each coefficient is a parameter.
    """

    carrier: Carrier
    functions: tuple[Smooth, ...]
    directions: tuple[tuple[float, ...], ...] = field(default=(), repr=False)

    @property
    def coefficients(self) -> int:
        """The number of coefficients on all axes."""
        functions = math.prod(each.number for each in self.functions)
        return functions * self.carrier.axes

    def displacements(self, state: State) -> list[Displacement]:
        """Return the displacements for one unit of each parameter."""
        rows = np.array(self.directions) if self.directions else np.eye(self.coefficients)
        of_functions = rows.reshape(-1, self.carrier.axes, rows.shape[1])
        functions = product_of(self.functions, state)
        shifts = np.tensordot(functions, of_functions, 1)
        return self.carrier.displacements(state, shifts)

    def filed(self) -> DiscrepancyPart:
        """Return the entry of the part in an arm file."""
        functions = [as_filed(each) for each in self.functions]
        directions = tuple(map(_rounded, self.directions))
        return DiscrepancyPart(
            acts_on=self.carrier.name, functions=functions, directions=directions
        )


def _rounded(row: tuple[float, ...]) -> tuple[float, ...]:
    """A row of directions to :data:`DIRECTION_DIGITS`."""
    texts = [f"{number:.{DIRECTION_DIGITS}g}" for number in row]
    return tuple(map(float, texts))


@dataclass(frozen=True)
class Discrepancy(Effect):
    """The discrepancy: structure that no cause explains, as smooth functions of recorded quantities
    with fitted coefficients.

    ``diagnose`` does not try a discrepancy as a cause. A calibration or diagnosis keeps the
    discrepancy of the arm file unchanged. Outside the range of the fitted records, functions of
    time, temperature and ranks keep their last values.

    Attributes:
        covariate: quantity on which the discrepancy depends, such as ``joint 2 × joint 4``.
        parts: the functions and the changed quantities; several parts share the parameters.
        size: number of parameters.
    """

    covariate: str
    parts: tuple[Part, ...] = field(repr=False)
    size: int
    cause: ClassVar[str] = "discrepancy"

    def __post_init__(self) -> None:
        """Check that all parts have the same parameters."""
        first, *others = self.parts
        if others or first.directions:
            self._check_directions()
        elif self.size != first.coefficients:
            raise AacmmError(
                f"{self.label}: {self.size} values; expected {first.coefficients}, one for each "
                "coefficient"
            )
        super().__post_init__()

    def _check_directions(self) -> None:
        """Raises AacmmError unless every coefficient of each part has a number for each
        parameter.
        """
        for part in self.parts:
            lengths = [len(row) for row in part.directions]
            if lengths != [self.size] * part.coefficients:
                expected = (
                    f"directions of {part.coefficients} coefficients with {self.size} numbers each"
                )
                raise AacmmError(f"{self.label}: {part.carrier.name}: expected {expected}")

    @property
    def label(self) -> str:
        """The name of the covariate and of the changed quantity."""
        label = f"{self.cause}:{self.covariate}"
        if len(self.parts) > 1:
            return label
        return f"{label} on {self.parts[0].carrier.name}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The conditions on which the functions depend."""
        return needs_of(self._functions)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The coefficients, or the factors of shared directions."""
        names = [f"c{k}" for k in range(1, self.size + 1)]
        if self.parts[0].directions:
            return tuple(Term(name, "1", 1.0, name, read_in=("1", 1.0)) for name in names)
        kind = self.parts[0].carrier.kind
        return tuple(Term(name, kind.unit, kind.typical, name) for name in names)

    @property
    def _functions(self) -> list[Smooth]:
        return [each for part in self.parts for each in part.functions]

    @property
    def details(self) -> list[str]:
        """The covariate and the changed quantity as text."""
        words = [f"over {self.covariate}"]
        if len(self.parts) == 1:
            words.append(self.parts[0].carrier.in_words)
        return words

    def displacements(self, state: State) -> list[Displacement]:
        """Return the functions along the axes of their carriers."""
        return [moved for part in self.parts for moved in part.displacements(state)]

    def filed(self) -> DiscrepancyEntry:
        """Return the entry of the discrepancy in an arm file."""
        parts = [part.filed() for part in self.parts]
        u = self.u if any(self.u) else ()
        return DiscrepancyEntry(
            depends_on=self.covariate, parts=parts, values_si=self.values, standard_uncertainty_si=u
        )

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """Return notes about records outside the fitted range of time or temperature."""
        found: dict[str, Note] = {}
        for each in self._functions:
            if not (isinstance(each, Cosines) and each.of in self.needs):
                continue
            values = conditions.require(each.of, self.label)
            low = each.at_si[0]
            high = each.at_si[-1]
            outside = int(np.sum((values < low) | (values > high)))
            fitted = {
                "cause": self.label,
                "condition": each.of,
                "unit": CONDITION_UNITS[each.of],
                "low": float(low),
                "high": float(high),
            }
            if outside:
                found[each.of] = Note(
                    "outside_fitted_range", {"records": outside, "of": conditions.n, **fitted}
                )
        return list(found.values())


def discrepancy_of(entry: DiscrepancyEntry) -> Discrepancy:
    """Return the discrepancy of an entry in an arm file.

    Raises:
        AacmmError: the functions, carriers or directions are invalid.
    """
    parts = tuple(_part(part) for part in entry.parts)
    values = entry.values_si
    u = entry.standard_uncertainty_si
    return Discrepancy(entry.depends_on, parts, len(values), values=values, u=u)


def _part(entry: DiscrepancyPart) -> Part:
    """A part that an arm file has."""
    functions = tuple(as_read(each) for each in entry.functions)
    return Part(Carrier(entry.acts_on), functions, entry.directions)
