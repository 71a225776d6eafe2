"""Drawings of words: the parts of an arm, the files between the commands, the kinds of reference
data.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch

from aacmm_pin import Arm
from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import chain
from aacmm_pin.report.arm_wireframe import ArmLines

ARM, AXIS, TEXT, SOFT = "#3b6ea5", "#c8553d", "#222222", "#8a8a8a"
BOX, FILE = "#e8eef5", "#fbf3e6"
POSTURE = np.radians([[90.0, -150.0, 0.0, 90.0, 0.0, -135.0]])
"""A posture of SINO6 in which both long tubes are seen from the side."""
SIZE = 9.0
"""Of letters [pt]."""
AXIS_LENGTH = 75.0
"""Of a joint's axis on each side [mm]."""
LABELS = {
    "joint 1": (-215, 95),
    "joint 2": (-215, 0),
    "joint 3": (-70, 240),
    "joint 4": (480, 690),
    "joint 5": (610, 610),
    "joint 6": (590, 270),
}
"""Where the label of each joint stands [mm]."""
PARTS = {
    "shoulder": ((25, -15), (160, -10)),
    "elbow": ((358, 603), (200, 690)),
    "wrist, frame5": ((790, 351), (890, 400)),
    "tube 3": ((180, 190), (245, 140)),
    "tube 5": ((600, 460), (480, 400)),
    "tube 6 with the stylus": ((810, 280), (890, 290)),
    "tip": ((828, 211), (890, 190)),
}
"""Each part, a point on it, and where its label stands [mm]."""


def labelled_arm() -> Figure:
    """SINO6 from the side, with its joints, tubes and the points that pages name."""
    arm = Arm.load("sino6")
    rotation, origin = arm.chain.walk(POSTURE)
    corners = ArmLines(arm).corners(POSTURE)[0] * 1e3
    figure = Figure(figsize=(8.0, 6.0))
    axes = figure.add_subplot(aspect="equal")
    axes.plot(corners[:, 1], corners[:, 2], color=ARM, linewidth=6, solid_capstyle="round")
    axes.plot([-120, 120], [-60, -60], color=SOFT, linewidth=8, solid_capstyle="butt")
    axes.plot([0, 0], [-60, 0], color=SOFT, linewidth=6)
    axes.plot(*corners[-1, 1:], "o", color=TEXT, markersize=6)
    for joint, (label, at) in enumerate(LABELS.items(), start=1):
        place = chain.axis(joint)
        _axis(axes, origin[place, 0] * 1e3, rotation[place, 0][:, 2], label, at)
    for label, (point, at) in PARTS.items():
        _pointed(axes, label, point, at, TEXT)
    axes.text(140, -62, "base, z up", color=SOFT, fontsize=SIZE, va="center")
    axes.set(xlim=(-300, 1200), ylim=(-110, 760), xlabel="horizontal [mm]", ylabel="z [mm]")
    axes.grid(alpha=0.25)
    return figure


def _axis(axes: Axes, origin: Array, z: Array, label: str, at: tuple[float, float]) -> None:
    """The axis of a joint: a line along a tube, or a ring where it points at the reader."""
    along = AXIS_LENGTH * z[1:]
    point = origin[1:]
    if float(np.linalg.norm(along)) > AXIS_LENGTH / 2.0:
        upwards = along * np.sign(along[1])
        ends = np.stack([point - upwards, point + upwards])
        axes.plot(*ends.T, color=AXIS, linewidth=1.8, linestyle=(0, (4, 1)), zorder=3)
        point = ends[1]
    else:
        axes.add_patch(Circle(point, 18.0, facecolor="white", edgecolor=AXIS, zorder=3))
    _pointed(axes, label, (float(point[0]), float(point[1])), at, AXIS)


def _pointed(
    axes: Axes, label: str, point: tuple[float, float], at: tuple[float, float], color: str
) -> None:
    arrow = {"arrowstyle": "-", "color": color, "linewidth": 0.8}
    axes.annotate(
        label, point, at, color=color, fontsize=SIZE, va="center", arrowprops=arrow, zorder=4
    )


FLOW = {
    "arm": (0.0, 3.0, "ARM.toml\nor URDF", FILE),
    "records": (0.0, 1.0, "DATA.csv\nreadings, references", FILE),
    "accuracy": (2.9, 4.0, "accuracy, map,\nconfigurations, show", BOX),
    "plan": (2.9, 3.0, "plan, simulate", BOX),
    "calibrate": (2.9, 2.0, "calibrate", BOX),
    "diagnose": (2.9, 1.0, "diagnose", BOX),
    "accept": (2.9, 0.0, "accept", BOX),
    "before": (5.7, 4.0, "U by posture,\nbudget, 3D scene", FILE),
    "procedure": (5.7, 3.0, "plan.csv: postures\nto measure", FILE),
    "calibrated": (5.7, 2.0, "calibrated ARM.toml", FILE),
    "extended": (5.7, 1.0, "report.html,\nextended ARM.toml", FILE),
    "verdict": (5.7, 0.0, "test report:\nconformity", FILE),
    "correct": (8.4, 1.5, "correct", BOX),
    "corrected": (10.9, 1.5, "corrected.csv", FILE),
}
"""Files and commands: middle, words, colour."""
WAYS = (
    ("arm", "accuracy"),
    ("arm", "plan"),
    ("arm", "calibrate"),
    ("records", "calibrate"),
    ("records", "diagnose"),
    ("arm", "diagnose"),
    ("records", "accept"),
    ("accuracy", "before"),
    ("plan", "procedure"),
    ("calibrate", "calibrated"),
    ("diagnose", "extended"),
    ("accept", "verdict"),
    ("calibrated", "correct"),
    ("extended", "correct"),
    ("correct", "corrected"),
)
WIDTH, HEIGHT = 2.25, 0.66
"""Of a box."""


