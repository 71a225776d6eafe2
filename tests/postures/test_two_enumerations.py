"""Three ways to all configurations of the nominal arm that share no code: curves as the package
traces them, a closed form at each swivel, written here, and the paper's equations (10) to (13) at
each θ2.
"""

from __future__ import annotations

import numpy as np
from papers.sino6.equations import ConfigurationsAtTheta2
from papers.sino6.table2 import exact_sectors, generating_grid
from papers.sino6.tables import NominalArm, sino6_nominal

from aacmm_pin._support.checks import Array

SAMPLES, HALVINGS = 180, 50
ARM = sino6_nominal()


def at_swivel(arm: NominalArm, points: Array, swivels: Array) -> tuple[Array, Array]:
    """Configurations (m, 4) [rad] with the elbow at each of ``swivels`` (s,), and their pairs of
    point and swivel (m,).

    With θ3 held, |OE| is known, so the triangle O, E, P and with the swivel the elbow E itself is
    known; θ2 follows from the height of E (two branches), θ1 from its azimuth. P lies in the plane
    through E at right angles to the axis of joint 4: the zeros of that condition over θ3. Samples
    of θ3 lie closer together near 0 and π, half a step off the planar ones.
    """
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, -1.0]) + along[:, 2:] * along
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    outward = np.cos(swivels)[:, None, None] * up + np.sin(swivels)[:, None, None] * np.cross(
        along, up
    )
    p, u = np.tile(points, (len(swivels), 1)).T, outward.reshape(-1, 3).T
    even = (np.arange(SAMPLES + 1) + 0.5) * 2 * np.pi / SAMPLES - np.pi
    theta3 = even - 0.45 * np.sin(2 * even)
    found, pairs = [], []
    with np.errstate(invalid="ignore"):
        for branch in (-1.0, 1.0):
            value = condition(arm, p[..., None], u[..., None], theta3, branch)[0]
            pair, left = np.nonzero(value[:, :-1] * value[:, 1:] <= 0)
            low, high = theta3[left], theta3[left + 1]
            exists = np.isfinite(value)  # zeros between a sample and where E goes out of reach
            edge, k = np.nonzero(exists[:, :-1] != exists[:, 1:])
            inside = np.where(exists[edge, k], k, k + 1)
            reachable, beyond = theta3[inside], theta3[2 * k + 1 - inside]
            for _ in range(HALVINGS):
                middle = (reachable + beyond) / 2
                within = np.isfinite(condition(arm, p[:, edge], u[:, edge], middle, branch)[0])
                reachable, beyond = (
                    np.where(within, middle, reachable),
                    np.where(within, beyond, middle),
                )
            turns = (
                value[edge, inside] * condition(arm, p[:, edge], u[:, edge], reachable, branch)[0]
                <= 0
            )
            pair = np.concatenate([pair, edge[turns]])
            low, high = (
                np.concatenate([low, theta3[inside][turns]]),
                np.concatenate([high, reachable[turns]]),
            )
            start = condition(arm, p[:, pair], u[:, pair], low, branch)[0]
            for _ in range(HALVINGS):
                middle = (low + high) / 2
                same = condition(arm, p[:, pair], u[:, pair], middle, branch)[0] * start > 0
                low, high = np.where(same, middle, low), np.where(same, high, middle)
            found.append(configuration(arm, p[:, pair], u[:, pair], (low + high) / 2, branch))
            pairs.append(pair)
    q, pair = np.concatenate(found), np.concatenate(pairs)
    sound = np.isfinite(q).all(axis=1)
    return q[sound], pair[sound]


def condition(
    arm: NominalArm, p: Array, u: Array, theta3: Array, branch: float
) -> tuple[Array, Array, Array]:
    """Condition [m], θ1 and t = -θ2 [rad]; NaN where E is out of reach."""
    cosine, sine = np.cos(theta3), np.sin(theta3)
    reach, aside = arm.l3 * cosine - arm.l2, arm.l3 * sine
    span, squared = reach**2 + arm.d3**2 + aside**2, np.sum(p**2, axis=0)
    share = (span + squared - arm.d5**2) / (2 * squared)
    elbow = share * p + np.sqrt(span - share**2 * squared) * u
    ahead = branch * np.sqrt(reach**2 + arm.d3**2 - elbow[2] ** 2)
    t = np.arctan2(elbow[2], ahead) + np.arctan2(arm.d3, reach)
    theta1 = np.arctan2(elbow[1], elbow[0]) - np.arctan2(aside, ahead)
    forward, sideways = (
        np.cos(theta1) * p[0] + np.sin(theta1) * p[1],
        np.cos(theta1) * p[1] - np.sin(theta1) * p[0],
    )
    return cosine * sideways - sine * (np.cos(t) * forward + np.sin(t) * p[2] + arm.l2), theta1, t


