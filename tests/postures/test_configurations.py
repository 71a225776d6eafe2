"""Configuration circles against brute force: nothing missed, nothing twice, every one exact.

The Newton iterations are this file's own: minimum-norm steps from random angles, by positions and
Jacobians that tests/arm holds to Pinocchio's. They know nothing of closed forms, continuation
or limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.accuracy.workspace import map_caveats, map_workspace
from aacmm_pin.arm import Arm, ArmFile, axis, load_arm_file
from aacmm_pin.arm.limits import into_limits, outside_limits
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.configurations import (
    PER_TURN,
    PER_TURN_IN_MAP,
    ConfigurationCircle,
    configuration_circle,
)
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.solution_curves import Curve
from aacmm_pin.postures.wrist import Wrist, reach_of_wrist
from tests.again import again
from tests.arm_files import RIGID, changed, craig, nominal
from tests.notes import data_of
from tests.oracle import jacobian_of

System = Callable[[Array, Index], tuple[Array, Array]]

SEAT = np.array([0.0336323, -0.6718702, 0.1829355])


# --- arms


ARMS: dict[str, Callable[[], ArmFile]] = {
    "sino6": lambda: load_arm_file("sino6"),
    "zero6": lambda: load_arm_file("zero6"),
    "nominal": nominal,
    "craig": craig,
}


@pytest.fixture(scope="session", params=["sino6", "craig", again("zero6"), again("nominal")])
def arm(request) -> Arm:
    return Arm.from_file(ARMS[request.param]())


# --- Newton and the test "is it on that curve?" of this file's own


def at_wrist(arm: Arm, points: Array) -> System:
    """The last joints held at 0."""

    def system(q: Array, which: Index) -> tuple[Array, Array]:
        whole = np.pad(wrapped(q), ((0, 0), (0, arm.nq - 4)))
        off = arm.positions(whole, "frame5") - points[which]
        return off, arm.jacobian(whole, "frame5")[:, :, :4]

    return system


def at_tip(arm: Arm, point: Array, axis: Array) -> System:
    """Place, and the whole direction of the stylus: six equations of rank five, so that the
    opposite one is no solution.
    """

    def system(q: Array, which: Index) -> tuple[Array, Array]:
        poses = arm.poses(wrapped(q))
        direction = poses.placement[:, :3, :3] @ arm.stylus_axis
        turned = np.cross(jacobian_of(poses)[:, 3:], direction[:, :, None], axis=1)
        off = np.hstack([poses.position - point, direction - axis])
        return off, np.concatenate([jacobian_of(poses)[:, :3], turned], axis=1)

    return system


def solve(system: System, q: Array, which: Index, iterations: int = 60) -> tuple[Array, Index]:
    """Minimum-norm Newton from each row of ``q``; the rows that arrive."""
    q, going = q.copy(), np.arange(len(q))
    arrived = np.zeros(len(q), dtype=bool)
    for _ in range(iterations):
        f, jacobian = system(q[going], which[going])
        done = np.abs(f).max(axis=1) < 3e-13
        arrived[going[done]] = True
        going, f, jacobian = going[~done], f[~done], jacobian[~done]
        if not going.size:
            break
        step = -least_squares(jacobian, f)
        q[going] += (
            step * np.minimum(1.0, 0.7 / np.maximum(np.linalg.norm(step, axis=1), 1e-30))[:, None]
        )
    return q[arrived], which[arrived]


def least_squares(matrix: Array, right: Array) -> Array:
    """By the normal equations, damped a trifle: they may have a null space."""
    square = matrix.transpose(0, 2, 1) @ matrix
    damping = 1e-13 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(square.shape[1])
    return np.asarray(
        np.linalg.solve(square + damping, matrix.transpose(0, 2, 1) @ right[:, :, None])[:, :, 0]
    )


def wrapped(angles: Array) -> Array:
    return (angles + np.pi) % (2 * np.pi) - np.pi


def dense(system: System, curves: list[Curve], between: int = 8) -> tuple[Array, Index]:
    """The curves' vertices with ``between - 1`` solutions on each piece."""
    parts = np.arange(between)[None, :, None] / between
    pieces = [
        (c.q[:, None] + wrapped(np.roll(c.q, -1, axis=0) - c.q)[:, None] * parts) for c in curves
    ]
    start = np.concatenate([p.reshape(-1, p.shape[2]) for p in pieces])
    which = np.repeat([c.problem for c in curves], [len(c.q) * between for c in curves])
    q, arrived = solve(system, start, which)
    assert len(q) == len(start)
    return q, arrived


