"""The configuration circle: the postures that reach a point (Xu You et al. 2019, section 1).

Unlike the closed forms of the paper, this holds for calibrated geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support.arrays import Array, Mask, unit_vector, vector, whole
from aacmm_pin._support.display import Note, report
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin.arm import Arm, GivenArm, as_arm, into_limits, outside_limits
from aacmm_pin.arm import axis as axis_place
from aacmm_pin.errors import AacmmError, UnsupportedArmError
from aacmm_pin.postures.curve_sampling import (
    Components,
    Flexibility,
    Sectors,
    arc_fractions,
    evenly,
)
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.postures_at_point import (
    PosturesAtPoint,
    in_degrees,
    missing_notes,
    open_curve_notes,
)
from aacmm_pin.postures.solution_curves import all_curves
from aacmm_pin.postures.wrist import WRIST_ROW, Wrist, reach_of_wrist

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

WRIST = "frame5"
"""Frame of the working point of the paper."""
TIP_JOINTS = WRIST_ROW + 1
"""Joints with which postures of given tip and stylus axis are closed curves."""
STARTS = 1000
"""Of Newton's method, for all curves of a tip. At 239 hard places 600 found all that 6000 found."""
PER_TURN, PER_TURN_IN_MAP = 24, 3
"""Held angles of each joint for the curves of a wrist, and for each wrist of a map; with as many
evenly spread starts for each of four joints the few find all that the many do.
"""


@dataclass(frozen=True, eq=False)
class ConfigurationCircle(PosturesAtPoint):
    """All postures with the wrist or the tip at one point, in order along closed curves.

    Attributes:
        components: the sampled closed curves.
    """

    components: Components

    @cached_property
    def branch(self) -> NDArray[np.intp]:
        """The signs of the solution branch, ``(n, 2)``.

        First the side of the wrist from the plane of joint axes 1 and 2, then the sign of
        d|shoulder → wrist|/dθ4.
        """
        dh = self.arm.require_dh("a branch")
        rotation, origin = self.arm.chain.walk(self.q)
        first, second, fourth = (rotation[axis_place(row)][:, :, 2] for row in (1, 2, 4))
        on_fourth = origin[axis_place(4)]
        wrist = origin[dh.place(5)]
        shoulder_to_wrist = wrist - self.components.swivel.shoulder
        normal = np.cross(first, second)
        side = np.einsum("ni,ni->n", normal, shoulder_to_wrist)
        velocity = np.cross(fourth, wrist - on_fourth)  # of the wrist, for 1 rad/s of joint 4
        stretch = np.einsum("ni,ni->n", velocity, shoulder_to_wrist)
        signs = np.column_stack([side, stretch])
        return np.where(signs >= 0, 1, -1)

    def flexibility(self, sectors: int = 12) -> Flexibility:
        """Return the flexibility ζ, counted in so many equal ``sectors`` of the swivel angle."""
        limits = self.arm.limits
        states = Sectors.of(self.components, limits, whole(sectors, 1, "sectors"))
        (arc_fraction,) = arc_fractions(self.components, limits)
        working = tuple(states.working[0].tolist())
        return Flexibility(float(states.zeta[0]), working, float(arc_fraction))

    def columns(self) -> dict[str, Any]:
        """Return the columns of :meth:`PosturesAtPoint.columns`, then the signs of
        :attr:`branch`.
        """
        shoulder, elbow = self.branch.T
        return super().columns() | {"shoulder_side": shoulder, "elbow_side": elbow}

    def plot(self, accuracy: Any = None, postures: int = 5, ax: Axes3D | None = None) -> Axes3D:
        """Plot the path of the elbow and some postures; see
        :func:`aacmm_pin.report.plots.plot_circle`.
        """
        drawn: Axes3D = report().plots.plot_circle(self, accuracy, postures, ax)
        return drawn

    def __str__(self) -> str:
        where = self._where()
        if self.reason:
            return f"{where}, has no posture, because {self.reason}"
        inside = f"of which {self.within_limits.sum()} are within the joint limits"
        part = "flexibility (share of swivel angles)"
        curves = f"{len(self)} postures on {self.component.max()} closed curves"
        return f"{where}, has {curves}, {inside}. The {part} is {self.flexibility()}"


