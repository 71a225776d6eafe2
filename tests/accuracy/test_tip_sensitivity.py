"""Accuracy of extended models and of parameters that are known together, against models that are
built anew for each draw, central differences, and identities of covariance matrices.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from aacmm_pin._support.arrays import ROWS_PER_BATCH, Array
from aacmm_pin.accuracy.parameter_draws import exact_positions
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.accuracy.volume import accuracy_volume
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import Covariance, load_arm_file
from aacmm_pin.effects import (
    EncoderEccentricity,
    ErrorModel,
    JointHysteresis,
    LinkBending,
    SeatError,
    StylusOffset,
    ThermalExpansion,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from tests.arm_files import changed
from tests.oracle import close, postures, with_dh_errors, zonotope_volume

WARM = Conditions(1, temperature=np.array([31.0]))
EFFECTS = (
    LinkBending(link=3, values=(5e-5,), u=(2e-5,)),
    EncoderEccentricity(joint=3, values=(1e-4, 5e-5), u=(6e-5, 4e-5)),
    ThermalExpansion(values=(2.2e-5,), u=(4e-6,)),
)
TOGETHER = ("d3", "theta_offset3", "alpha4", "encoder_eccentricity:3.cos", "link_bending:3")
U = (2e-5, 4e-5, 3e-5, 6e-5, 2e-5)


@pytest.fixture(scope="session")
def extended(sino6) -> ErrorModel:
    return ErrorModel(sino6, EFFECTS)


def with_covariance(names: tuple[str, ...], u: tuple[float, ...], correlation: Array) -> ErrorModel:
    """The extended model of an arm of which some parameters are known together."""
    lower = tuple(tuple(float(r) for r in row[:i]) for i, row in enumerate(correlation))
    known = Covariance(parameters=names, standard_uncertainty_si=u, correlation=lower)
    return ErrorModel(changed("sino6", covariance=known), EFFECTS)


def random_correlation(p: int, rng: np.random.Generator) -> Array:
    factor = rng.normal(size=(p, p + 1))
    matrix = factor @ factor.T
    scale = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(scale, scale))


@pytest.fixture
def calibrated(rng) -> ErrorModel:
    return with_covariance(TOGETHER, U, random_correlation(len(U), rng))


def rebuilt(model: ErrorModel, errors: dict[str, float], q: Array, conditions: Conditions) -> Array:
    """Position of an arm made anew from a table, effects and readings that are off by
    ``errors``.
    """

    def off(names: Iterable[str]) -> Array:
        return np.array([errors.get(name, 0.0) for name in names])

    arm = with_dh_errors(load_arm_file("sino6"), off(p.name for p in model.arm.parameters))
    effects = [e.at(tuple(e.values + off(p.name for p in e.parameters()))) for e in model.effects]
    read = q + off(f"encoder_noise{j}" for j in range(1, 7))
    return np.asarray(ErrorModel(arm, tuple(effects)).predict(read, conditions)[0])


def by_differences(sources: ErrorSources, q: Array) -> Array:
    """Sensitivity (3, p) by central differences of models made anew."""
    columns = []
    for p in sources.parameters:
        step = max(p.u, 1e-7)
        ahead, behind = (rebuilt(sources.model, {p.name: s * step}, q, WARM) for s in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.array(columns).T


# --- extended models


def test_exact_positions_are_those_of_models_made_anew(extended, rng):
    """But for the change of the sag and the warmth by the errors, some 5e-4 of these."""
    q = postures(extended.arm, rng, 1)
    sources = accuracy_volume(extended, q, conditions=WARM, encoder_noise=1e-5).sources
    names = [p.name for p in sources.parameters]
    errors = 2 * rng.normal(size=(12, len(names))) * sources.u
    each = [rebuilt(extended, dict(zip(names, e, strict=True)), q, WARM) for e in errors]
    found = exact_positions(sources, q, WARM, errors)
    close(found, np.array(each), 1e-7)
    many = np.vstack([np.zeros((ROWS_PER_BATCH, len(names))), errors])
    close(exact_positions(sources, q, WARM, many)[ROWS_PER_BATCH:], found, 1e-14)


def test_the_wrist_does_not_feel_the_stylus(sino6):
    model = ErrorModel(sino6, (StylusOffset(values=(0.05, 0.0, 0.02), u=(1e-4,) * 3),))
    q = postures(sino6, np.random.default_rng(5), 3)
    wrist, alone = (accuracy_volume(m, q, at="frame5") for m in (model, sino6))
    np.testing.assert_allclose(wrist.covariance, alone.covariance, rtol=1e-9, atol=1e-20)
    tip, alone = (accuracy_volume(m, q) for m in (model, sino6))
    assert (tip.u**2 > alone.u**2 + 2.9e-8).all()


# --- conditions


def test_causes_without_their_conditions_are_left_out_and_named(extended):
    q = postures(extended.arm, np.random.default_rng(5), 4)
    cold = accuracy_volume(extended, q)
    assert cold.not_included == ("thermal_expansion",)
    assert str(cold).endswith(" thermal_expansion")
    without = ErrorModel(extended.arm, EFFECTS[:2])
    expected = accuracy_volume(without, q)
    np.testing.assert_allclose(cold.covariance, expected.covariance, rtol=1e-12)
    np.testing.assert_allclose(cold.volume, expected.volume, rtol=1e-12)
    seat = SeatError(seat="A", values=(1e-3, 0, 0), u=(1e-3,) * 3)  # the reference has no part
    worn = accuracy_volume(without.with_effects(seat), q)
    np.testing.assert_array_equal(worn.volume, expected.volume)
    assert expected.not_included == accuracy_volume(extended, q, conditions=WARM).not_included == ()


def test_conditions_of_one_record_hold_for_all(extended):
    q = postures(extended.arm, np.random.default_rng(5), 5)
    each = Conditions(5, temperature=np.array([15.0, 20.0, 25.0, 30.0, 35.0]))
    same = accuracy_volume(extended, q, conditions=WARM)
    repeated = accuracy_volume(extended, q, conditions=WARM.take([0] * 5))
    np.testing.assert_array_equal(same.volume, repeated.volume)
    assert same.budget().set_index("parameter").loc["thermal_expansion", "share"] > 0.01
    with pytest.raises(ShapeError, match="conditions have 3 records; expected 5"):
        accuracy_volume(extended, q, conditions=each.take([0, 1, 2]))


def test_nothing_is_left(zero6):
    model = ErrorModel(zero6, (JointHysteresis(joint=2, u=(1e-5,)),))
    with pytest.raises(AacmmError, match="without joint_hysteresis:2"):
        accuracy_volume(model, np.zeros((1, 6)))
    assert accuracy_volume(model, np.empty((0, 6))).volume.shape == (0,)


def test_an_arm_that_came_without_its_effects_says_so(calibrated, tmp_path):
    q = np.zeros((1, 6))
    path = tmp_path / "extended.toml"
    ErrorModel(Arm.load("sino6"), (*EFFECTS, SeatError(seat="A"))).save(path)
    alone = accuracy_volume(Arm.load(path), q)
    assert alone.not_included == ("link_bending:3", "encoder_eccentricity:3", "thermal_expansion")
    assert accuracy_volume(ErrorModel(Arm.load(path)), q).not_included == ()
    with pytest.raises(AacmmError, match=r"encoder_eccentricity:3\.cos.*ErrorModel.load"):
        accuracy_volume(calibrated.arm, q)


# --- parameters that are known together


def test_covariance_with_correlations(calibrated):
    q = postures(calibrated.arm, np.random.default_rng(5), 1)
    result = accuracy_volume(calibrated, q, conditions=WARM, encoder_noise=1e-5)
    sources, known = result.sources, calibrated.arm.file.covariance
    names = [p.name for p in sources.parameters]
    where = [names.index(name) for name in known.parameters]
    c = np.diag(sources.u**2)
    c[np.ix_(where, where)] = known.matrix_of_correlation() * np.outer(U, U)
    s = by_differences(sources, q)
    within = {"rtol": 5e-3, "atol": 2e-3 * result.u[0] ** 2}
    np.testing.assert_allclose(result.covariance[0], s @ c @ s.T, **within)
    s = sources.sensitivity(q, WARM)[0]
    np.testing.assert_allclose(result.covariance[0], s @ c @ s.T, rtol=1e-10, atol=1e-20)


def test_monte_carlo_of_effects_and_with_correlations(extended, calibrated, rng):
    for model, noise in ((extended, 2e-5), (calibrated, None)):
        q = postures(model.arm, np.random.default_rng(5), 1)
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
        close(real.covariance / scale, first_order.covariance / scale, 0.11)
        assert (real.volume < first_order.volume * 1.002).all()
        np.testing.assert_allclose(real.volume, first_order.volume, rtol=0.03)


def test_two_that_are_known_only_together_are_one_line(sino6):
    q = postures(sino6, np.random.default_rng(5), 1)
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


# --- jointwise


def test_jointwise_refuses_rows_that_are_known_together(calibrated):
    with pytest.raises(
        UnsupportedArmError,
        match=r"d3 and alpha4 .*are correlated.*'jointwise'",
    ):
        accuracy_volume(calibrated, np.zeros((1, 6)), conditions=WARM, method="jointwise")


def test_jointwise_takes_correlations_inside_a_row_and_causes_of_the_whole_arm():
    names = ("d3", "theta_offset3", "encoder_eccentricity:3.cos")
    correlation = np.array([[1, 0.3, 0.2], [0.3, 1, 0.7], [0.2, 0.7, 1]])
    model = with_covariance(names, U[:3], correlation)
    q = postures(model.arm, np.random.default_rng(5), 2)
    result = accuracy_volume(model, q, conditions=WARM, method="jointwise")
    generators = result.sources.generators(result.sources.sensitivity(q, WARM))
    joints = [p.joint for p in result.sources.parameters]
    assert None in joints  # thermal expansion
    for k in range(2):
        rows = [generators[k][:, [joint == row for joint in joints]] for row in set(joints)]
        assert result.volume[k] == pytest.approx(sum(map(zonotope_volume, rows)), rel=1e-9, abs=0)


# --- budget


def test_shares_of_a_budget_sum_to_one(calibrated, sino6):
    for model in (sino6, calibrated):
        q = postures(sino6, np.random.default_rng(5), 7)
        result = accuracy_volume(model, q, conditions=WARM, encoder_noise=1e-5)
        single = result.budget()
        for by in ("parameter", "joint", "kind"):
            table = result.budget(by)
            assert table["share"].sum() == pytest.approx(1.0, abs=1e-12)
            expected = single.groupby(by, dropna=False)["share"].sum()
            expected = expected.sort_values(ascending=False)
            np.testing.assert_allclose(table["share"], expected, rtol=1e-9)
            if model is sino6:  # independent
                mean = 1e6 * np.square(result.u).mean()
                assert np.square(table["u_mm"]).sum() == pytest.approx(mean, rel=1e-12)


def test_share_is_what_the_variance_owes_to_u(calibrated):
    """Half of ∂ ln(variance) / ∂ ln(u), by differences of the whole covariance."""
    q = postures(calibrated.arm, np.random.default_rng(5), 3)
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
