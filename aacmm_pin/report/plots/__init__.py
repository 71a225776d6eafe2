"""Pictures of configurations, accuracy, maps, calibrations and diagnoses, with matplotlib.

Every function ``plot_…`` draws on ``ax`` and returns it; ``ax.figure`` is the picture. Without
``ax`` a new pyplot figure is made, which a notebook shows by itself and a program should close;
axes of your own ``matplotlib.figure.Figure`` leave pyplot alone. A picture of several panels
divides the place of ``ax`` among them, and returns its figure. Lengths are in mm, volumes in mm³,
uncertainties in µm, angles in degrees.

The main picture of a result is its own ``plot`` too: ``circle.plot()``, ``accuracy.plot()``,
``found.plot()``.
"""

from aacmm_pin.report.plots.accuracy import (
    plot_accuracy_of_postures,
    plot_budget,
)
from aacmm_pin.report.plots.calibration import (
    plot_correlation,
    plot_normalised_residuals,
    plot_residuals_by_seat,
    plot_residuals_over_joint,
    plot_residuals_over_joints,
)
from aacmm_pin.report.plots.causes import plot_cause, plot_diagnosis, plot_unexplained
from aacmm_pin.report.plots.circle import plot_circle
from aacmm_pin.report.plots.groups import plot_groups, plot_held_out, plot_rms
from aacmm_pin.report.plots.history import plot_history
from aacmm_pin.report.plots.maps import QUANTITIES, plot_map
from aacmm_pin.report.plots.parameter_changes import plot_geometry, plot_parameter_changes
from aacmm_pin.report.plots.residual_vectors import plot_residual_vectors, plot_residual_views
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION

__all__ = [
    "BLUE",
    "GREY",
    "INK",
    "QUANTITIES",
    "VERMILLION",
    "plot_accuracy_of_postures",
    "plot_budget",
    "plot_cause",
    "plot_circle",
    "plot_correlation",
    "plot_diagnosis",
    "plot_geometry",
    "plot_groups",
    "plot_held_out",
    "plot_history",
    "plot_map",
    "plot_normalised_residuals",
    "plot_parameter_changes",
    "plot_residual_vectors",
    "plot_residual_views",
    "plot_residuals_by_seat",
    "plot_residuals_over_joint",
    "plot_residuals_over_joints",
    "plot_rms",
    "plot_unexplained",
]