def missed(system: System, curves: list[Curve], q: Array, which: Index) -> Array:
    """Which of the solutions ``q`` are on none of the curves of their problem: from the nearest
    dense solutions, Newton in the hyperplane across the tangent at ``q`` must end at ``q``.
    """
    there, of = dense(system, curves)
    far = 100.0 * np.arange(max(of.max(), which.max()) + 1)  # problems do not mix
    tree = cKDTree(np.column_stack([np.cos(there), np.sin(there), far[of]]))
    _, near = tree.query(np.column_stack([np.cos(q), np.sin(q), far[which]]), k=6)
    tangent = np.linalg.svd(system(q, which)[1])[2][:, -1]
    found = np.zeros(len(q), dtype=bool)
    for column in near.T:
        guess = q + wrapped(there[column] - q)
        guess -= ((guess - q) * tangent).sum(axis=1)[:, None] * tangent
        x = guess.copy()
        for _ in range(6):
            f, jacobian = system(x, which)
            bordered = np.concatenate([jacobian, tangent[:, None]], axis=1)
            right = np.concatenate([-f, ((q - x) * tangent).sum(axis=1)[:, None]], axis=1)
            x = x + least_squares(bordered, right)
        close = (np.linalg.norm(guess - q, axis=1) < 0.05) & (
            np.linalg.norm(x - guess, axis=1) < 3e-3
        )
        found |= (of[column] == which) & close & (np.linalg.norm(x - q, axis=1) < 1e-6)
    return ~found


def twice(system: System, curves: list[Curve]) -> int:
    """Number of pairs of curves of which one starts on the other."""
    pairs = 0
    for one in curves:
        starts = [
            other.q[0] for other in curves if other is not one and other.problem == one.problem
        ]
        if starts:
            pairs += int(
                (~missed(system, [one], np.array(starts), np.full(len(starts), one.problem))).sum()
            )
    return pairs


# --- (a) nothing is missed


@dataclass(frozen=True)
class Cloud:
    """Points of one kind with everything that brute force found there."""

    points: Array
    q: Array
    which: Index


def directions(rng: np.random.Generator, n: int) -> Array:
    d = rng.normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def clouds_of(arm: Arm, rng: np.random.Generator, n: int) -> dict[str, Array]:
    """Places that are hard, each kind ``n`` times [m]."""
    dh = arm.require_dh("")
    shoulder = Swivel(dh, arm.up).shoulder
    near, far = reach_of_wrist(Wrist.of(dh, np.zeros(arm.nq - 4)), shoulder)
    rho, azimuth, height = (
        10 ** rng.uniform(-9, np.log10(3e-2), n),
        rng.uniform(0, 2 * np.pi, n),
        rng.uniform(near, far, n),
    )
    height *= rng.choice([-1.0, 1.0], n)
    little = 10 ** rng.uniform(-7, -3, (4, n, 1))
    return {
        "anywhere": shoulder + directions(rng, n) * rng.uniform(near, far, (n, 1)),
        "near the base axis": shoulder
        + np.column_stack([rho * np.cos(azimuth), rho * np.sin(azimuth), height]),
        "on the base axis": shoulder
        + np.column_stack([0 * height, 0 * height, np.roll(height, 1)]),
        "almost stretched": shoulder + directions(rng, n) * (far - little[0]),
        "just too far": shoulder + directions(rng, n) * (far + little[1]),
        "almost folded": shoulder + directions(rng, n) * (near + little[2]),
        "just in the hole": shoulder + directions(rng, n) * (near - little[3]),
    }


