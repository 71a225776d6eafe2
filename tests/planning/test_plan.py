"""Plans judged from outside: distances by dense least squares, decisions by an evidence that shares
no code with them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from aacmm_pin import Arm, ErrorModel, Measurements, plan_measurements, simulate_measurements
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG
from aacmm_pin.arm.chain import skew
from aacmm_pin.arm.random_postures import Room, joint_bounds
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import (
    BaseCompliance,
    BearingTilt,
    Effect,
    EncoderEccentricity,
    EncoderGain,
    JointCompliance,
    JointPeriodicError,
    ThermalExpansion,
    cause_of,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.state import State
from aacmm_pin.errors import (
    AacmmError,
    MissingConditionError,
    UnsupportedArmError,
)
from aacmm_pin.planning import MeasurementPlan
from aacmm_pin.planning.candidate_design import whitened_rows
from aacmm_pin.planning.measurement_conditions import possible_conditions
from aacmm_pin.planning.separability import Power, power_of
from tests.arm_files import RIGID, changed
from tests.notes import data_of
from tests.oracle import close

U_READING, U_REFERENCE = 8e-6, 1.2e-5
NOISE: dict[str, Any] = {"encoder_noise": U_READING, "reference_noise": U_REFERENCE}
PAIR = ("joint_compliance:2", "encoder_eccentricity:2")


def distances(power: Power) -> tuple[float, float]:
    """T of the first cause from the second, and the reverse."""
    return float(power.separation.distances[0, 1]), float(power.separation.distances[1, 0])


def planned(
    arm: Arm | ErrorModel, split: Any, records: int = 20, seed: int = 1, **options: Any
) -> MeasurementPlan:
    settings: dict[str, Any] = {
        "postures": 200,
        "rng": np.random.default_rng(seed),
        **NOISE,
        **options,
    }
    return plan_measurements(arm, split, records, **settings)


# --- an independent, dense computation


def geometry(arm: Arm, q: np.ndarray) -> np.ndarray:
    """What refitting one standard uncertainty of each geometric value does (n, 3, p)."""
    u = np.array([p.u for p in arm.parameters])
    return (arm.sensitivity(q) * u)[:, :, u > 0]


def columns(arm: Arm, records: Measurements, effect: Effect) -> np.ndarray:
    """What one unit of each parameter of a cause does (n, 3, p)."""
    model = ErrorModel(arm, (effect.at(()),))
    return model.sensitivity(records.q, records.conditions)[:, :, len(arm.parameters) :]


def dense(
    arm: Arm,
    parts: list[Measurements],
    causes: tuple[Effect, ...],
    external: bool,
    known_seats: bool,
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Whitened nuisances, prior rows below, and whitened columns of each cause, by plain loops."""
    seats = sorted(
        {s for m in parts if m.conditions.seat is not None for s in m.conditions.seat if s}
    )
    above: list[np.ndarray] = []
    of_causes: list[list[np.ndarray]] = [[] for _ in causes]
    for m in parts:
        jacobian, known, tips = arm.jacobian(m.q), geometry(arm, m.q), arm.positions(m.q)
        bodies = [columns(arm, m, effect) for effect in causes]
        for i in range(m.n):
            seat = "" if m.conditions.seat is None else m.conditions.seat[i]
            covariance = U_READING**2 * jacobian[i] @ jacobian[i].T
            covariance += 0 if seat else U_REFERENCE**2 * np.eye(3)
            white = np.linalg.inv(np.linalg.cholesky(covariance))
            own = [known[i]]
            if external:
                own += [np.eye(3), -skew(tips[i][None])[0]]
            own += [-np.eye(3) if s == seat else np.zeros((3, 3)) for s in seats]
            above.append(white @ np.hstack(own))
            for rows, body in zip(of_causes, bodies, strict=True):
                rows.append(white @ body[i])
    free = above[0].shape[1]
    count = known.shape[2]
    below = [np.eye(count, free)]
    if known_seats:
        below.append(np.eye(3 * len(seats), free, free - 3 * len(seats)) / U_REFERENCE)
    z = np.vstack([*above, *below])
    extra = len(z) - 3 * len(above)
    return z, [
        np.vstack([np.vstack(rows), np.zeros((extra, rows[0].shape[1]))]) for rows in of_causes
    ]


