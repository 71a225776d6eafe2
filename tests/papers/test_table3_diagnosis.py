"""The diagnosis of the paper's Table 3, against an independent analysis of the same table and
forward kinematics written here.

The independent analysis placed θ3, not the elbow, evenly round the circle, and drew its own arms;
its numbers are expected within what that and its draws may change.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from papers.document import papers_document
from papers.sino6.table2 import reproduce_table2
from papers.sino6.tables import printed_points, printed_table1
from papers.sino6_table3.diagnosis import Table3Diagnosis, diagnose_table3
from papers.sino6_table3.evidence import evidence
from papers.sino6_table3.patterns import DH, ECCENTRICITY, NOISE, ODD, STAND
from papers.sino6_table3.selection_bias import (
    COUNTS,
    MEASURED_LOGS,
    band,
    implied_counts,
    marked_count,
)
from papers.sino6_table3.simulated_touches import MEASURED, TouchedSeats, touched_seats

from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report.formats.html import page
from tests.oracle import close, dh_frames, perturbed_positions
from tests.pages import Page

ARCSEC = np.pi / 180 / 3600
FIVE_ARCSEC_MM = [0.0282, 0.0307, 0.0347, 0.0389, 0.0310]
"""Independent analysis: spreads of seats 1 to 5 by 5″ of noise on every joint, stylus along -z."""


@pytest.fixture(scope="module")
def seats() -> TouchedSeats:
    return touched_seats()


@pytest.fixture(scope="module")
def at_wrist() -> TouchedSeats:
    return touched_seats("wrist")


@pytest.fixture(scope="module")
def found(seats) -> Table3Diagnosis:
    return diagnose_table3(np.random.default_rng(20190427), seats)


def dh_tips(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tips and x axes of the last frame of SINO6, from the printed Table 1: (…, 3) [m]."""
    table = printed_table1()[["a_mm", "d_mm", "alpha_rad", "theta_offset_rad"]].to_numpy()
    flat = dh_frames(table * [1e-3, 1e-3, 1.0, 1.0], q.reshape(-1, 6))
    placement = flat.reshape(*q.shape[:-1], 4, 4)
    return placement[..., :3, 3], placement[..., :3, 0]


# Postures ------------------------------------------------------------


def test_the_tips_are_in_the_seats_with_the_stylus_down(seats):
    for q, point in zip(seats.q, printed_points(), strict=True):
        tips, stylus = dh_tips(q)
        assert len(q) == 50
        close(tips, np.broadcast_to(point, tips.shape), 1e-9)
        close(stylus, np.broadcast_to([0.0, 0.0, -1.0], stylus.shape), 1e-9)


def test_the_wrists_are_at_the_printed_coordinates_by_pinocchio(at_wrist):
    position = at_wrist.model.arm.poses(at_wrist.all_q, "frame5").position.reshape(6, 50, 3)
    assert np.linalg.norm(position - printed_points()[:, None], axis=2).max() < 2e-12
    assert ((at_wrist.q[..., [1, 3]] < 0) & (at_wrist.q[..., [1, 3]] > -np.pi)).all()
    close(np.diff(np.unwrap(at_wrist.q[..., 2], axis=1), axis=1), 2 * np.pi / 50, 0.02)
    with pytest.raises(UnknownNameError, match="stylus down"):
        touched_seats("sideways")  # type: ignore[arg-type]
    with pytest.raises(AacmmError, match="arc is 0"):
        touched_seats("wrist", arc=0.0)


def test_implied_counts_are_whole_but_for_seat_6():
    counts = implied_counts()
    assert counts["whole"].tolist() == [True] * 5 + [False]
    assert counts["marked_count"].round().tolist()[:5] == [17, 15, 20, 22, 24]
    assert implied_counts(51)["whole"].iloc[5]
    p = np.random.default_rng(15).normal(size=(50, 3)) * 1e-5  # a known split is recovered
    squared = np.sort(((p - p.mean(axis=0)) ** 2).sum(axis=1))
    spreads = np.sqrt([squared.sum() / 49, squared[:19].mean(), squared[19:].mean()])
    assert marked_count(spreads, 50) == pytest.approx(19, abs=1e-9)


