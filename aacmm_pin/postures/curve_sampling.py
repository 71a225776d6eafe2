"""Samples of closed curves: evenly spaced, at swivel angles, and inside the limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.display import Shown
from aacmm_pin.arm import inside_part, into_limits, outside_limits
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import Curve, following
from aacmm_pin.postures.wrist import Wrist

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
        swivel_change: along the piece (s,) [rad], in (-π, π).
        problem: number of the point (s,).
    """

    start: Array
    end: Array
    swivel: Array
    swivel_change: Array
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
        start = np.concatenate([c.q for c in self.curves])  # all vertices
        problem = np.repeat([c.problem for c in self.curves], lengths)
        swivel = self.angle(start, problem)
        last_of_open = np.cumsum(lengths)[[not c.closed for c in self.curves]] - 1
        begins = np.delete(np.arange(len(start)), last_of_open)
        ends = following(self.curves)[begins]
        end = start[begins] + wrapped(start[ends] - start[begins])
        swivel_change = wrapped(swivel[ends] - swivel[begins])
        return _Segments(start[begins], end, swivel[begins], swivel_change, problem[begins])

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
        """Pieces marked in ``which`` (s,), each in ``LIMIT_PARTS`` with solutions at the cuts."""
        cuts = LIMIT_PARTS + 1
        guess = np.linspace(pieces.start[which], pieces.end[which], cuts, axis=1)
        joints = guess.shape[2]
        problem = np.repeat(pieces.problem[which], cuts)
        q, arrived = self.equations.polish(guess.reshape(-1, joints), problem)
        swivel = self.angle(q, problem).reshape(-1, cuts)
        q = q.reshape(-1, cuts, joints)
        swivel_change = wrapped(np.diff(swivel, axis=1)).ravel()
        arrived = arrived.reshape(-1, cuts)
        both_ends = (arrived[:, :-1] & arrived[:, 1:]).ravel()
        start = q[:, :-1].reshape(-1, joints)[both_ends]
        end = q[:, 1:].reshape(-1, joints)[both_ends]
        swivel = swivel[:, :-1].ravel()[both_ends]
        numbers = np.repeat(pieces.problem[which], LIMIT_PARTS)[both_ends]
        return _Segments(start, end, swivel, swivel_change[both_ends], numbers)


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
        curves: at least one.
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
    q, arrived = equations.polish(np.concatenate(guesses), problem)
    return q[arrived], number[arrived], int((~arrived).sum())


def _finer(equations: Equations, curves: list[Curve]) -> list[Array]:
    """Solutions between the vertices of each curve; a closed one ends with its first."""
    finer = []
    for curve in curves:
        q = curve.q
        if curve.closed:
            # A joint may make whole revolutions along the curve.
            revolutions = np.round((q[-1] - q[0]) / (2 * np.pi))
            q = np.vstack([q, q[:1] + revolutions * 2 * np.pi])
        numbers = np.arange(len(q))
        rows = np.arange(numbers[-1] * FINER + 1) / FINER
        finer.append(np.column_stack([np.interp(rows, numbers, angles) for angles in q.T]))
    lengths = [len(q) for q in finer]
    problem = np.repeat([c.problem for c in curves], lengths)
    # What does not arrive is near enough to measure a path.
    solutions, _ = equations.polish(np.concatenate(finer), problem)
    return np.split(solutions, np.cumsum(lengths)[:-1])


def _swivel_crossings(pieces: _Segments, angles: Array) -> tuple[Index, Index, Array]:
    """Where swivel passes one of ``angles`` (s,) [rad]; the start of a piece counts, its end not.

    Returns:
        piece and angle (n,), and swivel from the start of the piece (n,) [rad].
    """
    order = np.argsort(wrapped(angles))
    revolutions = 2 * np.pi * np.arange(-1, 2)
    crossings = (wrapped(angles)[order] + revolutions[:, None]).ravel()
    low, high = np.sort([pieces.swivel, pieces.swivel + pieces.swivel_change], axis=0)
    first = np.searchsorted(crossings, low - SAME_SWIVEL)
    last = np.searchsorted(crossings, high + SAME_SWIVEL)
    count = last - first
    piece = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(piece)) + np.repeat(last - np.cumsum(count), count)
    which = order[number % len(angles)]
    ahead = wrapped(angles[which] - pieces.swivel[piece])
    change = pieces.swivel_change[piece]
    passed = np.where(change >= 0, (ahead >= 0) & (ahead < change), (ahead <= 0) & (ahead > change))
    # An elbow that stays in one plane passes no angle, but by rounding.
    passed &= np.abs(change) > SAME_SWIVEL
    return piece[passed], which[passed], ahead[passed]