def distance(z: np.ndarray, mine: np.ndarray, its: np.ndarray) -> float:
    others = np.hstack([z, its])
    others = others / np.linalg.norm(others, axis=0)
    left = mine - others @ np.linalg.lstsq(others, mine, rcond=None)[0]
    return float(np.square(left).sum())


def brute(
    plan: MeasurementPlan,
    arm: Arm,
    split: tuple[Effect, Effect],
    existing: Measurements | None = None,
    external: bool = False,
    known: bool = False,
) -> tuple[float, float]:
    parts = [plan.measurements] if existing is None else [existing, plan.measurements]
    z, (a, b) = dense(arm, parts, split, external, known)
    size = [
        np.diag([t.typical for t in e.terms]) if not any(e.values) else np.array(e.values)[:, None]
        for e in split
    ]
    return distance(z, a @ size[0], b), distance(z, b @ size[1], a)


EXACT = 1e-8


def test_the_distances_are_those_of_dense_least_squares(sino6):
    for split in (
        (JointCompliance(2), EncoderEccentricity(2)),
        (JointCompliance(3, values=(1.7e-5,)), EncoderEccentricity(3, values=(2e-5, -7e-5))),
        (BearingTilt(3), JointPeriodicError(3, 7.0)),
    ):
        plan = planned(sino6, split, as_it_stands=True)
        expected = brute(plan, sino6, split)
        assert distances(plan.after) == pytest.approx(expected, rel=EXACT)
        assert plan.after.least == pytest.approx(min(expected), rel=EXACT)


def test_an_amplitude_without_a_phase_is_planned_for_any_phase(sino6):
    split = (JointCompliance(3, values=(1.7e-5,)), EncoderEccentricity(3, values=(7e-5, 0.0)))
    plan = planned(sino6, split, as_it_stands=True)
    phases = np.arange(8) * np.pi / 4
    each = [
        brute(
            plan, sino6, (split[0], replace(split[1], values=(7e-5 * np.cos(p), 7e-5 * np.sin(p))))
        )
        for p in phases
    ]
    assert distances(plan.after) == pytest.approx(np.mean(each, axis=0), rel=EXACT)


def test_they_are_with_existing_records_in_an_unknown_frame_and_at_seats(sino6):
    split = (JointCompliance(2), EncoderEccentricity(2))
    existing = simulate_measurements(
        sino6, "free", 15, rng=np.random.default_rng(3), encoder_noise=U_READING
    )
    # Two records that say nothing.
    more, nothing = (np.vstack([existing.q, existing.q[:2]]), np.full((2, 3), np.nan))
    old = Measurements.of(more, np.vstack([existing.reference, nothing]))
    plan = planned(sino6, split, existing=old, reference_frame="external")
    # How the frame is turned does not matter to isotropic references, so the brute computation
    # leaves it where it is.
    expected = brute(plan, sino6, split, existing, external=True)
    assert plan.existing == 17
    assert plan.before is not None
    assert plan.before.least < plan.after.least
    assert distances(plan.after) == pytest.approx(expected, rel=1e-7)
    for known in (True, False):
        rng = np.random.default_rng(3)
        existing = simulate_measurements(
            sino6, "seats", 12, rng=rng, encoder_noise=U_READING, seats=4, known=known
        )
        plan = planned(sino6, split, 12, existing=existing, scheme="seats")
        assert set(plan.records["seat"]) <= {"S1", "S2", "S3", "S4"}
        expected = brute(plan, sino6, split, existing, known=known)
        assert distances(plan.after) == pytest.approx(expected, rel=1e-7)


