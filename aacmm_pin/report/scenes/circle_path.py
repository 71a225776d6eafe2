"""The line on which the elbow goes round the working point, in pieces within and outside the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.postures.configurations import ConfigurationCircle
from aacmm_pin.postures.solution_set import PosturesAtPoint

NEXT = 3.0
"""The ends of a line that no one calls closed are joined where they are no farther apart than so many usual steps."""


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of the line, all of it within limits or all of it not.

    Attributes:
        members: numbers of the configurations along it.
        works: whether it is within limits.
    """

    members: Index
    works: bool


def path_of(circle: PosturesAtPoint) -> tuple[Array, str]:
    """The point of the arm whose path shows the circle, (n, 3) [m], and its name.

    The elbow where the arm has one; else the origin of that joint that goes about most.
    """
    if isinstance(circle, ConfigurationCircle):
        return circle.components.swivel.elbow(circle.q), "the elbow"
    axes = circle.arm.chain.moving_axes()
    _, origin = circle.arm.chain.walk(circle.q)
    widest = int(np.linalg.norm(np.ptp(origin[axes], axis=1), axis=1).argmax())
    return origin[axes[widest]], f"joint {widest + 1}"


def thinned(component: Index, members: Index, most: int) -> Index:
    """At most about ``most`` of the ``members``, or three a component, evenly along each component."""
    step = -(-len(members) // most)
    numbers = np.unique(component[members])
    return np.concatenate([_every(members[component[members] == number], step) for number in numbers])


def _every(members: Index, step: int) -> Index:
    return members[:: max(1, min(step, len(members) // 3))]


def runs(circle: PosturesAtPoint, members: Index, path: Array) -> list[Run]:
    """The line through ``members`` of a circle, cut where it enters or leaves the limits."""
    found = []
    for number in np.unique(circle.component[members]):
        mine = members[circle.component[members] == number]
        if _closed(circle, int(number), path[mine]):
            mine = np.append(mine, mine[0])
        works = circle.within_limits[mine[:-1]] & circle.within_limits[mine[1:]]
        cuts = np.flatnonzero(np.diff(works)) + 1
        for start, end in zip([0, *cuts], [*cuts, len(works)], strict=True):
            if end > start:
                found.append(Run(mine[start : end + 1], bool(works[start])))
    return found


def _closed(circle: PosturesAtPoint, number: int, line: Array) -> bool:
    if isinstance(circle, ConfigurationCircle):
        return bool(circle.components.curves[number - 1].closed)
    if len(line) < 3:
        return False
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return bool(np.linalg.norm(line[-1] - line[0]) <= NEXT * np.median(steps))
