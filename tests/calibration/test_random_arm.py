"""A virtual arm drawn within the uncertainties of its file."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin import perturbed_model
from aacmm_pin.arm import Arm, Covariance
from aacmm_pin.effects import EncoderEccentricity, ErrorModel, ThermalExpansion
from tests.arm_files import changed
from tests.oracle import close

pytestmark = pytest.mark.fast


def steps(drawn: ErrorModel, model: ErrorModel) -> np.ndarray:
    return np.array(
        [a.value - b.value for a, b in zip(drawn.parameters, model.parameters, strict=True)]
    )


def test_geometry_stays_within_its_half_widths_and_fills_them(sino6):
    model = ErrorModel(sino6)
    drawn = np.array(
        [steps(perturbed_model(model, np.random.default_rng(k)), model) for k in range(60)]
    )
    widths = np.array([p.half_width for p in sino6.parameters])
    assert (np.abs(drawn) <= widths * (1 + 1e-9) + 1e-15).all()
    free = widths > 0
    assert (np.abs(drawn[:, free]).max(axis=0) > 0.8 * widths[free]).all()
    assert not drawn[:, ~free].any()


def test_the_truth_states_no_uncertainty_and_keeps_the_rest(sino6, rng):
    drawn = perturbed_model(ErrorModel(sino6), rng).arm
    assert not any(p.u for p in drawn.parameters)
    assert drawn.file.covariance is None
    np.testing.assert_array_equal(drawn.limits, sino6.limits)
    np.testing.assert_array_equal(drawn.masses, sino6.masses)
    assert drawn.source.startswith("drawn within the uncertainties of Xu You")
    q = rng.uniform(*sino6.limits.T, (20, 6))
    # Pinocchio moves with the table.
    close(drawn.poses(q).position, drawn.positions(q), 1e-12)
    assert np.abs(drawn.positions(q) - sino6.positions(q)).max() > 1e-5


def test_effects_are_drawn_by_their_own_uncertainty(sino6):
    effects = (
        EncoderEccentricity(joint=3, values=(1e-4, 0.0), u=(1e-5, 0.0)),
        ThermalExpansion(values=(2e-5,), u=(1e-6,)),
    )
    model = ErrorModel(sino6, effects)
    drawn = [perturbed_model(model, np.random.default_rng(k)).effects for k in range(200)]
    cos = np.array([e[0].values[0] for e in drawn])
    expansion = np.array([e[1].values[0] for e in drawn])
    assert all(e[0].values[1] == 0.0 for e in drawn)
    assert np.std(cos) == pytest.approx(1e-5, rel=0.2)
    assert np.mean(expansion) == pytest.approx(2e-5, rel=0.01)
    assert np.std(expansion) == pytest.approx(1e-6, rel=0.2)
    assert not any(e.u[0] for e in drawn[0])


def test_parameters_known_together_are_drawn_together(sino6):
    known = Covariance(
        parameters=("d3", "d5"), standard_uncertainty_si=(1e-5, 1e-5), correlation=((), (-0.999,))
    )
    model = ErrorModel(changed("sino6", covariance=known))
    names = [p.name for p in model.parameters]
    assert perturbed_model(model, np.random.default_rng(0)).arm.covariance is None
    drawn = np.array(
        [steps(perturbed_model(model, np.random.default_rng(k)), model) for k in range(100)]
    )
    d3, d5 = drawn[:, names.index("d3")], drawn[:, names.index("d5")]
    assert np.corrcoef(d3, d5)[0, 1] < -0.99
    assert np.std(d3 + d5) < 0.1 * np.std(d3)


def test_placements_of_a_urdf_are_drawn_within_their_half_widths(rng):
    """By Pinocchio's own placements: shifts and turns against those of the file, as logarithms."""
    half_widths = np.repeat([1e-4, 3e-4], 3)
    arm = Arm.from_urdf(
        "ur5",
        translation_half_width=half_widths[0],
        rotation_half_width=half_widths[-1],
    )
    moved = []
    for _ in range(40):
        drawn = perturbed_model(ErrorModel(arm), rng).arm
        assert not any(parameter.u for parameter in drawn.parameters)
        pairs = zip(arm.model.jointPlacements[1:], drawn.model.jointPlacements[1:], strict=True)
        moved += [pin.log6(before.actInv(after)).vector for before, after in pairs]
    size = np.abs(np.array(moved)) / half_widths
    assert size.max() < 1 + 1e-9
    assert (size.max(axis=0) > 0.95).all()
    close(size.mean(axis=0), 0.5, 0.08)
