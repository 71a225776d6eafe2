"""Postures of any arm of revolute joints with its tip at a point, perhaps oriented.

With as many conditions as joints postures are single; with one more joint they are closed curves,
the self-motion. Point: 3 conditions; point and axis: 5; pose: 6.

Newton's method finds them from many starts. There are up to sixteen curves (J. W. Burdick, "On the
inverse kinematics of redundant manipulators: characterization of the self-motion manifolds", ICRA
1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import (
    Array,
    Mask,
    spread_angles,
    unit_vector,
    vector,
    whole,
    wrapped,
)
from aacmm_pin._support.display import Note
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin.arm import Arm, GivenArm, as_arm, inside_part, into_limits, outside_limits
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.continuation import CLOSE_ENOUGH, POINT, SAME_POINT
from aacmm_pin.postures.curve_sampling import Flexibility, evenly
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.postures_at_point import (
    PosturesAtPoint,
    in_degrees,
    missing_notes,
    open_curve_notes,
)
from aacmm_pin.postures.solution_curves import (
    NEARLY_SINGULAR,
    SINGULAR,
    Curve,
    CurveSearch,
    degenerate,
    flattest,
)

CONDITIONS = {3: "a point", 5: "a point and an axis", 6: "a full pose"}
ELBOW_JOINT = 4
"""Its axis has the elbow of an AACMM."""
ORTHONORMAL = 1e-6
"""A matrix with a smaller deviation is made a rotation."""
ROUND = 256
ENOUGH = 300
"""Arrivals without a new solution that end a search."""
STARTS_WITHOUT_ARRIVAL = 1024
MOST_STARTS = 16384
STALLED_BELOW = 1e-5
"""Residual of a start that stalled next to a solution [m, rad]."""
MERGE_DISTANCE = 0.02
"""Closer solutions are one if the equations hold half-way too [rad]."""
ASIDE = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Distances from a solution, in its flattest direction, to look for neighbours [rad]."""
ALONG = np.array([0.02, 0.04, 0.08])
"""Steps along a family, each of which must arrive close to its end [rad]."""
ABOUT_THERE = 0.3
"""Part of such a step by which it may end elsewhere."""
MOST_SINGLE = 16
"""Postures of six revolute joints for a pose (Primrose 1986)."""
MOST_BESIDE = 8
"""Finds beside each other; close to a singular pose there is no end of them."""


@dataclass(frozen=True)
class Search:
    """Data of a search.

    Attributes:
        starts: of Newton's method.
        arrived: starts that ended in a solution.
        stalled: starts that stopped near a nearly singular solution.
        since_new: arrivals in the rounds after the last new solution.
        ended: ended at its limit of work.
        degenerate: nearly singular everywhere.
    """

    starts: int
    arrived: int
    stalled: int
    since_new: int
    ended: bool = False
    degenerate: bool = False

    @property
    def unseen(self) -> float:
        """Upper limit (95 %) of the probability that the next arrival is at a new solution.

        3/``since_new``, at most 1, by the rule of three: n trials without success bound it by
        -ln 0.05/n. The search never finds solutions that no start leads to.
        """
        return min(1.0, 3.0 / self.since_new) if self.since_new else 1.0

    def __str__(self) -> str:
        if not self.arrived:
            return f"none of {self.starts} starts of the search converged"
        counts = {"arrived": self.arrived, "starts": self.starts, "since": self.since_new}
        sentences = [str(Note("search_converged", counts | {"unseen": 100 * self.unseen}))]
        return "; ".join(sentences + [str(Note("search_ended"))] * self.ended)


