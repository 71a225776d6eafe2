"""What is known of records beside their angles: when, how warm, from which side, under which torque, at which seat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin.errors import MissingConditionError

Labels = NDArray[np.object_]
"""(n,) of str; "" where a record has none."""

COLUMNS = {
    "time": "time_s",
    "temperature": "temperature_c",
    "link_temperature": "temperature1_c …",
    "approach": "approach1 …",
    "torque": "torque1_nm …",
    "seat": "seat",
    "marker": "marker",
    "session": "session",
}
"""The column of a measurement file behind each condition."""


@dataclass(frozen=True, eq=False)
class Conditions(Shown):
    """Conditions of n records; None where nothing is known.

    Attributes:
        n: number of records.
        time: (n,) [s].
        temperature: of the whole arm (n,) [°C].
        link_temperature: of each DH row (n, rows) [°C].
        approach: sign of each joint's last motion (n, nq), -1, 0 or 1.
        torque: measured joint torques (n, nq) [N·m].
        seat: label of the seat touched (n,), "" where none.
        marker: label of the target on the flange (n,), "" where none.
        session: label of the session (n,), "" where none.
    """

    n: int
    time: Array | None = None
    temperature: Array | None = None
    link_temperature: Array | None = None
    approach: Array | None = None
    torque: Array | None = None
    seat: Labels | None = None
    marker: Labels | None = None
    session: Labels | None = None

    def take(self, rows: Index | slice | NDArray[np.bool_] | Sequence[int]) -> Conditions:
        """The same of some of the records."""
        chosen = {}
        for field in fields(self)[1:]:
            values = getattr(self, field.name)
            chosen[field.name] = None if values is None else values[rows]
        count = len(range(self.n)[rows]) if isinstance(rows, slice) else len(np.arange(self.n)[rows])
        return Conditions(count, **chosen)

    @property
    def present(self) -> tuple[str, ...]:
        """Names of the conditions that are known."""
        return tuple(field.name for field in fields(self)[1:] if getattr(self, field.name) is not None)

    def require(self, name: str, purpose: str) -> NDArray:  # type: ignore[type-arg]
        """The condition ``name``.

        Raises:
            MissingConditionError: it is not known; names the column that would tell.
        """
        values = getattr(self, name)
        if values is None:
            raise MissingConditionError(purpose, COLUMNS[name])
        return np.asarray(values)
