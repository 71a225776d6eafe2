"""Base class of lists of postures that bring a frame to a point."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array, Mask, wrapped
from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.units import DEG, MM, plain_mm
from aacmm_pin.arm import Arm
from aacmm_pin.postures.curve_sampling import Flexibility
from aacmm_pin.postures.solution_curves import Curve

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class PosturesAtPoint(Shown):
    """Postures that reach a point, in order along their components.

    Attributes:
        point: ``(3,)`` [m].
        at: frame whose origin is at the point.
        q: postures ``(n, nq)`` [rad], moved by full turns within limits where possible.
        component: of each posture, from 1, ``(n,)``.
        swivel: of the elbow ``(n,)`` [rad] in [-π, π], 0 if highest; NaN without elbow.
        broken: True for each joint outside its limits ``(n, nq)``.
        reason: why there is no posture, or "".
        notes: such as omitted families of singular postures.
        complete: False if there may be more; ``notes`` state why.
    """

    arm: Arm
    point: Array
    at: str
    q: Array
    component: NDArray[np.intp]
    swivel: Array
    broken: Mask
    reason: str = field(default="", kw_only=True)
    notes: tuple[Note, ...] = field(default=(), kw_only=True)
    complete: bool = field(default=True, kw_only=True)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def within_limits(self) -> Mask:
        """Postures with all joints within limits, ``(n,)``."""
        return np.asarray(~self.broken.any(axis=1))

    def flexibility(self, sectors: int = 12) -> Flexibility:
        """Return the share of the postures within limits."""
        raise NotImplementedError

    def to_frame(self) -> pd.DataFrame:
        """Return a table of postures with the columns of :meth:`columns`."""
        import pandas as pd

        return pd.DataFrame(self.columns())

    def columns(self) -> dict[str, Any]:
        """Return the columns of ``aacmm-pin configurations``, each ``(n,)``; x, y and z by
        Pinocchio.
        """
        broken = [" ".join(map(str, np.flatnonzero(row) + 1)) for row in self.broken]
        table: dict[str, Any] = {"component": self.component, "swivel_deg": self.swivel / DEG}
        table |= {f"theta{j + 1}_deg": self.q[:, j] / DEG for j in range(self.arm.nq)}
        table |= {"within_limits": self.within_limits, "broken_limits": broken}
        position = self.arm.poses(self.q, self.at).position / MM
        table |= {f"{axis}_mm": position[:, i] for i, axis in enumerate("xyz")}
        return table

    def _where(self) -> str:
        place = ", ".join(map(plain_mm, self.point))
        return f"{self.arm.name}, with {self.at} at ({place}) mm"


def open_curve_notes(curves: Iterable[Curve]) -> list[Note]:
    """Notes on curves that were not followed all around."""
    unfinished = [number for number, curve in enumerate(curves, start=1) if not curve.closed]
    return [Note("curve_open", {"component": number}) for number in unfinished]


def missing_notes(number: int) -> list[Note]:
    """A note on ``number`` missing postures of a curve, if any."""
    return [Note("configurations_missing", {"number": number})] if number else []


def in_degrees(q: Array) -> str:
    """Angles (k,) [rad] as text."""
    angles = ", ".join(f"{angle:.1f}" for angle in wrapped(q) / DEG)
    return f"({angles})°"
