"""Touched points of simulated or planned measurements: seats and bars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import MM
from aacmm_pin.arm import MOST_DRAWS, Arm, Room, joint_bounds
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import StateOf, agile, brought_to, different_postures, spread_out

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
