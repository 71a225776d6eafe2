"""Swivel angles and fractions of arc where they are easily wrong: odd mounts, and windows narrower than a step."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin import Arm, configuration_circle
from aacmm_pin.accuracy.workspace import map_caveats
from aacmm_pin.arm.file import ArmFile, load_arm_file


def mounted(gravity: tuple[float, float, float]) -> Arm:
    return Arm.from_file(load_arm_file("sino6").model_copy(update={"gravity_m_s2": gravity}))


def limited(joint: int, lower_deg: float, upper_deg: float) -> Arm:
    file: ArmFile = load_arm_file("sino6")
    rows = list(file.joints)
    limits = (float(np.radians(lower_deg)), float(np.radians(upper_deg)))
    rows[joint - 1] = rows[joint - 1].model_copy(update={"limits_rad": limits})
    return Arm.from_file(file.model_copy(update={"joints": rows}))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_swivel_straight_above_and_below_the_shoulder_in_any_mount(axis: int, sign: float) -> None:
    gravity = np.zeros(3)
    gravity[axis] = 9.81 * sign
    arm = mounted((gravity[0], gravity[1], gravity[2]))
    for side in (0.5, -0.5):
        point = np.zeros(3)
        point[axis] = side
        circle = configuration_circle(arm, point, count=72)
        first = circle.component == 1
        turned = np.unwrap(circle.swivel[first])
        assert abs(turned[-1] - turned[0]) > np.radians(340)  # once round, not stuck at one angle
        zeta = circle.flexibility()
        assert (zeta.zeta, zeta.arc_fraction) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("joint", "lower_deg", "upper_deg", "point_mm"),
    [
        (1, 30, 33, (-250, 300, -640)),
        (1, 30, 33, (60, 20, -700)),
        (3, 100, 102, (33.63, -671.87, 182.94)),
        (3, 0, 355, (33.63, -671.87, 182.94)),
        (1, 0, 355, (60, 20, -700)),
        (4, -180, 0, (37.5, 0, -225)),
        (4, -180, 0, (205, 10, -20)),
    ],
)
def test_arc_fraction_is_that_of_dense_samples(
    joint: int, lower_deg: float, upper_deg: float, point_mm: tuple[float, float, float]
) -> None:
    circle = configuration_circle(limited(joint, lower_deg, upper_deg), np.array(point_mm) * 1e-3, count=20_000)
    bins = np.floor(np.degrees(circle.swivel) * 5 + 1e-9).astype(int)  # a fifth of a degree
    dense = len(np.unique(bins[circle.within_limits])) / len(np.unique(bins))
    edges = 4 / 1800  # each end of each window may take in a bin; two windows at most
    assert circle.flexibility().arc_fraction == pytest.approx(dense, abs=edges)


def test_a_map_says_where_its_half_plane_does_not_stand_for_all_of_space() -> None:
    assert map_caveats(Arm.load("sino6")) == ()
    assert "joint 1" in map_caveats(limited(1, 0, 180))[0]
    assert "gravity" in map_caveats(mounted((9.81, 0.0, 0.0)))[0]
