"""Calibration against the paper, an independent least squares, repeats on simulated data, and
records that are wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import accuracy_volume, perturbed_model
from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm, load_arm_file
from aacmm_pin.arm.file import Uncertainty
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration import Calibration, Fit, calibrate, solver
from aacmm_pin.calibration.calibrate import notes_of
from aacmm_pin.calibration.calibrated_arm import moved_file
from aacmm_pin.effects import (
    BaseCompliance,
    BearingTilt,
    Conditions,
    EncoderEccentricity,
    EncoderSlip,
    ErrorModel,
    JointErrorCurve,
    JointPeriodicError,
    StylusOffset,
    ThermalExpansion,
    ZeroDrift,
)
from aacmm_pin.errors import AacmmError, MissingConditionError, UnknownNameError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.again import again
from tests.arm_files import PRISMATIC, by_table, changed
from tests.calibration.contacts import drawn
from tests.notes import data_of
from tests.oracle import close, perturbed_positions, postures

READING, REFERENCE = 8e-6, 12e-6


def free_points(arm: Arm, rng: np.random.Generator, n: int = 300) -> tuple[Measurements, Array]:
    """Records of an arm whose geometry is off by a draw of its stated uncertainty, and that
    draw.
    """
    q = postures(arm, rng, n)
    errors = drawn(arm, rng)
    tips = perturbed_positions(arm, q, np.tile(errors, (n, 1)))
    noisy = q + rng.normal(size=q.shape) * READING
    return Measurements.of(noisy, tips + rng.normal(size=tips.shape) * REFERENCE), errors


def quick(
    arm: Arm | ErrorModel, data: Measurements, *args: object, **options: object
) -> Calibration:
    known = {"encoder_noise": READING, "reference_noise": REFERENCE, "hold_out": False}
    return calibrate(arm, data, *args, **(known | options))


def test_values_of_a_row_with_a_prismatic_joint(rng):
    """The zero of the joint is in d; theta of its row is an angle as alpha is."""
    wide = dict.fromkeys(("a_mm", "d_mm"), 5.0) | {"alpha_rad": 0.02, "theta_offset_rad": 0.02}
    arm = changed("sino6", {0: {"uncertainty": Uncertainty(**wide)}, 3: PRISMATIC})
    data, errors = free_points(arm, rng)
    result = quick(arm, data)
    measured = {"d3", "theta_offset3"} & {*result.parameters.query("known == 'measured'").parameter}
    assert measured
    assert np.abs(normalised(arm, result, errors)).max() < 4.5
    q = postures(arm, rng, 50)
    tips = perturbed_positions(arm, q, np.tile(errors, (len(q), 1)))
    close(result.model.predict(q), tips, 2e-5)
    zeros = quick(arm, data, "zero-offsets")
    assert "d3" in [*zeros.parameters.parameter]


def normalised(arm: Arm, result: Calibration, errors: Array) -> Array:
    """Estimate minus truth over u, of the parameters that the data tell."""
    true = {p.name: p.value + e for p, e in zip(arm.parameters, errors, strict=True)}
    table = result.parameters[result.parameters["known"] == "measured"]
    scale = np.where(table["unit"] == "mm", 1e-3, 1.0)
    off = table["after"] * scale - [true[name] for name in table["parameter"]]
    return np.asarray(off / (table["u"] * scale))


def agreement(arm: Arm, result: Calibration, errors: Array) -> float:
    """Chance of an estimate as far from the truth as this one, by its own covariance."""
    position = {p.name: i for i, p in enumerate(arm.parameters)}
    off = (
        result.fit.point.x
        - errors[[position[p.name] for p in result.fit.problem.vector.parameters]]
    )
    return float(chi2.sf(off @ np.linalg.solve(result.covariance, off), off.size))


def test_stated_places_of_targets_are_a_prior(rng):
    """They determine the last placement, which targets at unknown places do not. If zeros alone are
    estimated, a note states that the placements stay.
    """
    u = (2e-5, 2e-5, 2e-5)
    stated = {"A": (0.05, 0.0, 0.08), "B": (-0.03, 0.045, 0.07), "C": (-0.02, -0.05, 0.11)}
    arm = Arm.from_urdf("ur5", translation_half_width=5e-4, rotation_half_width=1e-3)
    targets = [StylusOffset(marker, values=at, u=u) for marker, at in stated.items()]
    true = [target.at(rng.normal(target.values, u)) for target in targets]
    moved = np.zeros((6, 6))
    moved[5, [1, 4]] = 3e-4, 6e-4  # along and about the last axis
    q = rng.uniform(-2.5, 2.5, (120, 6))
    marker = Conditions(120, marker=np.array([*"ABC"] * 40, dtype=object))
    real = ErrorModel(arm.with_placements(moved, None), true)
    points = real.predict(q, marker) + rng.normal(0.0, 1e-5, (120, 3))
    records = Measurements.of(q, points, conditions=marker)
    noise = {"encoder_noise": 1e-6, "reference_noise": 1e-5, "hold_out": False}
    result = calibrate(ErrorModel(arm, targets), records, **noise)
    table = result.parameters.set_index("parameter")
    last = table.loc[["y6", "ry6"]]
    prior_u = {parameter.name: parameter.u for parameter in arm.parameters}
    assert (np.abs(last["after"] - [0.3, 6e-4]) < 4 * last["u"]).all()
    assert table.loc["y6", "u"] * 1e-3 < 0.1 * prior_u["y6"]
    assert table.loc["ry6", "u"] < 0.6 * prior_u["ry6"]
    named = calibrate(ErrorModel(arm, targets), records, ["geometry", *targets], **noise)
    pd.testing.assert_frame_equal(result.parameters, named.parameters)
    ignored = calibrate(ErrorModel(arm, targets), records, prior=False, **noise)
    unstated = [target.at(target.values) for target in targets]
    without_u = calibrate(ErrorModel(arm, unstated), records, **noise)
    (note,) = data_of(without_u.notes, "places_unused")
    assert not data_of([*result.notes, *ignored.notes], "places_unused")
    assert note["places"] == [target.label for target in targets]
    zeros = calibrate(ErrorModel(arm, targets), records, "zero-offsets", **noise)
    assert data_of(zeros.notes, "geometry_held") == [{"held": 36}]
    for free in (ignored, without_u):
        known = free.parameters.set_index("parameter")["known"]
        assert known["ry6"] in ("as stated", "in combination")


@pytest.mark.parametrize("by_marker", [True, again(False)])
def test_noise_of_readings_reaches_a_target_beyond_the_tip(sino6, by_marker):
    """χ² of 12 files with noise as stated, the reading's the larger part, and a target 0.3 m beyond
    the tip.
    """
    rng, n, noise = np.random.default_rng(5), 40, 5e-4
    marker = Conditions(n, marker=np.full(n, "far", dtype=object))
    model = ErrorModel(sino6, (StylusOffset("far", values=(0.1, -0.05, 0.3)),))
    setup = {
        "target": "unknown",
        "encoder_noise": noise,
        "reference_noise": 1e-5,
        "hold_out": False,
    }
    judged = []
    for _ in range(12):
        q = postures(sino6, rng, n)
        points = (
            model.predict(q + rng.normal(size=q.shape) * noise, marker)
            + rng.normal(size=(n, 3)) * 1e-5
        )
        data = Measurements.of(q, points, conditions=marker if by_marker else None)
        judged.append(calibrate(sino6, data, "zero-offsets", **setup).fit.chi2_stated)
    total, dof = np.sum(judged, axis=0)
    assert abs(total - dof) < 3.5 * np.sqrt(2 * dof)


# --- the estimate and its uncertainty


def test_an_independent_least_squares_agrees(sino6, rng):
    data, _ = free_points(sino6, rng, 120)
    result = quick(sino6, data, robust=False)
    names = [p.name for p in sino6.parameters]
    chosen = [names.index(name) for name in result.parameters["parameter"]]
    width = np.array([sino6.parameters[i].u for i in chosen])
    jacobian = sino6.jacobian(data.q)
    noise = REFERENCE**2 * np.eye(3) + READING**2 * jacobian @ jacobian.transpose(0, 2, 1)
    whiten = np.linalg.inv(np.linalg.cholesky(noise))

    def residual(z: Array) -> Array:
        errors = np.zeros(len(names))
        errors[chosen] = z * width
        off = perturbed_positions(sino6, data.q, np.tile(errors, (data.n, 1))) - data.reference
        return np.concatenate([np.einsum("nij,nj->ni", whiten, off).ravel(), z])

    best = least_squares(
        residual, np.zeros(len(chosen)), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    u = np.sqrt(np.diag(result.covariance))
    close(result.fit.point.x / u, best.x * width / u, 1e-2)
    covariance = np.linalg.inv(best.jac.T @ best.jac) * np.outer(width, width)
    close(result.covariance / np.outer(u, u), covariance / np.outer(u, u), 1e-2)


def test_uncertainties_are_honest(sino6):
    """RMS of error over u is one, and 95 % intervals hold 95 % of the true values, over repeats."""
    repeats = 20
    rngs = [np.random.default_rng(seed) for seed in range(repeats)]
    results = [
        (quick(sino6, data), errors) for data, errors in (free_points(sino6, rng) for rng in rngs)
    ]
    off = np.concatenate([normalised(sino6, result, errors) for result, errors in results])
    independent = off.size / 2  # the parameters of one repeat are correlated
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=4 / np.sqrt(2 * independent))
    assert np.mean(np.abs(off) < 1.96) == pytest.approx(
        0.95, abs=4 * np.sqrt(0.05 * 0.95 / independent)
    )
    chances = np.array([result.p_value for result, _ in results], dtype=float)
    assert 0.3 < chances.mean() < 0.7
    assert sum(len(result.excluded) for result, _ in results) <= 4


def test_more_scatter_than_stated_is_found_and_said(sino6, rng):
    data, _ = free_points(sino6, rng)
    worse = Measurements.of(data.q, data.reference + rng.normal(size=data.reference.shape) * 50e-6)
    result = quick(sino6, worse)
    assert result.p_value < 1e-6
    assert result.fit.scatter == pytest.approx(50e-6, rel=0.1)
    assert len(data_of(result.notes, "scatter_added")) == 1
    assert not data_of(result.notes, "wrong_value")


def test_a_part_that_was_exchanged_is_told(sino6, rng):
    """Another stylus, 1 mm longer: by its half-width of 2.9 µm, which would hold its length where
    it was.
    """
    file = load_arm_file("sino6")
    true = changed(file, {6: {"d_mm": file.joints[-1].d_mm + 1.0}})
    data = simulate_measurements(
        true, "free", 60, rng=rng, encoder_noise=READING, reference_noise=REFERENCE
    )
    result = quick(sino6, data)
    assert result.fit.scatter > 1e-4
    (told,) = data_of(result.notes, "wrong_value")
    assert told["parameter"] == "d6"
    assert told["found"] - told["stated"] == pytest.approx(1e-3, rel=0.05)
    free = quick(sino6, data, prior=False).parameters.set_index("parameter")
    assert free.loc["d6", "change"] == pytest.approx(1.0, rel=0.05)  # [mm]


@pytest.mark.parametrize("wrong", [0, 3])
def test_scatter_found_from_afar_is_that_of_the_records(wrong):
    """Offsets of 100°, where an independent least squares has its minimum; so with gross errors."""
    so101 = Arm.from_urdf("so101")
    rng = np.random.default_rng(12)
    offsets = np.radians([0.0, 100.0, -97.0, -5.0, 2.0])
    q = random_postures(so101, 60, rng)
    tips = so101.positions(q + offsets) + 5e-4 * rng.standard_normal((60, 3))
    gross = tips.copy()
    gross[:wrong] += 0.03
    result = calibrate(so101, Measurements.of(q, gross), "zero-offsets", hold_out=False)

    def residuals(x: Array) -> Array:
        return np.asarray((so101.positions(q + x) - tips)[wrong:].ravel())

    best = least_squares(residuals, offsets)
    scatter = np.sqrt(2.0 * best.cost / (best.fun.size - 5))
    information = best.jac.T @ best.jac / scatter**2 + np.eye(5) / result.fit.problem.widths**2
    u = np.sqrt(np.diag(np.linalg.inv(information)))
    assert np.flatnonzero(result.fit.excluded).tolist() == [*range(wrong)]
    assert result.fit.scatter == pytest.approx(scatter, rel=0.02)
    assert np.sqrt(np.diag(result.covariance)) == pytest.approx(u, rel=0.02)
    assert np.abs((result.fit.point.x - best.x) / u).max() < 1.0


# --- kinds of evidence


@pytest.mark.parametrize("plan", ["seats", "unknown seats", "bars"])
def test_seats_and_bars(sino6, rng, plan):
    q = np.zeros((1, 6))
    errors = drawn(sino6, rng)
    steps = {p.name: e for p, e in zip(sino6.parameters, errors, strict=True)}
    real = Arm.from_file(moved_file(sino6, steps))
    assert np.abs(real.positions(q) - sino6.positions(q)).max() > 1e-6
    data = simulate_measurements(
        real,
        "ball-bar" if plan == "bars" else "seats",
        300,
        rng=rng,
        encoder_noise=READING,
        reference_noise=REFERENCE,
        probe_noise=5e-6,
        known=plan == "seats",
        bar_length=0.5 if plan == "bars" else None,
    )
    if data.bar_length is not None:  # stated in the file, it is not assumed
        data = replace(data, bar_length_u=np.where(np.isnan(data.bar_length), np.nan, REFERENCE))
    result = quick(sino6, data, probe_noise=5e-6)
    # Of seats without coordinates, less what their place takes.
    assert result.rms == pytest.approx(result.noise, rel=0.1)
    assert agreement(sino6, result, errors) > 1e-3
    assert result.rms < 0.3 * result.rms_before
    assert result.p_value > 1e-4


def test_the_error_of_a_bar_is_common_to_all_its_places(sino6, rng):
    """No length of the arm is known better than the one bar that tells its size."""
    data = simulate_measurements(
        sino6, "ball-bar", 300, rng=rng, reference_noise=0.0, probe_noise=5e-6, bar_length=0.5
    )
    data = replace(data, bar_length_u=np.where(np.isnan(data.bar_length), np.nan, 3e-5))
    assert len(data.bars()) > 3
    model = quick(sino6, data, prior=False, probe_noise=5e-6).model
    one, other = (data.q[data.conditions.seat == seat][:1] for seat in data.bars()[0][1:3])
    along = (model.predict(one) - model.predict(other))[0] / 0.5
    by = along @ (model.sensitivity(one) - model.sensitivity(other))[0]
    assert 3e-5 < np.sqrt(by @ model.covariance() @ by) < 4.5e-5


def test_an_unknown_frame_and_what_it_hides(sino6, rng):
    data, errors = free_points(sino6, rng)
    turn = Rotation.from_rotvec([0.4, -0.2, 1.1]).as_matrix()
    elsewhere = Measurements.of(data.q, data.reference @ turn.T + [1.0, 2.0, -0.5])
    result = quick(sino6, elsewhere, reference_frame="external", prior=False)
    assert set(result.undetermined) == {
        "alpha6 is not determined",
        "only the sum of d1 and frame.z is determined",
        "only the sum of theta_offset1 and frame.rz is determined",
    }
    assert result.rms == pytest.approx(quick(sino6, data, prior=False).rms, rel=0.02)
    with_prior = quick(sino6, elsewhere, reference_frame="external")
    assert agreement(sino6, with_prior, errors) > 1e-3


def test_what_is_known_in_combination_only_has_no_u_by_itself(sino6, rng):
    result = quick(sino6, free_points(sino6, rng, 40)[0], [BaseCompliance(), BearingTilt(1)])
    (line,) = result.undetermined
    assert "sum of base_compliance and bearing_tilt:1" in line
    assert list(result.parameters["known"]) == ["in combination"] * 2
    assert result.parameters["u"].isna().all()
    assert all(effect.u[0] > 100 * effect.terms[0].typical for effect in result.model.effects)


def test_parallel_axes_are_known_together(rng):
    rows = [(0, 127.3, 90, 0), (-612, 0, 0, 0), (-572.3, 0, 0, 0), (0, 163.9, 90, 0)]
    arm = by_table("parallel", [*rows, (0, 115.7, -90, 0), (0, 92.2, 0, 0)], 170.0)
    q = postures(arm, rng, 150)
    data = Measurements.of(q, arm.positions(q) + rng.normal(size=(150, 3)) * 1e-5)
    result = calibrate(arm, data, reference_noise=1e-5, hold_out=False)
    together = [
        line for line in result.undetermined if "d2" in line or "d3" in line or "d4" in line
    ]
    assert len(together) == 2
    assert all("only the sum of" in line for line in together)
    x, unknown = result.fit.point.x, result.fit.unknown
    for direction in unknown.T:
        moved = result.fit.problem.predict(
            x + 1e-3 * direction * result.fit.problem.widths, result.fit.point.frame
        )
        close(moved.tips, result.fit.point.prediction.tips, 2e-6)


# --- records that are wrong


def test_good_records_belong_where_they_are_few(sino6):
    """A dozen arms within their half-widths, five records each: with a robust search alone a third
    of them lost one.
    """
    rng = np.random.default_rng(11)
    for _ in range(12):
        data = simulate_measurements(perturbed_model(ErrorModel.of(sino6), rng), "free", 5, rng=rng)
        assert not len(quick(sino6, data).excluded)
        wrong = data.reference.copy()
        wrong[2, 0] += 1e-3
        assert 2 in np.flatnonzero(quick(sino6, replace(data, reference=wrong)).fit.excluded)


@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_a_tenth_of_gross_errors(sino6, rng, size):
    data, _ = free_points(sino6, rng)
    wrong = rng.choice(300, 30, replace=False)
    reference = data.reference.copy()
    reference[wrong] += size * rng.normal(size=(30, 3))
    result = quick(sino6, Measurements.of(data.q, reference))
    excluded = set(result.excluded["row"] - 2)
    clear = {int(i) for i in wrong if np.linalg.norm(reference[i] - data.reference[i]) > 1.5e-4}
    assert clear <= excluded <= {int(i) for i in wrong}
    clean = quick(sino6, data.take(np.setdiff1d(np.arange(300), wrong)))
    u = np.sqrt(np.diag(clean.covariance))
    assert np.abs((result.fit.point.x - clean.fit.point.x) / u).max() < 1.0


# --- the calibrated arm


def test_the_calibrated_arm_is_saved_and_calibrated_again(sino6, rng, tmp_path):
    data, _ = free_points(sino6, rng)
    result = quick(sino6, data, ["geometry", EncoderEccentricity(3)])
    result.model.save(tmp_path / "cal.toml")
    loaded = ErrorModel.load(tmp_path / "cal.toml")
    q = postures(sino6, rng, 50)
    close(loaded.predict(q), result.model.predict(q), 1e-12)
    close(loaded.predict(data.q), result.fit.point.prediction.tips, 1e-9)
    by_name = {p.name: i for i, p in enumerate(loaded.parameters)}
    names = [p.name for p in result.fit.problem.vector.parameters]
    where = [by_name[name] for name in names]
    np.testing.assert_allclose(
        loaded.covariance()[np.ix_(where, where)], result.covariance, rtol=1e-6, atol=1e-30
    )
    again = quick(loaded, data, ["geometry", EncoderEccentricity(3)])
    assert again.rms == pytest.approx(result.rms, rel=0.05)
    assert [e.label for e in ErrorModel.of(result.model.arm).effects] == ["encoder_eccentricity:3"]


# --- bad input


def test_a_search_that_does_not_converge_gives_its_best_point_and_says_so(sino6, rng, monkeypatch):
    data = free_points(sino6, rng, 100)[0]
    result = quick(sino6, data)
    assert result.fit.converged
    fit = result.fit
    start = solver.initial_point(fit.problem, fit.observations)
    weights = fit.used.astype(np.float64)
    monkeypatch.setattr(solver, "MOST_STEPS", 1)
    far = solver.solve(fit.problem, fit.noise, start, weights)
    assert not far.converged
    assert far.system.cost < Fit.at(fit.problem, fit.noise, start, weights).system.cost
    said = [*notes_of(replace(fit, point=far.point, system=far.system, message=far.message))]
    assert data_of(said, "not_converged") == [{"why": far.message}]
    assert len(said) == 1 + len(result.notes)


def test_temperatures_in_another_unit_are_noted(sino6, rng):
    data = simulate_measurements(sino6, "free", 30, rng=rng)
    warm = replace(data.conditions, temperature=1.8 * data.conditions.temperature + 32.0)
    less = replace(data.conditions, temperature=data.conditions.temperature - 20.0)
    for conditions, asked in (
        (warm, ["temperatures_high"]),
        (less, ["temperatures_low"]),
        (data.conditions, []),
    ):
        notes = quick(sino6, replace(data, conditions=conditions), "geometry").notes
        assert [note.code for note in notes if note.code.startswith("temperatures")] == asked


@pytest.mark.parametrize(
    ("factor", "word"),
    [(1.0, ""), (1e-3, "reference_noise_odd"), (700.0, "reference_noise_odd")],
)
def test_an_uncertainty_of_references_in_another_unit(sino6, factor, word):
    for plan in ("free", "seats"):
        data = simulate_measurements(sino6, plan, 60, rng=np.random.default_rng(3), seats=6)
        notes = quick(
            sino6,
            replace(data, reference_u=factor * data.reference_u),
            "geometry",
            encoder_noise=8e-6,
        ).notes
        assert [note.code for note in notes if note.code.startswith("reference_noise")] == [
            word
        ] * bool(word), notes


def test_records_used_before(sino6, rng, tmp_path):
    first, second = (simulate_measurements(sino6, "free", 40, rng=rng) for _ in range(2))
    calibrated = quick(sino6, first).model
    calibrated.save(tmp_path / "once.toml")
    both = quick(ErrorModel.load(tmp_path / "once.toml"), second).model
    mixed = Measurements.from_frame(
        pd.concat([second.take(range(20)).to_frame(), first.take(range(5)).to_frame()])
    )
    for model, data, prior, counts in (
        (calibrated, first, True, [(40, 40)]),
        (both, first, True, [(40, 40)]),
        (calibrated, mixed, True, [(5, 25)]),
        (calibrated, first, False, []),
        (calibrated, second, True, []),
    ):
        told = data_of(quick(model, data, "geometry", prior=prior).notes, "records_used_before")
        assert [(one["again"], one["records"]) for one in told] == counts


@pytest.mark.parametrize(("plan", "count"), [("seats", 6), ("ball-bar", 3)])
def test_standards_used_before(sino6, plan, count, tmp_path):
    bar = {"bar_length": 0.5} if plan == "ball-bar" else {}
    data = simulate_measurements(sino6, plan, 80, seats=6, rng=np.random.default_rng(2), **bar)
    first, second = (data.take(slice(start, None, 2)) for start in (0, 1))
    quick(sino6, first).model.save(tmp_path / "once.toml")
    once = ErrorModel.load(tmp_path / "once.toml")
    for prior, said in ((True, True), (False, False)):
        notes = quick(once, second, "geometry", prior=prior).notes
        assert [one["standards"] for one in data_of(notes, "standards_used_before")] == [
            count
        ] * said
    moved = replace(second, reference=second.reference + 1e-6)
    again = quick(
        once,
        moved if plan == "seats" else replace(second, bar_length=second.bar_length + 1e-6),
        "geometry",
    )
    assert not {"records_used_before", "standards_used_before"} & {
        note.code for note in again.notes
    }


def test_a_seat_with_contradicting_coordinates_is_named(sino6, rng):
    data = simulate_measurements(sino6, "seats", 60, rng=rng, seats=6)
    label, records = next(iter(data.seats().items()))
    moved = data.reference.copy()
    moved[records[:3]] += [3e-3, -4e-3, 0.0]
    first, other = sorted(data.row[records[[0, 3]]])
    result = quick(sino6, replace(data, reference=moved), "geometry")
    (told,) = data_of(result.notes, "seat_contradicted")
    assert (told["seat"], told["rows"]) == (label, [first, other])
    assert told["apart"] == pytest.approx(5e-3, rel=0.02)
    noisy = replace(data, reference=data.reference + rng.normal(0, 12e-6, data.reference.shape))
    assert not data_of(quick(sino6, noisy, "geometry").notes, "seat_contradicted")


def test_a_bar_that_does_not_fit_between_its_ends_is_named(sino6, rng):
    data = simulate_measurements(sino6, "seats", 60, rng=rng, seats=6)
    (a, at_a), (b, at_b) = list(data.seats().items())[:2]
    seat = data.conditions.seat
    apart = float(np.linalg.norm(data.reference[at_a[0]] - data.reference[at_b[0]]))
    bar, end = (
        np.where(np.isin(seat, (a, b)), "long", ""),
        np.where(seat == a, "A", np.where(seat == b, "B", "")),
    )
    for error, named in ((0.0, 0), (0.8e-3, 1)):
        length = np.where(bar == "long", apart + error, np.nan)
        result = quick(
            sino6,
            replace(data, bar=bar.astype(object), bar_end=end.astype(object), bar_length=length),
            "geometry",
        )
        assert [told["bar"] for told in data_of(result.notes, "bar_contradicted")] == [
            "long"
        ] * named


def test_input_that_is_refused(sino6, zero6, rng):
    data, _ = free_points(sino6, rng, 40)
    two, five_joints = data.take([0, 1]), Measurements.of(data.q[:, :5], data.reference)
    near = [JointPeriodicError(joint=2, order=order) for order in (7.0, 7.0000001)]
    seats = simulate_measurements(zero6, "seats", 60, rng=rng, known=False)
    cases = [
        ("no record determines", AacmmError, Measurements.of(data.q), "geometry", {}),
        ("'all'", UnknownNameError, data, "all", {}),
        ("'x'", UnknownNameError, data, "geometry", {"reference_frame": "x"}),
        ("twice", AacmmError, data, ["zero-offsets", "zero-offsets"], {}),
        ("joint_periodic_error:2,order=7", AacmmError, data, near, {}),
        ("time_s", MissingConditionError, data, ["geometry", EncoderSlip(1, 10.0)], {}),
        ("5 joints; expected 6", AacmmError, five_joints, "geometry", {}),
        ("reference_noise is -1 m", AacmmError, data, "geometry", {"reference_noise": -1.0}),
        ("length_noise is 0.05 m", AacmmError, data, "geometry", {"length_noise": 0.05}),
        ("3 or more", AacmmError, two, "geometry", {"reference_frame": "external"}),
    ]
    for words, error, records, parameters, options in cases:
        with pytest.raises(error, match=words):
            quick(sino6, records, parameters, **options)
    few = Measurements.of(two.q, zero6.positions(two.q))
    for words, records in (("take more records", few), ("scale of the arm", seats)):
        with pytest.raises(AacmmError, match=words):
            calibrate(zero6, records, hold_out=False)


def test_records_outside_a_known_error_curve_are_left_out_and_listed(sino6):
    records = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(4))
    curve = JointErrorCurve(3, values=(1e-4,) * 5, lower_rad=0.5, upper_rad=6.0, coefficients=5)
    model = ErrorModel(sino6).with_effects(curve)
    inside = model.known_at(records.q)[:, 0]
    few, same = (
        calibrate(model, some, "zero-offsets", hold_out=False)
        for some in (records, records.take(inside))
    )
    assert few.rms == same.rms
    (note,) = set(few.notes) - set(same.notes)
    assert note.code == "outside_known_range"
    assert note.data["cause"].startswith(curve.label)
    assert note.data["rows"] == records.row[~inside].tolist()
    # Takes the place of the one that is known.
    wide = replace(curve, values=(), lower_rad=-0.1, upper_rad=6.4)
    assert calibrate(model, records, ["zero-offsets", wide], hold_out=False).fit.used.size == 60
    with pytest.raises(AacmmError, match="are outside the curve"):
        calibrate(model, records.take(~inside), "zero-offsets", hold_out=False)


def test_calibrated_lengths_hold_at_the_temperature_of_their_records(sino6):
    """A metre that was calibrated at 23 °C is no metre at 20 °C, unless the model says how it
    grows.
    """
    truth = ErrorModel(sino6, (ThermalExpansion(values=(2.3e-5,)),))
    rng, q = np.random.default_rng(5), random_postures(sino6, 80, np.random.default_rng(4))
    warm, cold = (Conditions(80, temperature=t + rng.uniform(-0.5, 0.5, 80)) for t in (23.0, 18.0))
    data = Measurements.of(
        q, truth.predict(q, warm) + rng.normal(0, 5e-6, (80, 3)), conditions=warm
    )
    alone = calibrate(sino6, data, reference_noise=5e-6)
    found = alone.model.arm
    assert found.reference_temperature == pytest.approx(23.0, abs=0.2)
    (told,) = data_of(alone.notes, "temperature_of_lengths")
    assert told == {"temperature": found.reference_temperature, "stated": 20.0}
    some = quick(sino6, data, "zero-offsets", reference_noise=5e-6)
    assert some.model.arm.reference_temperature == 20.0  # angles alone
    assert [len(data_of(one.notes, "geometry_held")) for one in (alone, some)] == [0, 1]
    assert alone.model.input_warnings(q, warm) == []
    assert len(alone.model.input_warnings(q, cold)) == 1
    off = np.linalg.norm(alone.model.predict(q, cold) - truth.predict(q, cold), axis=1)
    # With the expansion on top, the arm is right at other temperatures too.
    grown = ErrorModel(found, (*alone.model.effects, ThermalExpansion(values=(2.3e-5,))))
    assert (
        np.linalg.norm(grown.predict(q, cold) - truth.predict(q, cold), axis=1).max()
        < off.max() / 4
    )
    both = calibrate(
        truth, data, ["geometry", ThermalExpansion(values=(2.3e-5,))], reference_noise=5e-6
    )
    assert both.model.arm.reference_temperature == 20.0


def test_what_is_uncertain_of_a_time_constant_stays_so(sino6, tmp_path):
    """Against normal equations of both values by finite differences; a file keeps the u of both."""
    rng, drift = (
        np.random.default_rng(3),
        ZeroDrift(2, 1500.0, values=(2.5e-4,), u=(5e-5,), nonlinear_u=600.0),
    )
    ErrorModel(sino6, (drift,)).save(tmp_path / "a.toml")
    model = ErrorModel.load(tmp_path / "a.toml")
    assert model.effects == (drift,)
    q, conditions = (
        random_postures(sino6, 90, rng),
        Conditions(90, time=np.linspace(0.0, 1800.0, 90)),
    )

    def tips(value: float, constant: float) -> Array:
        return (
            ErrorModel(sino6, (replace(drift, values=(value,), time_constant_s=constant),))
            .predict(q, conditions)
            .ravel()
        )

    data = Measurements.of(
        q, tips(2.5e-4, 1500.0).reshape(-1, 3) + rng.normal(0, 2e-5, (90, 3)), conditions=conditions
    )
    after = calibrate(
        model, data, [drift], reference_noise=2e-5, encoder_noise=0.0, hold_out=False
    ).model
    (found,) = after.effects
    steps = (
        (tips(2.6e-4, 1500.0) - tips(2.4e-4, 1500.0)) / 2e-5,
        (tips(2.5e-4, 1501.0) - tips(2.5e-4, 1499.0)) / 2.0,
    )
    j = np.column_stack(steps) / 2e-5
    covariance = np.linalg.inv(j.T @ j + np.diag([5e-5**-2, 600.0**-2]))
    assert (*found.u, found.nonlinear_u) == pytest.approx(
        tuple(np.sqrt(np.diag(covariance))), rel=0.03
    )
    assert found.u[0] > 2.0 / np.sqrt(j[:, 0] @ j[:, 0])  # more than with a known time constant
    # And of tips within the session it tells far more than of both by themselves.
    after.save(tmp_path / "b.toml")
    u = [
        accuracy_volume(one, q, conditions=conditions, method="ellipsoid", encoder_noise=0.0).u
        for one in (ErrorModel.load(tmp_path / "b.toml"), sino6)
    ]
    by_normal_equations = (
        np.sqrt(np.einsum("ij,jk,ik->i", j, covariance, j).reshape(-1, 3).sum(axis=1)) * 2e-5
    )
    np.testing.assert_allclose(
        np.sqrt(u[0] ** 2 - u[1] ** 2)[9:], by_normal_equations[9:], rtol=0.05
    )


def test_a_bar_of_another_length_is_noted(sino6):
    data = simulate_measurements(
        sino6, "ball-bar", 160, bar_length=0.6, rng=np.random.default_rng(3), encoder_noise=8e-6
    ).to_frame()
    for off, u, said in (
        (0.0, None, False),
        (0.3, None, True),
        (-3.0, None, True),
        (0.0, 5e-6, False),
        (0.1, 5e-6, True),
    ):
        table = data.assign(bar_length_mm=data["bar_length_mm"] + off * (data["bar"] == "B4"))
        found = calibrate(sino6, Measurements.from_frame(table), length_noise=u, hold_out=False)
        assert [told["bar"] for told in data_of(found.notes, "bar_length_off")] == ["B4"] * said


@pytest.mark.parametrize("plan", ["ball-bar", "seats"])
def test_what_nothing_tells_stays_where_it_was(zero6, plan):
    """Readings scatter more across the arm than along it, which a turn of the whole arm would seem
    to fit better.
    """
    at = {"rng": np.random.default_rng(3), "encoder_noise": 2e-5}
    given = at | ({"bar_length": 0.3} if plan == "ball-bar" else {"known": False})
    data = simulate_measurements(zero6, plan, 200, **given)
    asked = "geometry" if plan == "ball-bar" else "zero-offsets"
    found = calibrate(zero6, data, asked, encoder_noise=2e-5, hold_out=False)
    assert "theta_offset1 is not determined" in found.undetermined
    turned = found.parameters.set_index("parameter").loc["theta_offset1"]
    assert abs(turned["change"]) < 1e-6
    assert found.fit.converged


def test_coordinates_of_seats_of_unstated_uncertainty(sino6):
    """Seats off by 50 µm, touches by 15: both are found, and u of tips is right."""
    z, seats = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        true = perturbed_model(ErrorModel(sino6), rng)
        noise = {"encoder_noise": 2e-5, "probe_noise": 5e-6, "reference_noise": 5e-5}
        data = simulate_measurements(true, "seats", 200, rng=rng, **noise)
        data = replace(data, reference_u=np.full((data.n, 3), np.nan))
        found = calibrate(sino6, data, prior=False, hold_out=False)
        seats.append(found.fit.noise.scatters.seat)
        assert found.fit.scatter == pytest.approx(1.5e-5, rel=0.15)
        q = postures(sino6, rng, 40)
        model = found.model
        sensitivity = model.sensitivity(q)
        u = np.sqrt(
            np.diagonal(
                sensitivity @ model.covariance() @ sensitivity.transpose(0, 2, 1), axis1=1, axis2=2
            )
        )
        z.append((model.predict(q) - true.predict(q)) / u)
    assert np.mean(seats) == pytest.approx(5e-5, rel=0.2)
    moved = replace(
        data,
        reference=data.reference
        + 1e-3 * np.isin(data.conditions.require("seat", "it"), "S4")[:, None],
    )
    assert calibrate(sino6, moved, prior=False, hold_out=False).fit.noise.scatters.seat < 1e-4
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.3  # 2.5 where one scatter stands for both
