"""From records to observations: which say what, and how well each is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.observations import Observations
from aacmm_pin.measurements.records import Measurements


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """Standard uncertainties as stated; None where nobody stated them.

    Attributes:
        encoder: of one reading of each joint (nq,) [rad].
        reference: of each coordinate of a reference, where the records do not state their own [m].
        probe: of each coordinate of one contact [m].
        length: of a bar's length [m].
    """

    encoder: Array | None
    reference: float | None
    probe: float | None
    length: float | None

    def __post_init__(self) -> None:
        for name in ("encoder", "reference", "probe", "length"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value).all() and np.min(value) >= 0):
                raise AacmmError(f"{name} noise is {value}, expected a standard uncertainty that is not negative")

    def suffices(self, measurements: Measurements) -> bool:
        """Whether the scatter of every kind of record is stated, so that χ² can be judged."""
        return not self.missing(measurements)

    def missing(self, measurements: Measurements) -> list[str]:
        """In words, whose noise nobody states although χ² needs it."""
        seats = measurements.conditions.seat
        touched = np.zeros(measurements.n, dtype=bool) if seats is None else np.asarray(seats != "", dtype=bool)
        placed = [measurements.known[records].any() for records in measurements.seats().values()]
        stated = np.asarray(np.isfinite(measurements.reference_u).all(axis=1))
        found = []
        if self.reference is None and not stated[measurements.known].all():
            found.append("of the reference coordinates")
        # Without these a seat touched again would have to give the very same tip.
        if touched.any() and self.probe is None and (self.encoder is None or not all(placed)):
            found.append("of a contact in its seat")
        return found


def observations_of(measurements: Measurements, noise: StatedNoise, unmodelled: float) -> Observations:
    """What the records say.

    A seat whose records state the same coordinates, if they state any, was measured once, and a record of it without
    coordinates was there too; a seat without coordinates is an unknown point. A record whose coordinates are its own stands
    for itself, even at a seat. Coordinates that differ by less than a third of their uncertainty are the same.

    Args:
        measurements: the records.
        noise: as stated.
        unmodelled: scatter of each coordinate that the stated noise does not explain; stands in for a noise that is not
            stated [m].
    """
    known, contact = measurements.known, noise.probe or 0.0
    u = _reference_u(measurements, noise, unmodelled)
    seat, labels = _numbered(measurements)
    at = _Seats.of(measurements, noise, u, seat, len(labels))
    # A seat whose records state coordinates of their own is none.
    kept = ~at.known | at.common
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    seat = np.where(seat >= 0, number[seat] if len(labels) else -1, -1)
    alone = known & (seat < 0)
    # What is not stated is in the covariance of the tips already.
    own = np.where(alone[:, None], np.hypot(_reference_u(measurements, noise, 0.0), contact), contact)
    chosen = [label for label, keeps in zip(labels, kept, strict=True) if keeps]
    ends, length = _bars(measurements, {label: k for k, label in enumerate(chosen)})
    return Observations(
        reference=np.where(alone[:, None], measurements.reference, np.nan),
        seat=seat.astype(np.intp),
        covariance=own[:, :, None] ** 2 * np.eye(3),
        labels=tuple(chosen),
        stated=at.reference[kept],
        stated_u=at.u[kept],
        ends=ends,
        length=length,
        length_u=np.full(len(length), max(LENGTH if noise.length is None else noise.length, LEAST)),
    )


def _reference_u(measurements: Measurements, noise: StatedNoise, unmodelled: float) -> Array:
    fallback = unmodelled if noise.reference is None else noise.reference
    u = np.where(np.isfinite(measurements.reference_u), measurements.reference_u, fallback)
    return np.maximum(u, LEAST)


LENGTH = 5e-5
"""Standard uncertainty of a bar's length that is not stated [m]."""
LEAST = 1e-12
"""A standard uncertainty of zero counts as this, so that it can be divided by [m]."""
SAME = 1e-9
"""Coordinates that differ by less are the same whatever their uncertainty [m]."""


def _numbered(measurements: Measurements) -> tuple[Index, list[str]]:
    """Number of the seat of each record in the order of their first records (n,), -1 where none; and their labels."""
    labels = measurements.conditions.seat
    if labels is None:
        return np.full(measurements.n, -1, dtype=np.intp), []
    numbers, found = pd.factorize(pd.Series(labels).replace("", None))
    return np.asarray(numbers, dtype=np.intp), [str(label) for label in found]


@dataclass(frozen=True, eq=False)
class _Seats:
    """What the records of each seat state: whether any states coordinates (s,), whether these are the same (s,), their mean
    (s, 3) [m], and its standard uncertainty (s, 3) [m].
    """

    known: NDArray[np.bool_]
    common: NDArray[np.bool_]
    reference: Array
    u: Array

    @staticmethod
    def of(measurements: Measurements, noise: StatedNoise, u: Array, seat: Index, count: int) -> _Seats:
        stating = measurements.known & (seat >= 0)

        def of_each(values: Array, what: str) -> Array:
            """Statistic of the records of each seat that state coordinates (s, 3); NaN where none does."""
            if not stating.any():
                return np.full((count, 3), np.nan)
            grouped = pd.DataFrame(values[stating]).groupby(seat[stating]).agg(what)
            return grouped.reindex(range(count)).to_numpy(dtype=np.float64)

        mean, spread = (of_each(measurements.reference, what) for what in ("mean", "max"))
        spread = spread - of_each(measurements.reference, "min")
        least = of_each(np.where(np.isfinite(measurements.reference_u), measurements.reference_u, np.inf), "min").min(axis=1)
        least = np.where(np.isfinite(least), least, noise.reference or 0.0)
        known = np.asarray(np.isfinite(mean).all(axis=1))
        same = np.maximum(SAME, least / 3)
        common = np.asarray(known & (np.nan_to_num(spread, nan=np.inf).max(axis=1, initial=0.0) <= same))
        stated = common[:, None]
        return _Seats(known, common, np.where(stated, mean, np.nan), np.where(stated, of_each(u, "max"), np.nan))


def _bars(measurements: Measurements, number: dict[str, int]) -> tuple[Index, Array]:
    """Numbers of the seats at both ends of each bar (b, 2), and the lengths (b,) [m]."""
    bars = [b for b in measurements.bars() if b.seat_a in number and b.seat_b in number]
    ends = np.array([(number[b.seat_a], number[b.seat_b]) for b in bars], dtype=np.intp).reshape(-1, 2)
    return ends, np.array([b.length for b in bars])
