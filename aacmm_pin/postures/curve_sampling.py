"""Samples of closed curves: evenly spaced, at swivel angles, and inside the limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask, wrapped
from aacmm_pin._support.display import Shown
from aacmm_pin.arm import inside_part, into_limits, outside_limits
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import Curve, Curves
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
        points: working points (m, 3) [m].
        curves_of_points: curves, each with the number of its point.
        wrist: completes postures from joints 1 to 4; None if the curves have all joints.
    """

    swivel: Swivel
    points: Array
    curves_of_points: Curves
    wrist: Wrist | None

    @property
    def curves(self) -> list[Curve]:
        """The curves."""
        return self.curves_of_points.curves

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
        lengths = np.array([len(c.q) for c in self.curves])
        start = np.concatenate([c.q for c in self.curves])  # all vertices
        problem = np.repeat([c.problem for c in self.curves], lengths)
        swivel = self.angle(start, problem)
        last = np.cumsum(lengths) - 1
        next_vertex = np.arange(1, len(start) + 1)
        next_vertex[last] = last - lengths + 1
        begins = np.delete(np.arange(len(start)), last[[not c.closed for c in self.curves]])
        ends = next_vertex[begins]
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
        q, arrived = self.curves_of_points.equations.polish(guess.reshape(-1, joints), problem)
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
    for curve in curves:
        vertices = curve.q
        if curve.closed:
            # A joint may make whole revolutions along the curve.
            revolutions = np.round((vertices[-1] - vertices[0]) / (2 * np.pi))
            vertices = np.vstack([vertices, vertices[:1] + revolutions * 2 * np.pi])
        numbers = np.arange(float(len(vertices)))
        rows = np.arange(numbers[-1] * FINER + 1) / FINER
        # What does not arrive is near enough to measure a path.
        finer, _ = equations.polish(_interpolated(rows, numbers, vertices), curve.problem)
        length = np.linalg.norm(np.diff(path(finer), axis=0), axis=1)
        if length.sum() < STILL:
            length = np.linalg.norm(np.diff(finer, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(length)])
        guesses.append(_interpolated(np.arange(count) * (along[-1] / count), along, finer))
    number = np.repeat(np.arange(len(guesses)), count)
    problem = np.array([c.problem for c in curves])[number]
    q, arrived = equations.polish(np.concatenate(guesses), problem)
    return q[arrived], number[arrived], int((~arrived).sum())


def _interpolated(wanted: Array, along: Array, rows: Array) -> Array:
    """Rows (n, k) at ``wanted`` values, from those at the values ``along`` a path."""
    return np.column_stack([np.interp(wanted, along, column) for column in rows.T])


def _centres_passed(pieces: _Segments, sectors: int) -> tuple[Index, Index]:
    """Pieces and the sectors (n,) whose centres they pass; the start of a piece counts, its end
    not.
    """
    width = 2 * np.pi / sectors
    start = pieces.swivel / width
    end = (pieces.swivel + pieces.swivel_change) / width
    forwards = end > start
    first = np.where(forwards, np.ceil(start), np.floor(end) + 1).astype(np.intp)
    stop = np.where(forwards, np.ceil(end), np.floor(start) + 1).astype(np.intp)
    # An elbow that stays in one plane passes no angle, but by rounding.
    count = np.where(np.abs(pieces.swivel_change) > SAME_SWIVEL, stop - first, 0)
    piece = np.repeat(np.arange(len(first)), count)
    number = np.arange(len(piece)) + np.repeat(first - np.cumsum(count) + count, count)
    return piece, number % sectors


def _solutions_at_swivel(
    components: Components, pieces: _Segments, piece: Index, wanted: Array
) -> tuple[Array, Mask]:
    """Postures (n, k) on each ``piece`` (n,) with swivel ``wanted`` (n,); and which were found.

    False position, every trial moved onto the curve; an end that stays counts less and less: N.
    Anderson, Å. Björck, "A new high order method of regula falsi type", BIT 13 (1973).
    """
    problem = pieces.problem[piece]
    open_rows = np.arange(len(piece))
    start = pieces.start[piece]
    end = pieces.end[piece]
    gap_start = wrapped(wanted - pieces.swivel[piece])
    gap_end = gap_start - pieces.swivel_change[piece]
    q = start.copy()
    last_replaced = np.zeros(len(piece))  # 1: the start, -1: the end
    arrived = np.ones(len(piece), dtype=bool)
    for _ in range(MOST_TRIALS):
        fraction = (gap_start / (gap_start - gap_end))[open_rows, None]
        guess = start[open_rows] + fraction * (end - start)[open_rows]
        q[open_rows], arrived[open_rows] = components.curves_of_points.equations.polish(
            guess, problem[open_rows]
        )
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
        piece, sector = _centres_passed(pieces, sectors)
        theoretical[pieces.problem[piece], sector] = True
        may_be_inside = ~components.outside(limits)[piece]
        piece = piece[may_be_inside]
        sector = sector[may_be_inside]
        wanted = sector_centres(sectors)[sector]
        q, is_found = _solutions_at_swivel(components, pieces, piece, wanted)
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
    bins_per_radian = ARC_BINS / (2 * np.pi)
    low = np.minimum(start, start + change) % (2 * np.pi) * bins_per_radian
    high = low + np.abs(change) * bins_per_radian
    first = np.ceil(low - 0.5).astype(np.intp)
    end = np.ceil(high - 0.5).astype(np.intp)
    begun = np.zeros((points, ARC_BINS), dtype=np.int16)
    np.add.at(begun, (problem, first % ARC_BINS), 1)
    np.add.at(begun, (problem, end % ARC_BINS), -1)
    np.add.at(begun[:, 0], problem, end // ARC_BINS - first // ARC_BINS)  # over bin 0
    covered = np.cumsum(begun, axis=1, dtype=np.int16) > 0
    return np.asarray(covered.sum(axis=1))