def test_the_wrist_reading_gives_the_same_picture(at_wrist):
    """Independent analysis: at the wrist 5″ misses seats 1 to 5 by 1.9 % rms after one size has
    been fitted.
    """
    other = diagnose_table3(np.random.default_rng(1), at_wrist, draws=500)
    assert 1.0 < other.fit[0] < 3.0
    assert other.noise[1] == pytest.approx(5.0 * ARCSEC, rel=0.05)
    assert other.log_bayes_factor(ODD, NOISE, "six") > 4.0
    assert (
        other.shown["measured_mm"].between(other.shown["dh_p05_mm"], other.shown["dh_p95_mm"]).all()
    )


# Show ------------------------------------------------------------


def test_dh_errors_give_the_level_and_one_number(found):
    """Independent: medians .049 .049 .051 .046 .045 .038 mm; correlation 0.97 to 0.98; sd of the
    logarithm 0.66.

    Here seat 6 is a little freer in this reading, down to 0.93; with the stylus up and at the wrist
    0.96 is the least.
    """
    np.testing.assert_allclose(
        found.shown["dh_median_mm"], [0.049, 0.049, 0.051, 0.046, 0.045, 0.038], rtol=0.08
    )
    log = found.patterns[DH].log_spread
    correlation = np.corrcoef(log.T)[np.triu_indices(6, 1)]
    assert correlation.mean() == pytest.approx(0.97, abs=0.015)
    assert correlation.min() > 0.91
    assert log.std(axis=0).mean() == pytest.approx(0.66, abs=0.05)
    assert (found.shown["measured_quantile"][:5].between(0.15, 0.5)).all()
    assert 0.66 < found.shown["measured_quantile"][5] < 0.9


def test_first_order_agrees_with_brute_force_arms(seats, found):
    """DH errors by whole forward kinematics instead of
    sensitivities.
    """
    arm, rng = seats.model.arm, np.random.default_rng(11)
    half = np.array([parameter.half_width or 0.0 for parameter in arm.parameters])
    errors = half * rng.uniform(-1.0, 1.0, (300, len(half)))
    exact = np.empty((300, 6))
    for k, q in enumerate(seats.q):
        moved = np.stack(
            [perturbed_positions(arm, one[None, :], errors).reshape(300, 3) for one in q], axis=1
        )
        exact[:, k] = np.sqrt(moved.var(axis=1, ddof=1).sum(axis=1))
    moved = np.einsum("snip,dp->dsni", seats.sensitivity(), errors, optimize=True)
    linear = np.sqrt(moved.var(axis=2, ddof=1).sum(axis=2))
    np.testing.assert_allclose(linear, exact, rtol=2e-3)
    # 300 arms against those of the diagnosis: medians of a distribution with sd 0.66 of the
    # logarithm.
    ours, theirs = (
        np.median(found.patterns[DH].log_spread, axis=0),
        np.median(np.log(exact), axis=0),
    )
    close(ours, theirs, 4 * 1.25 * 0.66 / np.sqrt(300))


# Name ------------------------------------------------------------


def test_noise_of_every_encoder_by_forward_kinematics(seats, found):
    """Readings with 5″ of noise through the matrices above, 400 times fifty records."""
    rng, pattern = np.random.default_rng(12), found.patterns[NOISE]
    for k, q in enumerate(seats.q):
        tips, _ = dh_tips(q + 5 * ARCSEC * rng.normal(size=(400, *q.shape)))
        simulated = np.sqrt(tips.var(axis=1, ddof=1).sum(axis=1))
        assert 5 * ARCSEC * np.sqrt(pattern.second[0, k]) == pytest.approx(
            np.sqrt((simulated**2).mean()), rel=0.015
        )
        assert np.log(simulated).std() == pytest.approx(pattern.log_sd[0, k], rel=0.2)
    np.testing.assert_allclose(
        5 * ARCSEC * np.sqrt(pattern.second[0, :5]) * 1e3, FIVE_ARCSEC_MM, rtol=0.03
    )


