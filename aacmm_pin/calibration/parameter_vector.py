"""The parameters of several effects as one vector, each entry with name, unit, effect and place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm, Parameter
from aacmm_pin.effects import (
    Effect,
    JointDistance,
    JointPlacement,
    JointZeroOffset,
    LinkLength,
    LinkTwist,
)

EFFECT_OF_KIND: dict[str, type[Effect]] = {
    "a": LinkLength,
    "d": JointDistance,
    "alpha": LinkTwist,
    "theta_offset": JointZeroOffset,
}
"""The cause behind each value of a DH row."""
KIND_OF = {cause: kind for kind, cause in EFFECT_OF_KIND.items()}
"""The value of a DH row behind each geometric cause."""


def geometric_parameters(arm: Arm, effect: Effect) -> list[Parameter]:
    """The arm's own parameters that a geometric effect changes, in the order of its terms; none for
    other effects.
    """
    if isinstance(effect, JointPlacement):
        return [p for p in arm.parameters if p.joint == effect.joint]
    kind = KIND_OF.get(type(effect))
    row = effect.row
    return [] if kind is None else [p for p in arm.parameters if p.kind == kind and p.joint == row]


@dataclass(frozen=True, eq=False)
class ParameterVector:
    """Parameters of effects, one after the other. Iteration gives each effect and the slice of its
    entries.

    Attributes:
        arm: whose geometry some of the effects change.
        effects: in the order of their entries; their values are where an estimation starts.
    """

    arm: Arm
    effects: tuple[Effect, ...]

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The entries of each effect."""
        found, start = [], 0
        for effect in self.effects:
            end = start + len(effect.terms)
            found.append(slice(start, end))
            start = end
        return tuple(found)

    def __iter__(self) -> Iterator[tuple[Effect, slice]]:
        return zip(self.effects, self.slices, strict=True)

    @property
    def size(self) -> int:
        """Number of entries p."""
        return self.slices[-1].stop if self.slices else 0

    @cached_property
    def values(self) -> Array:
        """Values of the effects (p,) [their units]."""
        return np.array([value for effect in self.effects for value in effect.values])

    @cached_property
    def typical(self) -> Array:
        """Usual magnitude of each entry on a measuring arm (p,) [their units]."""
        found: list[float] = []
        for effect in self.effects:
            found += [term.typical for term in effect.terms]
        return np.array(found)

    @cached_property
    def of_arm(self) -> tuple[Parameter | None, ...]:
        """The arm's own parameter that each entry changes (p entries); None where it is of a
        cause.
        """
        found: list[Parameter | None] = []
        for effect, own in self:
            found += geometric_parameters(self.arm, effect) or [None] * (own.stop - own.start)
        return tuple(found)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The entries with name, unit and value; geometric ones by the names that the arm has for
        them.
        """
        found: list[Parameter] = []
        for effect in self.effects:
            found += effect.parameters()
        for k, of_arm in enumerate(self.of_arm):
            if of_arm is not None:
                found[k] = replace(found[k], name=of_arm.name)
        return tuple(found)

    @property
    def names(self) -> list[str]:
        """Name of each entry."""
        return [parameter.name for parameter in self.parameters]

    @property
    def origins(self) -> Array:
        """What the arm states of each entry, to which the effect's value adds; zero for causes
        (p,).
        """
        values = [0.0 if p is None else p.value for p in self.of_arm]
        return np.array(values)

    @cached_property
    def arm_u(self) -> Array:
        """Standard uncertainty that the arm states of each entry that is its own (p,); 0 for
        others.
        """
        u = [0.0 if p is None else p.u for p in self.of_arm]
        return np.array(u)

    def at(self, x: Array) -> tuple[Effect, ...]:
        """The effects with the values ``x`` (p,)."""
        found = [effect.at(tuple(x[own])) for effect, own in self]
        return tuple(found)