class Isolated:
    """Single solutions.

    Two that nearly coincide have small basins: the search looks to both sides of each find in its
    flattest direction.

    Attributes:
        q: (m, k) [rad].
        families: singular solutions (f, k) of families with more dimensions, as they came.
    """

    ended = False

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.q = np.empty((0, len(equations.links) - 1))
        self.families = self.q

    def add(self, q: Array) -> None:
        """Add solutions (n, k) [rad]."""
        single = self._single(q)
        for solution in q[single]:
            if self._has(solution):
                continue
            if len(self.q) >= MOST_SINGLE:
                self.families = np.vstack([self.families, solution])
                continue
            self.q = np.vstack([self.q, wrapped(solution)])
            self._look_beside(solution)
        self.families = np.vstack([self.families, q[~single]])

    def __len__(self) -> int:
        return len(self.q)

    def _has(self, q: Array) -> bool:
        """Whether ``q`` (k,) is a find."""
        gap = wrapped(self.q - q)
        distance = np.linalg.norm(gap, axis=1)
        if distance.min(initial=np.inf) < SAME_POINT:
            return True
        # A solution of higher order is known less sharply.
        residuals, _ = self.equations(q + 0.5 * gap[distance < MERGE_DISTANCE])
        return bool((np.abs(residuals).max(axis=1) <= CLOSE_ENOUGH).any())

    def _look_beside(self, q: Array) -> None:
        """Add neighbours of a find (k,) in its flattest direction, and theirs."""
        to_visit = [q]
        for _ in range(MOST_BESIDE):
            if not to_visit:
                return
            find = to_visit.pop(0)
            _, vectors = flattest(self.equations, find[None, :])
            starts = find + np.concatenate([-ASIDE, ASIDE])[:, None] * vectors[0, -1]
            neighbours, arrived = self.equations.polish(starts)
            neighbours = neighbours[arrived]
            for neighbour in neighbours[self._single(neighbours)]:
                if len(self.q) < MOST_SINGLE and not self._has(neighbour):
                    self.q = np.vstack([self.q, wrapped(neighbour)])
                    to_visit.append(neighbour)

    def _single(self, q: Array) -> Mask:
        """Which solutions (n, k) do not continue in one of their two flattest directions: (n,)."""
        ratio, vectors = flattest(self.equations, q)
        singular = np.flatnonzero(ratio < SINGULAR)
        steps = ALONG[:, None] * vectors[singular, -2:, None]  # (m, 2, steps, k)
        guess = (q[singular, None, None] + steps).reshape(-1, q.shape[1])
        solutions, arrived = self.equations.polish(guess)
        miss = np.linalg.norm(solutions - guess, axis=1).reshape(-1, 2, len(ALONG))
        continues = arrived.reshape(miss.shape) & (miss < ABOUT_THERE * ALONG)
        single = np.ones(len(q), dtype=bool)
        single[singular] = ~continues.all(axis=2).any(axis=1)
        return single


def search(finds: Isolated | CurveSearch, joints: int, most_starts: int = MOST_STARTS) -> Search:
    """Fill ``finds`` from at most ``most_starts`` starts in ``joints`` angles."""
    equations = finds.equations
    starts = arrived = stalled = since_new = 0
    spread = spread_angles(most_starts, joints)
    settled = False
    while starts < most_starts and not (settled or finds.ended):
        guesses = spread[starts : starts + ROUND]
        ends, good = equations.polish(guesses)
        failed = ends[~good]
        residuals, _ = equations(failed)
        close = failed[np.abs(residuals).max(axis=1) < STALLED_BELOW]
        # Regular ones of these would have arrived with more steps.
        ratio, _ = flattest(equations, close)
        stalled += int((ratio < NEARLY_SINGULAR).sum())
        before = len(finds), len(finds.families) > 0
        finds.add(ends[good])
        is_new = (len(finds), len(finds.families) > 0) != before
        since_new = 0 if is_new else since_new + int(good.sum())
        starts += len(guesses)
        arrived += int(good.sum())
        settled = since_new >= ENOUGH or (not arrived and starts >= STARTS_WITHOUT_ARRIVAL)
    ended = finds.ended or not settled
    flat = degenerate(equations, spread[:ROUND])
    return Search(starts, arrived, stalled, since_new, ended, flat)


