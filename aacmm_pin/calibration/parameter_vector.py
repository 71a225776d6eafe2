"""The parameters of several effects as one vector."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin.arm import Arm, Parameter
from aacmm_pin.effects import (
    Effect,
    JointDistance,
    JointPlacement,
    JointZeroOffset,
    LinkLength,
    LinkTwist,
    ReferenceFrame,
    SlideAngle,
)

DH_KIND_OF_EFFECT: dict[type[Effect], str] = {
    LinkLength: "a",
    JointDistance: "d",
    LinkTwist: "alpha",
    JointZeroOffset: "theta_offset",
    SlideAngle: "theta_offset",
}


def geometric_parameters(arm: Arm, effect: Effect) -> list[Parameter]:
    """The arm's parameters that an effect changes, in the order of its terms."""
    if isinstance(effect, JointPlacement):
        return [p for p in arm.parameters if p.joint == effect.joint]
    kind = DH_KIND_OF_EFFECT.get(type(effect))
    if kind is None:
        return []
    return [p for p in arm.parameters if p.kind == kind and p.joint == effect.row]


@dataclass(frozen=True, eq=False)
class ParameterVector:
    """Parameters of effects, one after the other. Iteration gives each effect and its slice.

    Attributes:
        effects: with the values where an estimation starts.
    """

    arm: Arm
    effects: tuple[Effect, ...]

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The entries of each effect."""
        ends = accumulate((len(effect.terms) for effect in self.effects), initial=0)
        return tuple(slice(*pair) for pair in pairwise(ends))

    def __iter__(self) -> Iterator[tuple[Effect, slice]]:
        return zip(self.effects, self.slices, strict=True)

    def of_sessions(self) -> Iterator[tuple[str, slice]]:
        """Sessions with unknown frames of references, and their entries."""
        for effect, entries in self:
            if isinstance(effect, ReferenceFrame) and effect.session is not None:
                yield effect.session, entries

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
        """Typical magnitude of each entry (p,) [their units]."""
        typical = []
        for effect in self.effects:
            typical += [term.typical for term in effect.terms]
        return np.array(typical)

    @cached_property
    def arm_parameters(self) -> tuple[Parameter | None, ...]:
        """The arm's parameter that each entry changes; None if it is not geometric."""
        parameters: list[Parameter | None] = []
        for effect in self.effects:
            parameters += geometric_parameters(self.arm, effect) or [None] * len(effect.terms)
        return tuple(parameters)

    @property
    def geometric(self) -> Mask:
        """Whether an entry changes a parameter of the arm (p,)."""
        return np.array([p is not None for p in self.arm_parameters], dtype=bool)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of each entry; geometric ones by the arm's names."""
        parameters: list[Parameter] = []
        for effect in self.effects:
            parameters += effect.parameters()
        for k, arm_parameter in enumerate(self.arm_parameters):
            if arm_parameter is not None:
                parameters[k] = replace(parameters[k], name=arm_parameter.name)
        return tuple(parameters)

    @property
    def names(self) -> list[str]:
        """Name of each entry."""
        return [parameter.name for parameter in self.parameters]

    @property
    def stated_values(self) -> Array:
        """The arm's values, to which the effects' add (p,); 0 if not geometric."""
        return np.array([0.0 if p is None else p.value for p in self.arm_parameters])

    @cached_property
    def stated_u(self) -> Array:
        """Standard uncertainties of the arm's values (p,); 0 if not geometric."""
        return np.array([0.0 if p is None else p.u for p in self.arm_parameters])

    def at(self, x: Array) -> tuple[Effect, ...]:
        """The effects with values ``x`` (p,)."""
        return tuple(effect.at(x[entries]) for effect, entries in self)
