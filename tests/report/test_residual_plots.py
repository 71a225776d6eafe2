"""Pictures of calibrations: units on every axis, what is drawn and how large, refusals, no pyplot
state.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import calibrate
from aacmm_pin.report.parameter_tables import parameter_table
from aacmm_pin.report.plots import (
    BLUE,
    VERMILLION,
    plot_correlation,
    plot_parameter_changes,
    plot_residual_vectors,
    plot_residuals_over_joint,
    plot_residuals_over_joints,
)
from tests.oracle import close

READINGS = 8e-6


def drawn(figure: Any) -> Any:
    figure.canvas.draw()
    return figure


def labels(ax: Any) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


# Residuals ------------------------------------------------------------


def test_vectors_and_their_scale_are_as_long_as_the_title_says(at_seats):
    used = at_seats.fit.used
    table = at_seats.residuals[used]
    tips = at_seats.fit.problem.model.predict(at_seats.fit.problem.measurements.q)[used] / MM
    for when, plane in (("before", "xy"), ("after", "xz"), ("after", "yz")):
        ax = plot_residual_vectors(at_seats, when, plane)
        columns = ["xyz".index(axis) for axis in plane]
        factor = float(ax.get_title().rpartition("magnified ")[2][:-1])
        (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
        ends = np.array(lines.get_segments())
        expected = table[[f"{axis}_{when}_mm" for axis in plane]].to_numpy()
        np.testing.assert_allclose(ends[:, 1] - ends[:, 0], factor * expected, rtol=1e-6, atol=1e-6)
        assert np.abs(ends[:, 0] - tips[:, columns]).max() < 0.5
        ((number, unit),) = (t.get_text().split() for t in ax.texts)
        bar = next(line for line in ax.lines if line.get_marker() == "|")
        drawn_length = factor * float(number) * {"mm": 1.0, "µm": 1e-3}[unit]
        assert np.ptp(bar.get_xdata()) == pytest.approx(drawn_length)


def test_a_wave_of_an_encoder_shows_over_its_joint_alone(with_wave):
    figure = plot_residuals_over_joints(with_wave)
    drawn(figure)
    panels = figure.axes
    heights = []
    for ax in panels:
        (means,) = (c[0] for c in ax.containers)
        x, y = np.array(means.get_data(), float)
        x = np.deg2rad(x)
        columns = np.column_stack([np.cos(x), np.sin(x), np.ones_like(x)])
        heights.append(np.hypot(*np.linalg.lstsq(columns, y, rcond=None)[0][:2]))
    assert np.argmax(heights) == 2
    assert heights[2] > 3 * np.median(heights)


def test_a_turned_reference_frame_makes_no_difference_to_a_joint(with_wave):
    data, along = with_wave.fit.problem.measurements, []
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for records in (data, replace(data, reference=data.reference @ turn.T)):
        setup = {"reference_frame": "external", "encoder_noise": READINGS, "hold_out": False}
        ax = plot_residuals_over_joint(
            calibrate(with_wave.model.arm, records, "zero-offsets", **setup), 3
        )
        along.append(next(line.get_ydata() for line in ax.lines if line.get_marker() == "."))
    close(along[0], along[1], 0.01)


# Parameters ------------------------------------------------------------


def test_changes_stand_over_what_was_stated(at_seats):
    (ax,) = drawn(plot_parameter_changes(at_seats)).axes
    table = parameter_table(at_seats)
    assert [tick.get_text() for tick in ax.get_yticklabels()] == list(table["parameter"])
    changes = [bar.lines[0].get_xdata()[0] for bar in ax.containers]
    np.testing.assert_allclose(changes, table["change"] / table["stated"], rtol=1e-9)
    colours = [bar.lines[0].get_color() for bar in ax.containers]
    assert colours == [VERMILLION if beyond else BLUE for beyond in table["beyond"]]


def test_without_stated_uncertainties_changes_stand_in_small_units(of_robot):
    figure = drawn(plot_parameter_changes(of_robot))
    for ax, (_, table) in zip(
        figure.axes, of_robot.parameters.groupby("unit", sort=False), strict=True
    ):
        factor = {"mm": 1e3, "rad": 1e6}[table["unit"].iloc[0]]
        changes = [bar.lines[0].get_xdata()[0] for bar in ax.containers]
        np.testing.assert_allclose(changes, factor * table["change"], rtol=1e-9)
        open_ = [bar.lines[0].get_markerfacecolor() == "white" for bar in ax.containers]
        assert open_ == list(table["known"] == "in combination")


def test_correlation_hides_what_is_not_told(of_robot, at_seats):
    ax = plot_correlation(of_robot)
    drawn(ax.figure)
    (image,) = ax.images
    assert image.get_clim() == (-1, 1)
    hidden = np.ma.getmaskarray(image.get_array())
    names = list(of_robot.correlation.index)
    assert [names[i] for i in np.flatnonzero(hidden.all(axis=0))] == ["ry6"]
    assert "grey" in ax.get_title()
    assert "correlation [1]" in [other.get_ylabel() for other in ax.figure.axes]
    told = plot_correlation(at_seats)
    assert "grey" not in told.get_title()
    whole = told.images[0].get_array()
    assert not np.ma.getmaskarray(whole).any()
    np.testing.assert_allclose(np.diag(whole), 1.0)
