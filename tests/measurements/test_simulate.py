"""Virtual measurements, checked by kinematics written out here, by statistics at fixed seeds, and
by reading them back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import MARGIN
from aacmm_pin.effects import (
    ErrorModel,
    JointHysteresis,
    ReferenceFrame,
    SeatError,
    StylusOffset,
)
from aacmm_pin.errors import (
    AacmmError,
    MissingConditionError,
    UnknownNameError,
)
from aacmm_pin.measurements import simulation as workshop
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulation import simulate_measurements
from tests.arm_files import changed, serial_urdf
from tests.oracle import close

pytestmark = pytest.mark.fast

PLANS: list[dict[str, Any]] = [
    {"scheme": "free"},
    {"scheme": "seats"},
    {"scheme": "seats", "known": False},
    {"scheme": "ball-bar", "bar_length": 0.4},
    {"scheme": "single-point"},
]
ARMS = ["sino6", "zero6", "ur5", "panda"]


def quiet(**u: float) -> dict[str, float]:
    return {f"{what}_noise": u.get(what, 0.0) for what in ("encoder", "reference", "probe")}


def simulated(
    model: Arm | ErrorModel, records: int = 300, seed: int = 1, **options: Any
) -> Measurements:
    return simulate_measurements(
        model, options.pop("scheme"), records, rng=np.random.default_rng(seed), **options
    )


@pytest.fixture(params=ARMS)
def arm(request, robot_file) -> Arm:
    if request.param == "ur5":
        return Arm.from_urdf("ur5")
    if request.param == "panda":
        return Arm.from_urdf(robot_file("panda.urdf"), "panda_hand")
    return Arm.load(request.param)


def tips_of(arm: Arm, q: Array) -> Array:
    """Kinematics that the simulation does not use: the closed form of the table, or Pinocchio."""
    if arm.dh is not None:
        return arm.dh.chain.positions(q)
    data, frame = arm.model.createData(), arm.model.getFrameId(arm.tip, pin.FrameType.BODY)
    tips = []
    for row in q:
        pin.framesForwardKinematics(arm.model, data, row)
        tips.append(data.oMf[frame].translation.copy())
    return np.array(tips)


def consistent(whitened: Array) -> bool:
    """Whether the numbers are standard normal, as far as the sum of their squares tells; wrong once
    in 10 000.
    """
    return bool(1e-4 < chi2.cdf(np.square(whitened).sum(), whitened.size) < 1 - 1e-4)


def directions(q: Array) -> Array:
    return np.concatenate([np.cos(q), np.sin(q)], axis=1)


# --- the points


@pytest.mark.parametrize("options", PLANS, ids=lambda o: "-".join(map(str, o.values())))
def test_tips_are_where_the_plan_says_and_postures_differ(arm, options):
    """At the references, or of each unknown seat at one point; inside the limits, and away from
    where the arm is stuck.
    """
    measurements = simulated(arm, **quiet(), **options)
    q, tips, seats, known = (
        measurements.q,
        tips_of(arm, measurements.q),
        measurements.seats(),
        measurements.known,
    )
    free, stated = (
        options["scheme"] == "free",
        options["scheme"] in ("free", "seats") and options.get("known", True),
    )
    assert known.all() if stated else not known.any()
    close(tips[known], measurements.reference[known], 1e-12 if free else 1e-9)
    assert all(np.ptp(tips[rows], axis=0).max() < 1e-9 for rows in seats.values())
    assert len(seats) == {"free": 0, "single-point": 1}.get(options["scheme"], 10)
    assert np.isnan(measurements.reference_u).all()
    assert (q > arm.limits[:, 0] + MARGIN).all()
    assert (q < arm.limits[:, 1] - MARGIN).all()
    apart = np.linalg.norm(directions(q)[:, None] - directions(q), axis=2)
    assert apart[~np.eye(len(q), dtype=bool)].min() > 0.01
    easiness = np.linalg.svd(arm.jacobian(q), compute_uv=False)
    assert free or (easiness[:, 2] > 0.01 * easiness[:, 0]).all()
    for bar in measurements.bars():
        a, b = tips[seats[bar.seat_a]], tips[seats[bar.seat_b]]
        assert (bar.length, bar.seat_a, bar.seat_b) == (0.4, f"{bar.bar}A", f"{bar.bar}B")
        close(np.linalg.norm(a[:, None] - b, axis=2), 0.4, 1e-9)


def test_errors_of_references_act_where_these_are_stated(sino6):
    shift = np.array([1e-4, -2e-4, 3e-4])
    model = ErrorModel(sino6).with_effects(SeatError(seat="S3", values=tuple(shift)))
    measurements = simulated(model, scheme="seats", **quiet())
    # True place = stated place + e.
    off = sino6.dh.chain.positions(measurements.q) - measurements.reference
    third = measurements.conditions.seat == "S3"
    close(off[third], np.broadcast_to(shift, (30, 3)), 1e-9)
    close(off[~third], 0.0, 1e-9)

    turned = ErrorModel(sino6).with_effects(ReferenceFrame(values=(0.5, 0.1, -0.2, 0.0, 0.0, 0.3)))
    measurements = simulated(turned, scheme="free", **quiet())
    motion = pin.exp6(np.array([0.5, 0.1, -0.2, 0.0, 0.0, 0.3]))
    expected = sino6.dh.chain.positions(measurements.q) @ motion.rotation.T + motion.translation
    close(measurements.reference, expected, 1e-12)
    unknown = simulated(turned, scheme="single-point", **quiet())
    assert np.ptp(sino6.dh.chain.positions(unknown.q), axis=0).max() < 1e-9


# --- the postures


def test_postures_go_all_round_the_point(sino6):
    """Whatever posture another solver finds at the point, one like it is there: 300 in three
    dimensions of freedom.
    """
    q = simulated(sino6, scheme="single-point", **quiet()).q
    point, lower, upper = sino6.dh.chain.positions(q)[0], sino6.limits[:, 0], sino6.limits[:, 1]
    rng, found = np.random.default_rng(5), 0
    for _ in range(40):
        solution = least_squares(
            lambda x: sino6.dh.chain.positions(x[None])[0] - point,
            rng.uniform(lower, upper),
            jac=lambda x: sino6.jacobian(x[None])[0],
            bounds=(lower, upper),
        )
        if solution.cost < 1e-18:
            found += 1
            assert np.linalg.norm(directions(q) - directions(solution.x[None]), axis=1).min() < 1.0
    assert found >= 2


def test_seats_are_apart_and_clear_of_the_stand_and_the_table(sino6):
    measurements = simulated(sino6, scheme="seats", **quiet(), seats=20, above=0.1)
    points = np.array([measurements.reference[rows[0]] for rows in measurements.seats().values()])
    apart = np.linalg.norm(points[:, None] - points, axis=2)[~np.eye(20, dtype=bool)]
    assert apart.min() >= 0.05
    assert apart.max() > 0.7
    assert np.hypot(points[:, 0], points[:, 1]).min() >= 0.1
    assert points[:, 2].min() >= 0.1
    free = simulated(sino6, scheme="free", **quiet(), above=0.1).reference
    assert free[:, 2].min() >= 0.1
    assert np.hypot(free[:, 0], free[:, 1]).min() >= 0.1


def test_joints_may_slide_or_turn_without_end(tmp_path):
    path = tmp_path / "made.urdf"
    turning = [("revolute", "0 0 1", "0.3 0 0", -1e4, 1e4)] * 3
    path.write_text(serial_urdf([("prismatic", "0 0 1", "0 0 0", 0.0, 0.5), *turning], "0.3 0 0"))
    arm = Arm.from_urdf(path, "tip")
    measurements = simulated(arm, scheme="seats", records=40, seats=4, **quiet())
    close(tips_of(arm, measurements.q), measurements.reference, 1e-9)
    assert np.abs(measurements.q[:, 1:]).max() <= np.pi
    assert 0.0 < measurements.q[:, 0].min() < measurements.q[:, 0].max() < 0.5


# --- the noise


def test_encoder_noise(sino6):
    u = np.array([5e-6, 1e-5, 0.0, 2e-5, 8e-6, 4e-5])
    exact, noisy = (simulated(sino6, scheme="seats", **quiet(encoder=e)) for e in (0.0, u))  # type: ignore[arg-type]
    off, some = noisy.q - exact.q, u > 0
    assert consistent(off[:, some] / u[some])
    assert (off[:, ~some] == 0).all()


def test_reference_noise(sino6):
    options: dict[str, Any] = {"scheme": "seats", "seats": 30}
    exact, noisy = (simulated(sino6, **quiet(reference=u), **options) for u in (0.0, 2e-5))
    off = noisy.reference - exact.reference
    seats = list(noisy.seats().values())
    assert all((off[rows] == off[rows[0]]).all() for rows in seats)  # one draw a seat
    assert consistent(np.array([off[rows[0]] for rows in seats]) / 2e-5)
    np.testing.assert_array_equal(noisy.reference_u, np.full((300, 3), 2e-5))
    np.testing.assert_array_equal(noisy.q, exact.q)

    exact, noisy = (simulated(sino6, scheme="free", **quiet(reference=u)) for u in (0.0, 2e-5))
    assert consistent((noisy.reference - exact.reference) / 2e-5)


def test_noise_that_nobody_stated(sino6, zero6):
    measurements = simulated(sino6, scheme="free")
    assert (
        measurements.source
        == "simulated SINO6, scheme free, seed 1, encoder noise 8 µrad (assumed)"
    )
    assert (measurements.reference_u == 1.2e-5).all()
    exact = simulated(sino6, scheme="free", **quiet())
    assert consistent((measurements.q - exact.q) / 8e-6)
    stated = simulated(changed("sino6", {0: {"encoder_noise_rad": 3e-6}}), scheme="free")
    assert "assumed" not in stated.source
    assert consistent((stated.q - exact.q) / 3e-6)


# --- the workshop


def test_conditions_are_those_of_a_workshop(sino6):
    known = simulated(sino6, scheme="seats", records=600).conditions
    steps = np.diff(known.time)
    assert known.time[0] >= 20.0
    assert steps.min() >= 20.0
    ordinary = steps <= 40.0
    assert ordinary.mean() > 0.9
    assert (steps[~ordinary] >= 200.0).all()  # pauses, and breaks between sessions
    assert (steps > 3600.0).sum() == 2
    assert np.abs(known.temperature - 20.0).max() <= 3.0
    assert np.ptp(known.temperature) > 0.5
    assert set(np.unique(known.approach)) == {-1.0, 1.0}
    assert list(dict.fromkeys(known.session)) == ["1", "2", "3"]
    assert all(
        set(known.seat[known.session == s]) == {f"S{k}" for k in range(1, 11)} for s in "123"
    )  # type: ignore[index]
    one = simulated(sino6, scheme="seats", records=150).conditions
    assert one.session is None
    assert (one.seat[1:] != one.seat[:-1]).sum() == 9  # each seat in one visit


def test_joints_come_from_where_they_were(sino6):
    measurements = simulated(sino6, scheme="free", records=2000, **quiet())
    assert measurements.conditions.approach is not None
    same = np.sign(np.diff(measurements.q, axis=0)) == measurements.conditions.approach[1:]
    assert same.mean() == pytest.approx(1 - workshop.OVERSHOOT, abs=0.02)


@pytest.mark.parametrize("options", [PLANS[0], PLANS[3]], ids=["free", "ball-bar"])
def test_a_seed_is_a_data_set_that_a_file_holds(sino6, tmp_path, options):
    first, again, other = (simulated(sino6, records=60, seed=seed, **options) for seed in (7, 7, 8))
    assert first.to_frame().equals(again.to_frame())
    assert not first.to_frame().equals(other.to_frame())
    assert "seed 7" in first.source
    first.save(tmp_path / "data.csv")
    read = Measurements.read(tmp_path / "data.csv", 6)
    close(read.q, first.q, 1e-14)
    close(read.reference, first.reference, 1e-15)
    assert read.to_frame()["record"].tolist() == [str(k) for k in range(1, 61)]


# --- what cannot be done


REFUSED: list[tuple[dict[str, Any], str]] = [
    (
        {"scheme": "seat"},
        "unknown scheme 'seat'; expected one of free, seats, ball-bar, single-point",
    ),
    ({"scheme": "seats", "records": 19, "known": False}, "records is 19; expected at least 20"),
    ({"scheme": "single-point", "records": 1}, "records is 1; expected at least 2"),
    ({"scheme": "ball-bar", "seats": 5, "bar_length": 0.4}, "seats is 5; expected an even number"),
    ({"scheme": "ball-bar"}, "bar_length"),
    (
        {"scheme": "seats", "bar_length": 0.4},
        "0.4; expected a length",
    ),
    ({"scheme": "ball-bar", "bar_length": 5.0}, "0 bars of 5000 mm; expected 5"),
    ({"scheme": "free", "above": 2.0}, "SINO6: 0 of 6000 random postures .* 2000 mm"),
]


def test_a_plan_that_cannot_be_carried_out(sino6):
    for options, said in REFUSED:
        with pytest.raises(AacmmError, match=said):
            simulated(sino6, **options)


def test_seats_and_effects_that_no_posture_admits(sino6, tmp_path):
    """Two joints reach a point in two postures; with narrow limits there is room for few seats."""
    path = tmp_path / "two.urdf"
    for limit, seats, said in ((3.0, 2, r"0 seats .*at most 2"), (0.1, 10, "room for [23] seats")):
        joint = ("revolute", "0 0 1", "0.3 0 0", -limit, limit)
        path.write_text(serial_urdf([joint, joint], "0.3 0 0"))
        with pytest.raises(AacmmError, match=said):
            simulated(Arm.from_urdf(path, "tip"), scheme="seats", records=20, seats=seats)
    steps = [JointHysteresis(joint=j, values=(0.8,)) for j in range(1, 7)]
    with pytest.raises(AacmmError, match=r"[0-9]+ of [0-9]+ records .*joint_hysteresis:1, "):
        simulated(ErrorModel(sino6).with_effects(*steps), scheme="seats")


def test_an_effect_that_has_nothing_to_act_on(sino6):
    model = ErrorModel(sino6)
    with pytest.raises(
        UnknownNameError, match="unknown seat 'S11' of seat_error; expected one of S1, S2"
    ):
        simulated(
            model.with_effects(SeatError(seat="S11", values=(1e-4, 0.0, 0.0))), scheme="seats"
        )
    with pytest.raises(MissingConditionError, match=r"seat_error:S1: .*the column .seat"):
        simulated(model.with_effects(SeatError(seat="S1", values=(1e-4, 0.0, 0.0))), scheme="free")
    with pytest.raises(MissingConditionError, match=r"the column .marker"):
        simulated(
            model.with_effects(StylusOffset(marker="T1", values=(0.1, 0.0, 0.0))), scheme="seats"
        )