@pytest.fixture(scope="session")
def clouds(arm) -> dict[str, Cloud]:
    rng = np.random.default_rng(71)
    n = 10 if arm.name == "SINO6" and arm.require_dh("").standard else 4
    grid = np.array(list(product(np.linspace(-np.pi, np.pi, 4)[:-1] + 0.2, repeat=4)))
    result = {}
    for kind, points in clouds_of(arm, rng, n).items():
        starts = np.concatenate(
            [np.vstack([grid, rng.uniform(-np.pi, np.pi, (59, 4))]) for _ in points]
        )
        which = np.repeat(np.arange(n), len(grid) + 59)
        q, which = solve(at_wrist(arm, points), starts, which)
        result[kind] = Cloud(points, q, which)
    return result


@pytest.mark.parametrize("per_turn", [PER_TURN, PER_TURN_IN_MAP], ids=["one point", "a map"])
def test_brute_force_finds_nothing_that_the_circles_miss(arm, clouds, per_turn):
    wrist = Wrist.of(arm.require_dh(""), np.zeros(arm.nq - 4))
    for kind, cloud in clouds.items():
        system = at_wrist(arm, cloud.points)
        curves = wrist.curves(cloud.points, per_turn).curves
        assert {c.problem for c in curves} >= set(cloud.which.tolist()), kind
        assert all(c.closed for c in curves), kind
        if curves:
            lost = missed(system, curves, cloud.q, cloud.which)
            assert not lost.any(), (kind, cloud.points[cloud.which[lost]], cloud.q[lost])
            every = np.concatenate([c.q for c in curves])
            of = np.repeat([c.problem for c in curves], [len(c.q) for c in curves])
            place = arm.poses(
                np.column_stack([every, np.zeros((len(every), arm.nq - 4))]), "frame5"
            ).position
            np.testing.assert_allclose(place, cloud.points[of], rtol=0, atol=1e-12)
            assert twice(system, [c for c in curves if c.problem < 2]) == 0, kind
    assert sum(len(cloud.q) for cloud in clouds.values()) > 500
    assert not len(clouds["just too far"].q)
    assert not len(clouds["just in the hole"].q)


# --- (b, c) exact, in order, even


@pytest.fixture(scope="session")
def circles(arm) -> list[ConfigurationCircle]:
    shoulder = Swivel(arm.require_dh(""), arm.up).shoulder
    points = shoulder + np.array(
        [
            [0.034, -0.6, 0.19],
            [-0.25, 0.1, -0.4],
            [2e-3, 1e-3, 0.5],
            [0.0, 0.0, -0.6],
            [0.4, 0.4, 0.5],
        ]
    )
    return [configuration_circle(arm, point, count=120) for point in points]


