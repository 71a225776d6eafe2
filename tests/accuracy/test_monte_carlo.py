"""Propagation of distributions, checked by first order, by closed forms, and draw by draw."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.monte_carlo import length_uncertainty, point_uncertainty, shortest_interval, symmetric_interval
from aacmm_pin.accuracy.parameter_draws import drawn_effects, parameter_errors
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import ArmFile, Covariance
from aacmm_pin.effects import EncoderEccentricity, JointCompliance, JointHysteresis, SeatError, ThermalExpansion
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel, displaced
from aacmm_pin.errors import AacmmError, MissingConditionError, ShapeError
from aacmm_pin.measurements.noise import Noise

NOISE = Noise.of(6, encoder=1e-5, probe=3e-5)
NONE = Noise.of(6, encoder=0.0, probe=0.0)
Q = np.array([[1.0, -1.2, 2.0, -1.5, 0.3, -0.4]])
FAR = np.array([[2.5, -0.7, 4.0, -2.0, -1.3, 1.4]])
DRAWS = 30_000
WITHIN = 5 * np.sqrt(2.0 / DRAWS)
"""Five standard uncertainties of a variance from as many normal draws, relative; bounded draws scatter less."""


def first_order(model: ErrorModel, q: Array, noise: Noise, conditions: Conditions | None = None) -> Array:
    """S C Sᵀ of the parameters, the encoders and the contact: (3, 3)."""
    s, jacobian = model.sensitivity(q, conditions)[0], model.arm.jacobian(q)[0]
    return np.asarray(
        s @ model.covariance() @ s.T + jacobian @ np.diag(noise.encoder**2) @ jacobian.T + noise.probe**2 * np.eye(3)
    )


def assert_covariance(found: Array, expected: Array) -> None:
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=WITHIN)


@pytest.fixture(scope="module")
def extended(sino6: Arm) -> ErrorModel:
    """Effects with uncertainties: one that is not linear, one that bends, one that needs conditions."""
    return ErrorModel(sino6).with_effects(
        EncoderEccentricity(joint=3, values=(2e-4, 1e-4), u=(3e-5, 3e-5)),
        JointCompliance(joint=2, values=(2e-5,), u=(5e-6,)),
        ThermalExpansion(values=(2e-5,), u=(3e-6,)),
        JointHysteresis(joint=5, values=(5e-5,)),
    )


def warm(n: int) -> Conditions:
    return Conditions(n, temperature=np.full(n, 23.0), approach=np.ones((n, 6)))


# --- points


def test_a_point_agrees_with_first_order(sino6: Arm, rng: np.random.Generator) -> None:
    result = point_uncertainty(sino6, Q, noise=NOISE, rng=rng, draws=DRAWS)
    expected = first_order(ErrorModel(sino6), Q, NOISE)
    assert_covariance(result.covariance, expected)
    np.testing.assert_allclose(result.estimate, sino6.positions(Q)[0], atol=1e-15)
    np.testing.assert_allclose(result.mean, result.estimate, atol=5 * result.u.max() / np.sqrt(DRAWS) + 1e-7)
    np.testing.assert_allclose(result.u, np.sqrt(np.diag(result.covariance)))
    half = 0.5 * np.ptp(result.symmetric, axis=1) / result.u
    assert ((half > 1.8) & (half < 2.0)).all()  # nearly normal: 1.96
    assert (np.ptp(result.shortest, axis=1) <= np.ptp(result.symmetric, axis=1)).all()
    assert result.draws == DRAWS


def test_effects_and_conditions_have_their_part(extended: ErrorModel, rng: np.random.Generator) -> None:
    result = point_uncertainty(extended, Q, noise=NOISE, rng=rng, draws=8_000, conditions=warm(1))
    expected = first_order(extended, Q, NOISE, warm(1))
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        result.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=5 * np.sqrt(2 / 8_000)
    )
    np.testing.assert_allclose(result.estimate, extended.predict(Q, warm(1))[0])
    assert scale.min() > np.sqrt(np.diag(first_order(ErrorModel(extended.arm), Q, NOISE))).min()


def test_any_urdf_arm(robot_file: Callable[[str], Path], rng: np.random.Generator) -> None:
    panda = Arm.from_urdf(robot_file("panda.urdf"), "panda_hand", translation_half_width=5e-5, rotation_half_width=1e-4)
    q, noise = np.array([[0.3, -0.5, 0.2, -1.8, 0.4, 1.9, 0.1]]), Noise.of(7)
    result = point_uncertainty(panda, q, noise=noise, rng=rng, draws=DRAWS)
    assert_covariance(result.covariance, first_order(ErrorModel(panda), q, noise))


def test_one_rectangular_error_has_rectangular_intervals(rng: np.random.Generator) -> None:
    """Only d of row 1, along z of the base."""
    arm = Arm.load("sino6")
    assert arm.file is not None
    rows = [row.model_copy(update={"uncertainty": None}) for row in arm.file.joints]
    widths = arm.file.joints[1].uncertainty
    assert widths is not None
    nothing = dict.fromkeys(type(widths).model_fields, 0.0)
    rows[0] = rows[0].model_copy(update={"uncertainty": widths.model_copy(update=nothing | {"d_mm": 0.02})})
    result = point_uncertainty(
        Arm.from_file(arm.file.model_copy(update={"joints": rows})), Q, noise=NONE, rng=rng, draws=DRAWS
    )
    np.testing.assert_allclose(result.u, [0, 0, 2e-5 / np.sqrt(3)], rtol=0.02, atol=1e-12)
    np.testing.assert_allclose(result.symmetric[2] - result.estimate[2], [-0.95 * 2e-5, 0.95 * 2e-5], rtol=0.02)
    assert np.ptp(result.shortest[2]) == pytest.approx(0.95 * 4e-5, rel=0.02)


@pytest.fixture(scope="module")
def calibrated(sino6: Arm) -> ErrorModel:
    """d2 and d4 are known nearly as their sum alone, and the eccentricity together with d3."""
    assert sino6.file is not None
    known = Covariance(
        parameters=("d2", "d4", "d3", "encoder_eccentricity:3.cos"),
        standard_uncertainty_si=(5e-4, 5e-4, 1e-5, 2e-5),
        correlation=((), (-0.999,), (0.0, 0.0), (0.0, 0.0, 0.8)),
    )
    file: ArmFile = sino6.file.model_copy(update={"covariance": known})
    return ErrorModel(Arm.from_file(file), (EncoderEccentricity(joint=3, values=(1e-4, 0.0)),))


def test_what_is_known_together_is_drawn_together(calibrated: ErrorModel, rng: np.random.Generator) -> None:
    errors = parameter_errors(calibrated, rng, DRAWS)
    expected, scale = calibrated.covariance(), np.sqrt(np.diag(calibrated.covariance()))
    known = scale > 0
    assert (errors[:, ~known] == 0).all()
    whitened = errors[:, known] / scale[known]
    correlation = (expected / np.where(known, scale, 1.0) / np.where(known, scale, 1.0)[:, None])[np.ix_(known, known)]
    np.testing.assert_allclose(np.cov(whitened.T), correlation, atol=WITHIN)
    names = [p.name for p, k in zip(calibrated.parameters, known, strict=True) if k]
    largest = dict(zip(names, np.abs(whitened).max(axis=0), strict=True))
    assert largest["d2"] > 3.5  # normal
    assert largest["a3"] <= np.sqrt(3.0)  # rectangular
    result = point_uncertainty(calibrated, Q, noise=NONE, rng=rng, draws=10_000)
    expected = first_order(calibrated, Q, NONE)
    np.testing.assert_allclose(result.u, np.sqrt(np.diag(expected)), rtol=0.04)


# --- draws


def test_draws_of_the_arm_are_those_of_its_table(sino6: Arm, rng: np.random.Generator) -> None:
    model = ErrorModel(sino6)
    errors = 30 * parameter_errors(model, rng, 50)
    q = rng.uniform(sino6.limits[:, 0], sino6.limits[:, 1], (50, 6))
    drawn = displaced(sino6, drawn_effects(model, errors), q, Conditions(50), sino6.chain.tip, False).position
    np.testing.assert_allclose(drawn, sino6.perturbed_positions(q, errors), atol=1e-14)


def test_draws_of_effects_are_those_effects(extended: ErrorModel, rng: np.random.Generator) -> None:
    """Draw by draw, a model with these very values."""
    errors = parameter_errors(extended, rng, 20)
    geometric = len(extended.arm.parameters)
    errors[:, :geometric] = 0.0
    errors[:, geometric : geometric + 2] *= 3000.0  # an eccentricity of a tenth of the disc: far from linear
    q = rng.uniform(extended.arm.limits[:, 0], extended.arm.limits[:, 1], (20, 6))
    effects = drawn_effects(extended, errors)
    drawn = displaced(extended.arm, effects, q, warm(20), extended.arm.chain.tip, False).position
    for k in range(20):
        own, start = [], geometric
        for effect in extended.effects:
            values = np.array(effect.values) + errors[k, start : start + len(effect.terms)]
            own.append(effect.at(values))
            start += len(effect.terms)
        one = ErrorModel(extended.arm, tuple(own)).predict(q[k : k + 1], warm(1))[0]
        np.testing.assert_allclose(drawn[k], one, atol=1e-14)
    assert [effect.label for effect in effects[geometric:]] == [effect.label for effect in extended.effects]


def test_errors_of_references_have_no_part(sino6: Arm, rng: np.random.Generator) -> None:
    model = ErrorModel(sino6).with_effects(SeatError(seat="S1", values=(1.0, 0.0, 0.0), u=(1.0, 1.0, 1.0)))
    result = point_uncertainty(model, Q, noise=NOISE, rng=rng, draws=1000)
    assert result.u.max() < 1e-3


# --- lengths


def test_a_length_agrees_with_first_order(sino6: Arm, rng: np.random.Generator) -> None:
    result = length_uncertainty(sino6, Q, FAR, noise=NOISE, rng=rng, draws=DRAWS)
    model, way = ErrorModel(sino6), (sino6.positions(Q) - sino6.positions(FAR))[0]
    length = float(np.linalg.norm(way))
    shared = (way / length) @ (sino6.sensitivity(Q) - sino6.sensitivity(FAR))[0]
    own = sum(first_order(model, q, NOISE) - first_order(model, q, NONE) for q in (Q, FAR))
    variance = shared @ model.covariance() @ shared + way @ own @ way / length**2
    assert result.u**2 == pytest.approx(variance, rel=WITHIN)
    assert result.estimate == pytest.approx(length, abs=1e-12)
    assert result.mean == pytest.approx(length, abs=5 * result.u / np.sqrt(DRAWS) + 1e-7)
    assert np.ptp(result.symmetric) == pytest.approx(2 * 1.96 * result.u, rel=0.05)
    assert result.symmetric[0] < length < result.symmetric[1]


def test_both_ends_are_measured_by_one_arm(sino6: Arm, rng: np.random.Generator) -> None:
    """Its own errors cancel in a length of nothing and nearly in a short one; encoder noise does not."""
    assert length_uncertainty(sino6, Q, Q, noise=NONE, rng=rng, draws=500).u < 1e-15
    near = Q + 0.01
    short = length_uncertainty(sino6, Q, near, noise=NONE, rng=rng, draws=1000)
    point = point_uncertainty(sino6, Q, noise=NONE, rng=rng, draws=1000)
    assert short.u < 0.1 * point.u.max()
    noisy = length_uncertainty(sino6, Q, near, noise=Noise.of(6, encoder=1e-5), rng=rng, draws=1000)
    assert noisy.u > 3 * short.u


def test_conditions_of_both_ends(extended: ErrorModel, rng: np.random.Generator) -> None:
    conditions = Conditions(2, temperature=np.array([20.0, 90.0]), approach=np.array([[1.0] * 6, [-1.0] * 6]))
    result = length_uncertainty(extended, Q, FAR, noise=NONE, rng=rng, draws=2000, conditions=conditions)
    tips = extended.predict(np.concatenate([Q, FAR]), conditions)
    assert result.estimate == pytest.approx(float(np.linalg.norm(tips[0] - tips[1])), abs=1e-15)
    assert result.mean == pytest.approx(result.estimate, abs=5 * result.u / np.sqrt(2000))
    alike = extended.predict(np.concatenate([Q, FAR]), conditions.take([0, 0]))
    assert abs(np.linalg.norm(alike[0] - alike[1]) - result.estimate) > 10 * result.u / np.sqrt(2000)


# --- intervals


def test_intervals(rng: np.random.Generator) -> None:
    """JCGM 101, 7.7: of 10 000 ordered draws the 250th and the 9750th; of 100 the 3rd and the 98th. Of an exponential
    distribution the shortest interval starts at nothing, the symmetric one leaves 2.5 % on either side.
    """
    np.testing.assert_array_equal(symmetric_interval(np.arange(1, 10_001)), [250, 9750])
    np.testing.assert_array_equal(symmetric_interval(np.arange(1, 101)[::-1]), [3, 98])
    np.testing.assert_array_equal(shortest_interval(np.array([*range(96), 200, 300, 400, 500])), [0, 95])
    draws = rng.exponential(size=400_000)
    np.testing.assert_allclose(shortest_interval(draws), [0.0, -np.log(0.05)], atol=0.03)
    np.testing.assert_allclose(symmetric_interval(draws), [-np.log(0.975), -np.log(0.025)], atol=0.03)


# --- results and messages


def test_results_are_reproducible_and_say_what_they_are(sino6: Arm) -> None:
    first, again = (point_uncertainty(sino6, Q, noise=NOISE, rng=np.random.default_rng(4), draws=500) for _ in range(2))
    np.testing.assert_array_equal(first.covariance, again.covariance)
    assert str(first).startswith("standard uncertainty of x, y, z 0.0")
    assert str(first).endswith("mm, 500 draws")
    table = first.to_frame()
    assert table["coordinate"].tolist() == ["x", "y", "z"]
    np.testing.assert_allclose(table["u_mm"], 1e3 * first.u)
    assert "u [mm]" in first._repr_html_()
    length = length_uncertainty(sino6, Q, FAR, noise=NOISE, rng=np.random.default_rng(4), draws=10_001)  # in two parts
    assert "10001 draws" in str(length)
    assert "shortest 95 % interval" in str(length)


def test_messages(sino6: Arm, zero6: Arm, extended: ErrorModel, rng: np.random.Generator) -> None:
    with pytest.raises(ShapeError, match=r"q has 2 rows, expected 1: one configuration"):
        point_uncertainty(sino6, np.concatenate([Q, Q]), noise=NOISE, rng=rng)
    with pytest.raises(ShapeError, match=r"pass q_b\[None, :\]"):
        length_uncertainty(sino6, Q, Q[0], noise=NOISE, rng=rng)
    with pytest.raises(ShapeError, match="noise is of 5 encoders, expected 6 for SINO6"):
        point_uncertainty(sino6, Q, noise=Noise.of(5), rng=rng)
    with pytest.raises(AacmmError, match="draws is 99, expected at least 100"):
        point_uncertainty(sino6, Q, noise=NOISE, rng=rng, draws=99)
    with pytest.raises(ShapeError, match="conditions are of 1 records, expected 2"):
        length_uncertainty(extended, Q, FAR, noise=NOISE, rng=rng, conditions=warm(1))
    with pytest.raises(MissingConditionError, match="needs the column temperature_c"):
        point_uncertainty(extended, Q, noise=NOISE, rng=rng)
    assert sino6.file is not None
    rows = [row.model_copy(update={"uncertainty": None}) for row in sino6.file.joints]
    exact = Arm.from_file(sino6.file.model_copy(update={"joints": rows}))
    with pytest.raises(AacmmError, match="SINO6: no parameter has an uncertainty and there is no noise"):
        point_uncertainty(exact, Q, noise=NONE, rng=rng)
