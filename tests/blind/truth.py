"""What is hidden in a measurement file, in the names and units of the contract."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Hidden:
    """One fault.

    Attributes:
        cause: name of the contract; ``unexplained`` for those that no cause of the contract
            describes.
        joint: row from 1, None for causes of the whole arm.
        parameters: by the names of the contract.
        size_um: what it moves the tip (or the reference) by, rms over the records, at the same
            indications [µm].
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
