"""Which configurations of a circle an accuracy speaks of."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Index
from aacmm_pin.accuracy.volume import AccuracyVolume
from aacmm_pin.errors import ShapeError
from aacmm_pin.postures.solution_set import PosturesAtPoint


def paired(circle: PosturesAtPoint, accuracy: AccuracyVolume) -> Index:
    """Numbers, in the circle, of the configurations of ``accuracy``: those within limits, (n,).

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = np.flatnonzero(circle.within_limits)
    wanted = "pass accuracy_volume(arm, circle.q[circle.within_limits], at=circle.at)"
    if len(accuracy.q) != len(inside):
        raise ShapeError(
            f"accuracy has {len(accuracy.q)} configurations, expected the {len(inside)} of the circle's {len(circle.q)} "
            f"that are within limits: {wanted}"
        )
    if not np.array_equal(accuracy.q, circle.q[inside]):
        raise ShapeError(f"accuracy has other configurations than those of the circle within limits: {wanted}")
    return inside
