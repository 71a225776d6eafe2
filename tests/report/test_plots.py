"""Pictures: units on every axis, what is drawn, colour bars, refusals, no pyplot state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from aacmm_pin.accuracy.volume import AccuracyVolume, accuracy_volume, circle_accuracy
from aacmm_pin.accuracy.workspace import WorkspaceMap, map_workspace
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circle
from aacmm_pin.postures.general_ik import reaching_postures
from aacmm_pin.report.plots import (
    plot_accuracy_of_postures,
    plot_accuracy_over_swivel,
    plot_budget,
    plot_circle,
    plot_comprehensive,
    plot_flexibility,
    plot_uncertainty,
)

mpl.use("Agg")

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3
HALF_IN_LIMITS = np.array([0.30, 0.0, 1.12])
UNREACHABLE = np.array([5.0, 5.0, 5.0])


@pytest.fixture(scope="module")
def circle(sino6: Arm) -> ConfigurationCircle:
    return configuration_circle(sino6, POINT, count=36)


@pytest.fixture(scope="module")
def accuracy(circle: ConfigurationCircle) -> AccuracyVolume:
    return judged(circle)


@pytest.fixture(scope="module")
def map_(sino6: Arm) -> WorkspaceMap:
    return map_workspace(sino6, (12, 24), 4, progress=False)


def judged(circle: ConfigurationCircle) -> AccuracyVolume:
    return accuracy_volume(circle.arm, circle.q[circle.within_limits], at=circle.at)


def drawn(figure: Figure) -> None:
    figure.canvas.draw()


def colour_bar_labels(ax: Any) -> list[str]:
    return [other.get_ylabel() for other in ax.figure.axes if other.get_label() == "<colorbar>"]


def curves(ax: Axes3D) -> list[Line3DCollection]:
    return [artist for artist in ax.collections if isinstance(artist, Line3DCollection)]


def legend_texts(ax: Any) -> set[str]:
    return {text.get_text() for text in ax.get_legend().get_texts()}


def test_circle_shows_elbow_arm_axis_and_point(circle: ConfigurationCircle, accuracy: AccuracyVolume) -> None:
    ax = plot_circle(circle, accuracy, postures=3)
    drawn(ax.figure)
    assert [ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()] == ["x [mm]", "y [mm]", "z [mm]"]
    assert colour_bar_labels(ax) == ["accuracy volume [mm³]"]
    texts = {"joint axis 1", "base (shoulder)", "arm to the point", "working point"}
    assert legend_texts(ax) == texts | {"elbow, within limits", "elbow, outside limits"}
    inside, outside = curves(ax)
    assert inside.get_array().size == 36  # the only component within limits, closed
    assert inside.get_array().min() >= accuracy.volume.min() * 1e9
    assert len(outside._segments3d) == 3 * 36
    assert len(ax.lines) == 2 + 2 * 3 + 1  # joint axis and shoulder, tubes and joints of each posture, point


def test_tubes_end_in_the_working_point_and_all_is_in_view(circle: ConfigurationCircle) -> None:
    ax = plot_circle(circle, postures=2)
    assert colour_bar_labels(ax) == []
    tubes = [np.array(line.get_data_3d()).T for line in ax.lines if line.get_linewidth() > 4]
    assert len(tubes) == 2
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    for tube in tubes:
        np.testing.assert_allclose(tube[-1], POINT * 1e3, atol=1e-6)
        assert (tube >= limits[:, 0]).all()
        assert (tube <= limits[:, 1]).all()
    assert np.ptp(np.ptp(limits, axis=1) / ax._box_aspect) == pytest.approx(0.0, abs=1e-6)  # one scale for all axes


def test_circle_cut_by_limits_has_both_parts(sino6: Arm) -> None:
    circle = configuration_circle(sino6, HALF_IN_LIMITS, count=36)
    works = int(circle.within_limits.sum())
    assert 0 < works < 36
    inside, outside = curves(plot_circle(circle, judged(circle)))
    assert len(inside._segments3d) == works - 1
    assert len(inside._segments3d) + len(outside._segments3d) == len(circle)


def test_circle_in_modified_dh() -> None:
    file = load_arm_file("sino6").model_copy(update={"convention": "modified-dh"})
    arm = Arm.from_file(file)
    point = arm.positions(np.array([[0.3, -1.2, 1.0, -1.4, 0.0, 0.0]]), "frame5")[0]
    circle = configuration_circle(arm, point, count=12)
    assert len(circle)
    ax = plot_circle(circle, postures=1)
    drawn(ax.figure)
    (tube,) = (np.array(line.get_data_3d()).T for line in ax.lines if line.get_linewidth() > 4)
    np.testing.assert_allclose(tube[-1], point * 1e3, atol=1e-6)


def test_swivel_has_two_scales(circle: ConfigurationCircle, accuracy: AccuracyVolume) -> None:
    ax = plot_accuracy_over_swivel(circle, accuracy)
    drawn(ax.figure)
    (right,) = (other for other in ax.figure.axes if other is not ax)
    assert ax.get_xlabel().endswith("[deg]")
    assert ax.get_ylabel() == "accuracy volume [mm³]"
    assert right.get_ylabel() == "standard uncertainty u [µm]"
    np.testing.assert_allclose(ax.lines[0].get_ydata(), accuracy.volume * 1e9)
    np.testing.assert_allclose(right.lines[0].get_ydata(), accuracy.u * 1e6)
    np.testing.assert_allclose(right.lines[0].get_xdata(), np.degrees(circle.swivel[circle.within_limits]))


def test_swivel_tells_components_apart(sino6: Arm) -> None:
    seat = configuration_circle(sino6, [0.5, 0.3, 0.25], tip=True, axis=[0, 0, -1], count=36)
    accuracy = judged(seat)
    inside = seat.component[seat.within_limits]
    numbers = np.unique(inside)
    assert len(numbers) > 1
    ax = plot_accuracy_over_swivel(seat, accuracy)
    drawn(ax.figure)
    assert legend_texts(ax) == {f"component {number}" for number in numbers}
    (right,) = (other for other in ax.figure.axes if other is not ax)
    for axes, values in ((ax, accuracy.volume * 1e9), (right, accuracy.u * 1e6)):
        everything, *marked = axes.lines
        np.testing.assert_allclose(everything.get_ydata(), values)
        assert len({line.get_marker() for line in marked}) == len(marked) == len(numbers)
        for number, line in zip(numbers, marked, strict=True):
            assert np.abs(np.subtract.outer(line.get_ydata(), values[inside == number])).min(axis=1).max() < 1e-9
            assert len(line.get_ydata()) >= 12


def test_what_does_not_fit_a_circle(sino6: Arm, circle: ConfigurationCircle) -> None:
    nowhere = configuration_circle(sino6, UNREACHABLE)
    drawn(plot_accuracy_over_swivel(nowhere, judged(nowhere)).figure)
    ax = plot_circle(nowhere)
    drawn(ax.figure)
    assert "out of reach" in ax.get_title()
    assert curves(ax) == []
    of_all = accuracy_volume(circle.arm, circle.q, at=circle.at)
    for plot in (plot_circle, plot_accuracy_over_swivel):
        with pytest.raises(ShapeError, match=r"accuracy has 144 configurations, expected the 36 .*within_limits"):
            plot(circle, of_all)
    with pytest.raises(AacmmError, match="three-dimensional"):
        plot_circle(circle, ax=Figure().add_subplot())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("plot", "label", "column", "scale"),
    [
        (plot_flexibility, "flexibility ζ [1]", "flexibility", 1.0),
        (plot_comprehensive, "comprehensive accuracy volume [mm³]", "comprehensive_mm3", 1.0),
        (plot_uncertainty, "smallest standard uncertainty u [µm]", "smallest_u_mm", 1e3),
    ],
)
def test_maps(plot: Callable[..., Axes], label: str, column: str, scale: float, map_: WorkspaceMap) -> None:
    ax = plot(map_)
    drawn(ax.figure)
    assert ax.get_xlabel().endswith("[mm]")
    assert ax.get_ylabel().endswith("[mm]")
    assert ax.get_aspect() == 1.0
    assert colour_bar_labels(ax) == [label]
    assert "out of reach" in legend_texts(ax)
    image = next(artist for artist in ax.collections if isinstance(artist, QuadMesh))
    np.testing.assert_allclose(np.ma.filled(image.get_array(), np.nan), scale * map_.data[column].values.T, rtol=1e-14)
    np.testing.assert_allclose([*ax.get_xlim(), *ax.get_ylim()], [0.0, 1200.0, -1200.0, 1200.0], atol=1e-9)


def test_maps_of_few_cells(sino6: Arm) -> None:
    map_ = map_workspace(sino6, (2, 2), 4, extent=[0.0, 0.02, -0.23, -0.21], progress=False)
    assert "in reach, no sector within limits" in legend_texts(plot_comprehensive(map_))
    drawn(plot_flexibility(map_workspace(sino6, (1, 1), 2, progress=False)).figure)


def test_budget(accuracy: AccuracyVolume) -> None:
    kinds: tuple[Any, ...] = ("parameter", "joint", "kind")
    for by in kinds:
        ax = plot_budget(accuracy, by)
        drawn(ax.figure)
        assert "[%]" in ax.get_xlabel()
        assert sum(bar.get_width() for bar in ax.patches) == pytest.approx(100.0)
        assert any("µm" in text.get_text() for text in ax.texts)
    ax = plot_budget(accuracy, most=3)
    names = [text.get_text() for text in ax.get_yticklabels()]
    assert names == ["theta_offset3", "alpha4", "rest (15)"]
    assert sum(bar.get_width() for bar in ax.patches) == pytest.approx(100.0)
    with pytest.raises(AacmmError, match="expected at least 1"):
        plot_budget(accuracy, most=0)


def test_accuracy_of_single_postures_stands_over_their_numbers(sino6: Arm, rng: np.random.Generator) -> None:
    pose = sino6.poses(rng.uniform(*sino6.limits.T, (1, 6))).placement[0]
    postures = reaching_postures(sino6, pose[:3, 3], rotation=pose[:3, :3])
    accuracy = circle_accuracy(postures)
    ax = plot_accuracy_of_postures(postures, accuracy)
    drawn(ax.figure)
    dots = ax.lines[0]
    np.testing.assert_array_equal(dots.get_xdata(), postures.component[postures.within_limits])
    np.testing.assert_allclose(dots.get_ydata(), accuracy.volume * 1e9)
    assert list(ax.get_xticks()) == list(range(1, len(postures) + 1))
    assert ax.get_xlabel() == "number of the posture"


def test_accuracy_of_self_motion_stands_over_its_way(sino6: Arm, rng: np.random.Generator) -> None:
    pose = sino6.poses(rng.uniform(*sino6.limits.T, (1, 6))).placement[0]
    axis = pose[:3, :3] @ np.array([1.0, 0.0, 0.0])
    postures = reaching_postures(sino6, pose[:3, 3], axis=axis, count=60)
    ax = plot_accuracy_of_postures(postures, circle_accuracy(postures))
    drawn(ax.figure)
    assert ax.get_xlabel() == "way of all angles along the curve [rad]"
    shown = np.concatenate([line.get_xdata() for line in ax.lines if line.get_marker() in (".", "o")])
    assert set(shown) <= set(postures.travel[postures.within_limits])
    assert shown.max() == postures.travel[postures.within_limits].max()
