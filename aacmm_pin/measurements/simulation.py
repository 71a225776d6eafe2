"""Simulated measurements of an arm with known errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, Index, whole
from aacmm_pin._support.units import MM
from aacmm_pin.arm import MOST_DRAWS, Arm, Room, exp, joint_bounds
from aacmm_pin.effects import Conditions, ErrorModel, GivenModel, Labels, corrects_seat
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.noise import ENCODER, PROBE, REFERENCE_NOISE, Noise
from aacmm_pin.measurements.orientation import quaternions
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.postures import StateOf, agile, brought_to, different_postures, spread_out

Scheme = Literal["free", "seats", "ball-bar", "single-point"]
SCHEMES: tuple[Scheme, ...] = get_args(Scheme)
SEATS_APART = 0.05
"""[m]"""
POOL = 20_000
"""Random postures."""
GUESSES = 4
"""For each wanted posture, and at least :data:`LEAST_GUESSES`."""
LEAST_GUESSES = 100
CANDIDATES = 30
"""For each wanted seat or bar."""
TRIES = 4
"""Likewise, at which postures are searched."""
SIMULATED_BAR = plausible.BAR_LENGTH._replace(least=SEATS_APART)
"""Lengths of bars, whose ends are seats some distance apart [m]."""
MOST_IN_SESSION = 200
RECORD_INTERVAL = (20.0, 40.0)
"""[s]"""
PAUSE_LENGTH = (180.0, 900.0)
"""[s]"""
PAUSES = 1 / 40
"""Per record."""
BREAK = (3600.0, 3 * 3600.0)
"""Between sessions [s]; the arm stays on."""
DAY = 24 * 3600.0
"""[s]"""
OVERSHOOT = 0.2
"""Share of joints whose last motion is reversed."""
TEMPERATURE_RANGE = 3.0
"""Largest difference from the reference temperature of the arm [K]."""


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
    the stated coordinates. Postures avoid the obstacles of :class:`Room`, and stay 1e-3 rad off the
    limits. Time, temperature and approach are those of a workshop. A session has at most 200
    records.

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
    seat_count = {"free": 0, "single-point": 1}.get(scheme, seats)
    stated = scheme == "free" or (scheme == "seats" and known)
    _check_numbers(scheme, records, seat_count, stated, bar_length)
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
    stated_seed = seed_of(rng)
    seed = "unknown" if stated_seed is None else stated_seed
    source = f"simulated {model.arm.name}, scheme {scheme}, seed {seed}{assumed}"
    if orientation_noise is not None:
        plausible.ROTATION_NOISE.check(orientation_noise, "orientation_noise")
    workshop = _Workshop(model, noise, rng, source, orientation_noise)
    if scheme == "free":
        return workshop.free(Room(model.arm, above).postures(records, rng)[0])
    counts = np.bincount(np.arange(records) % seat_count)
    most_visits = int(counts.max())
    pool = Pool.draw(model, above, most_visits, rng)
    if bar_length:
        seats_or_bars = bars_for(pool, seat_count // 2, bar_length, most_visits, rng)
    else:
        seats_or_bars = seats_for(pool, seat_count, most_visits, rng)
    return workshop.touched(seats_or_bars, counts, stated, bar_length)


def simulate_touches(
    model: ErrorModel, q: Array, points: Array, *, rng: np.random.Generator, noise: Noise
) -> Measurements:
    """Records of touches in order, near the postures ``q`` (n, nq) [rad], without references.

    The tip, with all errors, is at ``points`` (n, 3) [m] plus noise of contacts.

    Raises:
        AacmmError: a point cannot be touched near its posture.
    """
    source = f"simulated {model.arm.name}, probed points"
    return _Workshop(model, noise, rng, source).at(points, q)


@dataclass(frozen=True, eq=False)
class _Workshop:
    model: ErrorModel
    noise: Noise
    rng: np.random.Generator
    source: str
    orientation_noise: float | None = None

    def free(self, q: Array) -> Measurements:
        conditions = self._conditions(q)
        tips = self.model.predict(q, conditions, as_referenced=True)
        contacts = tips + self._normal(self.noise.probe, tips)
        stated = contacts + self._normal(self.noise.reference, tips)
        return self._measurements(q, conditions, stated)

    def touched(
        self, seats_or_bars: list[SeatOrBar], counts: Index, stated: bool, length: float | None
    ) -> Measurements:
        """``counts`` (k,) records at seats, or at both ends of bars."""
        points = np.concatenate([touched.points for touched in seats_or_bars])
        ends = [f"B{k}{end}" for k in range(1, len(seats_or_bars) + 1) for end in "AB"]
        names = _seat_labels(len(points)) if length is None else ends
        postures = [q for touched in seats_or_bars for q in touched.postures]
        session = sessions(int(counts.sum()))
        point, number = visits(counts, session, self.rng)
        q = np.stack([postures[k][j] for k, j in zip(point, number, strict=True)])
        seat = np.array(names, dtype=object)[point]
        conditions = self._conditions(q, seat)
        q = self._postures_at(q, points[point], conditions)
        reference = None
        if stated:
            first = np.unique(point, return_index=True)[1]
            seats = self.model.predict(q[first], conditions.take(first), as_referenced=True)
            reference = (seats + self._normal(self.noise.reference, seats))[point]
        # The references are of the points themselves; each contact misses its point.
        if self.noise.probe > 0:
            contacts = points[point] + self._normal(self.noise.probe, points[point])
            q = self._postures_at(q, contacts, conditions)
        bars: dict[str, Any] = {}
        if length is not None:
            lengths = length + self._normal(self.noise.reference, np.empty(len(seats_or_bars)))
            bars = {
                "bar": [label[:-1] for label in seat],
                "bar_end": [label[-1] for label in seat],
                "bar_length": lengths[point // 2],
            }
        return self._measurements(q, conditions, reference, **bars)

    def at(self, points: Array, q: Array) -> Measurements:
        conditions = self._conditions(q)
        contacts = points + self._normal(self.noise.probe, points)
        postures = self._postures_at(q, contacts, conditions)
        return self._measurements(postures, conditions, None)

    def _postures_at(self, q: Array, target: Array, conditions: Conditions) -> Array:
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

    def _conditions(self, q: Array, seat: Labels | None = None) -> Conditions:
        """Conditions of records in order.

        Time counts from switching on. The temperature stays within :data:`TEMPERATURE_RANGE` of the
        reference. The approach is the sign of the motion since the record before (first: the mean
        posture), reversed for one joint in five. Probe directions are random, if the model needs
        them.
        """
        n = len(q)
        rng = self.rng
        session = sessions(n)
        intervals = rng.uniform(*RECORD_INTERVAL, size=n)
        is_pause = rng.random(n) < PAUSES
        intervals += is_pause * rng.uniform(*PAUSE_LENGTH, size=n)
        is_break = np.diff(session, prepend=session[:1]) > 0
        intervals += is_break * rng.uniform(*BREAK, size=n)
        time = np.cumsum(intervals)
        offset, drift, phase = rng.uniform(-1.0, 1.0, size=3)
        by_time = 0.3 * drift * time / time.max(initial=1.0)
        by_day = 0.2 * np.sin(2 * np.pi * time / DAY + np.pi * phase)
        share = 0.4 * offset + by_time + by_day + rng.uniform(-0.1, 0.1, size=n)
        approach = np.sign(np.diff(q, axis=0, prepend=q.mean(axis=0, keepdims=True)))
        is_reversed = rng.random(q.shape) < OVERSHOOT
        approach = np.where(is_reversed, -approach, approach)
        labels = np.array([str(number + 1) for number in session], dtype=object)
        conditions = Conditions(
            n,
            time=time,
            temperature=self.model.arm.reference_temperature + TEMPERATURE_RANGE * share,
            approach=approach + 0.0,  # without -0
            seat=seat,
            session=labels if session.any() else None,
        )
        needs = {need for effect in self.model.effects for need in effect.needs}
        if "probe_direction" in needs:
            # A stream of its own: all other numbers are the same without it.
            directions = probe_directions(n, rng.spawn(1)[0])
            conditions = replace(conditions, probe_direction=directions)
        return conditions.with_usual(needs, q.shape[1])

    def _normal(self, u: float, like: Array) -> Array:
        return u * self.rng.normal(size=like.shape)

    def _measurements(
        self, q: Array, conditions: Conditions, reference: Array | None, **attributes: Any
    ) -> Measurements:
        """Exact references state no u."""
        arm = self.model.arm
        readings = arm.readings(q) + self.noise.encoder * self.rng.normal(size=q.shape)
        u = self.noise.reference
        if reference is not None and u > 0:
            attributes["reference_u"] = np.full_like(reference, u)
        rotation_u = self.orientation_noise
        if rotation_u is not None and reference is not None:
            state = self.model.state(q, conditions, as_referenced=True)
            errors = self._normal(rotation_u, reference)
            rotations = exp(np.hstack([np.zeros_like(errors), errors]))[:, :3, :3]
            attributes["orientation"] = quaternions(rotations @ state.rotation[-1])
            attributes["orientation_u"] = np.full(len(q), rotation_u) if rotation_u > 0 else None
        attributes["record"] = [str(number) for number in range(1, len(q) + 1)]
        records = Measurements.of(
            readings, reference, conditions=conditions, source=self.source, **attributes
        )
        return records.with_joint_angles(arm)


def _seat_labels(count: int) -> list[str]:
    return [f"S{k}" for k in range(1, count + 1)]


def _check_numbers(
    scheme: Scheme, records: int, seats: int, stated: bool, bar_length: float | None
) -> None:
    """A seat without ``stated`` coordinates needs two records."""
    whole(records, 1, "records")
    if scheme != "free":
        whole(seats, 1, "seats")
    least_per_seat = 1 if stated else 2
    least = max(1, least_per_seat * seats)
    if records < least:
        for_each_seat = f" ({least_per_seat} for each of {seats} seats)" if seats else ""
        raise AacmmError(
            f"records is {records}; expected at least {least}{for_each_seat}; use more records or "
            "fewer seats"
        )
    if scheme == "ball-bar" and seats % 2:
        raise AacmmError(
            f"seats is {seats}; expected an even number, because each ball bar has two seats"
        )
    if (bar_length is not None) != (scheme == "ball-bar"):
        raise AacmmError(
            f"bar_length is {bar_length}; expected a length [m] for scheme 'ball-bar', else None"
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


def sessions(records: int) -> Index:
    """Session of each record, from 0, of equal sizes: (records,)."""
    count = -(-records // MOST_IN_SESSION)
    return np.sort(np.arange(records) % count)


def probe_directions(n: int, rng: np.random.Generator) -> Array:
    """Random unit vectors (n, 3), as directions of probing."""
    vectors = rng.normal(size=(n, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


# --- points, and postures at them


@dataclass(frozen=True, eq=False)
class SeatOrBar:
    """Points touched together: one seat, or the two ends of a bar.

    Attributes:
        points: (k, 3) [m].
        postures: of each point, (m, nq) [rad].
    """

    points: Array
    postures: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Pool:
    """Random postures of an arm.

    Attributes:
        room: the arm and the room of its tip.
        state_of: the arm with its errors that do not depend on conditions.
        q: (n, nq) [rad].
        tips: (n, 3) [m].
        tree: of the tips.
    """

    room: Room
    state_of: StateOf
    q: Array
    tips: Array
    tree: scipy.spatial.cKDTree

    @staticmethod
    def draw(model: ErrorModel, above: float | None, count: int, rng: np.random.Generator) -> Pool:
        """For ``count`` postures at a point, over a table at ``above`` [m].

        Raises:
            AacmmError: see :meth:`Room.postures`.
        """
        room = Room(model.arm, above)
        q, tips = room.postures(max(POOL, 10 * GUESSES * count), rng)
        effects = [effect for effect in model.effects if not effect.needs]
        steady = model.restricted(tuple(effects))
        tree = scipy.spatial.cKDTree(tips)
        return Pool(room, lambda q, _: steady.state(q), q, tips, tree)

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.room.arm

    def thinness(self, points: Array, most: float = np.inf) -> Array:
        """Radius about each point (n, 3) with the nearest tips: large if few postures reach it [m].
        Infinite from ``most`` on, to save time.
        """
        distances, _ = self.tree.query(points, k=LEAST_GUESSES, distance_upper_bound=most)
        return np.asarray(distances[:, -1])

    def dense(self, rng: np.random.Generator, count: int) -> Array:
        """The better half of ``2 count`` random tips, reached by many postures: (count, 3) [m]."""
        chosen = rng.permutation(len(self.tips))[: 2 * count]
        points = self.tips[chosen]
        order = np.argsort(self.thinness(points))
        return points[order[: len(points) // 2]]

    def postures_at(self, points: Array, count: int) -> list[Array]:
        """Up to ``count`` different postures at each of the ``points`` (k, 3)."""
        guesses = max(LEAST_GUESSES, GUESSES * count)
        _, nearest = self.tree.query(points, k=guesses)
        bounds = joint_bounds(self.arm)
        target = np.repeat(points, guesses, axis=0)
        q, arrived = brought_to(self.state_of, self.q[nearest.ravel()], target, bounds)
        low, high = bounds.T
        arrived &= ((q > low) & (q < high)).all(axis=1)
        if arrived.any():
            state = self.state_of(q[arrived], np.flatnonzero(arrived))
            arrived[arrived] = agile(state)
        postures = []
        for start in range(0, len(q), guesses):
            of_point = slice(start, start + guesses)
            solutions = q[of_point][arrived[of_point]]
            postures.append(different_postures(self.arm, solutions, count))
        return postures

    def reached(self, candidates: Array, wanted: int, count: int, what: str) -> list[SeatOrBar]:
        """The first ``wanted`` of ``candidates`` (c, k, 3) with ``count`` postures at all k points.

        Raises:
            AacmmError: there are fewer.
        """
        reached: list[SeatOrBar] = []
        most_elsewhere = 0
        tried = 0
        while len(reached) < wanted and tried < len(candidates):
            batch = candidates[tried : tried + wanted - len(reached)]
            tried += len(batch)
            postures = self.postures_at(batch.reshape(-1, 3), count)
            for k, points in enumerate(batch):
                at_points = tuple(postures[k * len(points) : (k + 1) * len(points)])
                fewest = min(map(len, at_points))
                if fewest == count:
                    reached.append(SeatOrBar(points, at_points))
                else:
                    most_elsewhere = max(most_elsewhere, fewest)
        if len(reached) < wanted:
            raise AacmmError(
                f"{self.arm.name}: the arm reaches only {len(reached)} {what} in {count} postures "
                f"within the limits; expected {wanted}; check these limits, or ask for fewer "
                f"records or {what} (the other {what} have at most {most_elsewhere} postures)"
            )
        return reached


def seats_for(pool: Pool, wanted: int, count: int, rng: np.random.Generator) -> list[SeatOrBar]:
    """Seats spread over the dense workspace, each with ``count`` postures.

    Raises:
        AacmmError: no room for so many, or too few postures.
    """
    points = pool.dense(rng, CANDIDATES * wanted)
    order = spread_out(points, TRIES * wanted, SEATS_APART)
    if len(order) < wanted:
        raise AacmmError(
            f"{pool.arm.name}: the workspace has room for {len(order)} seats at distances of "
            f"{SEATS_APART / MM:g} mm or more; expected {wanted}; reduce the number of seats"
        )
    return pool.reached(points[order][:, None], wanted, count, "seats")


def bars_for(
    pool: Pool, wanted: int, length: float, count: int, rng: np.random.Generator
) -> list[SeatOrBar]:
    """``wanted`` bars of ``length`` [m], each end with ``count`` postures.

    One end is a random tip; the other lies towards another, where postures are as dense as at
    seats.

    Raises:
        AacmmError: no room for so many, or too few postures at both ends.
    """
    first = pool.dense(rng, CANDIDATES * wanted)
    second = first.copy()
    has_end = np.zeros(len(first), dtype=bool)
    enough = float(pool.thinness(first).max())
    for _ in range(MOST_DRAWS):
        towards_tip = pool.tips[rng.integers(len(pool.tips), size=len(first))] - first
        distance = np.linalg.norm(towards_tip, axis=1, keepdims=True)
        trial = first + length * towards_tip / np.maximum(distance, MM)
        fits = ~has_end & (distance[:, 0] > MM)
        fits &= pool.room.admits(trial) & (pool.thinness(trial) <= enough)
        second[fits] = trial[fits]
        has_end |= fits
    if has_end.sum() < wanted:
        extent = np.linalg.norm(pool.tips.max(axis=0) - pool.tips.min(axis=0))
        raise AacmmError(
            f"{pool.arm.name}: the workspace has room for {has_end.sum()} bars of {length / MM:g} "
            f"mm; expected {wanted}; use shorter or fewer bars (the diagonal of the "
            f"workspace is {extent / MM:.0f} mm)"
        )
    first = first[has_end]
    second = second[has_end]
    order = spread_out((first + second) / 2, TRIES * wanted, 0.0)
    return pool.reached(np.stack([first, second], axis=1)[order], wanted, count, "bars")


def visits(counts: Index, session: Index, rng: np.random.Generator) -> tuple[Index, Index]:
    """The order of records: point by point in each session, with its share of every point.

    Args:
        counts: records of each point (k,).
        session: of each record, ascending (n,).
        rng: for the order of points and of postures.

    Returns:
        point and number of its posture, of each record (n,).
    """
    point = np.repeat(np.arange(len(counts)), counts)
    posture = np.concatenate([np.arange(count) for count in counts])
    session_count = int(session[-1]) + 1
    session_of = np.arange(len(point)) % session_count
    rank = np.stack([rng.permutation(len(counts)) for _ in range(session_count)])
    order = np.lexsort((rng.random(len(point)), rank[session_of, point], session_of))
    return point[order], posture[order]
