"""Where the arm is sent: postures in free space, or seats that are touched in many postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind.chains import Chain
from blind.conditions import SESSIONS
from blind.kinematics import Array

PLANS = ("free", "seats", "unknown-seats")
MARGIN = 0.02
"""[rad] that postures keep from the limits."""
SEATS = 10
APART = 0.22
CONE = np.radians(70.0)
"""The stylus enters a seat within this angle of the seat's axis."""


@dataclass(frozen=True, eq=False)
class Seats:
    """Points (S, 3) [m], outward axes (S, 3) and bars: pairs of seats (B, 2)."""

    points: Array
    axes: Array
    bars: NDArray[np.int_]

    def lengths(self) -> Array:
        """Of the bars (B,) [m]."""
        return np.asarray(
            np.linalg.norm(self.points[self.bars[:, 0]] - self.points[self.bars[:, 1]], axis=1)
        )


def free_postures(rng: np.random.Generator, arm: Chain, n: int) -> Array:
    """(n, nq) [rad]: a Latin hypercube within the limits."""
    low, high = arm.limits[:, 0] + MARGIN, arm.limits[:, 1] - MARGIN
    strata = np.stack([rng.permutation(n) for _ in low], axis=1)
    return low + (high - low) * (strata + rng.uniform(size=strata.shape)) / n


def random_postures(rng: np.random.Generator, arm: Chain, n: int) -> Array:
    return rng.uniform(arm.limits[:, 0] + MARGIN, arm.limits[:, 1] - MARGIN, (n, len(arm.limits)))


def choose_seats(rng: np.random.Generator, arm: Chain) -> Seats:
    """Seats on and over a table beside the arm: 0.3 to 0.9 m from its axis, within 0.5 m of its
    height, some way apart.
    """
    points: list[Array] = []
    tips = arm.tips(random_postures(rng, arm, 3000))
    out = np.hypot(tips[:, 0], tips[:, 1])
    for point in tips[(out > 0.3) & (out < 0.9) & (np.abs(tips[:, 2]) < 0.5)]:
        if len(points) < SEATS and all(np.linalg.norm(point - other) > APART for other in points):
            points.append(point)
    if len(points) < SEATS:
        raise ValueError(f"{len(points)} seats within reach, expected {SEATS}")
    axes = np.array([0.0, 0.0, 1.0]) + rng.normal(0.0, 0.25, (SEATS, 3))
    return Seats(
        np.array(points),
        axes / np.linalg.norm(axes, axis=1)[:, None],
        rng.permutation(SEATS).reshape(-1, 2),
    )


def visits(n: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Seat and session of each record (n,)."""
    session = np.arange(n) * SESSIONS // n
    return round_trips(session, SEATS), session


def round_trips(session: NDArray[np.int_], seats: int) -> NDArray[np.int_]:
    """Index of the seat of each record (n,): each session goes round all seats, or as many as it
    has records for.
    """
    seat = np.empty(len(session), dtype=int)
    for number in range(session[-1] + 1):
        these = np.flatnonzero(session == number)
        seat[these] = (
            np.arange(len(these)) * seats // len(these) if len(these) >= seats else these % seats
        )
    return seat


def seat_postures(
    rng: np.random.Generator, arm: Chain, seats: Seats, seat: NDArray[np.int_]
) -> Array:
    """One posture for each visit of ``seat`` (n,), (n, nq) [rad], with the tip in the seat by the
    bare table.

    Random postures are turned about the first axis towards a seat; those that end near it are
    brought into it.
    """
    q = np.full((len(seat), len(arm.limits)), np.nan)
    for _ in range(40):
        missing = np.flatnonzero(np.isnan(q[:, 0]))
        if not missing.size:
            return q
        found, of = _into(arm, seats, *_near(rng, arm, seats, seat[missing]))
        for s in range(len(seats.points)):
            open_, filled = missing[seat[missing] == s], np.flatnonzero(of == s)
            both = min(len(open_), len(filled))
            q[open_[:both]] = found[filled[:both]]
    raise ValueError("no postures found for a seat")


def _near(
    rng: np.random.Generator, arm: Chain, seats: Seats, wanted: NDArray[np.int_]
) -> tuple[Array, NDArray[np.int_]]:
    """Random postures whose tip comes near a seat after a turn about the first axis, and which
    seat.
    """
    pool = random_postures(rng, arm, 3000 + 10 * len(wanted))
    tips = arm.tips(pool)
    out, target = np.hypot(tips[:, 0], tips[:, 1]), np.hypot(seats.points[:, 0], seats.points[:, 1])
    postures, of = [], []
    for s, count in enumerate(np.bincount(wanted, minlength=len(seats.points))):
        far = np.hypot(out - target[s], tips[:, 2] - seats.points[s, 2])
        chosen = np.argsort(far)[: 5 * count]
        turned = pool[chosen].copy()
        azimuth = np.arctan2(tips[chosen, 1], tips[chosen, 0])
        turned[:, 0] += np.arctan2(seats.points[s, 1], seats.points[s, 0]) - azimuth
        postures.append(turned)
        of.append(np.full(len(chosen), s))
    return np.concatenate(postures), np.concatenate(of)


def _into(
    arm: Chain, seats: Seats, q: Array, of: NDArray[np.int_]
) -> tuple[Array, NDArray[np.int_]]:
    """Postures brought into their seats; only those within the limits whose stylus enters the seat
    from above.
    """
    for _ in range(8):
        j = arm.jacobian(q)
        square = j @ j.transpose(0, 2, 1) + 1e-9 * np.eye(3)
        step = np.linalg.solve(square, (seats.points[of] - arm.tips(q))[..., None])
        q = q + np.clip(np.einsum("nkj,nk->nj", j, step[..., 0]), -0.5, 0.5)
    low = arm.limits[:, 0]
    whole = arm.limits[:, 1] - low > 6.28
    q = np.where(whole, low + np.mod(q - low, 2.0 * np.pi), q)
    last = arm.walk(q)[1]
    there = np.abs(last[:, :3, 3] - seats.points[of]).max(axis=1) < 1e-6
    inside = ((q > low + MARGIN) & (q < arm.limits[:, 1] - MARGIN)).all(axis=1)
    stylus = last[:, :3, :3] @ arm.stylus
    enters = np.einsum("ni,ni->n", stylus, -seats.axes[of]) > np.cos(CONE)
    good = there & inside & enters
    return q[good], of[good]