# --- what it is worth: decisions by Bayes


def test_odds_are_those_of_the_densities_of_drawn_records(rng):
    """Monte Carlo: the true cause has the larger density, in 50 000 draws of records each."""
    draws = 50_000
    for size, count in ((0.5, 2), (1.0, 2), (2.0, 2), (0.6, 5), (0.4, 24)):
        blocks = (slice(0, 1), slice(1, 1 + count))
        r = size * rng.normal(size=(count + 3, count + 1))
        right = []
        for true, other in ((0, 1), (1, 0)):
            mine = r[:, blocks[true]]
            z = rng.standard_normal((mine.shape[1], draws))
            effects = mine @ (z / np.sqrt(np.square(z).mean(axis=0)))
            y = effects + rng.standard_normal((len(r), draws))
            shape = [r[:, block] @ r[:, block].T for block in blocks]
            shows = np.square(mine).sum()
            density = [
                multivariate_normal.logpdf(y.T, cov=np.eye(len(r)) + shows / np.trace(s) * s)
                for s in shape
            ]
            right.append(density[true] > density[other])
        power = power_of(r, blocks, (np.eye(1), np.eye(count)))
        assert power.probability == pytest.approx(np.mean(right), abs=6e-3)


def test_causes_that_do_the_same_or_nothing():
    blocks, sizes = (slice(0, 1), slice(1, 2)), (np.eye(1),) * 2
    same = power_of(np.ones((3, 2)), blocks, sizes)
    assert (same.probability, same.separation.own_effects.any()) == (0.5, False)
    nothing = power_of(np.diag([1e-4, 3.0]), blocks, sizes)
    assert (nothing.separation.own_effects[1, 0], nothing.inseparable) == (True, True)
    assert not nothing.separation.own_effects[0, 1]


# --- set-ups


def test_postures_alone_are_asked_for_where_they_do(sino6):
    plan = planned(sino6, PAIR)
    assert plan.summary()["power"]["after"]["T"] == [*distances(plan.after)]
    assert plan.set_up == ()
    assert not plan.changes_arm
    assert plan.decided
    assert [t.words for t in plan.tried] == ["no change"]
    assert list(plan.records.columns) == [
        *(f"theta{k}_deg" for k in range(1, 7)),
        "x_mm",
        "y_mm",
        "z_mm",
        "record",
    ]


def test_what_looks_the_same_on_a_level_mount_needs_another(sino6):
    split = ("bearing_tilt:1", "base_compliance")
    plan = planned(sino6, split)
    as_it_stands, loaded, turned = plan.tried
    assert as_it_stands.why_not == loaded.why_not == str(Note("causes_inseparable"))
    assert turned.why_not == ""
    assert plan.changes_arm
    assert plan.set_up == (turned.words,)
    assert "90°" in plan.setup
    assert plan.decided
    # Seen from outside: the same columns on this mount, others on that.
    q, _ = Room(sino6).postures(50, np.random.default_rng(1))
    for arm, same in ((sino6, True), (plan.model.arm, False)):
        one, other = (
            columns(arm, Measurements.of(q), effect)
            for effect in (BearingTilt(1), BaseCompliance())
        )
        assert (np.abs(one - other).max() < 1e-9 * np.abs(other).max()) == same
    assert abs(plan.model.arm.gravity @ sino6.gravity) < 1e-9
    assert np.linalg.norm(plan.model.arm.gravity) == pytest.approx(9.81)
    on_wall = changed("sino6", gravity_m_s2=(0.0, -9.81, 0.0))
    assert planned(on_wall, split).set_up == ()
    contained = planned(sino6, ("counterbalance:2", "encoder_eccentricity:2"))
    assert (
        contained.tried[0].why_not
        == "encoder_eccentricity:2 can have every effect of counterbalance:2"
    )
    stays = planned(sino6, split, as_it_stands=True)
    assert stays.after.inseparable
    assert not stays.decided
    assert "the same effect in every posture" in stays.tried[-1].why_not