def flow_of_files() -> Figure:
    """Which files go into each command, and which come out."""
    figure = Figure(figsize=(11.0, 4.4))
    axes = figure.add_subplot()
    for start, end in WAYS:
        (x0, y0, *_), (x1, y1, *_) = FLOW[start], FLOW[end]
        ends = {"xy": (x1 - WIDTH / 2, y1), "xytext": (x0 + WIDTH / 2, y0)}
        axes.annotate("", **ends, arrowprops={"arrowstyle": "-|>", "color": SOFT})
    for x, y, words, color in FLOW.values():
        corner = (x - WIDTH / 2, y - HEIGHT / 2)
        box = FancyBboxPatch(
            corner, WIDTH, HEIGHT, boxstyle="round,pad=0.03", facecolor=color, edgecolor=SOFT
        )
        axes.add_patch(box)
        axes.text(x, y, words, ha="center", va="center", fontsize=SIZE, color=TEXT)
    axes.set(xlim=(-1.2, 12.1), ylim=(-0.5, 4.5))
    axes.set_axis_off()
    return figure


def kinds_of_references() -> Figure:
    """Coordinates of a target, a seat that is touched in several postures, a bar of known
    length.
    """
    figure = Figure(figsize=(10.5, 3.4))
    titles = (
        "Coordinates\nx_mm, y_mm, z_mm",
        "Seat: one place, many postures\nseat",
        "Ball bar: a known length\nbar, bar_end, bar_length_mm",
    )
    drawn = (_coordinates, _seat, _bar)
    for number, (title, draw) in enumerate(zip(titles, drawn, strict=True), start=1):
        axes = figure.add_subplot(1, 3, number, aspect="equal")
        draw(axes)
        axes.set_title(title, fontsize=SIZE + 1, color=TEXT)
        axes.set(xlim=(-0.4, 4.4), ylim=(-0.5, 3.2))
        axes.set_axis_off()
    figure.tight_layout()
    return figure


def _little_arm(axes: Axes, elbow: tuple[float, float], tip: tuple[float, float]) -> None:
    """Base, elbow, tip."""
    corners = np.array([(0.0, 0.0), elbow, tip])
    axes.plot(*corners.T, color=ARM, linewidth=4, solid_joinstyle="round", alpha=0.8)
    axes.plot(*corners[:2].T, "o", color=ARM, markersize=8)
    axes.plot([-0.3, 0.3], [-0.15, -0.15], color=SOFT, linewidth=6)


def _coordinates(axes: Axes) -> None:
    _little_arm(axes, (0.9, 2.0), (2.4, 1.4))
    axes.plot(2.4, 1.4, "o", color=AXIS, markersize=11)
    axes.plot([4.0, 2.4], [0.4, 1.4], color=AXIS, linestyle=(0, (5, 3)))
    axes.plot(4.0, 0.35, "s", color=TEXT, markersize=12)
    _said(axes, 3.1, -0.1, "laser tracker or CMM")
    _said(axes, 2.5, 1.8, "target")


def _seat(axes: Axes) -> None:
    for elbow in ((0.5, 2.2), (1.4, 1.8), (2.0, 1.1)):
        _little_arm(axes, elbow, (3.0, 0.6))
    axes.plot(3.0, 0.6, "o", color=AXIS, markersize=11)
    axes.plot([2.7, 3.0, 3.3], [0.1, 0.45, 0.1], color=TEXT, linewidth=3)
    _said(axes, 2.2, -0.25, "seat, coordinates known or not")


def _bar(axes: Axes) -> None:
    _little_arm(axes, (0.5, 2.1), (1.7, 0.7))
    _little_arm(axes, (1.5, 2.0), (3.6, 1.5))
    axes.plot([1.7, 3.6], [0.7, 1.5], color=TEXT, linewidth=3)
    axes.plot([1.7, 3.6], [0.7, 1.5], "o", color=AXIS, markersize=11)
    _said(axes, 1.75, 0.25, "end A")
    _said(axes, 3.3, 1.85, "end B")


def _said(axes: Axes, x: float, y: float, words: str) -> None:
    axes.text(x, y, words, fontsize=SIZE, color=TEXT)