def configuration(arm: NominalArm, p: Array, u: Array, theta3: Array, branch: float) -> Array:
    """θ1 to θ4, θ4 from where P stands beyond E: (m, 4) [rad]."""
    _, theta1, t = condition(arm, p, u, theta3, branch)
    forward, sideways = (
        np.cos(theta1) * p[0] + np.sin(theta1) * p[1],
        np.cos(theta1) * p[1] - np.sin(theta1) * p[0],
    )
    offset = (np.cos(t) * forward + np.sin(t) * p[2] + arm.l2) * np.cos(theta3) + sideways * np.sin(
        theta3
    )
    along = np.sin(t) * forward - np.cos(t) * p[2]
    q = np.column_stack([theta1, -t, theta3, -np.arctan2(offset - arm.l3, along - arm.d3)])
    return np.asarray(np.pi - np.mod(np.pi - q, 2 * np.pi))


def swivel_of(points: Array, q: Array) -> Array:
    """Of the elbows: from the direction square to the line to the point that is nearest to
    -z_DH.
    """
    elbow = ARM.dh.chain.cut(ARM.dh.place(3)).positions(np.column_stack([q, np.zeros(len(q))]))
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, -1.0]) + along[:, 2:] * along
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.arctan2(np.sum(elbow * np.cross(along, up), axis=1), np.sum(elbow * up, axis=1))


def allowed(q: Array) -> Array:
    return ((q[:, [1, 3]] <= 0) & (q[:, [1, 3]] >= -np.pi)).all(axis=1)


def test_the_closed_form_reaches_its_points_and_misses_none() -> None:
    q = np.random.default_rng(11).uniform(
        [0, -np.pi, 0, -np.pi], [2 * np.pi, 0, 2 * np.pi, 0], (150, 4)
    )
    points = ARM.dh.chain.positions(np.column_stack([q, np.zeros(len(q))]))
    for point, own in zip(points, q, strict=True):
        found, _ = at_swivel(ARM, point[None], swivel_of(point[None], own[None]))
        reached = ARM.dh.chain.positions(np.column_stack([found, np.zeros(len(found))]))
        np.testing.assert_allclose(reached, np.broadcast_to(point, reached.shape), atol=1e-11)
        assert np.abs(np.angle(np.exp(1j * (found - own)))).max(axis=1).min() < 1e-7


def test_working_sectors_of_the_papers_cells_agree() -> None:
    """Every seventh of the 48 × 48 cells: the rims, the base axis and all the classes of the table
    are among them.
    """
    points = generating_grid(ARM)[2][::7]
    q, pair = at_swivel(ARM, points, np.arange(12) * np.pi / 6)
    works = np.zeros((12, len(points)), dtype=int)
    works.ravel()[pair[allowed(q)]] = 1
    assert len(np.unique(works.sum(axis=0))) >= 4
    np.testing.assert_array_equal(works.sum(axis=0), exact_sectors(ARM, points))


def test_equations_10_to_13_agree() -> None:
    """The circle of a cell walked by its θ2 instead comes near no swivel that the search leaves
    empty.
    """
    points = generating_grid(ARM)[2][np.random.default_rng(12).choice(48 * 48, 150, replace=False)]
    swivels = np.radians(
        np.arange(15.0, 180.0, 30.0)
    )  # off the planar configurations, where θ2 has its turning points
    q, pair = at_swivel(ARM, points, swivels)
    searched = np.zeros((len(swivels), len(points)), dtype=bool)
    searched.ravel()[pair[allowed(q)]] = True
    theta2 = -np.pi * (1 - np.cos(np.linspace(0, np.pi, 6_002)[1:-1])) / 2
    walked = np.zeros_like(searched)
    for number, point in enumerate(points):
        found = (
            ConfigurationsAtTheta2(ARM, np.tile(point, (len(theta2), 1)), theta2)
            .all()
            .reshape(-1, 4)
        )
        found = found[np.isfinite(found).all(axis=1) & (found[:, 3] <= 0)]
        near = np.abs(swivel_of(np.tile(point, (len(found), 1)), found)[:, None] - swivels).min(
            axis=0
        )
        walked[:, number] = near < np.radians(1)
    assert (~searched).sum() > 5
    assert (
        walked[searched].mean() > 0.95
    )  # close to the base axis the circle has nearly one θ2, and a walk by θ2 leaps
    assert not walked[~searched].any()