def test_conditions_that_causes_depend_on_are_varied(sino6):
    plan = planned(sino6, ("joint_hysteresis:3", "encoder_eccentricity:3"))
    assert len(plan.set_up) == 1
    assert "joint 3" in plan.setup
    assert set(plan.records["approach3"]) == {-1, 1}
    assert set(plan.records["approach2"]) == {1}
    assert not plan.changes_arm
    assert len(plan.tried) == 2
    plan = planned(sino6, ("thermal_expansion", "encoder_gain:2"))
    assert set(plan.records["temperature_c"]) == {20.0, 24.0}
    assert plan.records["temperature_c"].is_monotonic_increasing
    assert plan.tried[0].why_not.endswith("thermal_expansion")
    plan = planned(sino6, ("zero_drift:3,time_constant_s=1800", "encoder_gain:3"))
    assert "90 minutes" in plan.setup
    assert (np.diff(plan.records["time_s"]) >= 30.0).all()
    assert plan.records["time_s"].max() <= 5400.0 + 30.0 * len(plan.records)


def test_a_load_hangs_where_it_is_said_to(sino6):
    causes: tuple[Effect, ...] = (JointCompliance(2), EncoderGain(2))
    (loaded,) = [
        s for s in possible_conditions(ErrorModel(sino6), causes, 20.0) if str(s).startswith("hang")
    ]
    assert str(loaded) == str(Note("hang_load", {"load": 1.0, "link": 5}))
    q, _ = Room(sino6).postures(10, np.random.default_rng(2))
    bare, heavy = (
        State(arm, q, Conditions(10), arm.chain.tip) for arm in (sino6, loaded.model.arm)
    )
    wrist = bare.origin[2 * 5 + 1]
    for row in (1, 2, 4):
        extra = np.cross(wrist - bare.origin[2 * row], sino6.gravity)
        close(heavy.moment_at_axis(row) - bare.moment_at_axis(row), extra, 1e-9)


def test_more_records_are_less_effort_than_another_mount(sino6):
    free = simulate_measurements(sino6, "free", 200, rng=np.random.default_rng(1))
    split = (JointCompliance(2, values=(2e-6,)), EncoderEccentricity(2))
    few = planned(sino6, split, 20, existing=free)
    assert not few.decided
    assert few.set_up == ()
    assert few.enough is not None
    (alike,) = data_of(few.notes, "planned_as_large_as")
    assert (alike["cause"], alike["other"]) == ("encoder_eccentricity:2", "joint_compliance:2")
    assert planned(sino6, split, few.enough, existing=free).after.probability > 0.93


# --- what is given


def test_an_arm_that_has_the_cause_says_how_large_it_is(sino6):
    known = JointCompliance(2, values=(4e-5,), u=(1e-6,))
    extended = ErrorModel(sino6, (known, EncoderGain(5, values=(1e-4,))))
    assert cause_of("joint_compliance:2", extended) == known
    plan = planned(extended, PAIR, postures=20)
    typical = planned(sino6, PAIR, postures=20)
    # 4e-5 for the typical 2e-5.
    assert distances(plan.after)[0] == pytest.approx(4 * distances(typical.after)[0], rel=0.02)
    assert [e.label for e in plan.model.effects] == ["joint_compliance:2", "encoder_gain:5"]


def test_a_cause_without_a_size_is_as_large_as_it_looks_in_the_records(sino6):
    existing = simulate_measurements(sino6, "free", 30, rng=np.random.default_rng(3))
    found = JointCompliance(2, values=(1e-6,))
    plan = planned(sino6, (found, "encoder_eccentricity:2"), existing=existing)
    assert plan.before is not None
    # Ten times smaller than typical, the compliance is mimicked by no eccentricity of typical size.
    assert plan.before.separation.alone[1] < 1.01 * plan.before.separation.alone[0]


