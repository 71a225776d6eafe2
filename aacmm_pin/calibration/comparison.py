"""Errors of several arms against references, bars and seats."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.measurements import Measurements

MOST_GROWTH = 0.1
"""Growth of an RMS that counts as none: a poorly determined correction may add a few per cent."""
FAR_FROM_U = 10.0
"""RMS distance over standard uncertainty that asks for a look at arm and file."""
MAX_RMS = 0.01
"""Largest RMS distance of an arm from its references [m]; the worst are a millimetre off."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of one kind by each arm.

    Attributes:
        kind: ``reference``, ``bar length`` or ``seat`` (distance from the mean of its contacts).
        errors: by each arm (n,) [m].
        u: RMS standard uncertainty of the references [m]; nan if not stated.
        u_tips: of the tips of the last arm [m].
    """

    kind: str
    count: int
    errors: tuple[Array, ...]
    u: float = math.nan
    u_tips: float = math.nan

    @property
    def rms(self) -> list[float]:
        """By each arm [m]."""
        return [rms(errors) for errors in self.errors]

    @property
    def largest(self) -> list[float]:
        """By each arm [m]."""
        return [float(np.abs(errors).max()) for errors in self.errors]

    @property
    def is_worse(self) -> bool:
        """Whether the last arm has clearly larger errors than the first."""
        first = self.rms[0]
        last = self.rms[-1]
        return last > (1 + MOST_GROWTH) * first

    @property
    def expected(self) -> float:
        """Standard uncertainty of tips and references together [m]; nan if not stated."""
        return math.hypot(self.u_tips, np.nan_to_num(self.u))

    @property
    def is_far(self) -> bool:
        """Whether the last arm's errors are far beyond the stated uncertainties."""
        return 0.0 < FAR_FROM_U * self.expected < self.rms[-1]

    @property
    def is_of_other_frame(self) -> bool:
        """Whether the references cannot be those of the last arm's tip in its base."""
        return self.kind == "reference" and self.rms[-1] > MAX_RMS


def compare(records: Measurements, tips: Sequence[Array], u_tips: float) -> Iterator[Comparison]:
    """Compare the tips (n, 3) [m] of each arm with references, bars and seats."""
    placed = records.known
    if placed.any():
        u = np.linalg.norm(records.reference_u[placed], axis=1)
        u = u[np.isfinite(u)]
        deviations = [(tip - records.reference)[placed] for tip in tips]
        errors = tuple(np.linalg.norm(deviations, axis=2))
        u_references = rms(u) if len(u) else math.nan
        yield Comparison("reference", int(placed.sum()), errors, u_references, u_tips)
    bars = records.bars()
    if bars:
        yield Comparison("bar length", len(bars), tuple(map(records.bar_length_errors, tips)))
    points = (seat for seat in records.seats().values() if not records.on_surface[seat].any())
    seats = [seat for seat in points if len(seat) > 1 and not any(placed[seat])]
    if seats:
        scatters = []
        for tip in tips:
            from_mean = [tip[seat] - tip[seat].mean(axis=0) for seat in seats]
            scatters.append(np.linalg.norm(np.concatenate(from_mean), axis=1))
        yield Comparison("seat", len(seats), tuple(scatters))