def configuration_circle(
    arm: GivenArm,
    point: ArrayLike,
    *,
    axis: ArrayLike | None = None,
    rest: ArrayLike | None = None,
    count: int = 360,
) -> ConfigurationCircle:
    """Compute the configuration circle of ``arm`` at ``point``.

    Args:
        arm: its first five DH rows are joints.
        point: position of the wrist or tip ``(3,)`` [m].
        axis: direction of the stylus in the base ``(3,)``, of any length. With it the tip is at the
            point, and all six joints move. Without it the wrist (origin of frame 5) is there, and
            joints after joint 4 stay at ``rest``.
        rest: angles of joints 5, 6, … ``(nq - 4,)`` [rad]; default nearest to 0 within limits. (Row
            5 of SINO6 is 0.037 mm long, so that θ5 slightly changes the circle.)
        count: postures on each curve, evenly spaced along the path of the elbow.

    Returns:
        The circle; out of reach it is empty, and has a ``reason``.

    Raises:
        ShapeError: a vector has a wrong shape or is not finite.
        AacmmError: ``axis`` with ``rest``, an axis of length zero, or a count below 3.
        UnsupportedArmError: no DH table with the required joints, or joint 5 moves the wrist; see
            :meth:`aacmm_pin.postures.wrist.Wrist.of_arm`.
    """
    arm = as_arm(arm)
    purpose = "a configuration circle"
    place = vector(point, 3, "point", "m")
    COORDINATE.check(place, "point")
    count = whole(count, 3, "count")
    if axis is not None and rest is not None:
        raise AacmmError("rest cannot be combined with axis")
    components = _curves(arm, place[None], purpose, PER_TURN, axis, rest)
    curves = components.curves_of_points
    wrist = components.wrist
    notes = open_curve_notes(curves.curves) + [Note("arm_degenerate")] * curves.degenerate
    notes += wrist.notes if wrist is not None and rest is None else []
    for search in curves.searches:
        if len(search.families):
            posture = in_degrees(components.full(search.families[:1])[0])
            notes.append(Note("singular_unlisted", {"posture": posture}))
        notes += [Note("search_ended")] * search.ended
    q = np.empty((0, arm.nq))
    component = np.empty(0, dtype=np.intp)
    if curves.curves:
        moving_q, component, missing = evenly(
            curves.equations,
            curves.curves,
            count,
            lambda q: components.swivel.elbow(components.full(q)),
        )
        q = into_limits(components.full(moving_q), arm.limits)
        notes += missing_notes(missing)
    reason = "" if len(q) else "; ".join(map(str, notes))
    if not len(q) and not notes:
        shoulder = components.swivel.shoulder
        data = {"distance": float(np.linalg.norm(place - shoulder))}
        code = "stylus_axis_unreachable"
        if wrist is not None:
            code = "wrist_out_of_reach"
            data["nearest"], data["farthest"] = reach_of_wrist(wrist, shoulder)
        reason = str(Note(code, data))
    return ConfigurationCircle(
        arm=arm,
        point=place,
        at=WRIST if axis is None else arm.tip,
        q=q,
        component=component + 1,
        swivel=components.swivel.angle(q, place),
        broken=outside_limits(q, arm.limits),
        components=components,
        reason=reason,
        notes=tuple(notes),
        complete=not notes,
    )


def directed_stylus(arm: Arm, axis: ArrayLike) -> tuple[Array, Array]:
    """Unit direction of the stylus in the last frame (3,), and ``axis`` as one in the base (3,)."""
    dh = arm.require_dh("a circle of the tip", TIP_JOINTS, revolute=True)
    if dh.nq != TIP_JOINTS:
        raise UnsupportedArmError(
            f"{arm.name}: the arm has {dh.nq} joints; expected {TIP_JOINTS} for a circle of the "
            "tip; for this arm use reaching_postures"
        )
    if arm.stylus_axis is None:
        raise UnsupportedArmError(
            f"{arm.name}: the arm states no axis of the stylus; state [stylus] in the arm file"
        )
    return arm.stylus_axis, unit_vector(axis, "axis")


class Reach(NamedTuple):
    """Reachability of points.

    Attributes:
        sectors: of the swivel angle at each point.
        arc_fraction: working over theoretical range of swivel (m,); nan without a range.
        reachable: reached without regard to limits (m,).
        complete: all postures are known (m,).
    """

    sectors: Sectors
    arc_fraction: Array
    reachable: Mask
    complete: Mask


def reach_of_points(
    arm: Arm, points: Array, sectors: int, purpose: str, axis: ArrayLike | None
) -> Reach:
    """Reachability of ``points`` (m, 3) [m] by the wrist, or by the tip with the stylus along
    ``axis`` (3,), over equal ``sectors`` of swivel; errors name the ``purpose``.
    """
    components = _curves(arm, points, purpose, PER_TURN_IN_MAP, axis)
    reachable = np.zeros(len(points), dtype=bool)
    complete = np.full(len(points), not components.curves_of_points.degenerate)
    for search in components.curves_of_points.searches:
        reachable[search.problem] = True
        complete[search.problem] &= search.complete
    sector_states = Sectors.of(components, arm.limits, sectors)
    return Reach(sector_states, arc_fractions(components, arm.limits), reachable, complete)


def _curves(
    arm: Arm,
    points: Array,
    purpose: str,
    per_turn: int,
    axis: ArrayLike | None,
    rest: ArrayLike | None = None,
) -> Components:
    """Curves of the wrist with the other joints at ``rest``, or of the tip along ``axis``."""
    dh = arm.require_dh(purpose, revolute=True)
    wrist = None
    if axis is None:
        wrist = Wrist.of_arm(arm, purpose, rest)
        curves = wrist.curves(points, per_turn)
    else:
        equations = Equations.of_axis(dh.chain.links(), points, *directed_stylus(arm, axis))
        curves = all_curves(equations, STARTS)
    return Components(Swivel(dh, arm.up), points, curves, wrist)
