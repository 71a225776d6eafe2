"""Pictures of calibrations: units on every axis, what is drawn and how large, refusals, no pyplot state."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.effects import EncoderEccentricity, JointCompliance, ThermalExpansion
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.report.calibration_findings import (
    causes_in_words,
    comment,
    decimals,
    fit_in_words,
    frame_in_words,
    parameter_table,
    readable_parameters,
    small_unit,
    stated_half_widths,
    verdict,
)
from aacmm_pin.report.plots import (
    BLUE,
    VERMILLION,
    plot_calibration,
    plot_correlation,
    plot_normalised_residuals,
    plot_parameter_changes,
    plot_residual_sizes,
    plot_residual_vectors,
    plot_residuals_by_seat,
    plot_residuals_over_joint,
    plot_residuals_over_joints,
)

mpl.use("Agg")

WAVE = EncoderEccentricity(joint=3, values=(2e-4, 0.0))
READINGS = 8e-6


def with_slips(data: Measurements, rows: list[int]) -> Measurements:
    q = data.q.copy()
    q[rows, 1] += 2e-3
    return replace(data, q=q)


@pytest.fixture(scope="module")
def at_seats(sino6: Arm) -> Calibration:
    """SINO6 drawn anew, 120 records at twelve seats, two of them slips."""
    true = perturbed_model(ErrorModel(sino6), np.random.default_rng(1))
    data = simulate_measurements(true, "seats", 120, seats=12, rng=np.random.default_rng(1))
    return calibrate(sino6, with_slips(data, [3, 50]), encoder_noise=READINGS, hold_out=False)


@pytest.fixture(scope="module")
def with_wave(sino6: Arm) -> Calibration:
    """SINO6 with an eccentric encoder 3 that the calibration does not know of, free records."""
    data = simulate_measurements(ErrorModel(sino6, (WAVE,)), "free", 200, rng=np.random.default_rng(2))
    return calibrate(sino6, data, encoder_noise=READINGS, hold_out=False)


@pytest.fixture(scope="module")
def of_robot(robot_file: Callable[[str], Path]) -> Calibration:
    """UR5, whose placements nobody states and many of which cannot be told."""
    arm = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    steps = np.random.default_rng(3).normal(0.0, 2e-4, (6, 6))
    data = simulate_measurements(arm.with_placements(steps, None), "free", 80, rng=np.random.default_rng(4))
    return calibrate(arm, data, encoder_noise=READINGS, hold_out=False)


def drawn(figure: Any) -> None:
    figure.canvas.draw()


def labels(ax: Any) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


# Residuals --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("when", ["before", "after"])
def test_vectors_are_as_long_as_the_title_says(at_seats: Calibration, when: str) -> None:
    ax = plot_residual_vectors(at_seats, when, "xz")
    drawn(ax.figure)
    assert labels(ax) == ("x [mm]", "z [mm]")
    assert ax.get_aspect() == 1.0
    title = ax.get_title()
    factor = float(title[title.index("magnified ") + 10 : -1])
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
    ends = np.array(lines.get_segments())
    used = at_seats.fit.used
    assert len(ends) == used.sum() == 118
    table = at_seats.residuals[used]
    expected = table[[f"x_{when}_mm", f"z_{when}_mm"]].to_numpy()
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], factor * expected, rtol=1e-6, atol=1e-6)
    tips = at_seats.fit.problem.model.predict(at_seats.fit.problem.measurements.q)[used] / MM
    assert np.abs(ends[:, 0] - tips[:, [0, 2]]).max() < 0.5
    low, high = ax.get_xlim()
    assert low < ends[:, :, 0].min()
    assert ends[:, :, 0].max() < high


def test_the_scale_bar_is_as_long_as_it_says(at_seats: Calibration) -> None:
    ax = plot_residual_vectors(at_seats)
    title = ax.get_title()
    factor = float(title[title.index("magnified ") + 10 : -1])
    (text,) = (t.get_text() for t in ax.texts if t.get_text().endswith(" mm"))
    bar = next(line for line in ax.lines if line.get_marker() == "|")
    assert np.ptp(bar.get_xdata()) == pytest.approx(factor * float(text.removesuffix(" mm")))


def test_excluded_records_are_crosses(at_seats: Calibration) -> None:
    assert list(at_seats.excluded["row"]) == [5, 52]
    ax = plot_residual_vectors(at_seats)
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["target", "2 excluded"]
    ax = plot_residuals_by_seat(at_seats)
    drawn(ax.figure)
    off = [line for line in ax.lines if line.get_marker() == "^" and len(line.get_xdata())]
    assert sum(len(line.get_xdata()) for line in off) == 4  # before and after, off the scale of the others
    top = ax.get_ylim()[1]
    table = at_seats.residuals[at_seats.fit.used]
    assert table["before_mm"].max() < top < 2 * table["before_mm"].max()


def test_seats_stand_in_their_order(at_seats: Calibration) -> None:
    ax = plot_residuals_by_seat(at_seats)
    drawn(ax.figure)
    assert labels(ax) == ("seat", "distance of tip and target [mm]")
    assert [tick.get_text() for tick in ax.get_xticklabels()] == [f"S{k}" for k in range(1, 13)]
    dots = [line for line in ax.lines if line.get_marker() == "." and to_hex(line.get_color()) == BLUE]
    assert sum(len(line.get_xdata()) for line in dots) == 118


def test_records_without_seats_have_no_strip(with_wave: Calibration) -> None:
    with pytest.raises(AacmmError, match="no seat"):
        plot_residuals_by_seat(with_wave)


def test_a_wave_of_an_encoder_shows_over_its_joint_alone(with_wave: Calibration) -> None:
    panels = plot_residuals_over_joints(with_wave)
    drawn(panels[0].figure)
    assert [ax.get_xlabel() for ax in panels] == [f"joint {j} [°]" for j in range(1, 7)]
    assert panels[0].get_ylabel() == "residual [µm]"
    heights = []
    for ax in panels:
        (means,) = (c[0] for c in ax.containers)
        x, y = np.deg2rad(means.get_xdata()), means.get_ydata()
        columns = np.column_stack([np.cos(x), np.sin(x), np.ones_like(x)])
        heights.append(np.hypot(*np.linalg.lstsq(columns, y, rcond=None)[0][:2]))
    assert np.argmax(heights) == 2
    assert heights[2] > 3 * np.median(heights)


def test_residuals_along_a_joint_are_those_of_its_angle(with_wave: Calibration) -> None:
    ax = plot_residuals_over_joint(with_wave, 2)
    (dots,) = (line for line in ax.lines if line.get_marker() == ".")
    records, fit = with_wave.fit.problem.measurements, with_wave.fit
    motion = with_wave.model.arm.jacobian(records.q)[:, :, 1]
    along = np.einsum("ni,ni->n", fit.solution.system.deviation, motion) / np.linalg.norm(motion, axis=1)
    np.testing.assert_allclose(dots.get_ydata(), along[fit.used] * 1e6, rtol=1e-9)
    np.testing.assert_allclose(dots.get_xdata(), np.rad2deg(records.q[fit.used, 1]), rtol=1e-12)


def test_a_turned_reference_frame_makes_no_difference_to_a_joint(sino6: Arm) -> None:
    data = simulate_measurements(ErrorModel(sino6, (WAVE,)), "free", 100, rng=np.random.default_rng(2))
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turned = replace(data, reference=data.reference @ turn.T)
    along = []
    for records in (data, turned):
        result = calibrate(
            sino6, records, "zero-offsets", reference_frame="external", encoder_noise=READINGS, hold_out=False
        )
        ax = plot_residuals_over_joint(result, 3)
        along.append(next(line.get_ydata() for line in ax.lines if line.get_marker() == "."))
    np.testing.assert_allclose(along[0], along[1], atol=0.01)


def test_a_joint_whose_axis_goes_through_the_tip_says_so(robot_file: Callable[[str], Path]) -> None:
    ur5 = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    data = simulate_measurements(ErrorModel(ur5), "free", 80, rng=np.random.default_rng(2))
    result = calibrate(ur5, data, "zero-offsets", hold_out=False)
    for joint, still in ((5, False), (6, True)):
        texts = [text.get_text() for text in plot_residuals_over_joint(result, joint).texts]
        assert texts == (["does not move the tip"] if still else [])


def test_normalised_residuals_follow_chi(at_seats: Calibration) -> None:
    ax = plot_normalised_residuals(at_seats)
    drawn(ax.figure)
    assert labels(ax) == ("normalised residual [1]", "density [1]")
    assert ax.get_legend().get_texts()[0].get_text() == "118 records used"
    area = sum(p.get_width() * p.get_height() for p in ax.patches)
    assert area == pytest.approx(1.0)


def test_sizes_hold_every_record(at_seats: Calibration) -> None:
    ax = plot_residual_sizes(at_seats)
    drawn(ax.figure)
    assert labels(ax) == ("distance of tip and target [mm]", "records [1]")
    for container in ax.containers:
        assert sum(p.get_height() for p in container) == 118
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == [f"before, RMS {at_seats.rms_before / MM:.4f} mm", f"after, RMS {at_seats.rms / MM:.4f} mm"]


# Parameters -------------------------------------------------------------------------------------------------------------


def test_changes_stand_over_what_was_stated(at_seats: Calibration) -> None:
    ax = plot_parameter_changes(at_seats)
    drawn(ax.figure)
    assert ax.get_xlabel() == "change / stated ± [1]; bars: U (k = 2)"
    table = parameter_table(at_seats)
    assert [tick.get_text() for tick in ax.get_yticklabels()] == list(table["parameter"])
    points = [float(c[0].get_xdata()[0]) for c in ax.containers]
    np.testing.assert_allclose(points, table["change"] / table["stated"], rtol=1e-9)
    colours = [to_hex(c[0].get_color()) for c in ax.containers]
    assert colours == [VERMILLION if beyond else BLUE for beyond in table["beyond"]]
    assert ax.get_ylim()[0] > ax.get_ylim()[1]  # first on top


def test_without_stated_uncertainties_changes_stand_in_small_units(of_robot: Calibration) -> None:
    ax = plot_parameter_changes(of_robot)
    drawn(ax.figure)
    assert ax.get_xlabel() == "change [µm, µrad]; bars: U (k = 2)"
    assert "open: known only in combination" in ax.get_title()
    points = [float(c[0].get_xdata()[0]) for c in ax.containers]
    np.testing.assert_allclose(points, readable_parameters(of_robot)["change"], rtol=1e-9)
    open_ = [to_hex(c[0].get_markerfacecolor()) == "#ffffff" for c in ax.containers]
    assert open_ == list(of_robot.parameters["known"] == "in combination")


def test_parameters_without_a_stated_uncertainty_are_counted(sino6: Arm) -> None:
    data = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(2))
    result = calibrate(sino6, data, ["geometry", EncoderEccentricity(3)], encoder_noise=READINGS, hold_out=False)
    ax = plot_parameter_changes(result)
    assert "2 without a stated uncertainty are not shown" in ax.get_title()
    assert len(ax.containers) == 21


def test_correlation_hides_what_is_not_told(of_robot: Calibration, at_seats: Calibration) -> None:
    ax = plot_correlation(of_robot)
    drawn(ax.figure)
    (image,) = ax.images
    assert image.get_clim() == (-1, 1)
    hidden = np.ma.getmaskarray(image.get_array())
    names = list(of_robot.correlation.index)
    assert [names[i] for i in np.flatnonzero(hidden.all(axis=0))] == ["ry6"]
    assert "correlation [1]" in [other.get_ylabel() for other in ax.figure.axes]
    whole = plot_correlation(at_seats).images[0].get_array()
    assert not np.ma.getmaskarray(whole).any()
    np.testing.assert_allclose(np.diag(whole), 1.0)


def test_everything_in_one_picture(at_seats: Calibration) -> None:
    panels = plot_calibration(at_seats)
    drawn(panels[0].figure)
    assert list(panels[0].figure.axes) == list(panels)
    assert [ax.get_xlabel() for ax in panels] == [
        "x [mm]",
        "x [mm]",
        "distance of tip and target [mm]",
        "normalised residual [1]",
        "change / stated ± [1]; bars: U (k = 2)",
    ]


def test_panels_take_the_place_of_axes_or_an_array_of_them(at_seats: Calibration) -> None:
    figure = Figure(layout="constrained")
    left, right = figure.subplots(1, 2)
    panels = plot_residuals_over_joints(at_seats, ax=right)
    figure.canvas.draw()
    assert right not in figure.axes
    assert list(figure.axes) == [left, *panels]
    assert min(ax.get_position().x0 for ax in panels) > left.get_position().x1  # in its place, and nowhere else
    for limits in (ax.get_ylim() for ax in panels):  # one scale
        assert limits == panels[0].get_ylim()

    own = Figure().subplots(2, 4)
    assert list(plot_residuals_over_joints(at_seats, ax=own)) == list(own.ravel()[:6])
    with pytest.raises(AacmmError, match="ax holds 4 axes, expected 6"):
        plot_residuals_over_joints(at_seats, ax=Figure().subplots(2, 2))
    with pytest.raises(AacmmError, match="no place in a grid"):
        plot_calibration(at_seats, Figure().add_axes((0.1, 0.1, 0.8, 0.8)))
    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    "plot",
    [
        plot_residual_vectors,
        plot_residuals_by_seat,
        plot_normalised_residuals,
        plot_residual_sizes,
        plot_parameter_changes,
        plot_correlation,
        lambda result, ax: plot_residuals_over_joint(result, 1, ax=ax),
    ],
)
def test_given_axes_are_drawn_on(at_seats: Calibration, plot: Callable[..., Any]) -> None:
    ax = Figure().add_subplot()
    assert plot(at_seats, ax=ax) is ax
    assert plt.get_fignums() == []


def test_what_cannot_be_drawn_is_refused(at_seats: Calibration) -> None:
    with pytest.raises(AacmmError, match=r"plane is 'zz', expected 'xy', 'xz' or 'yz'"):
        plot_residual_vectors(at_seats, plane="zz")  # type: ignore[arg-type]
    with pytest.raises(AacmmError, match=r"when is 'later'"):
        plot_residual_vectors(at_seats, "later")  # type: ignore[arg-type]
    with pytest.raises(AacmmError, match=r"joint is 7, SINO6 has 1 to 6"):
        plot_residuals_over_joint(at_seats, 7)


# What is said of them ---------------------------------------------------------------------------------------------------


def test_stated_half_widths_are_those_of_the_arm(at_seats: Calibration, of_robot: Calibration, sino6: Arm) -> None:
    widths = {p.name: p.half_width for p in sino6.parameters}
    expected = [widths[p.name] for p in at_seats.fit.problem.parameters]
    np.testing.assert_allclose(stated_half_widths(at_seats), np.array(expected, dtype=float))
    assert np.isnan(stated_half_widths(of_robot)).all()


def test_stated_uncertainties_of_causes_count_twice(with_wave: Calibration, sino6: Arm) -> None:
    known = EncoderEccentricity(3, values=(2e-4, 0.0), u=(1e-5, 2e-5))
    data = with_wave.fit.problem.measurements
    result = calibrate(sino6, data, [known], encoder_noise=READINGS, hold_out=False)
    np.testing.assert_allclose(stated_half_widths(result), [2e-5, 4e-5])


def test_a_parameter_is_beyond_where_both_uncertainties_together_are_exceeded(sino6: Arm) -> None:
    assert sino6.file is not None
    rows = list(sino6.file.joints)
    rows[3] = rows[3].model_copy(update={"d_mm": rows[3].d_mm + 0.1})  # stated: within 0.016
    true = Arm.from_file(sino6.file.model_copy(update={"joints": rows}))
    data = simulate_measurements(true, "free", 150, rng=np.random.default_rng(2))
    result = calibrate(sino6, data, encoder_noise=READINGS, hold_out=False)
    table = parameter_table(result)
    assert list(table.loc[table["beyond"], "parameter"]) == ["d4"]
    assert VERMILLION in [to_hex(c[0].get_color()) for c in plot_parameter_changes(result).containers]


def test_the_fit_is_judged_in_words(at_seats: Calibration, with_wave: Calibration, sino6: Arm) -> None:
    assert fit_in_words(at_seats).startswith("The residuals are what the stated noise explains: χ² = ")
    assert "larger than the stated noise explains" in fit_in_words(with_wave)
    data = with_wave.fit.problem.measurements
    loud = calibrate(sino6, data, encoder_noise=1e-3, hold_out=False)
    assert "The noise is stated too large" in fit_in_words(loud)
    silent = replace(data, reference_u=np.full_like(data.reference_u, np.nan))
    assert "cannot judge" in fit_in_words(calibrate(sino6, silent, encoder_noise=READINGS, hold_out=False))


def test_the_verdict_goes_by_what_was_held_out(at_seats: Calibration, sino6: Arm) -> None:
    assert "nothing was held out, so this may flatter" in verdict(at_seats)
    data = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(5))
    needless = calibrate(sino6, data, encoder_noise=READINGS)
    assert verdict(needless).startswith("Calibration does not help SINO6: blocks of joint space it never saw are off by ")
    true = perturbed_model(ErrorModel(sino6), np.random.default_rng(1))
    data = simulate_measurements(true, "free", 60, rng=np.random.default_rng(5))
    helpful = calibrate(sino6, data, encoder_noise=READINGS)
    assert verdict(helpful).startswith("Calibration helps SINO6: ")
    assert f"{helpful.held_out[-1].rms_after / MM:.4f} mm after (RMS), " in verdict(helpful)


def test_causes_are_said_as_people_say_them(sino6: Arm) -> None:
    effects = (EncoderEccentricity(3, values=(1.6e-4, 1.2e-4)), ThermalExpansion(values=(2e-5,)))
    data = simulate_measurements(ErrorModel(sino6, effects), "free", 200, rng=np.random.default_rng(6))
    wanted = ["zero-offsets", EncoderEccentricity(3), ThermalExpansion()]
    result = calibrate(sino6, data, wanted, encoder_noise=READINGS, hold_out=False)
    wave, expansion = causes_in_words(result)
    said = re.fullmatch(r"encoder eccentricity of joint 3: amplitude (\S+) ± (\S+) µrad, phase (\S+) ± (\S+)°", wave)
    assert said is not None
    size, of_size, phase, of_phase = map(float, said.groups())
    assert size == pytest.approx(200.0, abs=2 * of_size)
    assert phase == pytest.approx(np.rad2deg(np.arctan2(1.2, 1.6)), abs=2 * of_phase)
    own = result.covariance[-3:-1, -3:-1]
    cos, sin = result.fit.solution.point.x[-3:-1]
    amplitude = np.hypot(cos, sin)
    gradient = np.array([cos, sin]) / amplitude
    assert of_size == pytest.approx(2e6 * np.sqrt(gradient @ own @ gradient), rel=0.05)
    assert re.match(r"thermal expansion of the arm: expansion [\d.]+ ± [\d.]+ µm/\(m·K\)", expansion)


def test_small_units() -> None:
    units = {"mm": "µm", "rad": "µrad", "rad/(N·m)": "µrad/(N·m)", "1/K": "10⁻⁶/K", "1": "10⁻⁶"}
    assert {unit: small_unit(unit)[0] for unit in units} == units
    assert small_unit("mm")[1] == 1e3
    assert small_unit("rad")[1] == 1e6


def test_values_for_reading_are_those_of_the_result(sino6: Arm) -> None:
    data = simulate_measurements(sino6, "free", 100, rng=np.random.default_rng(2))
    wanted = ["zero-offsets", ThermalExpansion(), JointCompliance(2)]
    result = calibrate(sino6, data, wanted, encoder_noise=READINGS, hold_out=False)
    table = readable_parameters(result).set_index("parameter")
    assert table.loc["theta_offset3", "value"].endswith(" rad")
    assert table.loc["thermal_expansion", "value"].endswith(" 1/K")
    expected = result.parameters.set_index("parameter")["u"] * 1e6
    np.testing.assert_allclose(table["u"], expected, rtol=1e-12)
    assert decimals(table.reset_index()).startswith("z.")


def test_decimals_show_two_digits_of_small_uncertainties(at_seats: Calibration) -> None:
    table = readable_parameters(at_seats)
    for u, form in ((123.0, "z.1f"), (1.3, "z.1f"), (0.45, "z.2f"), (0.012, "z.3f"), (0.0, "z.1f")):
        assert decimals(table.assign(u=u)) == form


def test_the_frame_is_said_only_where_it_was_unknown(sino6: Arm, at_seats: Calibration) -> None:
    assert frame_in_words(at_seats) == ""
    data = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(2))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = replace(data, reference=data.reference @ turn.T + [1.0, 2.0, 3.0])
    result = calibrate(sino6, moved, "zero-offsets", reference_frame="external", encoder_noise=READINGS, hold_out=False)
    words = frame_in_words(result)
    assert words.startswith("The base stands at (")
    assert "turned by 90.0" in words


def test_the_comment_says_what_is_not_told(of_robot: Calibration) -> None:
    text = comment(of_robot, "data.csv", "2026-01-02")
    assert text.startswith("Calibrated by aacmm-pin on 2026-01-02 (UTC) from data.csv: 80 records used, 0 excluded.")
    assert text.count("Not told by these data: ") == len(of_robot.undetermined)
