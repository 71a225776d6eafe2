"""What is hidden in a measurement file, in the names and units of the contract."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from blind.kinematics import Array


@dataclass(frozen=True, eq=False)
class Hidden:
    """One fault.

    Attributes:
        cause: name of the contract; ``unexplained`` for those that no cause of the contract describes.
        joint: row from 1, None for causes of the whole arm.
        parameters: by the names of the contract.
        size_um: what it moves the tip (or the reference) by, rms over the records, at the same indications [µm].
        depends_on: columns on which it depends, for ``unexplained``.
    """

    cause: str
    joint: int | None
    parameters: Mapping[str, Any]
    size_um: float = 0.0
    depends_on: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """``cause`` or ``cause:joint``."""
        return self.cause if self.joint is None else f"{self.cause}:{self.joint}"


@dataclass(frozen=True, eq=False)
class Truth:
    """What a file hides: its faults, the largest first; the records (from 0) that are outliers; the deviations of the DH
    values (R, 4) [m, m, rad, rad] from the arm file.
    """

    hidden: tuple[Hidden, ...]
    outliers: tuple[int, ...]
    geometry: Array

    @property
    def cause(self) -> str | None:
        return self.hidden[0].cause if self.hidden else None

    @property
    def joint(self) -> int | None:
        return self.hidden[0].joint if self.hidden else None

    @property
    def parameters(self) -> Mapping[str, Any]:
        return self.hidden[0].parameters if self.hidden else {}

    @property
    def size_um(self) -> float:
        return self.hidden[0].size_um if self.hidden else 0.0