def test_postures_are_inside_the_limits_readable_and_those_of_the_seed(sino6):
    plan, same, other = (planned(sino6, PAIR, seed=s) for s in (1, 1, 2))
    q = plan.records.filter(like="theta").to_numpy()
    bounds = joint_bounds(sino6) / DEG
    assert ((q >= bounds[:, 0] - 1e-6) & (q <= bounds[:, 1] + 1e-6)).all()
    inside = np.abs(q * 10 - np.round(q * 10)) < 1e-6
    assert inside.mean() > 0.98  # all but those that a limit cut
    assert Room(sino6).admits(plan.expected).all()
    close(plan.expected, sino6.positions(q * DEG), 1e-7)
    assert len(np.unique(q, axis=0)) == len(q)
    assert plan.csv() == same.csv() != other.csv()
    assert (plan.seed, other.seed) == (1, 2)


# --- all causes


def test_a_plan_for_everything(sino6, zero6):
    plan = planned(sino6, None, 30, postures=400)
    assert plan.pairs is not None
    assert not plan.asked
    table = plan.pairs.set_index(["cause", "other"])
    assert table.loc[("bearing_tilt:1", "base_compliance"), "why_not"] == "the same"
    told = table.loc[("encoder_eccentricity:2", "joint_compliance:2")]
    split = (EncoderEccentricity(2), JointCompliance(2))
    assert told["T"] == pytest.approx(min(brute(plan, sino6, split)), rel=EXACT)
    assert told["told"]
    open_ = plan.pairs[plan.pairs["why_not"] == ""]
    worst = open_.iloc[0]
    assert {effect.label for effect in plan.split} == {worst["cause"], worst["other"]}
    # Thirty random records leave the worst of the hardest pairs worse told.
    model = ErrorModel(sino6)
    hardest = [
        (cause_of(row.cause, model), cause_of(row.other, model))
        for row in open_.head(8).itertuples()
    ]
    by_chance = []
    for seed in range(5):
        q, _ = Room(sino6).postures(30, np.random.default_rng(seed))
        rng = np.random.default_rng(seed)
        conditions = Conditions(
            30,
            temperature=20.0 + 4 * rng.integers(2, size=30),
            approach=rng.choice([-1.0, 1.0], (30, 6)),
        )
        random = replace(plan, measurements=Measurements.of(q, conditions=conditions))
        by_chance.append(min(min(brute(random, sino6, pair)) for pair in hardest))
    assert worst["T"] > 1.5 * np.median(by_chance)
    without_masses = planned(zero6, None, 20)
    assert without_masses.pairs is not None
    assert not without_masses.pairs["cause"].str.contains("compliance").any()


# --- what cannot be


def test_what_cannot_be_is_refused(sino6, zero6):
    for one, other, said in (
        ("foo:1", "base_compliance", "unknown cause 'foo'"),
        ("encoder_slip:3", "base_compliance", "time_s"),
        ("link_length:3", "base_compliance", "link_length:3"),
        ("seat_error:S1", "base_compliance", "only at this seat"),
    ):
        with pytest.raises(AacmmError, match=said):
            planned(sino6, (one, other))
    rigid = changed("sino6", {4: RIGID})
    warm = ErrorModel(sino6, (ThermalExpansion(values=(2e-5,)),))
    q, tips = Room(sino6).postures(5, np.random.default_rng(1))
    cases: list[tuple[type[AacmmError], str, Any, Any, dict[str, Any]]] = [
        (AacmmError, "row 4 of SINO6 is rigid", rigid, ("encoder_gain:4", "base_compliance"), {}),
        (
            UnsupportedArmError,
            "the arm states no masses",
            zero6,
            ("joint_compliance:2", "encoder_gain:2"),
            {},
        ),
        (
            AacmmError,
            "postures is 5; expected at least 20",
            sino6,
            PAIR,
            {"postures": 5},
        ),
        (MissingConditionError, "temperature", warm, PAIR, {"existing": Measurements.of(q, tips)}),
        (AacmmError, "5 joints; expected 6", sino6, PAIR, {"existing": Measurements.of(q[:, :5])}),
    ]
    for error, said, arm, split, options in cases:
        with pytest.raises(error, match=said):
            planned(arm, split, **options)


