"""From records to observations: which say what, and how well each is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from aacmm_pin.checks import Array, Index
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.observations import KnownLength, KnownPoint, Length, Observation, SamePoint


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


def observations_of(measurements: Measurements, noise: StatedNoise, unmodelled: float) -> list[Observation]:
    """What the records say.

    A seat whose records state the same coordinates, if they state any, was measured once, and a record of it without
    coordinates was there too; a seat without coordinates is an unknown point. A record whose coordinates are its own stands
    for itself, even at a seat. Records that say nothing are in none.

    Args:
        measurements: the records.
        noise: as stated.
        unmodelled: scatter of each coordinate that the stated noise does not explain; stands in for a noise that nobody
            stated [m].
    """
    u = _reference_u(measurements, noise, unmodelled)
    contact = noise.probe or 0.0
    alone = measurements.known.copy()
    seats: dict[str, SamePoint] = {}
    for label, records in measurements.seats().items():
        reference = _common(measurements.reference[records], _rounding(measurements, noise, records))
        if reference is None and measurements.known[records].any():
            continue
        alone[records] = False
        stating = records[measurements.known[records]]
        seats[label] = SamePoint(records, label, contact, reference, None if reference is None else u[stating].max(axis=0))
    found: list[Observation] = []
    free = np.flatnonzero(alone)
    if free.size:
        own = _reference_u(measurements, noise, 0.0)[free]  # what nobody stated is in the covariance of the tips already
        found.append(KnownPoint(free, measurements.reference[free], np.hypot(own, contact)))
    return found + _barred(measurements, seats, noise)


def _reference_u(measurements: Measurements, noise: StatedNoise, unmodelled: float) -> Array:
    fallback = unmodelled if noise.reference is None else noise.reference
    u = np.where(np.isfinite(measurements.reference_u), measurements.reference_u, fallback)
    return np.maximum(u, LEAST)


LENGTH = 5e-5
"""Standard uncertainty of a bar's length that nobody stated [m]."""
LEAST = 1e-12
"""A standard uncertainty of zero counts as this, so that it can be divided by [m]."""


def _common(references: Array, rounding: float) -> Array | None:
    """The coordinates that the records of a seat state, or None where none does or they differ by more than rounding."""
    stated = references[np.isfinite(references).all(axis=1)]
    same = len(stated) > 0 and np.ptp(stated, axis=0).max() <= rounding
    return stated.mean(axis=0) if same else None


def _rounding(measurements: Measurements, noise: StatedNoise, records: Index) -> float:
    """Differences that are no second measurement of a seat: a third of its stated uncertainty [m]."""
    stated = measurements.reference_u[records]
    least = float(np.nanmin(stated)) if np.isfinite(stated).any() else noise.reference or 0.0
    return max(1e-9, least / 3)


def _barred(measurements: Measurements, seats: dict[str, SamePoint], noise: StatedNoise) -> list[Observation]:
    """Seats joined by bars become one observation each, the others stay."""
    labels = list(seats)
    number = {label: i for i, label in enumerate(labels)}
    u = LENGTH if noise.length is None else noise.length
    bars = [b for b in measurements.bars() if b.seat_a in number and b.seat_b in number]
    ends = [(number[b.seat_a], number[b.seat_b]) for b in bars]
    rows, columns = (np.array([e[k] for e in ends], dtype=np.intp) for k in (0, 1))
    graph = scipy.sparse.coo_array((np.ones(len(bars)), (rows, columns)), shape=(len(labels), len(labels)))
    _, part = scipy.sparse.csgraph.connected_components(graph, directed=False) if labels else (0, np.empty(0))
    found: list[Observation] = []
    for component in np.unique(part):
        members = [int(i) for i in np.flatnonzero(part == component)]
        if len(members) == 1:
            found.append(seats[labels[members[0]]])
            continue
        place = {seat: i for i, seat in enumerate(members)}
        lengths = [
            Length(b.bar, place[a], place[c], b.length, max(u, LEAST))
            for b, (a, c) in zip(bars, ends, strict=True)
            if a in place
        ]
        found.append(KnownLength.between([seats[labels[i]] for i in members], lengths))
    return found


def used_records(observations: list[Observation]) -> Index:
    """Records that some observation speaks of, in order."""
    return np.sort(np.concatenate([np.empty(0, dtype=np.intp), *(o.records for o in observations)]))
