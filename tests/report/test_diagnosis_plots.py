"""Pictures of diagnoses: partial residuals give back what is hidden, by formulas of their own;
units, sizes, refusals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import (
    Conditions,
    Effect,
    EncoderEccentricity,
    EncoderSlip,
    ErrorModel,
    JointCompliance,
    JointHysteresis,
    JointPeriodicError,
    SeatError,
    StylusBending,
    ThermalExpansion,
    ZeroDrift,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.report.document import blank_axes
from aacmm_pin.report.plots import (
    plot_cause,
    plot_groups,
    plot_held_out,
    plot_unexplained,
)
from aacmm_pin.report.plots.groups import held_out_parts
from aacmm_pin.report.plots.partial_residuals import (
    partial_residual,
)

ENCODER, REFERENCE = 8e-6, 12e-6
RECORDS = 240


def measured(arm: Arm, effect: Effect, rng: np.random.Generator, external: bool) -> Measurements:
    """Records of an arm with one cause, in the base or in a frame of their own."""
    limits = np.array(
        [[0.1, 6.1], [-3.0, -0.1], [0.1, 6.1], [-3.0, -0.1], [-3.0, 3.0], [-3.0, 3.0]]
    )
    q = rng.uniform(*limits.T, (RECORDS, 6))
    seat = np.array([f"S{k % 6}" for k in range(RECORDS)], dtype=object)
    conditions = Conditions(
        RECORDS,
        time=np.sort(rng.uniform(0.0, 14400.0, RECORDS)),
        temperature=rng.uniform(17.0, 24.0, RECORDS),
        approach=rng.choice([-1.0, 1.0], (RECORDS, 6)),
        seat=seat if isinstance(effect, SeatError) else None,
    )
    model = ErrorModel(arm, (effect,))
    true = model.predict(q, conditions, as_referenced=True) + REFERENCE * rng.standard_normal(
        (RECORDS, 3)
    )
    if external:
        turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        true = true @ turn.T + [1.0, 2.0, 3.0]
    return Measurements.of(q + ENCODER * rng.standard_normal(q.shape), true, conditions=conditions)


def knowing(
    base: Diagnosis, arm: Arm, effect: Effect, external: bool = False
) -> tuple[Diagnosis, Finding]:
    """The diagnosis of an arm with one cause, named as it is: what the pictures are drawn from,
    without the search.
    """
    rng = np.random.default_rng(5)
    data = measured(arm, effect, rng, external)
    frame: Any = "external" if external else "base"
    setup = Setup(frame, encoder_noise=np.full(6, ENCODER), reference_noise=REFERENCE)

    def fitted(parameters: list[Any]) -> Any:
        return fit(problem_of(ErrorModel(arm), data, parameters, setup))

    extended = fitted(["geometry", effect.at((), tuple(3 * t.typical for t in effect.terms))])
    (found,) = (e for e in extended.effects if e.cause == effect.cause)
    finding = Finding(found, dict.fromkeys(found.file_values(), (0.0, 0.0)), 1.0, 0.0, 1.0, ())
    fits = {"before": fitted([]), "recalibrated": fitted(["geometry"]), "extended": extended}
    return replace(base, findings=(finding,), **fits), finding


def wave(amplitude: float, order: float, phase: float) -> tuple[float, float]:
    return (amplitude * np.cos(phase), amplitude * np.sin(phase))


# cause, amount over what it is drawn over (in the units of the axes), axis
CASES: list[tuple[Effect, Callable[[Array], Array], str]] = [
    (
        EncoderEccentricity(3, values=wave(2e-4, 1, 0.4)),
        lambda x: 200 * np.cos(x * DEG - 0.4),
        "joint 3 [°]",
    ),
    (
        JointPeriodicError(2, 12.0, values=wave(1.5e-4, 12, -1.0)),
        lambda x: 150 * np.cos(12 * x * DEG + 1.0),
        "joint 2, folded into one period of 30° [°]",
    ),
    (
        JointCompliance(2, values=(2e-5,)),
        lambda x: 20 * x,
        "moment of the weight about the axis [N·m]",
    ),
    (StylusBending(values=(1e-4,)), lambda x: 100 * x, "horizontal part of the stylus [1]"),
    (ThermalExpansion(values=(2e-5,)), lambda x: 20 * (x - 20), "temperature [°C]"),
    (JointHysteresis(3, values=(1.5e-4,)), lambda x: 150 * x, "direction of the last motion [1]"),
    (
        EncoderSlip(1, 6000.0, values=(-2e-4,)),
        lambda x: np.where(x < 100, 0.0, -200.0),
        "time [min]",
    ),
    (ZeroDrift(2, 3000.0, values=(2e-4,)), lambda x: 200 * (1 - np.exp(-x / 50)), "time [min]"),
]


@pytest.mark.parametrize(
    ("effect", "amount", "axis"),
    CASES,
    ids=lambda v: v.label if isinstance(v, Effect) else "",
)
def test_records_say_what_the_cause_does(sound, sino6, effect, amount, axis):
    result, finding = knowing(sound, sino6, effect)
    shown = partial_residual(result, finding.effect)
    assert shown.x_label == axis
    assert len(shown.x) > 0.9 * RECORDS
    pull = (shown.value - amount(shown.x)) / shown.u
    weight = 1 / shown.u**2
    # what geometry takes up or a prior holds back differs from the truth by a little that is common
    # to all records
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.25)
    size = np.sqrt(np.average(amount(shown.x) ** 2, weights=weight))
    assert np.sqrt(np.average((shown.fitted - amount(shown.x)) ** 2, weights=weight)) < 0.25 * size
    # and without the cause in the model the same records would be far from nothing
    assert np.sqrt(np.mean((shown.value / shown.u) ** 2)) > 1.5
    ax = plot_cause(result, finding)
    ax.figure.canvas.draw()
    assert ax.get_xlabel() == axis
    assert ax.get_ylabel().endswith(("[µrad]", "[µm]", "[µm/m]"))


@pytest.mark.parametrize(
    "external", [False, True], ids=["in the base", "in a frame of the references"]
)
def test_records_say_it_even_where_the_model_lacks_the_cause(sound, sino6, external):
    """What the model lacks is then in the residuals alone; geometry has taken up a little of it."""
    effect, amount, _ = CASES[1]
    result, finding = knowing(sound, sino6, effect, external)
    lacking = partial_residual(replace(result, extended=result.recalibrated), finding.effect.at(()))
    weight = 1 / lacking.u
    slope, middle = np.polyfit(amount(lacking.x), lacking.value, 1, w=weight)
    assert slope == pytest.approx(1.0, abs=0.15)
    assert middle == pytest.approx(0.0, abs=20.0)
    assert not lacking.fitted.any()


def test_the_error_of_a_seat_is_no_curve(sound, sino6):
    effect = SeatError("S4", values=(5e-5, -8e-5, 2e-4))
    result, finding = knowing(sound, sino6, effect)
    ax = plot_cause(result, finding)
    assert ax.get_xlabel().startswith("RMS displacement of the tip")


# Overview ------------------------------------------------------------


def test_groups_against_their_own_prediction(sound, sino6):
    """A sound arm is off as its stated uncertainties predict, and after recalibration by
    its noise.
    """
    table = sound.residual_groups
    assert table["times_predicted"].median() == pytest.approx(0.85, abs=0.45)
    assert table["times_noise"].median() == pytest.approx(1.0, abs=0.1)
    q = sound.before.problem.measurements.q
    u = np.array([p.u for p in sino6.parameters])
    spread = np.square(sino6.sensitivity(q) * u).sum(axis=(1, 2)).mean()
    joint = table[table["by"] == "joint 1"]
    predicted = np.average(joint["predicted_mm"] ** 2, weights=joint["records"])
    noise = np.average(joint["noise_mm"] ** 2, weights=joint["records"])
    assert predicted - noise == pytest.approx(spread / MM**2, rel=1e-3)
    figure = plot_groups(sound, blank_axes(9.0, 7.0))
    figure.canvas.draw()
    panels = figure.axes
    assert panels[0].get_ylabel() == "RMS residual [mm]"
    assert {ax.get_title() for ax in panels} >= {
        "joint 1",
        "joint 6",
        "time",
        "temperature",
        "session",
    }
    assert plt.get_fignums() == []


def test_parts_left_out(sound):
    held = sound.held_out
    table = held_out_parts(sound)
    assert len(table) == held.groups
    total = np.sqrt(np.average(table["extended_mm"] ** 2, weights=table["records"]))
    assert total == pytest.approx(np.sqrt(np.nanmean(held.extended**2)) / MM)
    ax = plot_held_out(sound)
    assert [bar.get_height() for bar in ax.patches] == pytest.approx(
        [*table["recalibrated_mm"], *table["extended_mm"]]
    )
    with pytest.raises(AacmmError, match="held out"):
        plot_held_out(replace(sound, held_out=None))


def test_correction_of_a_covariate(blind):
    result = blind("unexplained:humidity", seed=2, hold_out=False)
    ax, shape = plot_unexplained(result, "humidity_pct"), result.unexplained.shapes["humidity_pct"]
    np.testing.assert_allclose(ax.lines[2].get_ydata(), shape["growth_um_per_m"])
    with pytest.raises(AacmmError, match="moon"):
        plot_unexplained(result, "moon")
