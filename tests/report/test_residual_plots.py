"""Pictures of calibrations: units on every axis, what is drawn and how large, refusals, no pyplot
state.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from aacmm_pin.calibration import calibrate
from aacmm_pin.report.plots import (
    BLUE,
    VERMILLION,
    plot_parameter_changes,
    plot_residuals_over_joint,
    plot_residuals_over_joints,
)
from aacmm_pin.report.plots.calibration_plots import parameter_table
from tests.oracle import close

READINGS = 8e-6


def drawn(figure: Any) -> Any:
    figure.canvas.draw()
    return figure


def labels(ax: Any) -> tuple[str, str]:
    return ax.get_xlabel(), ax.get_ylabel()


# Residuals ------------------------------------------------------------


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
    (ax,) = drawn(plot_parameter_changes(at_seats).figure).axes
    table = parameter_table(at_seats)
    assert [tick.get_text() for tick in ax.get_yticklabels()] == list(table["parameter"])
    changes = [bar.lines[0].get_xdata()[0] for bar in ax.containers]
    np.testing.assert_allclose(changes, table["change"] / table["stated"], rtol=1e-9)
    colours = [bar.lines[0].get_color() for bar in ax.containers]
    assert colours == [VERMILLION if beyond else BLUE for beyond in table["beyond"]]


def test_without_stated_uncertainties_changes_stand_over_u(of_robot):
    (ax,) = drawn(plot_parameter_changes(of_robot).figure).axes
    table = of_robot.parameters[of_robot.parameters["known"] != "in combination"]
    changes = [bar.lines[0].get_xdata()[0] for bar in ax.containers]
    np.testing.assert_allclose(changes, table["change"] / table["U"], rtol=1e-9)
