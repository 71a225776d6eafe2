"""The paper's tables and equations against forward kinematics and the print."""

import numpy as np
import pytest
from papers.sino6.equations import ConfigurationsAtTheta2, PlanarConfigurations
from papers.sino6.misprints import misprints
from papers.sino6.table2 import reproduce_table2
from papers.sino6.tables import NominalArm, printed_table1, printed_table2, sino6_nominal

from aacmm_pin.arm.dh import table
from aacmm_pin.errors import UnsupportedArmError
from tests.oracle import close

MM = 1e-3
L2, L3, D3, D5 = 60.7309 * MM, 53.10897 * MM, 700.95392 * MM, 500.2211 * MM
# Written out here once more, so that the truth of these tests does not come from the code under
# test.
TRUTH = table(
    [
        [0.0, 0.0, -np.pi / 2, 0.0],
        [-L2, 0.0, np.pi / 2, 0.0],
        [L3, -D3, -np.pi / 2, 0.0],
        [0.0, 0.0, np.pi / 2, 0.0],
        [0.0, -D5, np.pi / 2, 0.0],
    ]
)
ARM = NominalArm(L2, L3, D3, D5)


def random_configurations(seed, n, theta3=None):
    """θ1 to θ5 within the limits, θ5 = 0."""
    q = np.zeros((n, 5))
    q[:, :4] = np.random.default_rng(seed).uniform(
        [0, -np.pi, 0, -np.pi], [2 * np.pi, 0, 2 * np.pi, 0], (n, 4)
    )
    if theta3 is not None:
        q[:, 2] = theta3
    return q


def looks_towards(q, p):
    return np.cos(q[:, 0]) * p[:, 0] + np.sin(q[:, 0]) * p[:, 1] > 0


def angle_error(found, true):
    """Largest difference of the angles of a configuration, modulo a turn."""
    return np.abs(np.angle(np.exp(1j * (found - true)))).max(axis=-1)


def test_table_1_is_the_bundled_arm(sino6):
    printed = printed_table1()
    values = printed[["a_mm", "d_mm", "alpha_rad", "theta_offset_rad"]].to_numpy() * [MM, MM, 1, 1]
    widths = printed[
        ["a_half_width_mm", "d_half_width_mm", "alpha_half_width_rad", "theta_half_width_rad"]
    ].to_numpy()
    np.testing.assert_array_equal(sino6.dh.values(), values)
    stated = np.reshape([p.half_width for p in sino6.parameters], (6, 4))
    np.testing.assert_array_equal(stated, widths * [MM, MM, 1, 1])
    np.testing.assert_allclose([p.u for p in sino6.parameters], stated.ravel() / np.sqrt(3))
    assert sino6_nominal() == ARM
    np.testing.assert_array_equal(sino6_nominal().dh.values(), TRUTH.values())
    with pytest.raises(UnsupportedArmError, match="not positive"):
        NominalArm(-L2, L3, D3, -D5)


# Equations (2) to
# (13) ------------------------------------------------------------


def test_highest_configuration_is_the_one_that_made_the_point():
    q = random_configurations(1, 20_000, theta3=0.0)
    p = TRUTH.chain.positions(q)
    # Where |θ4| passes π - this, the mirror image about OP is the answer instead.
    elbow_angle = np.arctan2(L3 - L2, D3)
    applies = looks_towards(q, p) & (q[:, 3] > -np.pi - elbow_angle)
    assert applies.mean() > 0.8
    assert angle_error(PlanarConfigurations(ARM, p[applies]).highest, q[applies, :4]).max() < 1e-10
    # The case distinction of (2).
    printed = np.arctan(p[:, 1] / p[:, 0]) + np.where(p[:, 0] >= 0, 0.0, np.pi)
    assert (
        angle_error(PlanarConfigurations(ARM, p).azimuth[:, None], printed[:, None]).max() < 1e-14
    )


def test_lowest_configuration_is_the_one_that_made_the_point():
    q = random_configurations(2, 20_000, theta3=np.pi)
    p = TRUTH.chain.positions(q)
    first = q[:, 3] < -np.arctan2(L2 + L3, D3)
    # (7) starts from the highest configuration.
    reachable = np.linalg.norm(p, axis=1) < np.hypot(L3 - L2, D3) + D5
    towards = looks_towards(q, p)
    applies = towards & first & reachable
    assert applies.mean() > 0.6
    found = PlanarConfigurations(ARM, p)
    assert angle_error(found.lowest[applies], q[applies, :4]).max() < 1e-10
    assert np.abs(found.theta4_min[~first, 1] - q[~first, 3]).max() < 1e-10
    assert np.isnan(found.lowest[towards & ~reachable, 1]).all()


