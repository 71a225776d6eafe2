"""What is uncertain of a cause beside its values: its fields, such as the time constant of a drift."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from aacmm_pin.effects.effect import Displacement, Effect, Term
from aacmm_pin.effects.state import State

OF_VALUE = 1e-4
"""Step of the derivative by a field, as a part of its value."""


def open_questions(effect: Effect) -> tuple[Effect, ...]:
    """Causes of value zero whose u stands for what is uncertain of the effect beside its values."""
    widths, stated = effect.inner_widths(), zip(effect.inner, effect.inner_u, strict=False)
    of_fields = (OfInner(of=effect, name=name, u=(u,)) for name, u in stated if u and name in widths)
    return (*effect.open_questions, *of_fields)


@dataclass(frozen=True, eq=False, kw_only=True)
class OfInner(Effect):
    """How far a field of a cause may be from its value, such as the time constant of a drift.

    Attributes:
        of: the cause.
        name: the field.
    """

    cause: ClassVar[str] = "inner_value"
    of: Effect
    name: str

    @property
    def needs(self) -> tuple[str, ...]:
        """Those of the cause."""
        return self.of.needs

    @property
    def label(self) -> str:
        """That of the cause."""
        return self.of.label

    @property
    def key(self) -> str:
        """That of the cause."""
        return self.of.key

    @property
    def row(self) -> int | None:
        """That of the cause."""
        return self.of.row

    @property
    def terms(self) -> tuple[Term, ...]:
        """The field."""
        return (Term(self.name, "s" if self.name.endswith("_s") else "1", getattr(self.of, self.name), self.name),)

    def displacements(self, state: State) -> list[Displacement]:
        """Its derivative, at the values of the cause."""
        value, values = getattr(self.of, self.name), np.array(self.of.values)
        step = OF_VALUE * value
        more, less = (replace(self.of, **{self.name: value + d}).displacements(state) for d in (step, -step))
        pairs = zip(more, less, strict=True)
        return [Displacement(a.place, ((a.columns - b.columns) @ values / (2 * step))[..., None]) for a, b in pairs]