def test_components_are_ordered_closed_and_even(arm, circles):
    for circle in circles:
        assert len(circle) >= 240
        place = arm.poses(circle.q, "frame5").position
        np.testing.assert_allclose(
            place, np.broadcast_to(circle.point, place.shape), rtol=0, atol=1e-12
        )
        np.testing.assert_allclose(circle.q[:, 4:], 0.0, atol=1e-15)
        assert list(np.unique(circle.component)) == list(range(1, len(circle) // 120 + 1))
        assert twice(at_wrist(arm, circle.point[None]), circle.components.curves) == 0
        for number in np.unique(circle.component):
            q = circle.q[circle.component == number]
            assert len(q) == 120
            elbow = arm.positions(q, "frame3" if arm.require_dh("").standard else "frame4")
            steps = np.linalg.norm(np.roll(elbow, -1, axis=0) - elbow, axis=1)
            turns = np.abs(wrapped(np.roll(q, -1, axis=0) - q)).max(axis=1)
            # Near the base axis joint 1 turns fast while the elbow hardly moves.
            assert turns.max() < 0.9
            if steps.sum() > 1e-6:
                assert steps.max() < 1.05 * steps.mean()
                # Where the path turns back on itself a chord is shorter.
                assert (steps < 0.95 * steps.mean()).sum() <= 4


# --- (d) swivel


def own_swivel(elbow: Array, shoulder: Array, point: Array, up: Array) -> Array:
    """Angle between two half-planes through the line shoulder → point, by a rotation about it."""
    axis = (point - shoulder) / np.linalg.norm(point - shoulder)
    across = np.eye(3) - np.outer(axis, axis)
    top = across @ up / np.linalg.norm(across @ up)
    side = np.cross(axis, top)  # a quarter turn by the right hand
    return np.arctan2((elbow - shoulder) @ side, (elbow - shoulder) @ top)


@pytest.mark.parametrize(
    ("name", "gravity"),
    [("sino6", (0.0, 0.0, -9.81)), ("zero6", (9.81, 0.0, 0.0)), ("craig", (1.0, -2.0, 3.0))],
)
def test_swivel_is_zero_at_the_top_and_right_handed(name, gravity):
    arm = changed(ARMS[name](), gravity_m_s2=gravity)
    shoulder = np.array([0.0, 0.0, 0.09985 if name == "zero6" else 0.0])
    up = -np.array(gravity) / np.linalg.norm(gravity)
    point = shoulder + np.array([0.35, -0.3, 0.25])
    circle = configuration_circle(arm, point, count=180)
    elbow = arm.poses(circle.q, "frame4" if name == "craig" else "frame3").position
    np.testing.assert_allclose(
        wrapped(circle.swivel - own_swivel(elbow, shoulder, point, up)), 0.0, atol=1e-9
    )
    for number in np.unique(circle.component):
        mine = circle.component == number
        highest = np.argmax(elbow[mine] @ up)
        # The elbow's path is nearly a circle, not quite.
        assert abs(circle.swivel[mine][highest]) < np.radians(12)
    # The right hand turns the top towards (point - shoulder) × up.
    across = np.cross(point - shoulder, up)
    np.testing.assert_array_equal(
        np.sign((elbow - shoulder) @ across), np.sign(np.sin(circle.swivel))
    )


# --- (e) limits


def test_angles_are_turned_into_their_limits_by_whole_turns(rng):
    """Inside and nearest to the middle, or least outside; an angle on its limit is inside."""
    lower = rng.uniform(-8, 5, 60)
    pairs = np.column_stack([lower, lower + rng.uniform(0.01, 20, 60)])
    for low, high in [*pairs, [-2 * np.pi, 2 * np.pi], [0, 2 * np.pi]]:
        limits, edges = np.array([[low, high]]), np.array([low, high])[:, None] + [-1e-10, 0, 1e-10]
        q = np.concatenate([rng.uniform(-30, 30, 50), edges.ravel(), edges.ravel() - 4 * np.pi])
        into = into_limits(q[:, None], limits)[:, 0]
        np.testing.assert_allclose(wrapped(into - q), 0.0, atol=1e-9)
        every = q[:, None] + 2 * np.pi * np.arange(-12, 13)
        outside, least = (np.maximum(np.maximum(low - x, x - high), 0.0) for x in (into, every))
        np.testing.assert_allclose(outside, least.min(axis=1), atol=3e-9)
        broken = outside_limits(into[:, None], limits)[:, 0]
        np.testing.assert_array_equal(broken, least.min(axis=1) > 1e-9)
        from_middle = np.where(least < 1e-9, np.abs(every - (low + high) / 2), np.inf)
        there, nearest = ~broken, from_middle.min(axis=1)
        np.testing.assert_allclose(
            np.abs(into[there] - (low + high) / 2), nearest[there], atol=1e-8
        )
    assert (np.abs(into_limits(q[:, None], np.array([[-np.inf, np.inf]]))) <= np.pi + 1e-9).all()


def test_circle_says_which_limits_are_broken(arm, circles):
    for circle in circles:
        for j, (lower, upper) in enumerate(arm.limits):
            every = circle.q[:, j : j + 1] + 2 * np.pi * np.arange(-3, 4)
            fits = ((every >= lower - 1e-9) & (every <= upper + 1e-9)).any(axis=1)
            np.testing.assert_array_equal(circle.broken[:, j], ~fits)
        np.testing.assert_array_equal(circle.within_limits, ~circle.broken.any(axis=1))


# --- (f) branches


def test_branch_signs_are_those_of_the_geometry(arm, circles):
    shoulder = Swivel(arm.require_dh(""), arm.up).shoulder
    for circle in circles:
        step = np.array([[0.0, 0.0, 0.0, 1e-6, 0.0, 0.0]])
        grown, shrunk = (
            np.linalg.norm(arm.positions(circle.q + s * step, "frame5") - shoulder, axis=1)
            for s in (1.0, -1.0)
        )
        clear = np.abs(grown - shrunk) > 1e-9
        np.testing.assert_array_equal(circle.branch[clear, 1], np.sign(grown - shrunk)[clear])
        rotation, _ = arm.chain.walk(circle.q)
        first, second = (rotation[axis(joint)][:, :, 2] for joint in (1, 2))
        side = np.cross(first, second) @ (circle.point - shoulder)
        clear = np.abs(side) > 1e-9
        np.testing.assert_array_equal(circle.branch[clear, 0], np.sign(side)[clear])


# --- (g) what cannot be reached, and what cannot be asked


def test_out_of_reach_is_empty_with_a_reason(sino6, zero6):
    for arm, point, words in (
        (sino6, (0.05, 0.1, -0.05), ("122.474", "200.464", "1210.68")),
        (zero6, (0, 0, 1.0), ("900.15", "106.735", "839.921")),
    ):
        circle = configuration_circle(arm, point)
        assert (circle.q.shape, circle.branch.shape) == ((0, 6), (0, 2))
        assert all(word in circle.reason for word in words)
        flexibility = circle.flexibility()
        assert np.isnan([flexibility.zeta, flexibility.arc_fraction]).all()
        assert len(circle.to_frame()) == 0
    tip = configuration_circle(sino6, [1.36, 0.0, 0.0], axis=[-1, 0, 0])
    assert len(tip) == 0
    assert "1360 mm" in tip.reason


def test_reach_is_what_brute_force_reaches(arm):
    dh = arm.require_dh("")
    shoulder = Swivel(dh, arm.up).shoulder
    near, far = reach_of_wrist(Wrist.of(dh, np.zeros(arm.nq - 4)), shoulder)
    q = np.random.default_rng(8).uniform(-np.pi, np.pi, (100_000, arm.nq))
    q[:, 4:] = 0.0
    distance = np.linalg.norm(arm.positions(q, "frame5") - shoulder, axis=1)
    assert near <= distance.min() < near + 6e-3
    assert far - 6e-3 < distance.max() <= far


def with_long_fifth_row(length_mm: float) -> Arm:
    """SINO6 of five joints, whose last link carries the tip."""
    five = load_arm_file("sino6").joints[:5]
    five[4] = five[4].model_copy(update={"a_mm": length_mm, "limits_rad": (0.5, 2.0)})
    return changed("sino6", joints=five)


def test_a_held_joint_that_moves_the_point_is_named(sino6):
    """With a length behind it joint 5 carries frame 5 about: to hold it leaves out what was asked
    for.
    """
    arm, point = with_long_fifth_row(210.0), [0.3, 0.2, 0.4]
    for ask in (
        lambda: configuration_circle(arm, point),
        lambda: map_workspace(arm, (2, 2), progress=False),
    ):
        with pytest.raises(UnsupportedArmError) as refused:
            ask()
        assert "joint 5" in str(refused.value)
        assert "210 mm" in str(refused.value)
    stated = configuration_circle(arm, point, rest=[0.7], count=24)
    assert (len(stated), stated.notes, stated.complete) == (96, (), True)
    little = configuration_circle(with_long_fifth_row(0.9), point, count=24)
    (told,) = data_of(little.notes, "wrist_joint_held")
    assert "joint 5" in told["held"]
    assert "0.9 mm" in told["held"]
    assert not little.complete
    assert data_of(map_caveats(with_long_fifth_row(0.9)), "wrist_joint_held") == [told]
    assert configuration_circle(sino6, point, count=24).notes == ()


def test_what_cannot_be_asked(sino6):
    up = {"point": SEAT, "axis": [0, 0, 1]}
    asked: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"point": [0.1, np.nan, 0.3]}, ShapeError, r"point\[1\] is nan"),
        (up | {"axis": [0, 0, 0]}, AacmmError, "direction"),
        (up | {"rest": [0, 0]}, AacmmError, "rest"),
        ({"point": SEAT, "rest": [0.0]}, ShapeError, r"rest has shape \(1,\); expected \(2,\)"),
        ({"point": SEAT, "count": 10.5}, AacmmError, "count is 10.5; expected a whole number"),
    ]
    for arguments, error, words in asked:
        with pytest.raises(error, match=words):
            configuration_circle(sino6, **arguments)
    with pytest.raises(AacmmError, match="sectors"):
        configuration_circle(sino6, SEAT, count=3).flexibility(0)