def test_all_configurations_at_a_theta2_contain_the_one_that_made_the_point():
    q = random_configurations(5, 20_000)
    p = TRUTH.chain.positions(q)
    at = ConfigurationsAtTheta2(ARM, p, q[:, 1])
    error = angle_error(at.all(), q[:, None, None, :4])
    best = np.nanmin(error.reshape(len(q), 4), axis=1)
    # Inverse cosines near ±1 lose half the digits, whatever the code: such points are counted, not
    # judged to 1e-10.
    cosine1 = np.cos(q[:, 0] - np.arctan2(p[:, 1], p[:, 0]))
    sound = (np.abs(at.cosine_theta42(L3)) < 1 - 1e-5) & (np.abs(cosine1) < 1 - 1e-5)
    assert sound.mean() > 0.99
    assert best[sound].max() < 1e-10
    assert best.max() < 1e-6
    needs_second_root = ~(
        np.nanmin(np.where(np.isnan(error[:, 0]), np.inf, error[:, 0]), axis=1) < 1e-6
    )
    assert 0.045 < needs_second_root.mean() < 0.055


def test_every_configuration_at_a_theta2_reaches_the_point():
    rng = np.random.default_rng(6)
    p = TRUTH.chain.positions(random_configurations(6, 5_000))
    theta2 = rng.uniform(-np.pi, 0, len(p))  # another θ2 than the one that made the point
    found = ConfigurationsAtTheta2(ARM, p, theta2).all()
    exists = np.isfinite(found).all(axis=-1)
    number = np.nonzero(exists)[0]
    q = np.column_stack([found[exists], np.zeros(exists.sum())])
    assert len(q) > 1_000
    # θ3 follows from a direction: outside the limits it may point the other way.
    offset = L3 - D5 * np.sin(q[:, 3])
    inside = offset > 0
    close(TRUTH.chain.positions(q[inside]), p[number[inside]], 1e-11)
    np.testing.assert_array_equal(q[:, 1], theta2[number])


# Misprints ------------------------------------------------------------


def test_misprints_have_the_sizes_of_their_geometry():
    slips = misprints(np.random.default_rng(3), 20_000).set_index(["equation", "printed"])
    assert slips.loc[("3", "the1 with √(l3² + d5²)"), "cosine"] == pytest.approx(5.81, abs=0.005)
    row = slips.loc[("5", "θ4max = -(2π - ∠k - ∠q)")]  # a right angle
    assert row["median_angle_error_deg"] == pytest.approx(90.0, abs=1e-9)
    assert row["affected_share"] == 1.0
    q = random_configurations(3, 20_000, theta3=0.0)  # the same sample
    t4 = -q[looks_towards(q, TRUTH.chain.positions(q)), 3]
    t4 = t4[t4 < np.pi + np.arctan2(L3 - L2, D3)]  # else the mirror image of the highest
    squares, double = L3**2 + D5**2, 2 * L3 * D5 * np.sin(t4)
    difference = np.sqrt(squares + double) - np.sqrt(squares - double)
    measured = slips.loc[("7", "ken with cos(π/2 + θ4max)"), "median_length_error_mm"]
    assert measured == pytest.approx(np.median(difference) / MM, rel=1e-9)
    harmless = slips.index[slips["affected_share"] == 0.0].tolist()
    # Points of the workspace never violate the missing half.
    assert harmless == [("7", "exists if den + |d5| >= gen")]


def test_table_2_is_reproduced_within_one_percent_and_exact_geometry_gives_more():
    found, printed = reproduce_table2(), printed_table2()["cells"].to_numpy()
    ours = found.counts["reproduced_cells"].to_numpy()
    assert printed.sum() == ours.sum() == found.counts["exact_cells"].sum() == 48 * 48
    assert ours[0] == 0
    distance = 0.5 * np.abs(ours[1:] - printed).sum() / 2304
    assert distance <= 0.01
    assert found.total_variation["reproduced"] == pytest.approx(distance, abs=1e-12)
    assert found.total_variation["exact"] > 0.25
    assert found.mean_flexibility["paper"] == pytest.approx(0.7621, abs=5e-5)
    assert found.mean_flexibility["exact"] == pytest.approx(0.983, abs=5e-4)
    assert found.counts["exact_cells"].tolist() == [0, 0, 0, 0, 0, 3, 0, 28, 0, 55, 0, 156, 2062]
    near = found.cells[found.cells["behind_axis"]]  # the steps find one sector of the whole circle
    assert len(near) > 300
    assert (near["reproduced_sectors"] == 1).all()
    assert (near["exact_sectors"] == 12).all()