def test_five_arcseconds_describe_five_seats(found):
    low, middle, high = found.noise / ARCSEC
    assert low < 5.0 < high
    assert middle == pytest.approx(5.0, abs=0.2)
    assert found.fit[0] < 2.0  # independent: 0.9 %
    assert 1e-3 < found.fit[1] < 0.02  # independent: 0.0025
    # Size and misfit again, by hand.
    residual = np.log(MEASURED[:5]) - np.log(np.array(FIVE_ARCSEC_MM) * 1e-3)
    assert np.exp(residual.mean()) * 5.0 == pytest.approx(middle, rel=0.03)


def test_five_seats_do_not_tell_the_cause(found):
    """Independent log-evidences at τ = 0.15: noise +0.3, DH -0.9, eccentricity -1.2, seat + height
    -0.1, one odd -0.8.
    """
    assert found.verdict == "ambiguous"
    expected = {DH: -1.2, ECCENTRICITY: -1.5, STAND: -0.4, ODD: -1.1}
    for cause, difference in expected.items():
        assert found.log_bayes_factor(cause, NOISE, "five") == pytest.approx(difference, abs=0.8)
    assert found.evidences["five_probability"].sum() == pytest.approx(1.0)
    assert found.evidences["five_probability"].max() < 0.3


def test_six_seats_say_that_one_is_odd(found):
    """Independent, against noise: τ = 0.15 one odd +6.3, stand +2.3, DH -1.2; τ = 0.30 one odd
    +0.7, DH -1.5.
    """
    assert found.log_bayes_factor(ODD, NOISE, "six") == pytest.approx(6.3, abs=1.2)
    assert found.log_bayes_factor(STAND, NOISE, "six") == pytest.approx(2.3, abs=1.5)
    assert found.log_bayes_factor(DH, NOISE, "six") == pytest.approx(-1.2, abs=1.2)
    assert found.log_bayes_factor(ODD, NOISE, "six", 0.30) == pytest.approx(0.7, abs=0.8)
    assert found.log_bayes_factor(DH, NOISE, "six", 0.30) == pytest.approx(-1.5, abs=0.8)


def test_only_something_local_could_have_made_seat_6(found):
    """Independent: P(s6/s5 ≥ 2.54) at most 7e-4 for gravity, eccentricity, thermal drift, DH."""
    table = found.seat6.set_index("cause")
    assert table.index[table["possible"]].tolist() == [ODD]
    others = table.drop(ODD)
    assert others["ratio_probability"].max() < 2e-3
    assert others["as_large_probability"].max() < 0.01
    assert found.local_noise == pytest.approx(np.sqrt((0.0783**2 - 0.0335**2) / 3) * 1e-3, rel=0.01)


# Part and
# rest ------------------------------------------------------------


def test_the_contrast_is_that_of_picking_after_measuring(found):
    """Independent: picked after, medians .44 .41 .43 .43 .44; by volume .99 to 1.4; never all six
    as small as printed.
    """
    marked, measured = found.marked, np.exp(MEASURED_LOGS)
    low, middle, high = band(marked.after[NOISE])
    close(middle[:5], [0.44, 0.41, 0.43, 0.43, 0.44], 0.02)
    close(measured, [0.381, 0.392, 0.453, 0.531, 0.475, 0.565], 1e-3)
    assert COUNTS[:5] == [17, 15, 20, 22, 24]
    assert ((low <= measured) & (measured <= high)).sum() >= 4
    low, middle, _ = band(marked.before[DH])
    assert ((middle > 0.97) & (middle < 1.4)).all()
    assert (measured < low).all()
    assert (marked.causes["before_reached"] == 0).all()