def test_arms_that_lack_what_is_needed(robot_file):
    with pytest.raises(UnsupportedArmError, match="DH table"):
        configuration_circle(Arm.from_urdf(robot_file("ur5_robot.urdf"), "ee_link"), SEAT)
    with pytest.raises(UnsupportedArmError, match="stylus"):
        configuration_circle(changed("sino6", stylus=None), SEAT, axis=[0, 0, 1])
    four = changed("sino6", joints=load_arm_file("sino6").joints[:4])
    with pytest.raises(UnsupportedArmError, match=r"SINO6: .*has 4 joints in 4 DH rows"):
        configuration_circle(four, SEAT)
    with pytest.raises(UnsupportedArmError, match=r"SINO6: .*joint"):
        configuration_circle(changed("sino6", {3: RIGID}), SEAT)


# --- (h) the tip with a given stylus axis


TIPS = [
    ("sino6", (0.3, -0.4, 0.2), (0.0, 0.0, -1.0)),
    again("sino6", (0.0, 0.0, 0.9), (1.0, 0.0, 0.0)),
    again("sino6", (0.0, -1.32, 0.2), (0.0, -1.0, 0.2)),  # near the end of the reach
    ("zero6", (0.3, -0.3, 0.2), (0.0, 0.0, -1.0)),
    again("nominal", (0.4, 0.1, 0.3), (1.0, 0.0, 0.0)),
    # so near the end of the reach that the body behind joint 6 has a few degrees to turn about the
    # stylus
    (
        "craig",
        (-0.8484687406192339, -0.7918470712766146, -0.3539050526389978),
        (-0.8462676330612128, -0.44388966397261476, -0.2946066181389205),
    ),
]


