"""From records to observations and their noise, which targets of one reading share."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.display import Note
from aacmm_pin.calibration.problem import Frame, Problem
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.measurements import (
    FEWEST_CONTACTS,
    OF_BAR,
    Bar,
    Measurements,
    Observations,
    clusters_of,
)

BAR_NOISE = 5e-5
"""Standard uncertainty of a bar's length that is not stated [m]."""
LEAST_U = 1e-12
"""Least standard uncertainty, as a divisor [m]."""
SAME_COORDINATES = 1e-9
"""Coordinates that differ by less are the same [m]."""
MEASURED = 1 / 3
ROUNDED = 2.0
"""Standard uncertainties between coordinates of a seat that are the same: MEASURED if each may be a
record's own, ROUNDED if records repeat them.
"""
REPEATED = 2
"""Records per distinct coordinates of a seat, on average, from which they repeat them."""
CONTRADICTING = 10.0
"""Standard uncertainties between coordinates that are not of one point; the noise of 100 gives
6.
"""
INDEPENDENT_PART = 1e-9
"""Least independent part of a record's variance, which gives the rest an inverse."""


def records_sharing_readings(measurements: Measurements, observations: Observations) -> Index:
    """Records of one reading, each of another target, at one seat or none (groups, m); -1 where a
    group has fewer than m. A target measured again in a posture was read again.
    """
    marker = measurements.conditions.marker
    if marker is None:
        return np.empty((0, 0), dtype=np.intp)
    columns = [f"reading {k}" for k in range(measurements.nq)]
    table = pd.DataFrame(measurements.readings, columns=columns)
    table = table.assign(seat=observations.seat, marker=marker)[observations.has_target]
    repeat = table.groupby([*columns, "seat", "marker"], sort=False).cumcount()
    readings = table.assign(repeat=repeat).groupby([*columns, "seat", "repeat"], sort=False)
    reading, place = readings.ngroup().to_numpy(), readings.cumcount().to_numpy()
    groups = np.full((reading.max(initial=-1) + 1, place.max(initial=0) + 1), -1)
    groups[reading, place] = table.index
    return groups[(groups[:, 1:] >= 0).any(axis=1)]


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation of whitened records that share a reading: ``R = L Lᵀ`` group by group. Rows of
    tips come first: turns are whitened given all tips.

    Attributes:
        records: see :func:`records_sharing_readings` (groups, m).
        factors: L of each (groups, m k, m k).
    """

    records: Index = field(default_factory=lambda: np.empty((0, 0), dtype=np.intp))
    factors: Array = field(default_factory=lambda: np.empty((0, 0, 0)))

    @staticmethod
    def of(records: Index, by_reading: Array) -> Correlation:
        """From whitened displacements by one u of each reading (n, k, nq); zero does not count."""
        n, width, nq = by_reading.shape
        displacements = _rows_of(by_reading.reshape(n * width, nq), _row_numbers(records, width))
        covariance = (1.0 - INDEPENDENT_PART) * displacements @ displacements.transpose(0, 2, 1)
        record_of_row = np.tile(np.repeat(np.arange(records.shape[1]), 3), width // 3)
        covariance[:, record_of_row[:, None] == record_of_row] = 0.0
        factors = np.asarray(np.linalg.cholesky(covariance + np.eye(record_of_row.size)))
        return Correlation(records, factors)

    def take(self, chosen: Index) -> Correlation:
        """Of some records, whole groups of them."""
        if not self.records.size:
            return self
        new_numbers = np.full(max(self.records.max(), chosen.max(initial=0)) + 1, -1)
        new_numbers[chosen] = np.arange(chosen.size)
        records = np.where(self.records >= 0, new_numbers[self.records], -1)
        is_chosen = records[:, 0] >= 0
        return Correlation(records[is_chosen], self.factors[is_chosen])

    def whitened(self, rows: Array) -> Array:
        """``L⁻¹`` times rows (n, k, …), in place."""
        return self._applied(self._inverses, rows)

    def whitened_back(self, rows: Array) -> Array:
        """``L`` times rows (n, k, …), in place."""
        return self._applied(self.factors, rows)

    def weighed(self, rows: Array) -> Array:
        """``L⁻ᵀ`` times rows (n, k, …), in place."""
        return self._applied(self._inverses.transpose(0, 2, 1), rows)

    def weighed_back(self, rows: Array) -> Array:
        """``Lᵀ`` times rows (n, k, …), in place."""
        return self._applied(self.factors.transpose(0, 2, 1), rows)

    @cached_property
    def _inverses(self) -> Array:
        return np.asarray(np.linalg.inv(self.factors))

    def _applied(self, matrices: Array, rows: Array) -> Array:
        if not self.records.size:
            return rows
        width = rows.shape[1]
        flat = rows.reshape(len(rows) * width, int(np.prod(rows.shape[2:])))
        numbers = _row_numbers(self.records, width)
        inside = numbers >= 0
        # Tips come first: for rows of tips alone, the upper left part of a factor is theirs.
        size = numbers.shape[1]
        flat[numbers[inside]] = (matrices[:, :size, :size] @ _rows_of(flat, numbers))[inside]
        return flat.reshape(rows.shape)


def _row_numbers(records: Index, width: int) -> Index:
    """Of records in groups (groups, m), tips before turns: (groups, m width); negative for none."""
    first = width * records[:, :, None]
    parts = [first + np.arange(3 * part, 3 * part + 3) for part in range(width // 3)]
    return np.concatenate(parts, axis=1).reshape(len(records), width * records.shape[1])


def _rows_of(flat: Array, numbers: Index) -> Array:
    """Rows (groups, m, c) of ``flat`` (n, c); zero for negative numbers."""
    return np.where(numbers[:, :, None] >= 0, flat[numbers], 0.0)


class Scatters(NamedTuple):
    """Standard deviations beyond the stated noise, or instead of noise that is not stated.

    Attributes:
        tip: of each coordinate of a tip beside its target [m].
        rotation: of each component of the rotation behind it [rad].
        seat: of each coordinate of a seat without stated uncertainty, common to its contacts [m].
    """

    tip: float = 0.0
    rotation: float = 0.0
    seat: float = 0.0

    @property
    def of_targets(self) -> float:
        """The larger one of tips [m] and rotations [rad]."""
        return max(self.tip, self.rotation)

    def covariance(self, width: int) -> Array:
        """Of a residual of ``width`` numbers (3: tip; 6: tip and rotation), without ``seat`` (3, 3)
        or (6, 6) [m², rad²].
        """
        of_tip = max(self.tip, LEAST_U)
        of_rotation = max(self.rotation, LEAST_U)
        variance = np.repeat([of_tip**2, of_rotation**2], 3)
        return np.diag(variance[:width])


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Observations and their noise.

    Attributes:
        tip_covariance: of each tip in the references' frame, by its reading and the scatter (n, 3,
            3) [m²]; with orientations (n, 6, 6), the turn behind it [rad²].
        by_reading: displacement of each tip by one u of each reading (n, 3 or 6, nq) [m, rad]; (n,
            3 or 6, 0) without noise of readings.
        shared_readings: see :func:`records_sharing_readings`.
    """

    scatters: Scatters
    observations: Observations
    tip_covariance: Array
    by_reading: Array
    shared_readings: Index

    @staticmethod
    def of(
        problem: Problem,
        x: Array,
        frame: Frame,
        scatters: Scatters,
        observations: Observations | None = None,
        seats: Array | None = None,
    ) -> NoiseModel:
        """The noise of the records.

        Args:
            x: parameters (p,), which place the targets that readings move.
            seats: points (s, 3) [m], for the normals of surfaces; None: by the tips.
        """
        setup = problem.setup
        n = problem.measurements.n
        observations = observations or observations_of(problem.measurements, setup)
        u = np.where(observations.without_u, max(scatters.seat, LEAST_U), observations.stated_u)
        observations = replace(observations, stated_u=u)
        if observations.on_surface.any():
            tips_there = problem.poses(x, frame)[:, :3]
            centres = observations.first_seats(tips_there) if seats is None else seats
            observations = observations.with_normals(tips_there, centres)
        scatter = scatters.covariance(observations.covariance.shape[1])
        tip_covariance = np.broadcast_to(scatter, (n, *scatter.shape))
        by_reading = np.zeros((n, len(scatter), 0))
        shared_readings = Correlation().records
        if setup.encoder_noise is not None and setup.encoder_noise.any():
            by_reading = problem.reading_jacobian(x, frame) * setup.encoder_noise
            tip_covariance = tip_covariance + by_reading @ by_reading.transpose(0, 2, 1)
            shared_readings = records_sharing_readings(problem.measurements, observations)
        return NoiseModel(scatters, observations, tip_covariance, by_reading, shared_readings)

    def correlation(self, whitening: Array) -> Correlation:
        """Of residuals whitened by these (n, 3, 3), or (n, 6, 6); zero does not count."""
        width = whitening.shape[2]
        return Correlation.of(self.shared_readings, whitening @ self.by_reading[:, :width])

    @property
    def of_residuals(self) -> Array:
        """Covariance of each residual (n, 3, 3) [m²], or (n, 6, 6)."""
        covariance = self.tip_covariance + self.observations.covariance
        return self.observations.counting_covariance(covariance)

    @cached_property
    def whitening(self) -> Array:
        """To unit variance (n, 3, 3) [1/m], or (n, 6, 6); zero for turns that are not stated, and
        along a sphere. A triangle: turns do not change the first three numbers.
        """
        whitening = np.linalg.inv(np.linalg.cholesky(self.of_residuals))
        whitening[~self.observations.oriented, 3:] = 0.0
        return self.observations.along_normals(whitening)

    @property
    def without_scatter(self) -> Array:
        """:attr:`of_residuals` by the stated noise alone."""
        stated = self.tip_covariance - self.scatters.covariance(self.tip_covariance.shape[1])
        return self.observations.counting_covariance(stated + self.observations.covariance)


