"""Postures of any arm of revolute joints with its tip at a point, perhaps oriented.

With as many conditions as joints postures are single; with one more joint they are closed curves,
the self-motion. Point: 3 conditions; point and axis: 5; pose: 6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, unit_vector, vector, whole
from aacmm_pin._support.notes import Note
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin.arm import Arm, GivenArm, as_arm, inside_part, into_limits, outside_limits
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.continuation import POINT
from aacmm_pin.postures.curve_sampling import Flexibility, evenly
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.newton_search import (
    MOST_STARTS,
    Isolated,
    Search,
    search,
)
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.postures_at_point import (
    PosturesAtPoint,
    in_degrees,
    missing_notes,
    open_curve_notes,
)
from aacmm_pin.postures.solution_curves import (
    NEARLY_SINGULAR,
    Curve,
    CurveSearch,
    flattest,
)

CONDITIONS = {3: "a point", 5: "a point and an axis", 6: "a full pose"}
ELBOW_JOINT = 4
"""Its axis has the elbow of an AACMM."""
ORTHONORMAL = 1e-6
"""A matrix with a smaller deviation is made a rotation."""


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