@pytest.mark.parametrize(("name", "point", "axis"), TIPS)
def test_tip_circles_are_exact_and_complete(name, point, axis):
    arm = Arm.from_file(ARMS[name]())
    place = np.array(point)
    direction = np.array(axis) / np.linalg.norm(axis)
    circle = configuration_circle(arm, place, axis=axis, count=40)
    assert circle.at == "tip"
    assert len(circle)
    assert all(c.closed for c in circle.components.curves)
    placement = arm.poses(circle.q).placement
    np.testing.assert_allclose(placement[:, :3, 3] - place, 0.0, atol=1e-12)
    np.testing.assert_allclose(placement[:, :3, :3] @ arm.stylus_axis - direction, 0.0, atol=2e-12)

    starts = np.random.default_rng(12).uniform(-np.pi, np.pi, (350, 6))
    system = at_tip(arm, place, direction)
    q, which = solve(system, starts, np.zeros(350, dtype=np.intp), iterations=80)
    assert len(q) > 50
    lost = missed(system, circle.components.curves, q, which)
    assert not lost.any(), f"{lost.sum()} of {len(q)}: {q[lost][:2].tolist()}"
    assert twice(system, circle.components.curves) == 0
    # Also after the turns into the limits.
    np.testing.assert_allclose(
        arm.poses(circle.q[circle.within_limits]).position - place, 0.0, atol=1e-12
    )


# --- (k) flexibility


def brute_flexibility(
    circle: ConfigurationCircle, sectors: int
) -> tuple[list[bool], list[bool], float]:
    """From dense samples: which sector centres are crossed, crossed inside the limits, and the
    working range of swivel.
    """
    crossed, works = [False] * sectors, [False] * sectors
    bins = 1440
    any_bin, good_bin = np.zeros(bins, dtype=bool), np.zeros(bins, dtype=bool)
    for number in np.unique(circle.component):
        mine = circle.component == number
        swivel, inside = circle.swivel[mine], circle.within_limits[mine]
        turn = wrapped(np.roll(swivel, -1) - swivel)
        middle = (swivel + turn / 2) % (2 * np.pi)
        where = (middle / (2 * np.pi) * bins).astype(int) % bins
        any_bin[where] = True
        good_bin[where[inside]] = True
        for k in range(sectors):
            ahead = wrapped(k * 2 * np.pi / sectors - swivel)
            passes = (ahead * turn >= 0) & (np.abs(ahead) < np.abs(turn))
            crossed[k] |= bool(passes.any())
            works[k] |= bool((passes & inside).any())
    return crossed, works, float(good_bin.sum() / any_bin.sum())


