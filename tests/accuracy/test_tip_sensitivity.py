"""Accuracy of extended models and of parameters that are known together, against models that are
built anew for each draw, central differences, and identities of covariance matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from aacmm_pin._support.batches import CHUNK
from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.parameter_draws import exact_positions, source_errors
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.accuracy.volume import AccuracyVolume, accuracy_volume, circle_accuracy
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import Covariance, load_arm_file
from aacmm_pin.effects import (
    BaseCompliance,
    EncoderEccentricity,
    ErrorModel,
    JointCompliance,
    JointHysteresis,
    LinkBending,
    SeatError,
    StylusOffset,
    ThermalExpansion,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.configurations import configuration_circle
from aacmm_pin.report.plots import plot_budget

ROWS = {"a": "a_mm", "d": "d_mm", "alpha": "alpha_rad", "theta_offset": "theta_offset_rad"}
WARM = Conditions(1, temperature=np.array([31.0]))
EFFECTS = (
    LinkBending(link=3, values=(5e-5,), u=(2e-5,)),
    EncoderEccentricity(joint=3, values=(1e-4, 5e-5), u=(6e-5, 4e-5)),
    ThermalExpansion(values=(2.2e-5,), u=(4e-6,)),
)
TOGETHER = ("d3", "theta_offset3", "alpha4", "encoder_eccentricity:3.cos", "link_bending:3")
U = (2e-5, 4e-5, 3e-5, 6e-5, 2e-5)


@pytest.fixture(scope="session")
def extended(sino6: Arm) -> ErrorModel:
    return ErrorModel(sino6, EFFECTS)


def some(arm: Arm, n: int, seed: int = 5) -> Array:
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], (n, arm.nq))


def with_covariance(names: tuple[str, ...], u: tuple[float, ...], correlation: Array) -> ErrorModel:
    """The extended model of an arm of which some parameters are known together."""
    lower = tuple(tuple(float(r) for r in row[:i]) for i, row in enumerate(correlation))
    known = Covariance(parameters=names, standard_uncertainty_si=u, correlation=lower)
    return ErrorModel(
        Arm.from_file(load_arm_file("sino6").model_copy(update={"covariance": known})), EFFECTS
    )


def random_correlation(p: int, rng: np.random.Generator) -> Array:
    factor = rng.normal(size=(p, p + 1))
    matrix = factor @ factor.T
    scale = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(scale, scale))


@pytest.fixture
def calibrated(rng: np.random.Generator) -> ErrorModel:
    return with_covariance(TOGETHER, U, random_correlation(len(U), rng))


def rebuilt(model: ErrorModel, errors: dict[str, float], q: Array, conditions: Conditions) -> Array:
    """Position of an arm made anew from a table, effects and readings that are off by
    ``errors``.
    """
    file = load_arm_file("sino6")
    rows = []
    for n, row in enumerate(file.joints, start=1):
        scales = {kind: 1.0 if field.endswith("rad") else 1e3 for kind, field in ROWS.items()}
        change = {
            f: getattr(row, f) + scales[k] * errors.get(f"{k}{n}", 0.0) for k, f in ROWS.items()
        }
        rows.append(row.model_copy(update=change))
    effects = tuple(
        e.at(
            tuple(
                v + errors.get(p.name, 0.0) for v, p in zip(e.values, e.parameters(), strict=True)
            )
        )
        for e in model.effects
    )
    noise = np.array([errors.get(f"encoder_noise{j}", 0.0) for j in range(1, 7)])
    arm = Arm.from_file(file.model_copy(update={"joints": rows}))
    return np.asarray(ErrorModel(arm, effects).predict(q + noise, conditions)[0])


def by_differences(sources: ErrorSources, q: Array) -> Array:
    """Sensitivity (3, p) by central differences of models made anew."""
    columns = []
    for p in sources.parameters:
        step = max(p.u, 1e-7)
        ahead, behind = (rebuilt(sources.model, {p.name: s * step}, q, WARM) for s in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.array(columns).T


# --- extended models


def test_sensitivity_is_that_of_the_real_model(extended: ErrorModel) -> None:
    q = some(extended.arm, 1)
    sources = accuracy_volume(extended, q, conditions=WARM, encoder_noise=1e-5).sources
    assert {
        "d3",
        "link_bending:3",
        "encoder_eccentricity:3.sin",
        "thermal_expansion",
        "encoder_noise6",
    } <= {p.name for p in sources.parameters}
    expected = by_differences(sources, q)
    u = sources.u
    np.testing.assert_allclose(
        sources.sensitivity(q, WARM)[0] * u, expected * u, atol=1e-3 * (expected * u).max()
    )


def test_exact_positions_are_those_of_models_made_anew(
    extended: ErrorModel, rng: np.random.Generator
) -> None:
    """But for the sag and warmth of the errors of lengths, some 5e-4 of these."""
    q = some(extended.arm, 1)
    sources = accuracy_volume(extended, q, conditions=WARM, encoder_noise=1e-5).sources
    errors = 2 * rng.normal(size=(12, len(sources.parameters))) * sources.u
    names = [p.name for p in sources.parameters]
    expected = np.array(
        [rebuilt(extended, dict(zip(names, e, strict=True)), q, WARM) for e in errors]
    )
    assert np.ptp(expected, axis=0).min() > 5e-5
    np.testing.assert_allclose(exact_positions(sources, q, WARM, errors), expected, atol=1e-7)
    no_lengths = np.where([p.unit == "m" for p in sources.parameters], 0.0, errors)
    expected = np.array(
        [rebuilt(extended, dict(zip(names, e, strict=True)), q, WARM) for e in no_lengths]
    )
    few = exact_positions(sources, q, WARM, no_lengths)
    np.testing.assert_allclose(few, expected, atol=2e-8)
    many = np.vstack(
        [np.zeros((CHUNK, errors.shape[1])), no_lengths]
    )  # the last ones in a part of their own
    np.testing.assert_allclose(exact_positions(sources, q, WARM, many)[CHUNK:], few, atol=1e-14)


def test_uncertain_effects_enlarge_what_the_arm_alone_says(extended: ErrorModel) -> None:
    q = some(extended.arm, 5)
    for method in ("zonotope", "jointwise", "ellipsoid"):
        alone, whole = (
            accuracy_volume(m, q, conditions=WARM, method=method) for m in (extended.arm, extended)
        )
        assert (whole.volume > alone.volume).all()
        assert (whole.u > alone.u).all()
    assert (whole.largest_deviation > alone.largest_deviation).all()
    bounds = {p.name: (p.half_width, p.u) for p in whole.sources.parameters}
    assert bounds["link_bending:3"] == (4e-5, 2e-5)
    assert whole.sources.taken_as_exact == alone.sources.taken_as_exact
    assert len(whole.to_frame()) == 5


def test_certain_effects_change_nothing_to_speak_of(sino6: Arm) -> None:
    q = some(sino6, 4)
    certain = ErrorModel(sino6, tuple(e.at(e.values) for e in EFFECTS))
    alone, whole = (
        accuracy_volume(m, q, conditions=WARM, encoder_noise=1e-5) for m in (sino6, certain)
    )
    np.testing.assert_allclose(whole.volume, alone.volume, rtol=5e-3)
    np.testing.assert_allclose(whole.u, alone.u, rtol=5e-3)
    assert whole.sources.taken_as_exact[-4:] == (
        "link_bending:3",
        "encoder_eccentricity:3.cos",
        "encoder_eccentricity:3.sin",
        "thermal_expansion",
    )
    bare = accuracy_volume(ErrorModel(sino6), q, encoder_noise=1e-5)
    np.testing.assert_array_equal(bare.volume, alone.volume)
    np.testing.assert_array_equal(bare.covariance, alone.covariance)


def test_noise_of_readings_behind_a_rigid_row() -> None:
    """By way of an effect of size zero, and by the arm alone."""
    file = load_arm_file("sino6")
    first = file.joints[0].model_copy(
        update={"fixed": True, "limits_rad": None, "encoder_noise_rad": None}
    )
    arm = Arm.from_file(file.model_copy(update={"joints": [first, *file.joints[1:]]}))
    model, q, noise = (
        ErrorModel(arm, (EncoderEccentricity(joint=3),)),
        some(arm, 3),
        np.linspace(1e-5, 5e-5, 5),
    )
    found, alone = (accuracy_volume(m, q, encoder_noise=noise).covariance for m in (model, arm))
    np.testing.assert_allclose(found, alone, rtol=1e-9, atol=1e-20)


def test_the_wrist_does_not_feel_the_stylus(sino6: Arm) -> None:
    model = ErrorModel(sino6, (StylusOffset(values=(0.05, 0.0, 0.02), u=(1e-4,) * 3),))
    q = some(sino6, 3)
    wrist, alone = (accuracy_volume(m, q, at="frame5") for m in (model, sino6))
    np.testing.assert_allclose(wrist.covariance, alone.covariance, rtol=1e-9, atol=1e-20)
    tip, alone = (accuracy_volume(m, q) for m in (model, sino6))
    assert (tip.u**2 > alone.u**2 + 2.9e-8).all()


def test_a_urdf_arm_with_effects(
    robot_file: Callable[[str], Path], rng: np.random.Generator
) -> None:
    arm = Arm.from_urdf(
        robot_file("ur5_robot.urdf"),
        "ee_link",
        translation_half_width=2e-5,
        rotation_half_width=4e-5,
    )
    compliance = JointCompliance(joint=2, values=(1e-5,), u=(5e-6,))
    model = ErrorModel(
        arm, (compliance, EncoderEccentricity(joint=3, values=(1e-4, 0.0), u=(5e-5, 5e-5)))
    )
    q = rng.uniform(-2, 2, (1, 6))
    first_order = accuracy_volume(model, q, encoder_noise=1e-5)
    real = accuracy_volume(model, q, encoder_noise=1e-5, method="monte-carlo", rng=rng, draws=4000)
    scale = np.sqrt(np.outer(*[np.diag(first_order.covariance[0])] * 2))
    np.testing.assert_allclose(
        real.covariance[0] / scale, first_order.covariance[0] / scale, atol=0.11
    )
    assert (first_order.u > accuracy_volume(arm, q, encoder_noise=1e-5).u).all()
    assert real.volume[0] < first_order.volume[0] * 1.002


# --- conditions


def test_causes_without_their_conditions_are_left_out_and_named(extended: ErrorModel) -> None:
    q = some(extended.arm, 4)
    cold = accuracy_volume(extended, q)
    assert cold.not_included == ("thermal_expansion",)
    assert str(cold).endswith("; not included: thermal_expansion")
    without = ErrorModel(extended.arm, EFFECTS[:2])
    expected = accuracy_volume(without, q)
    worn = without.with_effects(
        SeatError(seat="A", values=(1e-3, 0, 0), u=(1e-3,) * 3)
    )  # the reference has no part
    np.testing.assert_array_equal(accuracy_volume(worn, q).volume, expected.volume)
    np.testing.assert_allclose(cold.covariance, expected.covariance, rtol=1e-12)
    np.testing.assert_allclose(cold.volume, expected.volume, rtol=1e-12)
    noisy = [
        accuracy_volume(m, q, encoder_noise=1e-5)
        for m in (ErrorModel(extended.arm, EFFECTS[2:]), extended.arm)
    ]
    np.testing.assert_array_equal(
        noisy[0].covariance, noisy[1].covariance
    )  # the only effect is left out
    assert expected.not_included == accuracy_volume(extended, q, conditions=WARM).not_included == ()
    assert "not included" not in str(expected)
    assert accuracy_volume(
        extended, q, method="monte-carlo", rng=np.random.default_rng(1), draws=100
    ).not_included


def test_conditions_of_one_record_hold_for_all(extended: ErrorModel) -> None:
    q, celsius = some(extended.arm, 5), np.array([15.0, 20.0, 25.0, 30.0, 35.0])
    each = Conditions(5, temperature=celsius)
    together = accuracy_volume(extended, q, conditions=each)
    alone = [
        accuracy_volume(extended, q[[k]], conditions=Conditions(1, temperature=celsius[[k]]))
        for k in range(5)
    ]
    np.testing.assert_allclose(together.volume, [a.volume[0] for a in alone], rtol=1e-12)
    same = accuracy_volume(extended, q, conditions=WARM)
    repeated = accuracy_volume(extended, q, conditions=Conditions(5, temperature=np.full(5, 31.0)))
    np.testing.assert_array_equal(same.volume, repeated.volume)
    assert same.budget().set_index("parameter").loc["thermal_expansion", "share"] > 0.01
    warm = Conditions(2, temperature=np.array([20.0, 120.0]))
    drawn = accuracy_volume(
        extended,
        q[[0, 0]],
        conditions=warm,
        method="monte-carlo",
        rng=np.random.default_rng(1),
        draws=200,
    )
    assert drawn.u[1] > 3.0 * drawn.u[0]
    with pytest.raises(ShapeError, match="conditions are of 3 records, expected 5"):
        accuracy_volume(extended, q, conditions=each.take([0, 1, 2]))


def test_nothing_is_left(zero6: Arm) -> None:
    model = ErrorModel(zero6, (JointHysteresis(joint=2, u=(1e-5,)),))
    with pytest.raises(AacmmError, match="without joint_hysteresis:2"):
        accuracy_volume(model, np.zeros((1, 6)))
    assert accuracy_volume(model, np.empty((0, 6))).volume.shape == (0,)


def test_an_arm_that_came_without_its_effects_says_so(
    calibrated: ErrorModel, tmp_path: Path
) -> None:
    q = np.zeros((1, 6))
    path = tmp_path / "extended.toml"
    ErrorModel(Arm.load("sino6"), (*EFFECTS, SeatError(seat="A"))).save(path)
    alone = accuracy_volume(Arm.load(path), q)
    assert alone.not_included == ("link_bending:3", "encoder_eccentricity:3", "thermal_expansion")
    assert accuracy_volume(ErrorModel(Arm.load(path)), q).not_included == ()
    with pytest.raises(AacmmError, match=r"encoder_eccentricity:3\.cos.*pass its ErrorModel"):
        accuracy_volume(calibrated.arm, q)


def test_circles_take_an_extended_model(extended: ErrorModel) -> None:
    circle = configuration_circle(extended.arm, np.array([0.0336, -0.6719, 0.1829]), count=24)
    q = circle.q[circle.within_limits]
    result = circle_accuracy(circle, extended, conditions=WARM)
    expected = accuracy_volume(extended, q, conditions=WARM, at=circle.at)
    np.testing.assert_array_equal(result.volume, expected.volume)
    assert result.volume.min() > circle_accuracy(circle).volume.max()


# --- parameters that are known together


def test_covariance_with_correlations(calibrated: ErrorModel) -> None:
    q = some(calibrated.arm, 1)
    result = accuracy_volume(calibrated, q, conditions=WARM, encoder_noise=1e-5)
    sources = result.sources
    known = calibrated.arm.file.covariance
    assert known is not None
    c = np.diag(sources.u**2)
    where = [
        next(i for i, p in enumerate(sources.parameters) if p.name == name)
        for name in known.parameters
    ]
    c[np.ix_(where, where)] = known.matrix_of_correlation() * np.outer(U, U)
    s = by_differences(sources, q)
    np.testing.assert_allclose(
        result.covariance[0], s @ c @ s.T, rtol=5e-3, atol=2e-3 * result.u[0] ** 2
    )
    s = sources.sensitivity(q, WARM)[0]
    np.testing.assert_allclose(result.covariance[0], s @ c @ s.T, rtol=1e-10, atol=1e-20)
    shuffled = accuracy_volume(
        calibrated, q, conditions=WARM, encoder_noise=1e-5, method="ellipsoid"
    )
    assert shuffled.volume[0] == pytest.approx(
        4 / 3 * np.pi * 7.814727903**1.5 * np.sqrt(np.linalg.det(s @ c @ s.T)), rel=1e-8, abs=0.0
    )


def test_principal_axes_hold_the_covariance_and_leave_others_alone(calibrated: ErrorModel) -> None:
    q = some(calibrated.arm, 3)
    sources = accuracy_volume(calibrated, q, conditions=WARM).sources
    assert sources.axes is not None
    np.testing.assert_allclose(sources.axes @ sources.axes.T, sources.correlation, atol=1e-12)
    s = sources.sensitivity(q, WARM)
    generators = sources.generators(s)
    inside = np.array([p.name in TOGETHER for p in sources.parameters])
    np.testing.assert_array_equal(
        generators[:, :, ~inside], (s * sources.half_widths)[:, :, ~inside]
    )
    c = (
        np.outer(sources.u, sources.u)[np.ix_(inside, inside)]
        * sources.correlation[np.ix_(inside, inside)]
    )
    block = generators[:, :, inside]
    expected = 4 * s[:, :, inside] @ c @ s[:, :, inside].transpose(0, 2, 1)
    np.testing.assert_allclose(block @ block.transpose(0, 2, 1), expected, rtol=1e-9, atol=1e-18)


def test_groups_that_are_not_correlated_have_axes_of_their_own() -> None:
    correlation = np.eye(5)
    correlation[0, 1] = correlation[1, 0] = correlation[2, 3] = correlation[3, 2] = 0.6
    sources = accuracy_volume(with_covariance(TOGETHER, U, correlation), np.zeros((1, 6))).sources
    assert sources.axes is not None
    place = {p.name: i for i, p in enumerate(sources.parameters)}
    for first, second in (TOGETHER[:2], TOGETHER[2:4]):
        axes = np.abs(
            sources.axes[np.ix_([place[first], place[second]], [place[first], place[second]])]
        )
        np.testing.assert_allclose(
            np.sort(axes, axis=1), [[np.sqrt(0.2), np.sqrt(0.8)]] * 2, rtol=1e-12
        )
    changed = np.abs(sources.axes - np.eye(len(place))).max(axis=0) > 0
    assert {p.name for p, c in zip(sources.parameters, changed, strict=True) if c} == set(
        TOGETHER[:4]
    )


def test_no_correlation_is_independence(extended: ErrorModel) -> None:
    """Zeros off the diagonal, against the same arm with these half-widths, 2 u, as bounds and u."""
    q = some(extended.arm, 3)
    model = with_covariance(TOGETHER, U, np.eye(len(U)))
    u = dict(zip(TOGETHER, U, strict=True))
    parameters = tuple(
        replace(p, u=u[p.name], half_width=2 * u[p.name]) if p.name in u else p
        for p in extended.arm.parameters
    )
    effects = (
        EFFECTS[0].at(EFFECTS[0].values, (2e-5,)),
        EFFECTS[1].at(EFFECTS[1].values, (6e-5, 4e-5)),
        EFFECTS[2],
    )
    expected = ErrorModel(replace(extended.arm, parameters=parameters), effects)
    for method in ("zonotope", "jointwise", "ellipsoid", "monte-carlo"):
        seeds = [np.random.default_rng(3) for _ in range(2)]
        found = [
            accuracy_volume(m, q, conditions=WARM, method=method, rng=rng, draws=200)
            for m, rng in zip((model, expected), seeds, strict=True)
        ]
        np.testing.assert_allclose(found[0].volume, found[1].volume, rtol=1e-9)
        np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-9, atol=1e-20)
    assert found[0].sources.correlation is None
    pd.testing.assert_frame_equal(found[0].budget(), found[1].budget())


def test_calibrated_parameters_are_drawn_from_their_normal_distribution(
    rng: np.random.Generator,
) -> None:
    """Rectangular within ± 2 u would have a third too much variance."""
    q, draws = some(Arm.load("sino6"), 1), 10_000
    model = ErrorModel(with_covariance(("d3", "theta_offset3"), (1e-3, 1e-3), np.eye(2)).arm)
    result = accuracy_volume(model, q, method="monte-carlo", rng=rng, draws=draws)
    expected = accuracy_volume(model, q)
    assert (result.u / expected.u) ** 2 == pytest.approx(1.0, abs=7 / np.sqrt(draws))
    sources = result.sources
    beyond = (np.abs(source_errors(sources, rng, 1000)) > sources.half_widths).any(axis=0)
    assert {p.name for p, far in zip(sources.parameters, beyond, strict=True) if far} == {
        "d3",
        "theta_offset3",
    }


def test_monte_carlo_of_effects_and_with_correlations(
    extended: ErrorModel, calibrated: ErrorModel, rng: np.random.Generator
) -> None:
    for model, noise in ((extended, 2e-5), (calibrated, None)):
        q = some(model.arm, 1)
        first_order = accuracy_volume(model, q, conditions=WARM, encoder_noise=noise)
        real = accuracy_volume(
            model,
            q,
            conditions=WARM,
            encoder_noise=noise,
            method="monte-carlo",
            rng=rng,
            draws=4_000,
        )
        scale = np.sqrt(np.einsum("nii,njj->nij", first_order.covariance, first_order.covariance))
        np.testing.assert_allclose(
            real.covariance / scale, first_order.covariance / scale, atol=0.11
        )
        assert (real.volume < first_order.volume * 1.002).all()
        np.testing.assert_allclose(real.volume, first_order.volume, rtol=0.03)


def test_a_left_out_cause_may_be_correlated() -> None:
    names, correlation = (
        ("d3", "a2", "thermal_expansion"),
        np.array([[1, 0.5, 0.8], [0.5, 1, 0.4], [0.8, 0.4, 1]]),
    )
    model = with_covariance(names, (2e-5, 2e-5, 4e-6), correlation)
    q = some(model.arm, 2)
    cold = accuracy_volume(model, q)
    assert cold.not_included == ("thermal_expansion",)
    two = with_covariance(names[:2], (2e-5, 2e-5), correlation[:2, :2])
    np.testing.assert_allclose(cold.covariance, accuracy_volume(two, q).covariance, rtol=1e-12)


def test_two_that_are_known_only_together_are_one_line(sino6: Arm) -> None:
    q = some(sino6, 1)
    for r in (1.0, -1.0):
        sources = accuracy_volume(
            with_covariance(("a3", "d3"), (1e-3, 2e-3), np.array([[1.0, r], [r, 1.0]])), q
        ).sources
        both = [i for i, p in enumerate(sources.parameters) if p.name in ("a3", "d3")]
        line = sources.sensitivity(q)[0][:, both] @ np.array([1e-3, r * 2e-3])
        none, whole = np.sort(
            np.linalg.norm(sources.generators(sources.sensitivity(q))[0][:, both], axis=0)
        )
        assert none == pytest.approx(0.0, abs=1e-10)
        assert whole == pytest.approx(2 * np.linalg.norm(line), rel=1e-6)


def test_an_arm_file_states_what_is_known_together(calibrated: ErrorModel, tmp_path: Path) -> None:
    calibrated.save(tmp_path / "calibrated.toml")
    q = some(calibrated.arm, 2)
    read = accuracy_volume(ErrorModel.load(tmp_path / "calibrated.toml"), q, conditions=WARM)
    np.testing.assert_allclose(
        read.covariance, accuracy_volume(calibrated, q, conditions=WARM).covariance, rtol=1e-12
    )
    assert read.sources.correlation is not None


# --- jointwise


def test_jointwise_refuses_rows_that_are_known_together(calibrated: ErrorModel) -> None:
    with pytest.raises(
        UnsupportedArmError,
        match=r"d3 and alpha4 are correlated.*'jointwise' needs independent rows",
    ):
        accuracy_volume(calibrated, np.zeros((1, 6)), conditions=WARM, method="jointwise")


def test_jointwise_takes_correlations_inside_a_row_and_causes_of_the_whole_arm() -> None:
    names = ("d3", "theta_offset3", "encoder_eccentricity:3.cos")
    correlation = np.array([[1, 0.3, 0.2], [0.3, 1, 0.7], [0.2, 0.7, 1]])
    model = with_covariance(names, U[:3], correlation)
    q = some(model.arm, 2)
    result = accuracy_volume(model, q, conditions=WARM, method="jointwise")
    generators = result.sources.generators(result.sources.sensitivity(q, WARM))
    parameters = result.sources.parameters

    def volume(g: Array) -> float:
        pairs = np.cross(g.T[:, None], g.T[None])
        return 8 / 6 * float(np.abs(pairs @ g).sum())

    for k in range(2):
        rows = {p.joint for p in parameters}
        assert None in rows  # thermal expansion
        total = sum(volume(generators[k][:, [p.joint == row for p in parameters]]) for row in rows)
        assert result.volume[k] == pytest.approx(total, rel=1e-9, abs=0.0)


# --- budget


def test_shares_sum_to_one(calibrated: ErrorModel, sino6: Arm) -> None:
    for model in (sino6, calibrated):
        result = accuracy_volume(model, some(sino6, 7), conditions=WARM, encoder_noise=1e-5)
        single = result.budget()
        for by in ("parameter", "joint", "kind"):
            table = result.budget(by)
            assert table["share"].sum() == pytest.approx(1.0, abs=1e-12)
            assert table["share"].is_monotonic_decreasing
            expected = single.groupby(by, dropna=False)["share"].sum()
            np.testing.assert_allclose(
                table["share"], expected.sort_values(ascending=False), rtol=1e-9
            )
            if model is sino6:  # independent
                together = np.sqrt(np.square(table["u_mm"]).sum())
                assert together == pytest.approx(
                    1e3 * np.sqrt(np.square(result.u).mean()), rel=1e-12
                )


def test_share_is_what_the_variance_owes_to_u(calibrated: ErrorModel) -> None:
    """Half of ∂ ln(variance) / ∂ ln(u), by differences of the whole covariance."""
    q = some(calibrated.arm, 3)
    result = accuracy_volume(calibrated, q, conditions=WARM)
    sources, table = result.sources, result.budget().set_index("parameter")
    s = sources.sensitivity(q, WARM)

    def variance(u: Array) -> float:
        return float(np.einsum("nip,pq,niq->", s, np.outer(u, u) * sources.correlation, s))

    for i, p in enumerate(sources.parameters):
        step = np.where(np.arange(len(sources.u)) == i, 1e-4, 0.0)
        ahead, behind = (np.log(variance(sources.u * (1 + sign * step))) for sign in (1, -1))
        assert table.loc[p.name, "share"] == pytest.approx((ahead - behind) / 4e-4, abs=1e-7)
        own = np.sqrt(np.square(s[:, :, i] * p.u).sum() / 3)
        assert table.loc[p.name, "u_mm"] == pytest.approx(1e3 * own, rel=1e-9)


@pytest.fixture
def opposed() -> AccuracyVolume:
    """theta_offset3 and the eccentricity of the same joint move the tip alike: at r = -0.95 they
    hide each other.
    """
    names, correlation = (
        ("theta_offset3", "encoder_eccentricity:3.cos"),
        np.array([[1, -0.95], [-0.95, 1]]),
    )
    model = with_covariance(names, (4e-5, 8e-5), correlation)
    q = some(model.arm, 1)
    q[0, 2] = 0.1
    return accuracy_volume(model, q, conditions=WARM)


def test_a_share_may_be_negative(opposed: AccuracyVolume) -> None:
    table = opposed.budget().set_index("parameter")
    assert table.loc["theta_offset3", "share"] < 0
    assert table.loc["theta_offset3", "u_mm"] > 0
    assert table["share"].sum() == pytest.approx(1.0)
    assert opposed.budget("joint").set_index("joint").loc[3, "share"] > 0


def test_bars_of_a_budget_with_negative_shares(opposed: AccuracyVolume) -> None:
    ax = plot_budget(opposed, ax=Figure().add_subplot(), most=40)
    bars = {
        text.get_text(): bar.get_width()
        for text, bar in zip(ax.get_yticklabels(), ax.patches, strict=True)
    }
    assert sum(bars.values()) == pytest.approx(100.0)
    assert ax.get_xlim()[0] < bars["theta_offset3"] < 0
    few = plot_budget(opposed, ax=Figure().add_subplot(), most=4)
    assert sum(bar.get_width() for bar in few.patches) == pytest.approx(100.0)
    assert "µm" not in few.texts[-1].get_text()  # the rest is not a sum of squares
    by_joint = plot_budget(opposed, "joint", ax=Figure().add_subplot())
    assert {"whole arm", "joint 3"} <= {text.get_text() for text in by_joint.get_yticklabels()}


def test_causes_of_the_whole_arm_have_no_joint(sino6: Arm) -> None:
    model = ErrorModel(sino6, (BaseCompliance(values=(1e-5,), u=(5e-6,)),))
    q = some(sino6, 3)
    table = accuracy_volume(model, q).budget()
    of_arm = table.set_index("parameter").loc["base_compliance", "joint"]
    assert pd.isna(of_arm)
    assert table["joint"].dtype == "Int64"
    assert set(table["joint"].dropna()) == {1, 2, 3, 4, 5, 6}
    by_joint = accuracy_volume(model, q).budget("joint")
    assert by_joint["joint"].isna().sum() == 1
    assert by_joint["share"].sum() == pytest.approx(1.0)


def test_an_uncertainty_that_cannot_be_squared_is_none() -> None:
    known = Covariance(
        parameters=("d1", "d3"), standard_uncertainty_si=(1e-300, 1e-6), correlation=((), (0.5,))
    )
    arm = Arm.from_file(load_arm_file("sino6").model_copy(update={"covariance": known}))
    sources = accuracy_volume(arm, np.zeros((1, 6))).sources
    names = [parameter.name for parameter in sources.parameters]
    assert "d3" in names
    assert "d1" not in names
    assert sources.axes is None
