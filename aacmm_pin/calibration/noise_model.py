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
SAME_PLACE = 1e-9
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
        turn: of each component of the turn behind it [rad].
        seat: of each coordinate of a seat without stated uncertainty, common to its contacts [m].
    """

    tip: float = 0.0
    turn: float = 0.0
    seat: float = 0.0

    @property
    def of_targets(self) -> float:
        """The larger one of tips [m] and turns [rad]."""
        return max(self.tip, self.turn)

    def covariance(self, width: int) -> Array:
        """Of a residual of ``width`` numbers (3: tip; 6: tip and turn), without ``seat`` (3, 3) or
        (6, 6) [m², rad²].
        """
        of_tip = max(self.tip, LEAST_U)
        of_turn = max(self.turn, LEAST_U)
        variance = np.repeat([of_tip**2, of_turn**2], 3)
        return np.diag(variance[:width])


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Observations and their noise.

    Attributes:
        tips: covariance of each tip in the references' frame, by its reading and the scatter (n, 3,
            3) [m²]; with orientations (n, 6, 6), the turn behind it [rad²].
        by_reading: displacement of each tip by one u of each reading (n, 3 or 6, nq) [m, rad]; (n,
            3 or 6, 0) without noise of readings.
        together: see :func:`records_sharing_readings`.
    """

    scatters: Scatters
    observations: Observations
    tips: Array
    by_reading: Array
    together: tuple[Index, ...]

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
        u = np.where(observations.unstated, max(scatters.seat, LEAST_U), observations.stated_u)
        observations = replace(observations, stated_u=u)
        if observations.on_surface.any():
            tips_there = problem.poses(x, frame)[:, :3]
            centres = observations.start(tips_there) if seats is None else seats
            observations = observations.with_normals(tips_there, centres)
        scatter = scatters.covariance(observations.covariance.shape[1])
        tips = np.broadcast_to(scatter, (n, *scatter.shape))
        by_reading = np.zeros((n, len(scatter), 0))
        together: tuple[Index, ...] = ()
        if setup.encoder_noise is not None and setup.encoder_noise.any():
            by_reading = problem.reading_jacobian(x, frame) * setup.encoder_noise
            tips = tips + by_reading @ by_reading.transpose(0, 2, 1)
            together = records_sharing_readings(problem.measurements, observations)
        return NoiseModel(scatters, observations, tips, by_reading, together)

    def correlation(self, whitening: Array) -> Correlation:
        """Of residuals whitened by these (n, 3, 3), or (n, 6, 6); zero does not count."""
        width = whitening.shape[2]
        return Correlation.of(self.together, whitening @ self.by_reading[:, :width])

    @property
    def of_residuals(self) -> Array:
        """Covariance of each residual (n, 3, 3) [m²], or (n, 6, 6)."""
        return self.observations.counting(self.tips + self.observations.covariance)

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
        stated = self.tips - self.scatters.covariance(self.tips.shape[1])
        return self.observations.counting(stated + self.observations.covariance)


def observations_of(measurements: Measurements, setup: Setup) -> Observations:
    """What the records state.

    A seat whose records state the same coordinates was measured once; a record of it without
    coordinates was there too. A seat without coordinates is an unknown point. A record with other
    coordinates than its seat stands for itself: if records repeat the seat's, those off by twice
    the uncertainty, for less may be rounding; if not, by a third of it.
    """
    stated_place = measurements.placed
    contact = setup.probe_noise or 0.0
    seat, labels = _numbered(measurements)
    u = reference_u(measurements, setup, np.nan)
    stating = stated_place & (seat >= 0)
    at_seat = seat[stating]
    count = len(labels)
    least = np.nan_to_num(np.fmin.reduce(_of_each(np.fmin, u[stating], at_seat, count), axis=1))
    repeated, most = _repeated(at_seat, measurements.reference[stating], count)
    if repeated.any():
        from_repeated = np.abs(measurements.reference - most[seat]).max(axis=1)
        far = from_repeated > np.maximum(SAME_PLACE, ROUNDED * least)[seat]
        seat = np.where(stating & repeated[seat] & far, -1, seat)
        stating = stated_place & (seat >= 0)
    at_seat = seat[stating]
    stated = measurements.reference[stating]
    combined = [_of_each(combine, stated, at_seat, count) for combine in (np.add, np.fmax, np.fmin)]
    total, high, low = combined
    records = np.maximum(np.bincount(at_seat, minlength=count), 1)
    at = total / records[:, None]
    at_u = _of_each(np.fmax, u[stating], at_seat, count)
    extent = (high - low).max(axis=1)
    mixed = ~repeated & (extent > np.maximum(SAME_PLACE, MEASURED * least))
    # A seat whose records state coordinates of their own is none, as is a surface of few contacts.
    contacts = np.bincount(seat[measurements.on_surface & (seat >= 0)], minlength=count)
    few = (contacts > 0) & (contacts < FEWEST_CONTACTS)
    mixed |= few & ~np.isfinite(at).all(axis=1)
    number = np.where(mixed, -1, np.cumsum(~mixed) - 1)
    seat = np.where(seat >= 0, number[seat] if len(labels) else -1, -1)
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
    chosen = [label for label, none in zip(labels, mixed, strict=True) if not none]
    place = {label: k for k, label in enumerate(chosen)}
    ends, relation, value, value_u = _relations(measurements, setup, place)
    return Observations(
        reference=np.where(alone[:, None], measurements.reference, np.nan),
        seat=seat.astype(np.intp),
        covariance=noise[:, :, None] ** 2 * np.eye(noise.shape[1]),
        labels=tuple(chosen),
        stated=at[~mixed],
        stated_u=at_u[~mixed],
        ends=ends,
        relation=relation,
        value=value,
        value_u=value_u,
        oriented=measurements.oriented,
        radius=radius,
        on_plane=on_plane,
        anchor=np.full((len(chosen), 3), np.nan),
        normal=np.zeros((measurements.n, 3)),
        by_place=np.zeros((measurements.n, 3)),
    )


