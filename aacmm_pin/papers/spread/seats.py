"""Seats, and the postures in which each of them is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, batch
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import ShapeError

LEAST_RECORDS = 3


@dataclass(frozen=True, eq=False)
class TouchedSeats:
    """Seats of unknown place that an arm touches in many postures each.

    Attributes:
        model: the arm with the effects that are known of it.
        q: postures of each seat, one (n_k, nq) a seat [rad].
        labels: name of each seat.
        at: frame whose origin is in the seat; None for the tip.

    Raises:
        ShapeError: a seat has fewer than three records, or not as many angles as the arm has joints.
    """

    model: ErrorModel
    q: tuple[Array, ...]
    labels: tuple[str, ...]
    at: str | None = None

    def __post_init__(self) -> None:
        checked = tuple(batch(q, self.model.arm.nq, f"postures of seat {k}", "rad") for k, q in enumerate(self.q, start=1))
        if len(self.labels) != len(checked):
            raise ShapeError(f"there are {len(self.labels)} labels of {len(checked)} seats, expected one each")
        for label, q in zip(self.labels, checked, strict=True):
            if len(q) < LEAST_RECORDS:
                raise ShapeError(f"seat {label} has {len(q)} records, expected at least {LEAST_RECORDS}")
        object.__setattr__(self, "q", checked)

    @property
    def records(self) -> Array:
        """Number of records of each seat (seats,)."""
        return np.array([len(q) for q in self.q], dtype=np.float64)

    @property
    def all_q(self) -> Array:
        """All postures, seat by seat (n, nq) [rad]."""
        return np.concatenate(self.q)

    def by_seat(self, values: Array) -> list[Array]:
        """``values`` of all records (n, …), cut into those of each seat."""
        return np.split(values, np.cumsum([len(q) for q in self.q])[:-1])

    def sensitivity(self, effects: Sequence[Effect], conditions: Conditions | None = None) -> Array:
        """∂(position)/∂(parameters of all ``effects``) in all records: (n, 3, p) [m/unit].

        Raises:
            MissingConditionError: an effect depends on a condition that is not there.
        """
        state = self.model.state(self.all_q, conditions, self.at)
        return np.concatenate([effect.sensitivity(state) for effect in effects], axis=2)

    def levers(self) -> Array:
        """∂(position)/∂(angle of each joint) in all records: (n, 3, nq) [m/rad]."""
        return self.model.arm.jacobian(self.all_q, self.at)