@pytest.mark.parametrize("degrees", [0.0, 10.0])
def test_measured_torques_are_expected_to_hold_the_weight(sino6, degrees):
    """On the mount of the last existing record."""
    q, tips = Room(sino6).postures(20, np.random.default_rng(1))
    conditions = Conditions(20, torque=np.ones((20, 6)))
    if degrees:
        conditions = replace(conditions, tilt_x=np.linspace(0.0, degrees * DEG, 20))
    existing = Measurements.of(q, tips, conditions=conditions)
    plan = planned(sino6, PAIR, existing=existing)
    assert isinstance(plan.split[0], JointCompliance)
    assert plan.split[0].torque == "measured"
    new = plan.measurements
    by_torque, by_weight = (
        columns(sino6, new, JointCompliance(2, torque=t)) for t in ("measured", "gravity")
    )  # type: ignore[arg-type]
    close(by_torque, by_weight, 1e-9)
    assert plan.records.filter(like="torque").isna().all(axis=None)  # to be measured
    if degrees:
        close(plan.records["tilt_x_deg"].to_numpy(), np.full(new.n, degrees), 1e-12)
    assert data_of(plan.notes, "record_torques")


def test_more_that_is_unknown_leaves_less_to_tell(sino6):
    # Every posture is taken: the same records.
    fixed: dict[str, Any] = {"as_it_stands": True, "postures": 20}
    more = planned(sino6, PAIR, **fixed)
    unknown: list[dict[str, Any]] = [
        {"prior": False},
        {"target": "unknown"},
        {"reference_frame": "external"},
    ]
    for options in unknown:
        less = planned(sino6, PAIR, **fixed, **options)
        for t_less, t_more in zip(distances(less.after), distances(more.after), strict=True):
            assert t_less < 0.999 * t_more


def test_plans_carry_the_columns_of_existing_records_and_say_when_none_are_needed(sino6):
    q, tips = Room(sino6).postures(150, np.random.default_rng(1))
    clock, u = Conditions(150, time=60.0 * np.arange(150)), np.full((150, 3), U_REFERENCE)
    existing = Measurements.of(q, tips, u, conditions=clock, operator=["x"] * 150)
    split = (JointCompliance(2, values=(4e-5,)), EncoderEccentricity(2, values=(4e-4, 0.0)))
    plan = planned(sino6, split, 5, existing=existing, postures=20)
    assert list(plan.records) == list(existing.to_frame())
    assert plan.records["u_x_mm"].tolist() == pytest.approx([U_REFERENCE * 1e3] * 5)
    assert plan.records["operator"].isna().all()
    assert plan.records["time_s"].min() > 60.0 * 149
    assert not plan.needed
    assert "150" in str(plan)


def test_a_bar_ties_the_distance_of_its_ends(sino6, rng):
    """Half a bar's length by each end: nothing for ends that move together or across the bar."""
    records = simulate_measurements(sino6, "ball-bar", 40, seats=2, bar_length=0.5, rng=rng)
    setup = Setup.of(sino6, length_noise=2e-5)
    problem = problem_of(ErrorModel.of(sino6), records, ["geometry"], setup)
    seats = records.seats()
    _, ties = whitened_rows(problem, problem.scales, [*seats], Frame.identity(0))
    (tie,) = ties
    assert not tie[: problem.scales.size].any()
    one, other = tie[problem.scales.size :].reshape(2, 3) * 2e-5
    close(one, -other, 1e-12)
    ends = [sino6.positions(records.q[rows]).mean(axis=0) for rows in seats.values()]
    along = (ends[0] - ends[1]) / np.linalg.norm(ends[0] - ends[1])
    assert abs(one @ along) == pytest.approx(1.0, abs=1e-3)