def contradictions(measurements: Measurements, setup: Setup, scatters: Scatters) -> Iterator[Note]:
    """Seats and bars with stated coordinates farther apart than their noise allows."""
    u = reference_u(measurements, setup, max(scatters.tip, scatters.seat))
    placed = measurements.placed
    seat, labels = _numbered(measurements)
    at_seats = placed & (seat >= 0)
    repeats, _ = _repeated(seat[at_seats], measurements.reference[at_seats], len(labels))
    repeated = dict(zip(labels, repeats, strict=True))
    stating = {
        label: records[placed[records]]
        for label, records in measurements.seats().items()
        if placed[records].any()
    }
    for bar in measurements.bars():
        of_ends = [stating[seat] for seat in (bar.seat_a, bar.seat_b) if seat in stating]
        if len(of_ends) < 2:
            continue
        a, b = (measurements.reference[records].mean(axis=0) for records in of_ends)
        apart = float(np.linalg.norm(a - b))
        allowed = [*(u[records].max() for records in of_ends), _length_u(bar, setup)]
        if abs(apart - bar.length) > CONTRADICTING * np.linalg.norm(allowed):
            data = {"bar": bar.bar, "length": bar.length, "apart": apart}
            yield Note("bar_contradicted", data)
    for label, records in stating.items():
        at = measurements.reference[records]
        over_u = np.ptp(at, axis=0) / np.maximum(u[records].max(axis=0), SAME_PLACE)
        if over_u.max() > (ROUNDED if repeated[label] else CONTRADICTING):
            ends = records[[at[:, over_u.argmax()].argmin(), at[:, over_u.argmax()].argmax()]]
            apart = float(np.linalg.norm(np.diff(measurements.reference[ends], axis=0)))
            rows = np.sort(measurements.row[ends]).tolist()
            yield Note("seat_contradicted", {"seat": label, "apart": apart, "rows": rows})


def reference_u(measurements: Measurements, setup: Setup, scatter: float) -> Array:
    """Standard uncertainty of each coordinate of the references, else ``scatter`` (n, 3) [m]."""
    fallback = scatter if setup.reference_noise is None else setup.reference_noise
    u = np.where(np.isfinite(measurements.reference_u), measurements.reference_u, fallback)
    return np.maximum(u, LEAST_U)


def _numbered(measurements: Measurements) -> tuple[Index, list[str]]:
    """Of first records in order (n,), -1 without a seat; and labels."""
    labels = measurements.conditions.seat
    if labels is None:
        return np.full(measurements.n, -1, dtype=np.intp), []
    numbers, labels_of_seats = pd.factorize(pd.Series(labels).replace("", None))
    return np.asarray(numbers, dtype=np.intp), [str(label) for label in labels_of_seats]


def _of_each(combine: np.ufunc, values: Array, seat: Index, count: int) -> Array:
    """By ``np.add``, ``np.fmin`` or ``np.fmax``, of values (n, 3) at each seat (s, 3); else NaN."""
    combined = np.full((count, 3), np.nan)
    combined[seat] = 0.0 if combine is np.add else np.nan
    combine.at(combined, seat, values)
    return combined


def _repeated(seat: Index, stated: Array, count: int) -> tuple[Mask, Array]:
    """Of each seat (s,); and the coordinates that most records state (s, 3)."""
    rows = np.column_stack([seat, stated])
    different, times = np.unique(rows, axis=0, return_counts=True)
    at_seat = different[:, 0].astype(np.intp)
    distinct = np.bincount(at_seat, minlength=count)
    repeated = (distinct > 0) & (
        np.bincount(at_seat, times, minlength=count) >= REPEATED * distinct
    )
    order = np.lexsort((-times, at_seat))
    most = np.full((count, 3), np.nan)
    numbers, first = np.unique(at_seat[order], return_index=True)
    most[numbers] = different[order[first], 1:]
    return repeated, most


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
        stated.append((bar.seat_a, bar.seat_b, length, guessed))
    for relation in measurements.relations:
        stated += [(relation.a, relation.b, row, False) for row in relation.rows()]
    between_seats = [row for row in stated if row[0] in number and row[1] in number]
    ends = np.array([(number[a], number[b]) for a, b, *_ in between_seats], dtype=np.intp).reshape(
        -1, 2
    )
    cluster = clusters_of(ends, len(number))
    places = defaultdict(set)
    for k, (_, _, row, _) in enumerate(between_seats):
        places[row].add(-1 - k if row[0] == OF_BAR else cluster[ends[k, 0]])
    common = [1.0 if guessed else len(places[row]) ** 0.5 for _, _, row, guessed in between_seats]
    kind = np.array([row[0] for _, _, row, _ in between_seats], dtype=np.str_)
    value, u = np.array([row[1:] for _, _, row, _ in between_seats]).reshape(-1, 2).T
    return ends, kind, value, u * common


def _length_u(bar: Bar, setup: Setup) -> float:
    fallback = BAR_NOISE if setup.length_noise is None else setup.length_noise
    return bar.u if np.isfinite(bar.u) else fallback
