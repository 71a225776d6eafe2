"""Pictures: units on every axis, what is drawn, colour bars, refusals, no pyplot state."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from aacmm_pin import (
    AccuracyVolume,
    ConfigurationCircle,
    accuracy_volume,
    circle_accuracy,
    configuration_circle,
    map_workspace,
    reaching_postures,
)
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.report.plots import plot_accuracy_of_postures, plot_budget, plot_circle, plot_map
from tests.arm_files import changed
from tests.oracle import close

pytestmark = pytest.mark.fast

mpl.use("Agg")

UNREACHABLE = np.array([5.0, 5.0, 5.0])


@pytest.fixture(scope="module")
def accuracy(circle) -> AccuracyVolume:
    return judged(circle)


def judged(circle: ConfigurationCircle) -> AccuracyVolume:
    return accuracy_volume(circle.arm, circle.q[circle.within_limits], at=circle.at)


def drawn(figure: Figure) -> None:
    figure.canvas.draw()


def colour_bar_labels(ax: Any) -> list[str]:
    return [other.get_ylabel() for other in ax.figure.axes if other.get_label() == "<colorbar>"]


def legend_texts(ax: Any) -> set[str]:
    return {text.get_text() for text in ax.get_legend().get_texts()}


def test_what_does_not_fit_a_circle(sino6, circle):
    nowhere = configuration_circle(sino6, UNREACHABLE)
    drawn(plot_accuracy_of_postures(nowhere, judged(nowhere)).figure)
    ax = plot_circle(nowhere)
    drawn(ax.figure)
    assert "out of reach" in ax.get_title()
    assert not ax.collections
    of_all = accuracy_volume(circle.arm, circle.q, at=circle.at)
    with pytest.raises(
        ShapeError, match=r"accuracy has 144 postures; expected 36, .*within_limits"
    ):
        plot_circle(circle, of_all)


def test_budget(accuracy):
    kinds = ("parameter", "joint", "kind")
    for by in kinds:
        ax = plot_budget(accuracy, by)
        drawn(ax.figure)
        assert "[%]" in ax.get_xlabel()
        assert 99.0 < sum(bar.get_width() for bar in ax.patches) < 100.0 + 1e-9
        assert any("µm" in text.get_text() for text in ax.texts)
    ax = plot_budget(accuracy, most=3)
    names = [text.get_text() for text in ax.get_yticklabels()]
    assert names[:2] == ["theta_offset3", "alpha4"]
    assert ax.get_title().endswith("the 3 largest of 17")
    with pytest.raises(AacmmError, match="expected at least 1"):
        plot_budget(accuracy, most=0)


def test_accuracy_stands_over_what_the_postures_have(sino6, rng, circle, accuracy):
    pose = sino6.poses(rng.uniform(*sino6.limits.T, (1, 6))).placement[0]
    single = reaching_postures(sino6, pose[:3, 3], rotation=pose[:3, :3])
    motion = reaching_postures(sino6, pose[:3, 3], axis=pose[:3, 0], count=60)
    for postures, x, label in (
        (circle, np.degrees(circle.swivel), "swivel angle (elbow highest at 0°) [°]"),
        (single, single.component, "number of the posture"),
        (motion, motion.travel, "distance along the curve in joint space [rad]"),
    ):
        found, inside = circle_accuracy(postures), postures.within_limits
        ax = plot_accuracy_of_postures(postures, found)
        drawn(ax.figure)
        (right,) = (other for other in ax.figure.axes if other is not ax)
        assert (ax.get_xlabel(), ax.get_ylabel()) == (label, "accuracy volume [mm³]")
        assert right.get_ylabel() == "standard uncertainty u [µm]"
        for axes, expected in ((ax, found.volume * 1e9), (right, found.u * 1e6)):
            shown = np.hstack([line.get_data() for line in axes.lines])
            np.testing.assert_allclose(np.sort(shown), np.sort([x[inside], expected]))


def test_maps(sino6):
    map_ = map_workspace(sino6, (12, 24), 4)
    for column, label, scale in (
        ("flexibility", "flexibility ζ [1]", 1.0),
        ("comprehensive_mm3", "comprehensive accuracy volume [mm³]", 1.0),
        ("smallest_u_mm", "smallest standard uncertainty u [µm]", 1e3),
    ):
        ax = plot_map(map_, column)
        drawn(ax.figure)
        assert ax.get_aspect() == 1.0
        assert colour_bar_labels(ax) == [label]
        assert "out of reach" in legend_texts(ax)
        image = next(artist for artist in ax.collections if isinstance(artist, QuadMesh))
        np.testing.assert_allclose(
            np.ma.filled(image.get_array(), np.nan), scale * map_.data[column].values.T, rtol=1e-14
        )
        close([*ax.get_xlim(), *ax.get_ylim()], [0.0, 1220.0, -1220.0, 1220.0], 1e-9)
    few = map_workspace(sino6, (2, 2), 4, extent=[0.0, 0.02, -0.23, -0.21])
    assert "in reach, no posture within the joint limits" in legend_texts(plot_map(few))


def test_circles_have_tubes_to_the_point_and_all_is_in_view(circle, accuracy):
    modified = changed("sino6", convention="modified-dh")
    point = modified.positions(np.array([[0.3, -1.2, 1.0, -1.4, 0.0, 0.0]]), "frame5")[0]
    for one, of, bars in (
        (circle, accuracy, ["accuracy volume [mm³]"]),
        (configuration_circle(modified, point, count=12), None, []),
    ):
        ax = plot_circle(one, of, postures=2)
        drawn(ax.figure)
        assert colour_bar_labels(ax) == bars
        tubes = [np.array(line.get_data_3d()).T for line in ax.lines if line.get_linewidth() > 4]
        limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
        assert tubes
        for tube in tubes:
            close(tube[-1], one.point * 1e3, 1e-6)
            assert (tube >= limits[:, 0]).all()
            assert (tube <= limits[:, 1]).all()
        # One scale for all axes.
        assert np.ptp(np.ptp(limits, axis=1) / ax._box_aspect) == pytest.approx(0.0, abs=1e-6)
    path = plot_circle(circle, accuracy).collections[-1]
    np.testing.assert_allclose(path.get_array(), accuracy.volume * 1e9)
