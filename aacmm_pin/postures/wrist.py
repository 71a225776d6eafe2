"""The wrist: a point that joints 1 to 4 move, the others held.

Near the base axis curves run at almost constant θ3, and on it θ1 is free: the closed form holds
each of joints 1 to 4 in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, Index, vector
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import OF_A_POSE, Arm, DHTable, into_limits, screws, table
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.postures.continuation import POINT
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import Curves, all_curves
from aacmm_pin.postures.three_revolutes import candidates

POSITIONING = 4
"""Joints that place the wrist."""
WRIST_ROW = 5
"""The wrist is the origin of this frame."""
SEEN_LEVER = 1e-4
"""A note states a larger distance of the wrist from joint 5 (SINO6: 0.037 mm) [m]."""
MOST_LEVER = 0.01
"""A larger distance is by design; the largest residue of SINO6 is 0.7 mm [m]."""
GRID = 16
"""Angles of each of joints 1 to 4 to search for the reach."""
LOCAL_SEARCHES = 4
"""Starts of a local search: 25 random arms all had the reach that 16 starts find."""


@dataclass(frozen=True)
class Wrist:
    """The origin of frame 5 as a function of joints 1 to 4, with the others held.

    Attributes:
        table: rows 1 to 5 with the fifth fixed.
        rest: held angles of the joints after joint 4, (nq - 4,) [rad].
    """

    table: DHTable
    rest: Array

    @staticmethod
    def of_arm(arm: Arm, purpose: str, rest: ArrayLike | None = None) -> Wrist:
        """The wrist of an arm within limits; errors name the ``purpose``."""
        wrist = Wrist.of(arm.require_dh(purpose, WRIST_ROW, revolute=True), rest, arm.limits)
        if rest is None and wrist.lever > MOST_LEVER:
            pose = ", or --rpy-deg" if arm.nq >= OF_A_POSE else ""
            raise UnsupportedArmError(
                f"{arm.name}: {purpose} needs a wrist, but {wrist.held}; expected at most "
                f"{MOST_LEVER / MM:g} mm; to place the tip use --axis 0 0 -1{pose} (in Python "
                "reaching_postures)"
            )
        return wrist

    @staticmethod
    def of(dh: DHTable, rest: ArrayLike | None = None, limits: Array | None = None) -> Wrist:
        """Hold joints 5 and up.

        Args:
            rest: held angles (nq - 4,) [rad]; default closest to 0 inside ``limits``.
            limits: of all joints (nq, 2) [rad], or None.
        """
        count = dh.nq - POSITIONING
        held = np.zeros(count) if rest is None else vector(rest, count, "rest", "rad")
        if rest is None and limits is not None:
            nearest = into_limits(held, limits[POSITIONING:])
            # Exactly 0 where that is inside.
            held = np.clip(nearest, *limits[POSITIONING:].T) - nearest
        rows = dh.values()[:WRIST_ROW]
        theta_of_wrist_row = -1, -1
        rows[theta_of_wrist_row] += held[0]
        moving = [True] * POSITIONING + [False]
        return Wrist(table(rows, dh.convention, moving), held)

    @property
    def lever(self) -> float:
        """From the axis of joint 5 to the wrist [m]."""
        if not self.table.standard:
            return 0.0
        return abs(float(self.table.a[-1]))

    @property
    def held(self) -> str:
        """The held joint and its distance from the wrist, in words."""
        return (
            f"the axis of joint {WRIST_ROW}, held at {self.rest[0] / DEG:.4g}°, is "
            f"{self.lever / MM:.4g} mm from frame{WRIST_ROW}"
        )

    @property
    def notes(self) -> list[Note]:
        """A note on the neglected joint 5."""
        if self.lever <= SEEN_LEVER:
            return []
        return [Note("wrist_joint_held", {"held": self.held})]

    def curves(self, points: Array, per_turn: int) -> Curves:
        """Curves of joints 1 to 4 with the wrist at ``points`` (m, 3) [m]; each joint is held at
        ``per_turn`` angles.
        """
        equations = Equations(self.table.chain.links(), points, POINT)
        guesses = partial(self.guesses, per_turn=per_turn)
        return all_curves(equations, POSITIONING * per_turn, guesses)

    def guesses(self, points: Array, per_turn: int) -> tuple[Array, Index]:
        """Joints 1 to 4 (n, 4) [rad] near those with the wrist at ``points`` (m, 3) [m], and the
        point of each (n,): each joint is held at ``per_turn`` angles, the other three are in closed
        form.
        """
        links = self.table.chain.links()
        # Off the symmetric angles 0 and ±π.
        angles = np.linspace(-np.pi, np.pi, per_turn, endpoint=False) + 0.37
        rotations = screws(angles, 0.0, 2)
        point, angle = np.indices((len(points), per_turn)).reshape(2, -1)
        guesses = []
        points_of_guesses = []
        for held in range(POSITIONING):
            constants = [np.broadcast_to(link, rotations.shape) for link in links[:WRIST_ROW]]
            constants[held : held + 2] = [constants[held] @ rotations @ links[held + 1]]
            b0, b1, b2 = (transforms[angle] for transforms in constants[:3])
            others, pair = candidates(b0, b1, b2, constants[3][angle, :3, 3], points[point])
            guesses.append(np.insert(others, held, angles[angle[pair]], axis=1))
            points_of_guesses.append(point[pair])
        return np.concatenate(guesses), np.concatenate(points_of_guesses)

    def full(self, q: Array) -> Array:
        """All joints from the first four: (n, nq) [rad]."""
        return np.hstack([q, np.tile(self.rest, (len(q), 1))])


def reach_of_wrist(wrist: Wrist, shoulder: Array) -> tuple[float, float]:
    """Least and largest distance of the wrist from ``shoulder`` (3,) [m], without limits."""
    nearest, farthest = _extremes(wrist, lambda at: np.square(at - shoulder).sum(axis=-1))
    return float(np.sqrt(max(nearest, 0.0))), float(np.sqrt(farthest))


def box_of_wrist(wrist: Wrist) -> Array:
    """Least and largest distance of the wrist from the base z axis, then least and largest z (4,)
    [m], without limits.
    """
    squared_radii = _extremes(wrist, lambda at: np.square(at[..., :2]).sum(axis=-1))
    heights = _extremes(wrist, lambda at: at[..., 2])
    return np.array([*np.sqrt(np.maximum(squared_radii, 0.0)), *heights])


def _extremes(wrist: Wrist, value_at: Callable[[Array], Array]) -> tuple[float, float]:
    """Least and largest value over all postures, of a function of the wrist's place (…, 3) [m]."""
    return _least(wrist, value_at), -_least(wrist, lambda at: -value_at(at))


def _least(wrist: Wrist, value_at: Callable[[Array], Array]) -> float:
    """Of a grid, then of local searches."""

    def value(q: Array) -> Array:
        return value_at(wrist.table.chain.positions(q.reshape(-1, POSITIONING)))

    angles = np.linspace(-np.pi, np.pi, GRID, endpoint=False)
    grid = np.stack(np.meshgrid(*[angles] * POSITIONING), axis=-1).reshape(-1, POSITIONING)
    starts = grid[np.argsort(value(grid))[:LOCAL_SEARCHES]]
    return min(
        float(scipy.optimize.minimize(lambda q: value(q)[0], start, method="BFGS").fun)
        for start in starts
    )