def observations_of(measurements: Measurements, setup: Setup) -> Observations:
    """What the records state.

    A seat whose records state the same coordinates was measured once; a record of it without
    coordinates was there too. A seat without coordinates is an unknown point.

    A record with other coordinates than its seat stands for itself. Where records repeat the
    coordinates of the seat, others are more than 2 u away, for less may be rounding. Where all
    states differ, they are more than u/3 away.
    """
    contact = setup.probe_noise or 0.0
    u = reference_u(measurements, setup, np.nan)
    seat, labels, stated, stated_u = _stated_seats(measurements, u)
    radius = np.where(seat >= 0, measurements.contact_radius, np.nan)
    on_plane = measurements.on_plane & (seat >= 0)
    alone = measurements.known & (seat < 0)
    # What is not stated is in the covariance of the tips already.
    of_reference = np.hypot(reference_u(measurements, setup, 0.0), contact)
    noise = np.where(alone[:, None], of_reference, contact)
    if measurements.orientation is not None:
        turn = np.zeros(measurements.n)
        if measurements.orientation_u is not None:
            turn = np.nan_to_num(measurements.orientation_u)
        noise = np.hstack([noise, np.repeat(turn[:, None], 3, axis=1)])
    ends, relation, value, value_u = _relations(measurements, setup, labels)
    return Observations(
        reference=np.where(alone[:, None], measurements.reference, np.nan),
        seat=seat,
        covariance=noise[:, :, None] ** 2 * np.eye(noise.shape[1]),
        labels=tuple(labels),
        stated=stated,
        stated_u=stated_u,
        ends=ends,
        relation=relation,
        value=value,
        value_u=value_u,
        oriented=measurements.oriented,
        radius=radius,
        on_plane=on_plane,
        # Of planes; NoiseModel fills these from a first fit.
        anchor=np.full((len(labels), 3), np.nan),
        normal=np.zeros((measurements.n, 3)),
        normal_for_seat=np.zeros((measurements.n, 3)),
    )