def test_part_of_the_variance_scatters(found):
    pick = found.marked
    assert 0.3 < pick.least_random_share < 0.55
    assert pick.chance(np.array([pick.least_random_share]))[0] == pytest.approx(0.05, abs=0.01)
    assert pick.chance(np.array([0.0, 1.0]))[1] == pytest.approx(pick.shares["reached"].max())
    # Only noise: the law of the chi distribution, near the medians of the independent analysis.
    assert pick.shares["ratio"].iloc[-1] == pytest.approx(0.43, abs=0.015)


# Extend and
# measure ------------------------------------------------------------


def test_the_extended_arm_states_its_noise(found, tmp_path):
    found.model.save(tmp_path / "arm.toml")
    loaded = ErrorModel.load(tmp_path / "arm.toml")
    np.testing.assert_allclose(loaded.arm.encoder_noise, found.noise_beside_dh[1], rtol=1e-12)
    assert [p.half_width for p in loaded.parameters] == [
        p.half_width for p in ErrorModel.load("sino6").parameters
    ]
    assert found.noise_beside_dh[1] < found.noise[1]
    assert found.noise_beside_dh[2] < 1.2 * found.noise[2]


def test_gain_on_a_seat_left_out(found):
    held = found.held_out
    logs = {
        name: np.log(held.seats["measured_mm"] / held.seats[f"{name}_mm"])
        for name in ("recalibrated", "extended")
    }
    rms = {name: np.sqrt(np.mean(np.square(values))) for name, values in logs.items()}
    gain = 1 - rms["extended"] / rms["recalibrated"]
    assert held.gain["extended"] == pytest.approx(gain, abs=1e-9)
    assert 0.4 < gain < 0.9
    # Noise without DH errors, by hand: the mean logarithm of the others carries the size.
    log, pattern = np.log(MEASURED[:5]), found.patterns[NOISE].log_spread[0, :5]
    others = [np.mean(np.delete(log - pattern, k)) + pattern[k] for k in range(5)]
    np.testing.assert_allclose(held.seats["noise_alone_mm"], np.exp(others) * 1e3, rtol=0.02)


# What is
# said ------------------------------------------------------------


def test_another_seat_would_be_named_if_it_were_odd(found):
    """The same table with the excess at seat 2: the odd seat is found there, not where this one has
    it.
    """
    swapped = MEASURED.copy()
    swapped[1], swapped[5] = (
        MEASURED[1] * 2.4,
        5 * ARCSEC * np.sqrt(found.patterns[NOISE].second[0, 5]),
    )
    known = evidence(found.patterns[ODD], swapped, 0.15)
    per_seat = known.weights.reshape(-1, 6).sum(axis=0)
    assert per_seat.argmax() == 1
    assert (
        evidence(found.patterns[ODD], MEASURED, 0.15).weights.reshape(-1, 6).sum(axis=0).argmax()
        == 5
    )


def test_with_noise_alone_nothing_is_special(found):
    """Spreads drawn from the noise law: seat 6 is then no exception, in nine of ten tables."""
    rng, pattern = np.random.default_rng(19), found.patterns[NOISE]
    special = 0
    for _ in range(60):
        drawn = np.exp(
            np.log(5 * ARCSEC) + pattern.log_spread[0] + pattern.log_sd[0] * rng.normal(size=6)
        )
        both = [evidence(found.patterns[name], drawn, 0.15).log_evidence for name in (ODD, NOISE)]
        special += both[0] - both[1] > np.log(10)
    assert special <= 6


def test_the_page_of_both_papers(found):
    table2 = reproduce_table2(grid=12)
    parsed = Page(page(papers_document(table2, found, 1)))
    assert len(parsed.all("img")) == 5
    assert not re.search(r"\bnan\b|\binf\b|None", parsed.text)
    for result in (table2, found):  # as Jupyter shows them
        assert f"<{Page(result._repr_html_()).tags[0][0]}" in result._repr_html_()
