"""Samples of closed curves: evenly spaced, at swivel angles, and inside the limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, Index, Mask, whole
from aacmm_pin._support.display import Shown
from aacmm_pin.arm import inside_part, into_limits, outside_limits
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import Curve, following
from aacmm_pin.postures.wrist_ik import Wrist

FINER = 16
"""Parts of each piece to measure a path."""
STILL = 1e-9
"""A shorter path of a whole curve is none [m, rad]."""
ARC_BINS = 3600
"""Resolution of the arc fraction: 0.1° of swivel."""
SAME_SWIVEL = 1e-10
"""Tolerance of a wanted angle [rad]."""
MOST_TRIALS, NO_LENGTH = 100, 1e-15
"""Trials, and length of a bracket, at which it is met as well as can be [rad]."""
CURVED = 0.02
"""Largest distance of a curve from a chord [rad]."""
OUTWARDS = np.array([-1.0, 1.0])
"""Of a lower and an upper limit."""
LIMIT_PARTS = 16
"""Of a piece that may meet a limit."""


@dataclass(frozen=True, eq=False)
class _Segments:
    """Pieces between neighbouring vertices of all curves.

    Attributes:
        start, end: postures (s, k) [rad], not wrapped.
        swivel: angle at the start (s,) [rad].
        turn: change of swivel along the piece (s,) [rad], in (-π, π).
        problem: number of the point (s,).
    """

    start: Array
    end: Array
    swivel: Array
    turn: Array
    problem: Index


@dataclass(frozen=True, eq=False)
class Components:
    """Closed curves of postures that reach one or many points.

    Attributes:
        equations: of the curves.
        points: working points (m, 3) [m].
        curves: each with the number of its point.
        wrist: completes postures from joints 1 to 4; None if the curves have all joints.
    """

    swivel: Swivel
    equations: Equations
    points: Array
    curves: list[Curve]
    wrist: Wrist | None

    def full(self, q: Array) -> Array:
        """All joints (n, nq) from the joints of the curves."""
        return q if self.wrist is None else self.wrist.full(q)

    @cached_property
    def _frames(self) -> Array:
        return self.swivel.frames(self.points)

    def angle(self, q: Array, problem: Index) -> Array:
        """Swivel angles (n,) [rad] of ``q`` (n, k) at points with these numbers (n,)."""
        return self.swivel.angle_in(self._frames[problem], self.full(q))

    @cached_property
    def segments(self) -> _Segments:
        """All pieces between neighbouring vertices."""
        lengths = [len(c.q) for c in self.curves]
        start = np.concatenate([c.q for c in self.curves])
        problem = np.repeat([c.problem for c in self.curves], lengths)
        swivel = self.angle(start, problem)
        last_of_open = np.cumsum(lengths)[[not c.closed for c in self.curves]] - 1
        keep = np.delete(np.arange(len(start)), last_of_open)
        after = following(self.curves)[keep]
        end = start[keep] + wrapped(start[after] - start[keep])
        return _Segments(
            start[keep], end, swivel[keep], wrapped(swivel[after] - swivel[keep]), problem[keep]
        )

    def inside(self, pieces: _Segments, limits: Array) -> tuple[Array, Array]:
        """The part of the chord of each piece inside the limits; see :func:`inside_part`."""
        joints = pieces.start.shape[1]
        first, last = inside_part(pieces.start, pieces.end, limits[:joints])
        if self.wrist is not None:
            held = into_limits(self.wrist.rest, limits[joints:])
            if outside_limits(held, limits[joints:]).any():
                last = np.zeros_like(last)
        return first, last

    def outside(self, limits: Array) -> Mask:
        """Segments outside ``limits`` (nq, 2) [rad] all along: (s,)."""
        first, last = self.inside(self.segments, limits + CURVED * OUTWARDS)
        return last <= first

    def divided(self, pieces: _Segments, which: Mask) -> _Segments:
        """The marked pieces, in ``LIMIT_PARTS`` with solutions at the cuts."""
        cuts = LIMIT_PARTS + 1
        guess = np.linspace(pieces.start[which], pieces.end[which], cuts, axis=1)
        joints = guess.shape[2]
        problem = np.repeat(pieces.problem[which], cuts)
        q, there = self.equations.polish(guess.reshape(-1, joints), problem)
        swivel = self.angle(q, problem).reshape(-1, cuts)
        q = q.reshape(-1, cuts, joints)
        turn = wrapped(np.diff(swivel, axis=1)).ravel()
        there = there.reshape(-1, cuts)
        arrived = (there[:, :-1] & there[:, 1:]).ravel()
        start = q[:, :-1].reshape(-1, joints)[arrived]
        end = q[:, 1:].reshape(-1, joints)[arrived]
        swivel = swivel[:, :-1].ravel()[arrived]
        numbers = np.repeat(pieces.problem[which], LIMIT_PARTS)[arrived]
        return _Segments(start, end, swivel, turn[arrived], numbers)


@dataclass(frozen=True)
class Flexibility(Shown):
    """The flexibility ζ at a point (eq. 1 of Xu You et al. 2019).

    ζ is the number of working over theoretical sectors of the swivel angle. A theoretical swivel
    angle has a posture without regard to limits, a working one within limits.

    Attributes:
        zeta: decided at the centres; NaN without theoretical sectors.
        sectors: True for working ones; sector k, from 0, has its centre at k 360°/count.
        arc_fraction: working over theoretical range, to 0.1°; NaN without a theoretical range.
    """

    zeta: float
    sectors: tuple[bool, ...]
    arc_fraction: float

    def __str__(self) -> str:
        counted = f"counted in {len(self.sectors)} sectors"
        numbers = {counted: self.zeta, "measured along the arc": self.arc_fraction}
        finite = [f"{x:.3f} {of}" for of, x in numbers.items() if np.isfinite(x)]
        return ", or ".join(finite) or "undefined"


def evenly(
    equations: Equations, curves: list[Curve], count: int, path: Callable[[Array], Array]
) -> tuple[Array, Index, int]:
    """``count`` solutions on each curve, evenly spaced along a path.

    Args:
        equations: of the curves.
        curves: at least one.
        count: of each curve.
        path: from solutions along a curve (m, k) to places (m, any). If these stand still, the
            angles count.

    Returns:
        up to (curves * count, k) [rad], the curve of each, and the number of solutions not found
            (nearly degenerate arm).
    """
    guesses = []
    for vertices in _finer(equations, curves):
        length = np.linalg.norm(np.diff(path(vertices), axis=0), axis=1)
        if length.sum() < STILL:
            length = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(length)])
        wanted = np.arange(count) * (along[-1] / count)
        guesses.append(np.column_stack([np.interp(wanted, along, column) for column in vertices.T]))
    number = np.repeat(np.arange(len(guesses)), count)
    problem = np.array([c.problem for c in curves])[number]
    q, there = equations.polish(np.concatenate(guesses), problem)
    return q[there], number[there], int((~there).sum())


def _finer(equations: Equations, curves: list[Curve]) -> list[Array]:
    """Solutions between the vertices of each curve; a closed one ends with its first."""
    finer = []
    for curve in curves:
        q = curve.q
        if curve.closed:
            # Made when it is back at its start.
            turns = np.round((q[-1] - q[0]) / (2 * np.pi)) * 2 * np.pi
            q = np.vstack([q, q[:1] + turns])
        numbers = np.arange(len(q))
        rows = np.arange(numbers[-1] * FINER + 1) / FINER
        finer.append(np.column_stack([np.interp(rows, numbers, angles) for angles in q.T]))
    lengths = [len(q) for q in finer]
    problem = np.repeat([c.problem for c in curves], lengths)
    # What does not arrive is near enough to measure a way.
    solutions, _ = equations.polish(np.concatenate(finer), problem)
    return np.split(solutions, np.cumsum(lengths)[:-1])


def _swivel_crossings(pieces: _Segments, angles: Array) -> tuple[Index, Index, Array]:
    """Where swivel passes one of ``angles`` (s,) [rad]; the start of a piece counts, its end not.

    Returns:
        piece and angle (n,), and swivel from the start of the piece (n,) [rad].
    """
    order = np.argsort(wrapped(angles))
    turns = 2 * np.pi * np.arange(-1, 2)
    crossings = (wrapped(angles)[order] + turns[:, None]).ravel()
    low, high = np.sort([pieces.swivel, pieces.swivel + pieces.turn], axis=0)
    first = np.searchsorted(crossings, low - SAME_SWIVEL)
    last = np.searchsorted(crossings, high + SAME_SWIVEL)
    count = last - first
    piece = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(piece)) + np.repeat(last - np.cumsum(count), count)
    which = order[number % len(angles)]
    ahead = wrapped(angles[which] - pieces.swivel[piece])
    turn = pieces.turn[piece]
    passed = np.where(turn >= 0, (ahead >= 0) & (ahead < turn), (ahead <= 0) & (ahead > turn))
    # An elbow that stays in one plane passes no angle, but by rounding.
    passed &= np.abs(turn) > SAME_SWIVEL
    return piece[passed], which[passed], ahead[passed]


def _solutions_at_swivel(
    components: Components, pieces: _Segments, piece: Index, wanted: Array, ahead: Array
) -> tuple[Array, Mask]:
    """Postures on each ``piece`` with swivel ``wanted``, ``ahead`` of its start; and which were
    found.

    False position, every trial moved onto the curve; an end that stays counts less and less: N.
    Anderson, Å. Björck, "A new high order method of regula falsi type", BIT 13 (1973).
    """
    problem = pieces.problem[piece]
    left = np.arange(len(piece))
    low = pieces.start[piece]
    high = pieces.end[piece]
    gap_low = ahead.copy()
    gap_high = ahead - pieces.turn[piece]
    q = low.copy()
    last = np.zeros(len(piece))
    there = np.ones(len(piece), dtype=bool)
    for _ in range(MOST_TRIALS):
        part = (gap_low / (gap_low - gap_high))[left, None]
        guess = low[left] + part * (high - low)[left]
        q[left], there[left] = components.equations.polish(guess, problem[left])
        gap = wrapped(wanted[left] - components.angle(q[left], problem[left]))
        # Still on the near side of the wanted swivel.
        before = np.sign(gap) == np.sign(gap_low[left])
        with np.errstate(divide="ignore", invalid="ignore"):  # an end that is met
            less = 1.0 - gap / np.where(before, gap_low[left], gap_high[left])
        less = np.where(less > 0, less, 0.5)
        near = left[before]
        far = left[~before]
        gap_high[near] *= np.where(last[near] > 0, less[before], 1.0)
        gap_low[far] *= np.where(last[far] < 0, less[~before], 1.0)
        low[near], gap_low[near] = q[near], gap[before]
        high[far], gap_high[far] = q[far], gap[~before]
        last[near], last[far] = 1.0, -1.0
        left = left[
            (np.abs(gap) > SAME_SWIVEL) & (np.abs(high - low).max(axis=1)[left] > NO_LENGTH)
        ]
        if not left.size:
            break
    return q, there


def sector_centres(sectors: int) -> Array:
    """Swivel angles of sector centres (sectors,) [rad]; at 0 the elbow is highest."""
    return np.asarray(2 * np.pi / sectors * np.arange(sectors))


@dataclass(frozen=True, eq=False)
class Sectors:
    """Postures at the centres of sectors of the swivel angle, at many points.

    Attributes:
        q: those inside the limits (n, nq) [rad].
        sector: of each (n,).
        point: number of the point of each (n,).
        theoretical: centres with any posture (points, sectors).
        working: centres with a posture in ``q`` (points, sectors).
    """

    q: Array
    sector: Index
    point: Index
    theoretical: Mask
    working: Mask

    @staticmethod
    def of(components: Components, limits: Array, sectors: int) -> Sectors:
        """Sectors of all points of ``components``, with ``limits`` (nq, 2) [rad].

        A sector is theoretical if a curve passes its centre, and working if the posture there is
        found inside the limits.
        """
        theoretical, working = np.zeros((2, len(components.points), sectors), dtype=bool)
        if not components.curves:
            none = np.empty(0, dtype=np.intp)
            q = np.empty((0, len(limits)))
            return Sectors(q, none, none, theoretical, working)
        pieces = components.segments
        centres = sector_centres(sectors)
        piece, sector, ahead = _swivel_crossings(pieces, centres)
        theoretical[pieces.problem[piece], sector] = True
        may_be_inside = ~components.outside(limits)[piece]
        piece = piece[may_be_inside]
        sector = sector[may_be_inside]
        ahead = ahead[may_be_inside]
        q, is_found = _solutions_at_swivel(components, pieces, piece, centres[sector], ahead)
        q = into_limits(components.full(q), limits)
        inside = is_found & ~outside_limits(q, limits).any(axis=1)
        q = q[inside]
        sector = sector[inside]
        point = pieces.problem[piece[inside]]
        working[point, sector] = True
        return Sectors(q, sector, point, theoretical, working)

    @property
    def zeta(self) -> Array:
        """Working over theoretical sectors (points,); nan without any."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.working.sum(axis=1) / self.theoretical.sum(axis=1))


