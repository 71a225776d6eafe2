"""Simulated measurements of an arm with known errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Array, Index, whole
from aacmm_pin.arm import Room, exp
from aacmm_pin.effects import Conditions, ErrorModel, GivenModel, Labels, corrects_seat
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.measuring_points import (
    SEATS_APART,
    Pool,
    SeatOrBar,
    bars_for,
    seats_for,
    visits,
)
from aacmm_pin.measurements.noise import ENCODER, PROBE, REFERENCE_NOISE, Noise
from aacmm_pin.measurements.orientation import quaternions
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.schedule import sessions, workshop_conditions
from aacmm_pin.postures import brought_to

Scheme = Literal["free", "seats", "ball-bar", "single-point"]
SCHEMES: tuple[Scheme, ...] = get_args(Scheme)
SIMULATED_BAR = plausible.BAR_LENGTH._replace(least=SEATS_APART)
"""Lengths of bars, whose ends are seats some distance apart [m]."""


def simulate_measurements(
    model: GivenModel,
    scheme: Scheme,
    records: int,
    *,
    rng: np.random.Generator,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float = REFERENCE_NOISE,
    probe_noise: float = PROBE,
    seats: int = 10,
    known: bool = True,
    bar_length: float | None = None,
    above: float | None = None,
    temperature_range: float = 3.0,
    orientation_noise: float | None = None,
) -> Measurements:
    """Simulate measurements of an arm with the errors of ``model``, plus noise.

    The schemes are:

    - ``free``: random postures, uniform in the joint angles; a laser tracker measures each tip.
    - ``seats``: seats in the whole workspace, touched in different postures of all solution
      branches. Each has one stated reference, or none (``known=False``).
    - ``ball-bar``: ``seats // 2`` bars of ``bar_length``, touched at both ends, without
      coordinates. Each stated length has one error from the reference noise.
    - ``single-point``: one seat without reference.

    Errors are exact (:meth:`ErrorModel.predict`). Before encoder noise, the tip misses the seat
    (``free``: the target of the tracker) by the probe noise. Causes with ``of_reference`` change
    the stated coordinates. Postures avoid the obstacles of
    :class:`Room`, and stay 1e-3 rad off the limits. For conditions see
    :func:`aacmm_pin.measurements.schedule.workshop_conditions`; a session has at most 200 records.

    Args:
        model: the arm with its errors.
        rng: ``source`` of the result states its seed.
        encoder_noise: standard uncertainty of one reading, ``(nq,)`` or one number [rad; m for a
            prismatic joint]; default of the arm file, else 8 µrad. ``source`` states an assumption.
        reference_noise: standard uncertainty of each reference coordinate [m], with one draw for a
            seat or free point.
        probe_noise: standard uncertainty of each coordinate of a contact [m], with a draw for each
            record.
        seats: number; each bar has two.
        known: state the coordinates of the seats; only for ``seats``.
        bar_length: [m]; only for ``ball-bar``.
        above: height of a table over the base origin, against gravity [m], above which the tip
            stays.
        temperature_range: largest difference from the reference temperature of the arm [K].
        orientation_noise: standard uncertainty about each axis of stated orientations [rad], or
            None.

    Raises:
        UnknownNameError: the scheme is unknown, or a ``seat_error`` names a seat that the scheme
            lacks.
        ShapeError: the noise is not finite, or not one for each encoder.
        MissingConditionError: a cause depends on a condition that is not simulated.
        AacmmError: a number is invalid, or the scheme not possible.
    """
    if scheme not in SCHEMES:
        raise UnknownNameError("scheme", scheme, list(SCHEMES))
    model = ErrorModel.of(model).restricted_to_known_range()
    points = {"free": 0, "single-point": 1}.get(scheme, seats)
    stated = scheme == "free" or (scheme == "seats" and known)
    _check_numbers(scheme, records, points, stated, bar_length)
    if scheme == "seats" and known:
        labels = _seat_labels(seats)
        for effect in filter(corrects_seat, model.effects):
            if effect.place not in labels:
                raise UnknownNameError(f"seat of {effect.cause}", str(effect.place), labels)
    assumed = ""
    if encoder_noise is None:
        encoder_noise = model.arm.encoder_noise
    if encoder_noise is None:
        encoder_noise = ENCODER
        assumed = f", encoder noise {ENCODER * 1e6:g} µrad (assumed)"
    noise = Noise.of(
        model.arm.nq, encoder=encoder_noise, reference=reference_noise, probe=probe_noise
    )
    known_seed = seed_of(rng)
    seed = "unknown" if known_seed is None else known_seed
    source = f"simulated {model.arm.name}, scheme {scheme}, seed {seed}{assumed}"
    if orientation_noise is not None:
        plausible.TURN_NOISE.check(orientation_noise, "orientation_noise")
    shop = _Workshop(model, noise, temperature_range, rng, source, orientation_noise)
    if scheme == "free":
        return shop.free(Room(model.arm, above).postures(records, rng)[0])
    counts = np.bincount(np.arange(records) % points)
    each = int(counts.max())
    pool = Pool.draw(model, above, each, rng)
    if bar_length:
        places = bars_for(pool, points // 2, bar_length, each, rng)
    else:
        places = seats_for(pool, points, each, rng)
    return shop.touched(places, counts, stated, bar_length)


def simulate_touches(
    model: ErrorModel, q: Array, points: Array, *, rng: np.random.Generator, noise: Noise
) -> Measurements:
    """Records of touches in order, near the postures ``q`` (n, nq) [rad], without references.

    The tip, with all errors, is at ``points`` (n, 3) [m] plus noise of contacts.

    Raises:
        AacmmError: a point cannot be touched near its posture.
    """
    source = f"simulated {model.arm.name}, probed points"
    return _Workshop(model, noise, 3.0, rng, source).at(points, q)


@dataclass(frozen=True, eq=False)
class _Workshop:
    model: ErrorModel
    noise: Noise
    temperature_range: float
    rng: np.random.Generator
    source: str
    orientation_noise: float | None = None

    def free(self, q: Array) -> Measurements:
        """Each record has its own reference."""
        conditions = self._conditions(sessions(len(q)), q, None)
        tips = self.model.predict(q, conditions, as_referenced=True)
        touched = tips + self._normal(self.noise.probe, tips)
        stated = touched + self._normal(self.noise.reference, tips)
        return self._recorded(q, conditions, stated)

    def touched(
        self, places: list[SeatOrBar], counts: Index, stated: bool, length: float | None
    ) -> Measurements:
        """``counts`` (k,) records at seats, or at both ends of bars."""
        points = np.concatenate([place.points for place in places])
        ends = [f"B{k}{end}" for k in range(1, len(places) + 1) for end in "AB"]
        names = _seat_labels(len(points)) if length is None else ends
        postures = [q for place in places for q in place.postures]
        session = sessions(int(counts.sum()))
        point, posture = visits(counts, session, self.rng)
        q = np.stack([postures[k][j] for k, j in zip(point, posture, strict=True)])
        seat = np.array(names, dtype=object)[point]
        conditions = self._conditions(session, q, seat)
        q = self._exactly(q, points[point], conditions)
        reference = None
        if stated:
            first = np.unique(point, return_index=True)[1]
            seats = self.model.predict(q[first], conditions.take(first), as_referenced=True)
            reference = (seats + self._normal(self.noise.reference, seats))[point]
        if self.noise.probe > 0:
            contacts = points[point] + self._normal(self.noise.probe, points[point])
            q = self._exactly(q, contacts, conditions)
        bars: dict[str, Any] = {}
        if length is not None:
            lengths = length + self._normal(self.noise.reference, np.empty(len(places)))
            bars = {
                "bar": [label[:-1] for label in seat],
                "bar_end": [label[-1] for label in seat],
                "bar_length": lengths[point // 2],
            }
        return self._recorded(q, conditions, reference, **bars)

    def at(self, points: Array, q: Array) -> Measurements:
        conditions = self._conditions(sessions(len(q)), q, None)
        touched = points + self._normal(self.noise.probe, points)
        exact = self._exactly(q, touched, conditions)
        return self._recorded(exact, conditions, None)

    def _exactly(self, q: Array, target: Array, conditions: Conditions) -> Array:
        """Postures near ``q`` whose tip, with all errors, is at ``target`` (n, 3) [m]."""
        arm = self.model.arm
        q, arrived = brought_to(
            lambda q, rows: self.model.state(q, conditions.take(rows)), q, target, arm.limits
        )
        if not arrived.all():
            causes = ", ".join(effect.label for effect in self.model.effects if effect.needs)
            advice = f"reduce {causes}" if causes else "use a procedure of this arm"
            raise AacmmError(
                f"{arm.name}: {(~arrived).sum()} of {len(q)} records have no posture within the "
                f"limits; {advice}"
            )
        return q

    def _conditions(self, session: Index, q: Array, seat: Labels | None) -> Conditions:
        return workshop_conditions(self.model, session, q, seat, self.temperature_range, self.rng)

    def _normal(self, u: float, like: Array) -> Array:
        return u * self.rng.normal(size=like.shape)

    def _recorded(
        self, q: Array, conditions: Conditions, reference: Array | None, **more: Any
    ) -> Measurements:
        """Exact references state no uncertainty."""
        arm = self.model.arm
        readings = arm.readings(q) + self.noise.encoder * self.rng.normal(size=q.shape)
        u = self.noise.reference
        if reference is not None and u > 0:
            more["reference_u"] = np.full_like(reference, u)
        turn_u = self.orientation_noise
        if turn_u is not None and reference is not None:
            state = self.model.state(q, conditions, as_referenced=True)
            turn = self._normal(turn_u, reference)
            rotation = exp(np.hstack([np.zeros_like(turn), turn]))[:, :3, :3]
            more["orientation"] = quaternions(rotation @ state.rotation[-1])
            more["orientation_u"] = np.full(len(q), turn_u) if turn_u > 0 else None
        more |= {"record": [*map(str, range(1, len(q) + 1))], "source": self.source}
        records = Measurements.of(readings, reference, conditions=conditions, **more)
        return records.with_joint_angles(arm)


def _seat_labels(count: int) -> list[str]:
    return [f"S{k}" for k in range(1, count + 1)]


def _check_numbers(
    scheme: Scheme, records: int, points: int, stated: bool, bar_length: float | None
) -> None:
    whole(records, 1, "records")
    if scheme != "free":
        whole(points, 1, "seats")
    of_seat = 1 if stated else 2
    least = max(1, of_seat * points)
    if records < least:
        each = f" ({of_seat} for each of {points} seats)" if points else ""
        raise AacmmError(
            f"records is {records}; expected at least {least}{each}; use more records or fewer "
            "seats"
        )
    if scheme == "ball-bar" and points % 2:
        raise AacmmError(
            f"seats is {points}; expected an even number, because each ball bar has two seats"
        )
    if (bar_length is not None) != (scheme == "ball-bar"):
        if bar_length is None:
            raise AacmmError(f"bar_length is missing; expected a length for scheme {scheme!r}")
        raise AacmmError(
            f"bar_length is {bar_length:g} m; expected none, because scheme {scheme!r} has no bars"
        )
    if bar_length is not None:
        SIMULATED_BAR.check(bar_length, "bar_length")


def seed_of(rng: np.random.Generator) -> int | None:
    """The seed of an unused generator, or None."""
    bits = rng.bit_generator
    seed = getattr(bits, "seed_seq", None)
    if (
        not isinstance(seed, np.random.SeedSequence)
        or seed.spawn_key
        or not isinstance(seed.entropy, int)
    ):
        return None
    return seed.entropy if repr(type(bits)(seed).state) == repr(bits.state) else None
