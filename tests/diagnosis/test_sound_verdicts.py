"""What a verdict may be trusted with: priors, nonlinear parameters, structure, known causes, trials
that fail.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import accuracy_volume, perturbed_model
from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm, axis
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration import Fit, Setup, calibrate, solver
from aacmm_pin.calibration.linearisation import Point
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.diagnosis import THRESHOLDS, BudgetPart, Diagnosis, Finding, diagnose
from aacmm_pin.diagnosis.held_out_gain import Brought
from aacmm_pin.diagnosis.verdict import DOUBTS, verdict_of
from aacmm_pin.effects import (
    BaseCompliance,
    BearingTilt,
    Conditions,
    Displacement,
    Effect,
    EncoderEccentricity,
    EncoderGain,
    EncoderSlip,
    ErrorModel,
    JointCompliance,
    JointPeriodicError,
    LinkBending,
    State,
    StylusOffset,
    Term,
    ZeroDrift,
    in_words,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.report.verdicts import verdict_in_words
from tests.again import again
from tests.arm_files import changed
from tests.cli import shell
from tests.few_causes import FEW, NO_WAVES
from tests.notes import data_of
from tests.oracle import jacobian_of

NOISE = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}


def drawn(model: Arm | ErrorModel, records: int, seed: int) -> Measurements:
    """Records of an arm at points anywhere, with the noise that ``diagnosed`` states."""
    rng = np.random.default_rng(seed)
    return simulate_measurements(model, "free", records, rng=rng, **NOISE)


def diagnosed(model: Arm | ErrorModel, data: Measurements) -> Diagnosis:
    return diagnose(model, data, hold_out=False, **NOISE)


def test_calibrating_twice_is_calibrating_with_all_records(sino6, rng):
    data = simulate_measurements(ErrorModel(sino6), "free", 160, rng=rng)
    first, second = data.take(slice(0, 80)), data.take(slice(80, 160))

    def calibrated(model: Arm | ErrorModel, records: Measurements) -> tuple[Array, Array]:
        result = calibrate(model, records, hold_out=False, robust=False, **NOISE)
        table = result.parameters.set_index("parameter")
        return table["after"].to_numpy(), table["u"].to_numpy()

    once = calibrate(sino6, first, hold_out=False, robust=False, **NOISE).model
    (values, u), (both, wanted) = calibrated(once, second), calibrated(sino6, data)
    np.testing.assert_allclose(u, wanted, rtol=0.01)
    assert (np.abs(values - both) < 0.05 * wanted).all()


@FEW
@pytest.mark.parametrize("seed", [5, again(6), again(7)])
def test_a_warm_up_that_is_not_over_is_as_uncertain_as_its_evidence_says(sino6, seed):
    """Records over one time constant, which may be much longer than it seems: no error beyond 3.5
    u, and u is told.
    """
    drift, rng = ZeroDrift(1, 1200.0, values=(4e-4,)), np.random.default_rng(seed)
    q = rng.uniform(*sino6.limits.T, (40, 6))
    known = Conditions(40, time=np.cumsum(rng.uniform(15.0, 45.0, 40)))
    tips = ErrorModel(sino6, (drift,)).predict(q, known) + 12e-6 * rng.normal(size=(40, 3))
    data = Measurements.of(q - 8e-6 * rng.normal(size=q.shape), tips, conditions=known)
    (finding,) = diagnosed(sino6, data).findings
    assert finding.label == drift.label
    assert finding.inner["time_constant_s"][1] > 0.0
    value, u = finding.parameters["drift_rad"]
    assert abs(value - 4e-4) < 3.5 * u


def test_a_trial_that_cannot_be_evaluated_is_a_rejected_step(sino6, rng, monkeypatch):
    data = simulate_measurements(
        ErrorModel(sino6, (EncoderGain(3, values=(1e-4,)),)), "free", 60, rng=rng
    )
    fit = calibrate(sino6, data, ["geometry", EncoderGain(3)], hold_out=False, **NOISE).fit
    predict, refused = Problem.predict, []

    def narrow(self: Problem, x: Array, *rest: object) -> object:
        if np.abs(x - fit.point.x).max() > 3e-4 and np.any(x != self.start):
            refused.append(x)
            raise AacmmError("too soft to stand")
        return predict(self, x, *rest)

    monkeypatch.setattr(Problem, "predict", narrow)
    x = fit.problem.start + np.where(np.arange(fit.problem.start.size) == 0, 2.9e-4, 0.0)
    prediction = predict(fit.problem, x, fit.point.frame)
    start = Point(x, fit.point.frame, fit.point.seats, prediction)
    found = solver.solve(fit.problem, fit.noise, start, fit.used.astype(float))
    assert found.converged
    assert found.system.cost == pytest.approx(fit.system.cost, rel=1e-6)


@dataclass(frozen=True)
class SquareTilt(Effect):
    """A bearing that tilts with the square of its moment, which no cause of the library does."""

    joint: int
    cause = "square_tilt"
    elastic = True

    @property
    def terms(self) -> tuple[Term, ...]:
        return (Term("", "rad/(N·m)²", 1e-6, "square_rad_per_nm2"),)

    def displacements(self, state: State) -> list[Displacement]:
        place, moment = axis(self.joint), state.moment_at_axis(self.joint)
        across = np.einsum("nji,nj->ni", state.rotation[place], moment)
        across[:, 2] = 0.0
        columns = np.zeros((state.n, 6, 1))
        columns[:, 3:, 0] = across * np.linalg.norm(across, axis=1)[:, None]
        return [Displacement(place, columns)]


@pytest.mark.long
def test_what_no_cause_has_lends_its_strength_to_no_name(sino6):
    model = ErrorModel(sino6, (SquareTilt(3, values=(3e-6,)),))
    data = drawn(model, 100, 3)
    found = diagnosed(sino6, data)
    assert found.verdict in ("unexplained", "partly-explained")
    assert found.findings[0].label == "bearing_tilt:3"
    assert "structure left" in found.doubts


@NO_WAVES
def test_what_is_not_explained_stays_with_the_arm(sino6, tmp_path):
    """Joint 2 turns with the angle of joint 5 too."""
    data = drawn(sino6, 200, 3)
    coupled = data.q.copy()
    coupled[:, 1] -= 1e-4 * np.sin(data.q[:, 1] + data.q[:, 4])
    found = diagnosed(sino6, replace(data, q=coupled))
    assert (found.verdict, found.findings) == ("unexplained", ())
    saved = tmp_path / "extended.toml"
    found.model.save(saved)
    q = data.q[:1]
    assert "depend on joint" in Arm.load(saved).unexplained
    (told,) = data_of(
        accuracy_volume(ErrorModel.load(saved), q).sources.caveats, "unexplained_not_in_u"
    )
    assert "depend on joint" in told["unexplained"]
    # New records that the arm explains take it back; records that scatter beyond their noise do
    # not.
    for noise, left in ((1e-6, False), (2e-4, True)):
        again = simulate_measurements(
            found.model, "free", 60, rng=np.random.default_rng(4), encoder_noise=noise
        )
        done = calibrate(found.model, again, hold_out=False, encoder_noise=1e-6)
        assert (
            "scatter of" in done.model.arm.unexplained,
            "depends" in done.model.arm.unexplained,
        ) == (left, False)


@FEW
@pytest.mark.parametrize(
    ("records", "note"), [again(60, "prior_ignored"), (15, "partly_in_calibration")]
)
def test_part_of_an_unknown_error_is_in_an_earlier_calibration(sino6, records, note):
    """By more than the U of its values; whether its records showed that something was left decides
    how that is told.
    """
    off, amplitude = [], 1e-4
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = ErrorModel(
            perturbed_model(sino6, rng).arm, (EncoderEccentricity(3, values=(amplitude, 0.0)),)
        )
        first, second = (
            simulate_measurements(truth, "free", n, rng=rng, encoder_noise=8e-6)
            for n in (records, 60)
        )
        calibrated = calibrate(sino6, first, hold_out=False, encoder_noise=8e-6)
        if bool(calibrated.model.arm.unexplained) != (note == "prior_ignored"):
            continue
        found = diagnose(calibrated.model, second, hold_out=False, encoder_noise=8e-6)
        assert len(data_of(found.notes, note)) == 1
        value, u = next(
            f.parameters["amplitude_rad"]
            for f in found.findings
            if f.label == "encoder_eccentricity:3"
        )
        off.append((value - amplitude) / u)
    assert off
    if note == "prior_ignored":
        assert np.sqrt(np.mean(np.square(off))) < 1.5
        again = calibrate(calibrated.model, second, hold_out=False, encoder_noise=8e-6)
        assert len(data_of(again.notes, "prior_left_unexplained")) == 1


@pytest.mark.long
def test_two_names_that_take_turns_do_not_cancel(tmp_path):
    """Beside the values of a periodic error the records are for an error curve, and the other way
    round.
    """
    effects = (
        "--cause encoder_eccentricity:4,amplitude_rad=4e-5,phase_rad=1.0 "
        "--cause encoder_ellipticity:4,amplitude_rad=8e-5,phase_rad=2.0 "
        "--cause joint_periodic_error:4,order=3,amplitude_rad=3e-5,phase_rad=0.5"
    )
    data, noise = tmp_path / "data.csv", "--encoder-noise 8e-6 --u-reference-mm 0.02"
    plan = f"--scheme free --records 100 --random-geometry --seed 8 {noise} {effects}"
    shell.done(f"simulate sino6 {plan} -o {data}")
    found = shell.found(f"diagnose sino6 {data} {noise} --no-cross-validation")
    assert found["verdict"] != "no-discrepancy"
    assert {finding["joint"] for finding in found["findings"]} == {4}
    assert found["rms_mm"]["extended"] < 1.05 * found["rms_mm"]["noise"]


def finding(probability: float, low: float | None = 0.1, effect: Effect | None = None) -> Finding:
    brought = None if low is None else Brought(0.2, low, 0.3)
    return Finding(effect or EncoderEccentricity(3), {}, probability, 1e-6, 0.5, (), brought)


def test_verdicts(sino6, rng):
    data = simulate_measurements(ErrorModel(sino6), "free", 40, rng=rng)
    fit = calibrate(sino6, data, hold_out=False, **NOISE).fit
    stuck = replace(fit, message="60 steps were not enough")
    without_noise = replace(fit.problem, setup=Setup())
    noiseless = replace(fit, problem=without_noise, weights=np.zeros(40))
    out = np.arange(40)
    seven, six = (replace(fit, weights=(out >= count).astype(float)) for count in (7, 6))
    sure, below_zero = [finding(0.99)], JointCompliance(2, values=(-1e-6,), u=(1e-6,))
    far_below = replace(below_zero, values=(-3e-6,))
    cases = [
        ("explained", sure, {}),
        ("inconclusive", sure, {"unexplained": left(left=True)}),
        ("inconclusive", [], {"unexplained": left(left=True)}),
        ("ambiguous", sure, {"more": 0.6}),
        ("ambiguous", [], {"more": 0.6}),
        ("explained", sure, {"more": 0.4}),
        ("explained", [finding(0.99, None)], {}),
        ("inconclusive", [finding(0.99, -0.01)], {}),
        ("explained", [finding(0.99, effect=below_zero)], {}),
        ("inconclusive", [finding(0.99, effect=far_below)], {}),
        ("ambiguous", [finding(0.7)], {}),
        ("unexplained", sure, {"unexplained": left(structure=True)}),
        ("no-discrepancy", [], {}),
        ("inconclusive", [], {"visible": (40, 100)}),
        ("inconclusive", sure, {"extended": stuck}),
        ("inconclusive", [], {"extended": noiseless}),
        ("inconclusive", sure, {"extended": seven}),
        ("unexplained", [], {"unexplained": left(structure=True), "extended": seven}),
        ("explained", sure, {"extended": six}),
        ("inconclusive", sure, {"contradicted": ("seat A moved",)}),
        ("inconclusive", sure, {"no_better": True}),
        ("inconclusive", sure, {"agree": False}),
    ]
    for verdict, findings, other in cases:
        assert judged_of(fit, findings, **other) == verdict, other


def left(structure: bool = False, left: bool = False) -> SimpleNamespace:
    return SimpleNamespace(structure=structure, left=left)


def judged_of(fit: Fit, findings: list[Finding], agree: bool = True, **other: object) -> str:
    """The verdict of a diagnosis that has only what verdicts are read from."""
    usual = {
        "findings": findings,
        "below_zero": [one for one in findings if one.below_zero],
        "unexplained": left(),
        "more": 0.1,
        "visible": (90, 100),
        "otherwise": (),
        "no_better": False,
        "contradicted": (),
        "choice": SimpleNamespace(posterior=SimpleNamespace(agree=agree)),
        "recalibrated": fit,
        "extended": fit,
        "noise": fit.noise_rms,
        "budget": (BudgetPart("noise", fit.noise_rms**2, 0.0),),
    }
    result: Any = SimpleNamespace(**usual | other)
    result.converged = result.extended.converged
    doubts = [name for name, stands in DOUBTS.items() if stands(result)]
    return verdict_of(result, doubts)


@FEW
def test_a_value_that_nature_does_not_have_explains_nothing(sino6):
    model = ErrorModel(sino6, (JointCompliance(2, values=(-3e-5,)),))
    data = drawn(model, 60, 1)
    found = diagnosed(sino6, data)
    assert "joint_compliance:2" not in [finding.label for finding in found.findings]
    assert found.verdict not in ("explained", "no-discrepancy")


def known_before(sino6: Arm, *new: Effect, value: float = 2e-5, records: int = 60) -> Diagnosis:
    """Of records of an arm that is known to have a compliance of joint 2, with another value or
    with causes besides.
    """
    known = JointCompliance(joint=2, values=(2e-5,), u=(2e-7,))
    truth = ErrorModel(sino6, (known.at((value,)), *new))
    data = drawn(truth, records, 1)
    return diagnosed(ErrorModel(sino6, (known,)), data)


@pytest.mark.parametrize(("orders", "lost"), [((8,), True), again((5, 7), False)])
def test_a_known_cause_with_another_inner_value(sino6, orders, lost):
    """A periodic error that was of order 7 is of another order now, or there are two."""
    known = JointPeriodicError(joint=3, order=7, values=(1e-4, 0.0), u=(3e-6, 3e-6))
    truth = ErrorModel(
        sino6, tuple(JointPeriodicError(joint=3, order=k, values=(1e-4, 0.0)) for k in orders)
    )
    data = drawn(truth, 80, 2)
    found = diagnosed(ErrorModel(sino6, (known,)), data)
    (finding,) = found.findings
    assert (found.verdict, finding.label) == ("explained", known.label)
    assert (finding.effect.order, finding.was) == (orders[0], known if lost else None)
    assert sorted(e.order for e in found.model.effects) == sorted(orders)


@FEW
@pytest.mark.parametrize(
    ("before", "after", "drift"), [(3600.0, 1200.0, 2e-4), again(1200.0, 1200.0, 1e-4)]
)
def test_a_known_warm_up_that_is_quicker_or_smaller(sino6, before, after, drift):
    """The new one stands in the place of the known one, which looks much like it, and not beside
    it.
    """
    known = ZeroDrift(joint=3, time_constant_s=before, values=(2e-4,), u=(3e-6,))
    truth = ErrorModel(sino6, (ZeroDrift(joint=3, time_constant_s=after, values=(drift,)),))
    data = drawn(truth, 300, 10)
    found = diagnosed(ErrorModel(sino6, (known,)), data)
    (finding,), (effect,) = found.findings, found.model.effects
    assert (found.verdict, finding.was, finding.gone) == ("explained", known, False)
    assert abs(effect.values[0] - drift) < 3.3 * effect.u[0] < 5e-5
    assert (
        abs(effect.time_constant_s - after)
        < 3.3 * finding.inner.get("time_constant_s", (after, 1.0))[1]
    )


LOADED = (
    JointCompliance(2, values=(2e-5,), u=(1.5e-7,)),
    JointCompliance(2, load_at=6, values=(1.2e-4,), u=(2e-6,)),
)
WAVES = tuple(
    JointPeriodicError(4, order=n, values=(9e-5, 4e-5), u=(2e-6, 2e-6)) for n in (5.0, 8.0)
)


@pytest.mark.long
@pytest.mark.parametrize(
    ("known", "now", "changed"),
    [
        (LOADED, [4e-5], {"compliance_rad_per_nm": 4e-5, "load_rad_per_m": 0.0}),
        (LOADED[1:], [2e-5], {"compliance_rad_per_nm": 2e-5, "load_rad_per_m": 0.0}),
        (WAVES, [], {"amplitude_rad": 0.0}),
        (WAVES, [2e-4], {"amplitude_rad": np.hypot(2e-4, 4e-5)}),
    ],
)
def test_known_causes_of_one_kind_and_place(sino6, known, now, changed):
    """What is stated of each counts: without that, a refit would hide that they are other than they
    were.
    """
    first = replace(known[0], load_at=None) if isinstance(known[0], JointCompliance) else known[0]
    truth = [first.at((*now, *known[0].values[1:]))] if now else []
    truth += [known[1].at(known[1].values)] if known is WAVES and now else []
    data = drawn(ErrorModel(sino6, tuple(truth)), 200, 3)
    found = diagnosed(ErrorModel(sino6, known), data)
    assert found.verdict == "explained"
    assert len(found.findings) == (1 if known is WAVES and now else 2)
    for finding in found.findings:
        for key, (value, u) in finding.parameters.items():
            assert key not in changed or finding.gone or abs(value - changed[key]) < 3.3 * u


@pytest.mark.long
def test_a_known_slip_that_has_grown_is_no_second_one(sino6):
    known = EncoderSlip(joint=5, time_s=5000.0, values=(2.2e-4,), u=(6.6e-6,))
    truth = ErrorModel(sino6, (replace(known, values=(4.8e-4,), u=()),))
    data = drawn(truth, 150, 1)
    found = diagnose(ErrorModel(sino6, (known,)), data, **NOISE)
    (finding,) = found.findings
    assert found.held_out.interval[0] > 0.0
    assert (found.verdict, finding.was, finding.effect.identity) == (
        "explained",
        known,
        known.identity,
    )
    assert abs(finding.effect.values[0] - 4.8e-4) < 3.3 * finding.effect.u[0] < 1.1e-4


@FEW
@pytest.mark.parametrize(
    ("constant", "amplitude"), [(1500.0, 2.5e-4), again(5e4, 1.2e-3), again(2e4, 4e-3)]
)
def test_a_drift_that_records_show_as_a_slope_may_stop_or_go_on(
    sino6, constant, amplitude, tmp_path
):
    """Records of an hour: what comes later is told where they last for longer than the time
    constant, and open elsewhere.
    """
    truth = ErrorModel(sino6, (ZeroDrift(joint=3, time_constant_s=constant, values=(amplitude,)),))
    rng = np.random.default_rng(7)
    q = random_postures(sino6, 200, rng)
    conditions = Conditions(200, time=np.sort(rng.uniform(0.0, 3600.0, 200)))
    measured = truth.predict(q, conditions) + rng.normal(0.0, 5e-6, (200, 3))
    data = Measurements.of(q + rng.normal(0.0, 3e-6, q.shape), measured, conditions=conditions)
    found = diagnose(
        ErrorModel(sino6),
        data,
        encoder_noise=3e-6,
        reference_noise=5e-6,
        hold_out=False,
    )
    found.model.save(tmp_path / "extended.toml")
    model = ErrorModel.load(tmp_path / "extended.toml")
    (drift,) = (effect for effect in model.effects if isinstance(effect, ZeroDrift))
    told = constant < 3600.0
    assert (drift.until_s is None) == told
    assert told == (not data_of(found.notes, "drift_slope"))
    for later in (2e4, 8e4):
        conditions = Conditions(50, time=np.full(50, later))
        off = np.linalg.norm(
            model.correct(q[:50], conditions) - truth.correct(q[:50], conditions), axis=1
        )
        u = accuracy_volume(
            model, q[:50], conditions=conditions, method="ellipsoid", encoder_noise=0.0
        ).u
        assert np.sqrt(np.mean((off / u) ** 2)) < 2.0
        assert bool(model.input_warnings(q[:50], conditions)) != told


@FEW
def test_a_known_slip_beside_a_clock_that_stands(sino6):
    """All records are of one time, behind the slip."""
    known = ErrorModel(sino6, (EncoderSlip(joint=4, time_s=3000.0, values=(3e-4,), u=(5e-6,)),))
    rng, conditions = np.random.default_rng(5), Conditions(60, time=np.full(60, 5000.0))
    q = random_postures(sino6, 60, rng)
    data = Measurements.of(
        q, known.predict(q, conditions) + rng.normal(0.0, 1.2e-5, (60, 3)), conditions=conditions
    )
    found = diagnosed(known, data)
    assert not found.findings


@FEW
@pytest.mark.parametrize(("seed", "step"), [again(0, 2.5e-4), (2, 4e-5)])
def test_readings_between_the_records_around_a_slip_have_its_step_in_their_u(
    sino6, seed, step, tmp_path
):
    """Which of the two they are nobody knows: u is as large as the error there, and no larger
    elsewhere.
    """
    rng = np.random.default_rng(seed)
    noise = {"encoder_noise": 1e-5, "reference_noise": 5e-6}
    truth = ErrorModel(sino6, (EncoderSlip(joint=3, time_s=3000.0, values=(step,)),))
    data = simulate_measurements(truth, "free", 120, rng=rng, **noise)
    found = diagnose(ErrorModel(sino6), data, **noise, hold_out=False)
    (finding,) = found.findings
    low, high = finding.effect.between_s
    assert low < 3000.0 < high
    found.model.save(tmp_path / "extended.toml")
    model, time = (
        ErrorModel.load(tmp_path / "extended.toml"),
        np.linspace(2 * low - high, 2 * high - low, 301),
    )
    q, conditions = data.q[rng.integers(0, data.n, time.size)], Conditions(time.size, time=time)
    off = np.linalg.norm(model.correct(q, conditions) - truth.correct(q, conditions), axis=1)
    judged = accuracy_volume(model, q, conditions=conditions, method="ellipsoid", encoder_noise=0.0)
    z, between = off / judged.u, (low < time) & (time < high)
    assert 0.7 < np.sqrt(np.mean(z[between] ** 2)) < 1.3
    assert z.max() < 3.0
    assert judged.u[~between].mean() < judged.u[between].mean() / 1.5
    assert [note.data["records"] for note in model.input_warnings(q, conditions)] == [
        (time <= low).sum()
    ]
    later = Conditions(
        time.size, time=time - low, session=np.full(time.size, "next day", dtype=object)
    )
    off = np.linalg.norm(
        model.correct(q, later) - truth.correct(q, replace(later, time=time + 1e4)), axis=1
    )
    assert np.all(
        off
        < 3.0 * accuracy_volume(model, q, conditions=later, method="ellipsoid", encoder_noise=0.0).u
    )
    told = {"records": 301, "of": 301, "cause": "encoder_slip:3", "sessions": ["next day"]}
    assert data_of(model.input_warnings(q, later), "after_slip") == [told]


@FEW
@pytest.mark.parametrize(
    ("new", "left"),
    [again(BearingTilt(joint=2, values=(1e-5,)), 2e-5), (BaseCompliance(values=(2e-5,)), 0.0)],
)
def test_what_moves_the_tip_alike_is_named_as_one_cause(sino6, new, left):
    """A stand that yields as joint 2 did, which no longer does, has the columns of a bearing that
    tilts beside it.
    """
    found = known_before(sino6, new, value=left)
    assert (found.verdict, [finding.label for finding in found.findings]) == (
        "explained",
        ["bearing_tilt:2"],
    )


@FEW
@pytest.mark.parametrize(
    "known",
    [
        JointCompliance(joint=2, values=(2e-5,), u=(2e-7,)),
        again(LinkBending(link=3, values=(5e-5,), u=(1e-6,))),
    ],
)
def test_a_load_that_the_file_does_not_have(known, sino6):
    """A mass at the tip of an arm that is known to yield makes nothing softer, and is no error of
    an encoder.
    """
    added, last = 0.4, sino6.file.joints[-1]
    total = last.mass_kg + added  # the frame of the last row is at the tip
    nearer = tuple(last.mass_kg / total * c for c in last.com_mm)
    truth = changed("sino6", {6: {"mass_kg": total, "com_mm": nearer}})
    data = drawn(ErrorModel(truth, (known,)), 150, 1)
    found = diagnosed(ErrorModel(sino6, (known,)), data)
    (finding,) = found.findings
    assert (found.verdict, finding.effect.identity) == (
        "explained",
        replace(known, load_at=6).identity,
    )
    load = known.values[0] * added * 9.81
    assert abs(finding.effect.values[0] - load) < 3.3 * finding.effect.u[0] < 0.3 * load


@FEW
@pytest.mark.parametrize("phase", [0.0, again(np.pi / 2)])
def test_a_new_cause_is_not_taken_for_a_change_of_a_known_one(sino6, phase):
    """An eccentricity whose phase makes it like the torque of gravity, in few records."""
    new = EncoderEccentricity(joint=2, values=(8e-5 * np.cos(phase), 8e-5 * np.sin(phase)))
    found = known_before(sino6, new, records=20)
    sure = {
        finding.label for finding in found.findings if finding.probability >= THRESHOLDS.settled
    }
    assert sure <= {new.label}, str(found)
    aliases = {alias.label for finding in found.findings for alias in finding.aliases}
    assert phase or new.label in aliases | {finding.label for finding in found.findings}


@FEW
def test_a_known_cause_that_has_changed(sino6):
    for value in (2.6e-5, 0.0):
        found = known_before(sino6, value=value)
        (finding,) = found.findings
        assert (found.verdict, finding.label) == ("explained", "joint_compliance:2")
        ((changed, u),) = finding.parameters.values()
        assert abs(changed - value) < 3.3 * u < 2e-6
        assert (finding.was.values, finding.gone) == ((2e-5,), value == 0.0)
        assert "outdated values for compliance" in verdict_in_words(found)
        (told,) = data_of(
            found.notes, "known_cause_gone" if finding.gone else "known_cause_changed"
        )
        assert told["cause"] == "joint_compliance:2"
        assert told["was"].startswith("compliance 20")


def slipped(arm: Arm, joint: int, before: int, size: float, records: int, seed: int) -> Diagnosis:
    """Of records of which so many, or all but so many, are before a slip."""
    first = drawn(arm, records, seed)
    time = np.sort(first.conditions.require("time", "the test"))
    slip = EncoderSlip(joint, float((time[before - 1] + time[before]) / 2), values=(size,))
    data = drawn(ErrorModel(arm, (slip,)), records, seed)
    return diagnosed(arm, data)


@pytest.mark.long
@pytest.mark.parametrize(("last", "size"), [(4, 1e-3), (4, 5e-3), (8, 1e-3)])
def test_a_slip_near_the_end_is_no_gross_errors(sino6, last, size):
    """The few records after it are far off, and all that are."""
    found = slipped(sino6, 2, -last, size, 120, last)
    assert (found.verdict, [finding.label for finding in found.findings]) == (
        "explained",
        ["encoder_slip:2"],
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_an_early_slip_is_no_drift(sino6, seed):
    """A drift that is soon over looks like it, and is not to be compared with a slip at a time of
    which few were tried.
    """
    found = slipped(sino6, 5, 5, 3e-4, 200, seed)
    labels = {finding.label: finding.probability for finding in found.findings}
    assert labels.get("zero_drift:5", 0.0) < 0.95
    assert "encoder_slip:5" in {
        *labels,
        *(alias.label for finding in found.findings for alias in finding.aliases),
    }


@FEW
@pytest.mark.parametrize(
    "shares", [again("last few"), again("time"), again("operator"), "joint 2", again("place")]
)
def test_records_that_are_excluded_together_are_no_gross_errors(sino6, shares):
    """In a tenth of the records the tip is elsewhere on the last body; they are outliers to the
    rest, and yet all alike.
    """
    rng = np.random.default_rng(4)
    data = simulate_measurements(sino6, "free", 160, rng=rng, **NOISE)
    operator = np.where(rng.random(160) < 0.1, "Bo", "Al").astype(object)
    time = data.conditions.require("time", "the test")
    late, high = time > np.quantile(time, 0.9), data.q[:, 1] > np.quantile(data.q[:, 1], 0.9)
    near = np.linalg.norm(data.reference - data.reference[0], axis=1).argsort().argsort() < 16
    apart = {
        "last few": time >= np.sort(time)[-5],
        "time": late,
        "operator": operator == "Bo",
        "joint 2": high,
        "place": near,
    }[shares]
    off = apart[:, None] * 3e-4 * ErrorModel(sino6).state(data.q).rotation[-1][:, :, 2]
    told = replace(data, reference=data.reference + off, operator=operator)
    found = diagnosed(sino6, told)
    if shares in ("last few", "time"):
        assert found.verdict == "explained"
        assert [finding.cause for finding in found.findings] == ["stylus_shift"]
        return
    assert found.verdict == "unexplained"
    assert shares in found.unexplained.depends_on


def with_a_bump(arm: Arm, number: int, size: float, seed: int) -> Measurements:
    """An eccentricity of joint 3; so many records more within 0.15 m of a place round which the
    references are shifted.
    """
    rng = np.random.default_rng(seed)
    postures = random_postures(arm, 6000, rng)
    tips = arm.positions(postures)
    apart = np.linalg.norm(tips - tips[0], axis=1)
    q = rng.permutation([*postures[-200:], *postures[np.flatnonzero(apart < 0.15)[:number]]])
    moved = np.linalg.norm(arm.positions(q) - tips[0], axis=1)
    shift = size * np.exp(-0.5 * np.square(moved / 0.1))[:, None] * np.array([0.6, 0.0, 0.8])
    hidden = ErrorModel(arm, (EncoderEccentricity(3, values=(1e-4, 4e-5)),))
    read = q + 8e-6 * rng.standard_normal(q.shape)
    return Measurements.of(
        read, hidden.predict(q) + shift + 1e-5 * rng.standard_normal(shift.shape)
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", [4, 1])
def test_a_bump_in_the_room_is_no_gross_errors(sino6, seed):
    """The eccentricity beside it, which displaces tips by more, is the only name."""
    found = diagnose(sino6, with_a_bump(sino6, 10, 9e-5, seed), **NOISE, hold_out=False)
    assert found.verdict == "partly-explained"
    (finding,) = found.findings
    assert finding.label == "encoder_eccentricity:3"
    assert np.all(
        np.abs(finding.effect.values - np.array([1e-4, 4e-5])) < 3.3 * finding.effect.u[0]
    )
    assert {"x", "place"} & set(found.unexplained.depends_on)


@FEW
def test_a_target_that_is_unknown_again_is_found_anew(sino6, rng):
    known = ErrorModel(sino6, (StylusOffset(values=(0.01, 0.02, 0.03), u=(1e-5, 1e-5, 1e-5)),))
    now = ErrorModel(sino6, (StylusOffset(values=(0.03, 0.0, 0.01)),))
    data = simulate_measurements(now, "free", 100, rng=rng, **NOISE)
    found = diagnose(known, data, **NOISE, target="unknown", hold_out=False)
    (offset,) = found.model.effects
    assert found.verdict == "no-discrepancy"
    assert offset.values == pytest.approx((0.03, 0.0, 0.01), abs=2e-4)


@pytest.mark.long
def test_what_is_a_part_of_moved_sessions_is_not_in_the_extended_arm(sino6, rng):
    """What fits the steps between sessions a little would harm at every other time; a slip of joint
    1 rotates all.
    """
    data = simulate_measurements(sino6, "free", 240, rng=rng, **NOISE)
    number = np.arange(240) // 80
    turn, shift = rng.normal(0, 2e-4, (3, 3))[number], rng.normal(0, 1.5e-4, (3, 3))[number]
    moved = data.reference + np.cross(turn, data.reference) + shift
    session = np.array(["a", "b", "c"], dtype=object)[number]
    told = replace(data, reference=moved, conditions=replace(data.conditions, session=session))
    found = diagnosed(sino6, told)
    assert found.verdict == "unexplained"
    assert {"session", "time"} <= set(found.unexplained.depends_on)
    assert {effect.label for effect in found.model.effects if "time" in effect.needs} <= {
        "encoder_slip:1"
    }


@pytest.mark.long
@pytest.mark.parametrize(("order", "turns"), [(14.5, 0.95), (20.5, 0.95), (2.75, 3.0)])
def test_one_wave_of_any_order_is_no_curve(sino6, order, turns):
    """Between the orders that are tried a free curve fits far better than any of them, and than
    none.
    """
    limits = sino6.limits.copy()
    limits[0] = -turns * np.pi, turns * np.pi
    arm, rng = replace(sino6, limits=limits), np.random.default_rng(4)
    data = simulate_measurements(
        ErrorModel(arm, (JointPeriodicError(1, order, values=(6e-5, 8e-5)),)), "free", 100, rng=rng
    )
    result = diagnose(arm, data, hold_out=False)
    (finding,) = result.findings
    assert result.verdict == "explained"
    assert finding.label == "joint_periodic_error:1"
    found, u = finding.inner["order"]
    assert abs(found - order) < 4 * u < 0.1


@FEW
@pytest.mark.parametrize(("noise", "payload"), [again(1.0, 0.0), (0.02, 2.0)])
def test_torques_with_noise_and_masses_that_lack_a_payload(sino6, noise, payload):
    """Whichever of the two tells the moment better is taken, so that no cause beside it has an
    advantage.
    """
    rng, hidden = np.random.default_rng(1), JointCompliance(3, values=(2e-5,))
    data = simulate_measurements(sino6, "free", 120, rng=rng, **NOISE)
    state = State(sino6, data.q, data.conditions, sino6.chain.tip)
    loads = [JointCompliance(j, load_at=6).moments(state, j)[:, :, 0] for j in range(1, 7)]
    carried = [state.moment_at_axis(j) + 9.81 * payload * load for j, load in enumerate(loads, 1)]
    moment = np.stack([state.along_axis(j, each) for j, each in enumerate(carried, 1)], axis=1)
    moved = data.reference + 2e-5 * moment[:, 2, None] * jacobian_of(sino6.poses(data.q))[:, :3, 2]
    torque = noise * rng.standard_normal(moment.shape) - moment
    told = replace(data, reference=moved, conditions=replace(data.conditions, torque=torque))
    found = diagnosed(sino6, told)
    assert {f.label for f in found.findings if f.probability >= THRESHOLDS.settled} <= {
        hidden.label
    }, str(found)
    (finding,) = [f for f in found.findings if f.label == hidden.label]
    assert finding.effect.torque == ("gravity" if noise > payload else "measured")
    assert abs(finding.effect.values[0] - 2e-5) < 3.3 * finding.effect.u[0] < 8e-6


@FEW
def test_compliance_on_a_mount_that_is_tilted_in_half_of_the_records(sino6):
    """Each half is simulated with the gravity of its mount in the arm file, not with the columns.

    By 10° about y, gravity gets a component of sin 10° along +x. Only the tilted half loads joint
    1.
    """
    part = np.sin(np.radians(10.0)), 0.0, -np.cos(np.radians(10.0))
    tilted = changed("sino6", gravity_m_s2=tuple(9.81 * np.array(part)))
    hidden = (JointCompliance(1, values=(3e-5,)), JointCompliance(2, values=(3e-5,)))
    tables = []
    for seed, arm, degrees in ((0, sino6, 0.0), (1, tilted, 10.0)):
        data = drawn(ErrorModel(arm, hidden), 40, seed)
        tables.append(data.to_frame().assign(tilt_y_deg=degrees))
    table = pd.concat(tables, ignore_index=True).drop(columns=["time_s", "record"])
    found = diagnosed(sino6, Measurements.from_frame(table))
    assert found.verdict == "explained"
    effects = sorted((finding.effect for finding in found.findings), key=lambda e: e.label)
    assert [effect.label for effect in effects] == ["joint_compliance:1", "joint_compliance:2"]
    for effect in effects:
        assert abs(effect.values[0] - 3e-5) < 2.5 * effect.u[0] < 6e-6


def in_two_parts(
    arm: Arm, seed: int, hidden: Callable[[float, float], Effect]
) -> tuple[Effect, float, Diagnosis]:
    """What is hidden in records before and behind a long pause, how long that is, and what is
    found.
    """
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.exponential(30.0, 120))
    pause = 3600.0 * rng.uniform(1.0, 6.0)
    time[60:] += pause
    effect, at = hidden(time[59], pause), Conditions(120, time=time)
    q = rng.uniform(*arm.limits.T, (120, 6))
    reference = ErrorModel(arm, (effect,)).predict(q, at) + 1.2e-5 * rng.standard_normal((120, 3))
    data = Measurements.of(q + 8e-6 * rng.standard_normal(q.shape), reference, conditions=at)
    return effect, pause, diagnosed(arm, data)


@FEW
@pytest.mark.parametrize(("seed", "part"), [again(1, 0.2), (7, 0.5), again(25, 0.9)])
def test_a_slip_in_a_long_pause(sino6, seed, part):
    """It may have been at any time of it."""
    hidden, pause, found = in_two_parts(
        sino6, seed, lambda start, pause: EncoderSlip(3, start + part * pause, values=(2e-4,))
    )
    (finding,) = found.findings
    assert finding.label == hidden.label, str(found)
    found_at, u = finding.inner["time_s"]
    assert abs(found_at - hidden.time_s) < 1.8 * u
    assert u == pytest.approx(pause / np.sqrt(12.0), rel=0.1)


@FEW
@pytest.mark.parametrize("seed", [6, again(5), again(0)])
def test_an_encoder_that_was_knocked_midway_is_no_slip(sino6, seed):
    """Its disc is eccentric since."""
    rng, at, joint = (
        np.random.default_rng(seed),
        Conditions(60, time=30.0 * np.arange(60)),
        2 + seed % 3,
    )
    q = rng.uniform(*sino6.limits.T, (60, 6))
    knocked = ErrorModel(
        sino6, (EncoderEccentricity(joint, values=(1.5e-4 * np.cos(seed), 1.5e-4 * np.sin(seed))),)
    )
    reference = np.where(at.time[:, None] > 1040.0, knocked.predict(q), sino6.positions(q))
    reference += 1.2e-5 * rng.standard_normal((60, 3))
    data = Measurements.of(q + 8e-6 * rng.standard_normal(q.shape), reference, conditions=at)
    found = diagnosed(sino6, data)
    assert (found.verdict, found.findings) == ("unexplained", ())
    assert found.unexplained.depends_on == (f"joint {joint}", "time")


@FEW
@pytest.mark.parametrize("seed", [3, again(6), again(14)])
def test_a_drift_over_a_long_pause_is_no_slip(sino6, seed):
    """Its time constant is beyond the usual ones."""
    hidden, _, found = in_two_parts(sino6, seed, lambda *_: ZeroDrift(3, 1e4, values=(2e-4,)))
    (finding,) = found.findings
    assert finding.probability < THRESHOLDS.settled, str(found)
    assert hidden.label in {finding.label, *(alias.label for alias in finding.aliases)}


@FEW
@pytest.mark.parametrize("seed", [10, again(15), again(22)])
def test_a_cause_that_excluded_records_show_is_not_denied(sino6, seed):
    """One of few records shows the fault most, and so seems to be a gross error."""
    rng = np.random.default_rng(seed)
    hidden = EncoderEccentricity(3, values=tuple(rng.normal(0.0, 8e-5, 2)))
    data = simulate_measurements(ErrorModel(sino6, (hidden,)), "free", 16, rng=rng, **NOISE)
    found = diagnosed(sino6, data)
    assert found.verdict != "no-discrepancy"
    shown = sum(share for labels, share in found.alternatives.items() if hidden.label in labels)
    assert shown > 0.3
    assert in_words(hidden) in verdict_in_words(found)
