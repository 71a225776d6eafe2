"""The pictures of the documentation, drawn by the package itself from measurements of a virtual
arm.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin import (
    AccuracyVolume,
    Arm,
    ConfigurationCircle,
    Diagnosis,
    ErrorModel,
    ReachingPostures,
    circle_accuracy,
    configuration_circle,
    diagnose,
    map_workspace,
    reaching_postures,
    simulate_measurements,
)
from aacmm_pin.effects import EncoderEccentricity, LinkBending
from aacmm_pin.report import plots
from aacmm_pin.report.scenes import circle_scene
from building.drawings import flow_of_files, kinds_of_references, labelled_arm

POINT = np.array([400.0, 0.0, 300.0]) * 1e-3
NOISE = 8e-6


@cache
def _at_the_point() -> tuple[ConfigurationCircle, AccuracyVolume]:
    circle = configuration_circle(Arm.load("sino6"), POINT)
    return circle, circle_accuracy(circle)


@cache
def _diagnosed() -> Diagnosis:
    arm = Arm.load("sino6")
    hidden = (EncoderEccentricity(4, values=(1.1e-4, 1.0e-4)), LinkBending(3, values=(6e-5,)))
    data = simulate_measurements(ErrorModel(arm, hidden), "free", 200, rng=np.random.default_rng(4))
    return diagnose(arm, data, encoder_noise=NOISE)


PICTURES: dict[str, Callable[[], Axes | Figure]] = {
    "arm.png": labelled_arm,
    "files.png": flow_of_files,
    "references.png": kinds_of_references,
    "error_budget.png": lambda: plots.plot_error_budget(_diagnosed()),
    "circle.png": lambda: plots.plot_circle(*_at_the_point()),
    "swivel.png": lambda: plots.plot_accuracy_of_postures(*_at_the_point()),
    "budget.png": lambda: plots.plot_budget(_at_the_point()[1]),
    "map.png": lambda: plots.plot_map(
        map_workspace(Arm.load("sino6"), (24, 24), 12, progress=False)
    ),
    "groups.png": lambda: plots.plot_groups(_diagnosed()),
    "cause.png": lambda: plots.plot_cause(_diagnosed(), _diagnosed().findings[1]),
    "held_out.png": lambda: plots.plot_held_out(_diagnosed()),
}


def draw(folder: Path) -> None:
    """Every picture that ``folder`` does not have yet."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"backend": "Agg", "figure.max_open_warning": 0}):
        for name, drawn in PICTURES.items():
            if not (folder / name).exists():
                drawn().figure.savefig(folder / name, dpi=130, bbox_inches="tight")


def _self_motion() -> ReachingPostures:
    pointing_down = np.diag([1.0, -1.0, -1.0])
    place = np.array([400.0, 100.0, 500.0]) * 1e-3
    return reaching_postures(Arm.load("panda"), place, rotation=pointing_down)


def draw_scenes(folder: Path) -> None:
    """The pages of the scenes in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    circle_scene(*_at_the_point()).save(folder / "circle.html", force=True)
    circle_scene(_self_motion()).save(folder / "self_motion.html", force=True)
