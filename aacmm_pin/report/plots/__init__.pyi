from .accuracy_plots import plot_accuracy_of_postures, plot_budget, plot_map
from .calibration_plots import (
    plot_parameter_changes,
    plot_residuals_by_seat,
    plot_residuals_over_joint,
    plot_residuals_over_joints,
)
from .cause_plots import plot_cause, plot_diagnosis, plot_unexplained
from .circle import plot_circle
from .control_charts import plot_history
from .groups import (
    plot_error_budget,
    plot_groups,
    plot_held_out,
)
from .style import BLUE, GREY, VERMILLION

__all__ = [
    "BLUE",
    "GREY",
    "VERMILLION",
    "plot_accuracy_of_postures",
    "plot_budget",
    "plot_cause",
    "plot_circle",
    "plot_diagnosis",
    "plot_error_budget",
    "plot_groups",
    "plot_held_out",
    "plot_history",
    "plot_map",
    "plot_parameter_changes",
    "plot_residuals_by_seat",
    "plot_residuals_over_joint",
    "plot_residuals_over_joints",
    "plot_unexplained",
]