def _solutions_at_swivel(
    components: Components, pieces: _Segments, piece: Index, wanted: Array, ahead: Array
) -> tuple[Array, Mask]:
    """Postures (n, k) on each ``piece`` (n,) with swivel ``wanted`` (n,), ``ahead`` of its start;
    and which were found.

    False position, every trial moved onto the curve; an end that stays counts less and less: N.
    Anderson, Å. Björck, "A new high order method of regula falsi type", BIT 13 (1973).
    """
    problem = pieces.problem[piece]
    open_rows = np.arange(len(piece))
    start = pieces.start[piece]
    end = pieces.end[piece]
    gap_start = ahead.copy()
    gap_end = ahead - pieces.swivel_change[piece]
    q = start.copy()
    last_replaced = np.zeros(len(piece))  # 1: the start, -1: the end
    arrived = np.ones(len(piece), dtype=bool)
    for _ in range(MOST_TRIALS):
        fraction = (gap_start / (gap_start - gap_end))[open_rows, None]
        guess = start[open_rows] + fraction * (end - start)[open_rows]
        q[open_rows], arrived[open_rows] = components.equations.polish(guess, problem[open_rows])
        swivel = components.angle(q[open_rows], problem[open_rows])
        gap = wrapped(wanted[open_rows] - swivel)
        is_before = np.sign(gap) == np.sign(gap_start[open_rows])
        with np.errstate(divide="ignore", invalid="ignore"):  # an end that is met
            weight = 1.0 - gap / np.where(is_before, gap_start[open_rows], gap_end[open_rows])
        weight = np.where(weight > 0, weight, 0.5)
        before = open_rows[is_before]
        beyond = open_rows[~is_before]
        gap_end[before] *= np.where(last_replaced[before] > 0, weight[is_before], 1.0)
        gap_start[beyond] *= np.where(last_replaced[beyond] < 0, weight[~is_before], 1.0)
        start[before], gap_start[before] = q[before], gap[is_before]
        end[beyond], gap_end[beyond] = q[beyond], gap[~is_before]
        last_replaced[before], last_replaced[beyond] = 1.0, -1.0
        length = np.abs(end - start).max(axis=1)[open_rows]
        open_rows = open_rows[(np.abs(gap) > SAME_SWIVEL) & (length > NO_LENGTH)]
        if not open_rows.size:
            break
    return q, arrived


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
    partly = last > first
    enters = fine.swivel + first * fine.swivel_change
    change_inside = (last - first) * fine.swivel_change
    problem = np.concatenate([pieces.problem[inside], fine.problem[partly]])
    swivel = np.concatenate([pieces.swivel[inside], enters[partly]])
    change = np.concatenate([pieces.swivel_change[inside], change_inside[partly]])
    theoretical = _covered_bins(pieces.problem, pieces.swivel, pieces.swivel_change, m)
    working = _covered_bins(problem, swivel, change, m)
    with np.errstate(invalid="ignore"):
        return working / theoretical


def _covered_bins(problem: Index, start: Array, change: Array, points: int) -> Index:
    """Number of ``ARC_BINS`` with the centre on an arc from ``start`` over ``change`` (points,)."""
    bins = ARC_BINS
    bins_per_radian = bins / (2 * np.pi)
    low = np.where(change >= 0, start, start + change) % (2 * np.pi) * bins_per_radian
    high = low + np.abs(change) * bins_per_radian
    first = np.ceil(low - 0.5).astype(np.intp)
    end = np.ceil(high - 0.5).astype(np.intp)
    over = end > bins  # these begin again at bin 0
    problem = np.concatenate([problem, problem[over]])
    first = np.concatenate([first, np.zeros_like(end[over])])
    end = np.concatenate([np.minimum(end, bins), end[over] - bins])
    # Bins of all points in one row, arcs in order: each adds those after the last one covered.
    order = np.argsort(problem * bins + first, kind="stable")
    bin_0 = problem[order] * bins
    covered_to = np.maximum.accumulate(np.concatenate([[0], bin_0 + end[order]]))
    added = covered_to[1:] - np.maximum(covered_to[:-1], bin_0 + first[order])
    return np.bincount(problem[order], np.maximum(added, 0), points).astype(np.intp)