@dataclass(frozen=True, eq=False)
class ReachingPostures(PosturesAtPoint):
    """Postures that satisfy conditions on the tip: single ones or closed curves.

    Each single posture is a component.

    Attributes:
        conditions: their number: 3, 5 with a direction, 6 with an orientation.
        curves: of self-motion, sampled; empty for single postures.
        search: and whether it is complete.
    """

    conditions: int
    curves: tuple[Curve, ...]
    search: Search

    @property
    def single(self) -> bool:
        """True for single postures, False on curves."""
        return self.conditions == self.arm.nq

    @property
    def travel(self) -> Array:
        """Length of the path in joint space from the first posture of the component, ``(n,)``
        [rad]; zero for single ones.
        """
        lengths = np.linalg.norm(self._steps, axis=1)
        before = np.cumsum(lengths) - lengths
        return np.asarray(before - before[np.searchsorted(self.component, self.component)])

    @property
    def arc_fraction(self) -> float:
        """Share of the curves within limits, by length in joint space; NaN for single postures."""
        if self.single or not len(self):
            return float("nan")
        first, last = inside_part(self.q, self.q + self._steps, self.arm.limits)
        length = np.linalg.norm(self._steps, axis=1)
        fraction_inside = np.maximum(last - first, 0.0)
        return float((length * fraction_inside).sum() / length.sum())

    def flexibility(self, sectors: int = 12) -> Flexibility:
        """Flexibility with ``arc_fraction`` only: arms without elbow have no sectors."""
        return Flexibility(float("nan"), (), self.arc_fraction)

    @property
    def _steps(self) -> Array:
        """To the next posture of the component, around it if closed, else 0 (n, nq) [rad]."""
        steps = np.zeros_like(self.q)
        for number, curve in enumerate(self.curves, start=1):
            rows = np.flatnonzero(self.component == number)
            following = np.roll(rows, -1) if curve.closed else np.append(rows[1:], rows[-1:])
            steps[rows] = wrapped(self.q[following] - self.q[rows])
        return steps

    def __str__(self) -> str:
        where = f"{self._where()} for {CONDITIONS[self.conditions]}"
        if self.reason:
            return f"{where}, has no posture, because {self.reason}"
        inside = f"of which {self.within_limits.sum()} are within the joint limits"
        if self.single:
            return f"{where}, has {len(self)} single postures, {inside}; {self.search}"
        return (
            f"{where}, has {len(self)} postures on {len(self.curves)} closed curves, {inside} "
            f"({100 * self.arc_fraction:.1f} % of the curve length); {self.search}"
        )


def reaching_postures(
    arm: GivenArm,
    point: ArrayLike,
    *,
    axis: ArrayLike | None = None,
    tool: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
    count: int = 360,
    most_starts: int = MOST_STARTS,
) -> ReachingPostures:
    """Find the postures of ``arm`` with the tip at ``point``, also those outside the joint limits.

    ``broken`` marks angles outside the limits. Newton's method starts from evenly spread postures,
    until 300 arrivals in a row find nothing new; then each curve is followed once around. Families
    of singular postures with more dimensions than free joints are omitted, and stated in ``notes``,
    or in ``reason`` if there is no other posture.

    Args:
        arm: revolute joints, as many as conditions, or one more.
        point: position of the tip in the base ``(3,)`` [m].
        axis: direction of ``tool`` in the base ``(3,)``, of any length (five conditions).
        tool: direction in the tip frame ``(3,)``; default the stylus axis, else z.
        rotation: orientation of the tip frame in the base ``(3, 3)`` (six conditions).
        count: postures on each curve, evenly spaced in joint space.
        most_starts: starts at most.

    Raises:
        ShapeError: a wrong shape, not finite, or no rotation.
        AacmmError: both ``axis`` and ``rotation``, a direction of zero length, ``tool`` without
            ``axis``, or a count below 3.
        UnsupportedArmError: a prismatic joint, or a number of joints that does not match the
            conditions.
    """
    arm = as_arm(arm)
    count = whole(count, 3, "count")
    most_starts = whole(most_starts, 1, "most_starts")
    place = vector(point, 3, "point", "m")
    equations = _equations(arm, place, axis, tool, rotation)
    curves: tuple[Curve, ...] = ()
    finds = Isolated(equations) if equations.count == arm.nq else CurveSearch(equations)
    outcome = search(finds, arm.nq, most_starts)
    notes = []
    if len(finds.families):
        data = {"families": len(finds.families), "posture": in_degrees(finds.families[0])}
        data["arrivals"] = outcome.arrived
        notes.append(Note("singular_families_unlisted", data))
    if isinstance(finds, Isolated):
        q = finds.q
        component = np.arange(len(q))
        near = np.flatnonzero(flattest(equations, q)[0] < NEARLY_SINGULAR)
        if near.size:
            notes.append(Note("nearly_singular", {"postures": (near + 1).tolist()}))
        if outcome.stalled:
            stalled = {"stalled": outcome.stalled, "starts": outcome.starts}
            notes.append(Note("starts_stalled", stalled))
    else:
        curves = tuple(finds.curves)
        q, component, missing = np.empty((0, arm.nq)), np.arange(0), 0
        if curves:
            q, component, missing = evenly(equations, finds.curves, count, lambda q: q)
        notes += open_curve_notes(curves) + missing_notes(missing)
    notes += [Note("arm_degenerate")] * outcome.degenerate
    reason = "" if len(q) else "; ".join(map(str, notes)) or f"{outcome}, out of reach"
    q = into_limits(q, arm.limits)
    swivel = np.full(len(q), np.nan)
    if arm.dh is not None and arm.dh.rows > ELBOW_JOINT and arm.dh.moving[:ELBOW_JOINT].all():
        swivel = Swivel(arm.dh, arm.up).angle(q, place)
    return ReachingPostures(
        arm,
        place,
        arm.tip,
        q,
        component + 1,
        swivel,
        outside_limits(q, arm.limits),
        equations.count,
        curves,
        outcome,
        reason=reason,
        notes=tuple(notes),
        complete=not (notes or outcome.ended),
    )