def flexibility(components: Components, limits: Array, sectors: int) -> Flexibility:
    """Flexibility of a single point.

    Raises:
        AacmmError: ``sectors`` is below 1, or too large.
    """
    states = Sectors.of(components, limits, whole(sectors, 1, "sectors"))
    working = tuple(states.working[0].tolist())
    (arc_fraction,) = arc_fractions(components, limits)
    return Flexibility(float(states.zeta[0]), working, float(arc_fraction))


def arc_fractions(components: Components, limits: Array) -> Array:
    """Working over theoretical range of swivel at each point (m,); nan without a range."""
    m = len(components.points)
    if not components.curves:
        return np.full(m, np.nan)
    pieces = components.segments
    first, last = components.inside(pieces, limits - CURVED * OUTWARDS)
    inside = (first == 0.0) & (last == 1.0)
    fine = components.divided(pieces, ~(components.outside(limits) | inside))
    first, last = components.inside(fine, limits)
    some = last > first
    problem = np.concatenate([pieces.problem[inside], fine.problem[some]])
    swivel = np.concatenate([pieces.swivel[inside], (fine.swivel + first * fine.turn)[some]])
    turn = np.concatenate([pieces.turn[inside], ((last - first) * fine.turn)[some]])
    theoretical = _covered_bins(pieces.problem, pieces.swivel, pieces.turn, m)
    working = _covered_bins(problem, swivel, turn, m)
    with np.errstate(invalid="ignore"):
        return working / theoretical


def _covered_bins(problem: Index, start: Array, turn: Array, points: int) -> Index:
    """Number of ``ARC_BINS`` with the centre on an arc from ``start`` over ``turn``: (points,)."""
    bins = ARC_BINS
    a_radian = bins / (2 * np.pi)
    low = np.where(turn >= 0, start, start + turn) % (2 * np.pi) * a_radian
    high = low + np.abs(turn) * a_radian
    first = np.ceil(low - 0.5).astype(np.intp)
    end = np.ceil(high - 0.5).astype(np.intp)
    over = end > bins  # these begin again at bin 0
    problem = np.concatenate([problem, problem[over]])
    first = np.concatenate([first, np.zeros_like(end[over])])
    end = np.concatenate([np.minimum(end, bins), end[over] - bins])
    order = np.argsort(problem * bins + first, kind="stable")
    place = problem[order] * bins
    before = np.maximum.accumulate(np.concatenate([[0], place + end[order]]))
    added = before[1:] - np.maximum(before[:-1], place + first[order])
    return np.bincount(problem[order], np.maximum(added, 0), points).astype(np.intp)