def _stated_seats(measurements: Measurements, u: Array) -> tuple[Index, list[str], Array, Array]:
    """Number of each record's seat (n,), -1 if it stands for itself; labels, coordinates and u of
    the seats (s, 3), by the records' (n, 3) [m].
    """
    seat = np.full(measurements.n, -1, dtype=np.intp)
    labels: list[str] = []
    coordinates = []
    largest_u = []
    for label, at_seat in measurements.seats().items():
        is_placed = measurements.placed[at_seat]
        stating = at_seat[is_placed]
        stated = measurements.reference[stating]
        extent = np.ptp(stated, axis=0).max() if stating.size else 0.0
        if extent > SAME_COORDINATES:
            least_u = np.nan_to_num(np.fmin.reduce(u[stating], axis=None))
            repeated = _repeated_coordinates(stated)
            if repeated is not None:
                deviation = np.abs(stated - repeated).max(axis=1)
                stating = stating[deviation <= max(SAME_COORDINATES, ROUNDED * least_u)]
                at_seat = np.concatenate([at_seat[~is_placed], stating])
            elif extent > MEASURED * least_u:
                continue  # the records state coordinates of their own
        contacts = np.count_nonzero(measurements.on_surface[at_seat])
        if 0 < contacts < FEWEST_CONTACTS and not stating.size:
            continue
        seat[at_seat] = len(labels)
        labels.append(label)
        of_seat = measurements.reference[stating]
        coordinates.append(of_seat.mean(axis=0) if stating.size else np.full(3, np.nan))
        largest_u.append(np.fmax.reduce(u[stating], axis=0, initial=np.nan))
    shape = (len(labels), 3)
    return seat, labels, np.reshape(coordinates, shape), np.reshape(largest_u, shape)