def test_wrist_joints_rest_inside_their_limits(sino6):
    # θ6 as good as from -2 to -1.
    lower, upper = (np.array([0.5, 2 * np.pi - 2.0]), np.array([1.0, 2 * np.pi - 1.0]))
    narrow = replace(sino6, limits=np.vstack([sino6.limits[:4], np.column_stack([lower, upper])]))
    free, held = (configuration_circle(arm, [0.4, 0.0, 0.3]) for arm in (sino6, narrow))
    np.testing.assert_allclose(
        np.unique(held.q[:, 4:], axis=0), [[0.5, 2 * np.pi - 1.0]], atol=1e-12
    )
    assert held.flexibility().sectors == free.flexibility().sectors
    assert held.flexibility().arc_fraction == pytest.approx(
        free.flexibility().arc_fraction, abs=2e-3
    )
    assert not configuration_circle(narrow, [0.4, 0.0, 0.3], rest=[0.0, 0.0]).within_limits.any()


def limited(name: str, joint: int, lower_deg: float, upper_deg: float) -> Arm:
    """A bundled arm with other limits of a joint; 0 for all of them."""
    return changed(name, {joint: {"limits_rad": tuple(np.radians([lower_deg, upper_deg]))}})


@pytest.mark.parametrize(
    ("limits", "point_mm"),
    [
        (None, (33.6, -671.9, 182.9)),
        again(None, (20, 10, 620)),
        again(None, (300, 0, -300)),
        (None, (0, 1190, 100)),
        (("zero6", 0, -109, 92), (200, 200, 400)),  # so that there is something to lose
        (("sino6", 1, 30, 33), (-250, 300, -640)),  # windows narrower than a step
        again(("sino6", 3, 100, 102), (33.6, -671.9, 182.9)),
        again(("sino6", 1, 0, 355), (60, 20, -700)),
        again(("sino6", 4, -180, 0), (205, 10, -20)),
    ],
)
def test_flexibility_is_that_of_dense_samples(limits, point_mm, sino6):
    circle = configuration_circle(
        limited(*limits) if limits else sino6, np.array(point_mm) * 1e-3, count=6000
    )
    for sectors in (1, 7, 12):
        result = circle.flexibility(sectors)
        crossed, works, fraction = brute_flexibility(circle, sectors)
        assert result.sectors == tuple(works)
        assert result.zeta == pytest.approx(
            sum(works) / sum(crossed) if any(crossed) else np.nan, nan_ok=True
        )
        assert result.arc_fraction == pytest.approx(fraction, abs=0.004)


@pytest.mark.parametrize(("axis", "sign"), [(0, 1.0), (2, -1.0), again(1, -1.0), again(2, 1.0)])
def test_swivel_straight_above_and_below_the_shoulder_in_any_mount(axis, sign):
    gravity = tuple((9.81 * sign * np.eye(3)[axis]).tolist())
    arm = changed("sino6", gravity_m_s2=gravity)
    for side in (0.5, -0.5):
        circle = configuration_circle(arm, side * np.eye(3)[axis], count=72)
        turned = np.unwrap(circle.swivel[circle.component == 1])
        assert abs(turned[-1] - turned[0]) > np.radians(340)  # once round, not stuck at one angle
        zeta = circle.flexibility()
        assert (zeta.zeta, zeta.arc_fraction) == (1.0, 1.0)


def test_a_map_says_what_it_does_not_stand_for(sino6):
    assert map_caveats(sino6) == ()
    assert map_caveats(limited("sino6", 1, 0, 180))[0].code == "first_joint_limited"
    assert data_of(map_caveats(limited("sino6", 5, 17, 180)), "joints_held") == [
        {"joints": "joint 5 at 17°"}
    ]
    wall = changed("sino6", gravity_m_s2=(9.81, 0.0, 0.0))
    assert map_caveats(wall)[0].code == "gravity_off_first_axis"
