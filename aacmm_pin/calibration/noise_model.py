"""From records to observations and their noise."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration.common_readings import Correlation, records_sharing_readings
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
    shared_readings: tuple[Index, ...]

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
        shared_readings: tuple[Index, ...] = ()
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
    coordinates was there too. A seat without coordinates is an unknown point. A record with other
    coordinates than its seat stands for itself: if records repeat the seat's, those off by twice
    the uncertainty, for less may be rounding; if not, by a third of it.
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
    number_of_seat = {label: k for k, label in enumerate(labels)}
    ends, relation, value, value_u = _relations(measurements, setup, number_of_seat)
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
        anchor=np.full((len(labels), 3), np.nan),
        normal=np.zeros((measurements.n, 3)),
        normal_for_seat=np.zeros((measurements.n, 3)),
    )


def _stated_seats(measurements: Measurements, u: Array) -> tuple[Index, list[str], Array, Array]:
    """Number of each record's seat (n,), -1 if it stands for itself; labels, coordinates and u of
    the seats (s, 3), by the records' (n, 3) [m].
    """
    seat, labels = _seats_of_records(measurements)
    states_seat = measurements.placed & (seat >= 0)
    stated_seat = seat[states_seat]
    count = len(labels)
    least_u = _combined_by_seat(np.fmin, u[states_seat], stated_seat, count)
    least_u = np.nan_to_num(np.fmin.reduce(least_u, axis=1))
    repeated, most_stated = _repeated_coordinates(
        stated_seat, measurements.reference[states_seat], count
    )
    if repeated.any():
        from_repeated = np.abs(measurements.reference - most_stated[seat]).max(axis=1)
        far = from_repeated > np.maximum(SAME_COORDINATES, ROUNDED * least_u)[seat]
        seat = np.where(states_seat & repeated[seat] & far, -1, seat)
        states_seat = measurements.placed & (seat >= 0)
        stated_seat = seat[states_seat]
    stated = measurements.reference[states_seat]
    total, high, low = (
        _combined_by_seat(combine, stated, stated_seat, count)
        for combine in (np.add, np.fmax, np.fmin)
    )
    records = np.maximum(np.bincount(stated_seat, minlength=count), 1)
    mean = total / records[:, None]
    largest_u = _combined_by_seat(np.fmax, u[states_seat], stated_seat, count)
    extent = (high - low).max(axis=1)
    # A seat whose records state coordinates of their own is none, as is a surface of few contacts.
    is_none = ~repeated & (extent > np.maximum(SAME_COORDINATES, MEASURED * least_u))
    contacts = np.bincount(seat[measurements.on_surface & (seat >= 0)], minlength=count)
    few = (contacts > 0) & (contacts < FEWEST_CONTACTS)
    is_none |= few & ~np.isfinite(mean).all(axis=1)
    new_number = np.where(is_none, -1, np.cumsum(~is_none) - 1)
    seat = np.where(seat >= 0, new_number[seat] if len(labels) else -1, -1)
    kept = [label for label, none in zip(labels, is_none, strict=True) if not none]
    return seat.astype(np.intp), kept, mean[~is_none], largest_u[~is_none]


def contradictions(measurements: Measurements, setup: Setup, scatters: Scatters) -> Iterator[Note]:
    """Seats and bars with stated coordinates farther apart than their noise allows."""
    u = reference_u(measurements, setup, max(scatters.tip, scatters.seat))
    placed = measurements.placed
    seat, labels = _seats_of_records(measurements)
    states_seat = placed & (seat >= 0)
    repeated, _ = _repeated_coordinates(
        seat[states_seat], measurements.reference[states_seat], len(labels)
    )
    repeated_at = dict(zip(labels, repeated, strict=True))
    records_stating = {
        label: records[placed[records]]
        for label, records in measurements.seats().items()
        if placed[records].any()
    }
    for bar in measurements.bars():
        ends = [bar.seat_a, bar.seat_b]
        of_ends = [records_stating[label] for label in ends if label in records_stating]
        if len(of_ends) < 2:
            continue
        a, b = (measurements.reference[records].mean(axis=0) for records in of_ends)
        distance = float(np.linalg.norm(a - b))
        u_of_parts = [*(u[records].max() for records in of_ends), _length_u(bar, setup)]
        if abs(distance - bar.length) > CONTRADICTING * np.linalg.norm(u_of_parts):
            data = {"bar": bar.bar, "length": bar.length, "apart": distance}
            yield Note("bar_contradicted", data)
    for label, records in records_stating.items():
        stated = measurements.reference[records]
        over_u = np.ptp(stated, axis=0) / np.maximum(u[records].max(axis=0), SAME_COORDINATES)
        if over_u.max() > (ROUNDED if repeated_at[label] else CONTRADICTING):
            along_axis = stated[:, over_u.argmax()]
            extremes = records[[along_axis.argmin(), along_axis.argmax()]]
            distance = float(np.linalg.norm(np.diff(measurements.reference[extremes], axis=0)))
            rows = np.sort(measurements.row[extremes]).tolist()
            yield Note("seat_contradicted", {"seat": label, "apart": distance, "rows": rows})


def reference_u(measurements: Measurements, setup: Setup, scatter: float) -> Array:
    """Standard uncertainty of each coordinate of the references, else ``scatter`` (n, 3) [m]."""
    fallback = scatter if setup.reference_noise is None else setup.reference_noise
    u = np.where(np.isfinite(measurements.reference_u), measurements.reference_u, fallback)
    return np.maximum(u, LEAST_U)


def _seats_of_records(measurements: Measurements) -> tuple[Index, list[str]]:
    """Numbers in order of occurrence (n,), -1 without a seat; and labels."""
    labels = measurements.conditions.seat
    if labels is None:
        return np.full(measurements.n, -1, dtype=np.intp), []
    numbers, labels_of_seats = pd.factorize(pd.Series(labels).replace("", None))
    return np.asarray(numbers, dtype=np.intp), [str(label) for label in labels_of_seats]


def _combined_by_seat(combine: np.ufunc, values: Array, seat: Index, count: int) -> Array:
    """Of values (n, 3) at each seat (s, 3); NaN for seats without."""
    combined = np.full((count, 3), np.nan)
    combined[seat] = 0.0 if combine is np.add else np.nan
    combine.at(combined, seat, values)
    return combined


def _repeated_coordinates(seat: Index, stated: Array, count: int) -> tuple[Mask, Array]:
    """Whether records repeat coordinates, by seat (s,); and those that most state (s, 3)."""
    distinct, times = np.unique(np.column_stack([seat, stated]), axis=0, return_counts=True)
    seat_of_distinct = distinct[:, 0].astype(np.intp)
    distinct_count = np.bincount(seat_of_distinct, minlength=count)
    records = np.bincount(seat_of_distinct, times, minlength=count)
    repeated = (distinct_count > 0) & (records >= REPEATED * distinct_count)
    order = np.lexsort((-times, seat_of_distinct))
    most_stated = np.full((count, 3), np.nan)
    numbers, first = np.unique(seat_of_distinct[order], return_index=True)
    most_stated[numbers] = distinct[order[first], 1:]
    return repeated, most_stated


class _Relation(NamedTuple):
    """Seats ``a`` and ``b``; kind, value and standard uncertainty [m, rad]."""

    a: str
    b: str
    value: tuple[str, float, float]
    guessed: bool = False


def _relations(
    measurements: Measurements, setup: Setup, number: dict[str, int]
) -> tuple[Index, NDArray[np.str_], Array, Array]:
    """Numbers of the seats of each relation (b, 2), of bars, then of distances and angles of
    planes; their kinds, values and standard uncertainties (b,) [m, rad].

    Equal bars are one bar at n places with a common error: with √n u each, their mean has u. A
    guessed u is large enough for each. Planes are one body at n places if no relation connects
    these.
    """
    stated = []
    for bar in measurements.bars():
        guessed = setup.length_noise is None and not np.isfinite(bar.u)
        length = (OF_BAR, bar.length, max(_length_u(bar, setup), LEAST_U))
        stated.append(_Relation(bar.seat_a, bar.seat_b, length, guessed))
    for relation in measurements.relations:
        stated += [_Relation(relation.a, relation.b, value) for value in relation.rows()]
    relations = [one for one in stated if one.a in number and one.b in number]
    pairs = [(number[one.a], number[one.b]) for one in relations]
    ends = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    body_of_seat = clusters_of(ends, len(number))
    bodies = defaultdict(set)  # on which each value is stated
    for k, one in enumerate(relations):
        is_bar = one.value[0] == OF_BAR
        bodies[one.value].add(-1 - k if is_bar else body_of_seat[ends[k, 0]])
    factor = [1.0 if one.guessed else len(bodies[one.value]) ** 0.5 for one in relations]
    kind = np.array([one.value[0] for one in relations], dtype=np.str_)
    value, u = np.array([one.value[1:] for one in relations]).reshape(-1, 2).T
    return ends, kind, value, u * factor


def _length_u(bar: Bar, setup: Setup) -> float:
    fallback = BAR_NOISE if setup.length_noise is None else setup.length_noise
    return bar.u if np.isfinite(bar.u) else fallback