def _equations(
    arm: Arm,
    point: Array,
    axis: ArrayLike | None,
    tool: ArrayLike | None,
    rotation: ArrayLike | None,
) -> Equations:
    COORDINATE.check(point, "point")
    slides = np.flatnonzero(arm.chain.prismatic) + 1
    if slides.size:
        raise UnsupportedArmError(
            f"{arm.name}: joint {', '.join(map(str, slides))} is prismatic; expected "
            "revolute joints to enumerate postures"
        )
    if arm.mimics:
        copies = ", ".join(str(mimic.joint) for mimic in arm.mimics)
        raise UnsupportedArmError(
            f"{arm.name}: joint {copies} mimics "
            "another joint; expected independent joints to enumerate postures"
        )
    if axis is not None and rotation is not None:
        raise AacmmError("axis and rotation are both stated; expected one of the two")
    if tool is not None and axis is None:
        raise AacmmError("tool requires axis, which is the direction of the tool in the base")
    links = arm.chain.links()
    points = point[None]
    if axis is not None:
        stylus = arm.stylus_axis if arm.stylus_axis is not None else np.array([0.0, 0.0, 1.0])
        unit_tool = stylus if tool is None else unit_vector(tool, "tool")
        equations = Equations.of_axis(links, points, unit_tool, unit_vector(axis, "axis"))
    elif rotation is not None:
        matrix = vector(np.ravel(rotation), 9, "rotation", "1").reshape(3, 3)
        u, singular_values, v_transposed = np.linalg.svd(matrix)
        deviation = np.abs(singular_values - 1.0).max()
        if deviation > ORTHONORMAL or np.linalg.det(matrix) < 0:
            raise ShapeError(
                f"rotation: a deviation of {deviation:.1e} from orthonormal; expected a "
                "right-handed orthonormal matrix (3, 3)"
            )
        equations = Equations.of_pose(links, points, u @ v_transposed)
    else:
        equations = Equations(links, points, POINT)
    if arm.nq - equations.count not in (0, 1):
        fitting = (f"{n} or {n + 1} for {words}" for n, words in CONDITIONS.items())
        raise UnsupportedArmError(
            f"{arm.name}: {arm.nq} joints at {CONDITIONS[equations.count]}; expected "
            f"{', '.join(fitting)}"
        )
    return equations