def _repeated_coordinates(stated: Array) -> Array | None:
    """Those (3,) that most records of a seat (m, 3) repeat, if they repeat them."""
    distinct, times = np.unique(stated, axis=0, return_counts=True)
    return distinct[times.argmax()] if 0 < REPEATED * len(distinct) <= len(stated) else None


def contradictions(measurements: Measurements, setup: Setup, scatters: Scatters) -> Iterator[Note]:
    """Seats and bars with stated coordinates farther apart than their noise allows."""
    u = reference_u(measurements, setup, max(scatters.tip, scatters.seat))
    reference, placed = measurements.reference, measurements.placed
    stating = {label: records[placed[records]] for label, records in measurements.seats().items()}
    for bar in measurements.bars():
        seats = (bar.seat_a, bar.seat_b)
        ends = [stating[seat] for seat in seats if len(stating.get(seat, ()))]
        if len(ends) < 2:
            continue
        a, b = (reference[records].mean(axis=0) for records in ends)
        distance = float(np.linalg.norm(a - b))
        u_of_parts = [*(u[records].max() for records in ends), _length_u(bar, setup)]
        if abs(distance - bar.length) > CONTRADICTING * np.linalg.norm(u_of_parts):
            data = {"bar": bar.bar, "length": bar.length, "apart": distance}
            yield Note("bar_contradicted", data)
    for label, records in stating.items():
        if len(records) < 2:
            continue
        stated = reference[records]
        over_u = np.ptp(stated, axis=0) / np.maximum(u[records].max(axis=0), SAME_COORDINATES)
        is_repeated = _repeated_coordinates(stated) is not None
        if over_u.max() > (ROUNDED if is_repeated else CONTRADICTING):
            along_axis = stated[:, over_u.argmax()]
            extremes = records[[along_axis.argmin(), along_axis.argmax()]]
            distance = float(np.linalg.norm(np.diff(reference[extremes], axis=0)))
            rows = np.sort(measurements.row[extremes]).tolist()
            yield Note("seat_contradicted", {"seat": label, "apart": distance, "rows": rows})


def reference_u(measurements: Measurements, setup: Setup, scatter: float) -> Array:
    """Standard uncertainty of each coordinate of the references, else ``scatter`` (n, 3) [m]."""
    fallback = scatter if setup.reference_noise is None else setup.reference_noise
    u = np.where(np.isfinite(measurements.reference_u), measurements.reference_u, fallback)
    return np.maximum(u, LEAST_U)


def _relations(
    measurements: Measurements, setup: Setup, labels: list[str]
) -> tuple[Index, NDArray[np.str_], Array, Array]:
    """Numbers of the seats of each relation (b, 2), of bars, then of distances and angles of
    planes; their kinds, values and standard uncertainties (b,) [m, rad].

    Equal bars are one bar at n places with a common error: with √n u each, their mean has u. A
    guessed u is large enough for each. Planes are one body at n places if no relation connects
    these.
    """
    stated: list[tuple[str, str, tuple[str, float, float], bool]] = []
    for bar in measurements.bars():
        is_guessed = setup.length_noise is None and not np.isfinite(bar.u)
        length = (OF_BAR, bar.length, max(_length_u(bar, setup), LEAST_U))
        stated.append((bar.seat_a, bar.seat_b, length, is_guessed))
    for relation in measurements.relations:
        stated += [(relation.a, relation.b, value, False) for value in relation.rows()]
    number = {label: k for k, label in enumerate(labels)}
    relations = [item for item in stated if {*item[:2]} <= number.keys()]
    pairs = [(number[a], number[b]) for a, b, _, _ in relations]
    ends = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    values = [value for _, _, value, _ in relations]
    body_of_seat = clusters_of(ends, len(labels))
    bodies = defaultdict(set)  # on which each value is stated
    for k, value in enumerate(values):
        bodies[value].add(-1 - k if value[0] == OF_BAR else body_of_seat[ends[k, 0]])
    places = [1 if is_guessed else len(bodies[value]) for _, _, value, is_guessed in relations]
    kind = np.array([value[0] for value in values], dtype=np.str_)
    numbers, u = np.array([value[1:] for value in values]).reshape(-1, 2).T
    return ends, kind, numbers, u * np.sqrt(places)


def _length_u(bar: Bar, setup: Setup) -> float:
    fallback = BAR_NOISE if setup.length_noise is None else setup.length_noise
    return bar.u if np.isfinite(bar.u) else fallback
