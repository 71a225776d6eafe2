"""Scenes without a browser: what is sent to meshcat is where Pinocchio has it, in the right size
and colour.
"""

from __future__ import annotations

import base64
import html as markup
import json
import re
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import umsgpack
from matplotlib import colormaps
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import (
    AacmmError,
    Arm,
    ErrorModel,
    calibrate,
    circle_accuracy,
    configuration_circle,
    diagnose,
    reaching_postures,
    simulate_measurements,
)
from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.effects import EncoderEccentricity
from aacmm_pin.errors import ShapeError, UnknownNameError
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Frames, Scene
from aacmm_pin.report.scenes.scene import viewer_script
from tests.few_causes import ECCENTRICITY_ALONE
from tests.oracle import close, dh_sensitivity, postures

POINT = np.array([33.6323, -671.8702, 182.9355]) * MM
SINGLE = 2e-7
"""What single precision costs over a metre [m]."""


def commands(scene: Scene, kind: str) -> dict[str, dict[str, Any]]:
    """The last command of a kind for every path."""
    unpacked = [umsgpack.unpackb(command) for command in scene.commands]
    return {c["path"].removeprefix("/meshcat/"): c for c in unpacked if c["type"] == kind}


def transform(scene: Scene, path: str) -> Array:
    """A placement as it was sent: column by column."""
    return np.array(commands(scene, "set_transform")[path]["matrix"]).reshape(4, 4).T


def mesh(scene: Scene, path: str) -> tuple[Array, Array, Array | None]:
    """Vertices (v, 3), triangles (f, 3) and colours (v, 3) of an object as they were sent."""
    data = commands(scene, "set_object")[path]["object"]["geometries"][0]["data"]

    def numbers(packed: dict[str, Any], kind: str) -> Array:
        return np.frombuffer(packed["array"].data, dtype=kind).reshape(-1, 3)

    attributes = data["attributes"]
    colours = numbers(attributes["color"], "<f4") if "color" in attributes else None
    return (
        numbers(attributes["position"], "<f4").astype(float),
        numbers(data["index"], "<u4"),
        colours,
    )


def decoded(scene: Scene, path: str) -> Array:
    """Placements of a moving body, out of what the page gets."""
    frames = page_data(scene.html())["frames"]
    rows = np.frombuffer(base64.b64decode(frames["moving"][path]), dtype="<f4").reshape(
        frames["count"], 3, 4
    )
    placements = np.tile(np.eye(4), (len(rows), 1, 1))
    placements[:, :3] = rows
    return placements


def page_data(html: str) -> dict[str, Any]:
    """What a page hands to its script."""
    found = re.search(r'<script type="application/json" id="scene-data">(.*?)</script>', html)
    return json.loads(found[1])


def readings(scene: Scene) -> list[tuple[str, ...]]:
    """The texts of the displayed numbers, frame by frame."""
    return [*zip(*scene.frames.texts.values(), strict=True)]


# --- the arm


def test_bodies_and_tip_are_where_pinocchio_has_them(arm_file, rng):
    arm = Arm.from_file(arm_file)
    dh, q = arm.require_dh("this test"), postures(arm, rng, 7)
    scene = scenes.arm_scene(ErrorModel(arm), q)
    last = f"arm/body {dh.rows}"
    tip = decoded(scene, last) @ transform(scene, f"{last}/tip")
    close(tip[:, :3, 3], arm.poses(q, "tip").position, SINGLE)
    for row in range(1, dh.rows + 1):
        expected = arm.poses(q, f"link{row}").placement
        if not dh.standard:  # the axis of modified DH has d before it
            expected[:, :3, 3] += dh.d[row - 1] * expected[:, :3, 2]
        close(decoded(scene, f"arm/body {row}"), expected, SINGLE)


def test_an_arm_that_came_as_urdf(robot_file, rng):
    arm = Arm.from_urdf(robot_file("panda.urdf"), "panda_hand")
    q = postures(arm, rng, 7)
    scene, data = scenes.arm_scene(arm, q, body_style="sticks"), arm.model.createData()
    tip = decoded(scene, f"arm/body {arm.nq}") @ transform(scene, f"arm/body {arm.nq}/tip")
    close(tip[:, :3, 3], arm.poses(q, "panda_hand").position, SINGLE)
    for number, row in enumerate(q):
        pin.forwardKinematics(arm.model, data, row)
        for joint in range(1, arm.nq + 1):
            placement = decoded(scene, f"arm/body {joint}")[number]
            close(placement[:3, 3], data.oMi[joint].translation, SINGLE)
            jacobian = pin.computeJointJacobian(arm.model, data, row, joint)[3:, joint - 1]
            axis = data.oMi[joint].rotation @ jacobian
            # Drawn joints lie along z.
            close(placement[:3, 2], axis, 1e-6)


# --- the circle


@cache
def sino6_circle() -> Any:
    return configuration_circle(Arm.load("sino6"), POINT, count=90)


@cache
def at_the_point() -> Scene:
    circle = sino6_circle()
    return scenes.circle_scene(circle, circle_accuracy(circle))


def shown_rows(scene: Scene) -> Array:
    """Numbers, in the circle, of the postures on the slider, found by their angles."""
    angles = np.array([[float(t.removesuffix("°")) for t in row[2:8]] for row in readings(scene)])
    distance = np.abs(angles[:, None] - sino6_circle().q[None] / DEG).max(axis=2)
    assert (distance.min(axis=1) < 0.006).all()
    return distance.argmin(axis=1)


def factor_of(scene: Scene) -> float:
    """The magnification that the legend states."""
    (said,) = [m for note in scene.notes if (m := re.search(r"magnified ([\d.e+]+) times", note))]
    return float(said[1])


def test_the_line_is_the_path_of_the_elbow():
    circle, scene = sino6_circle(), at_the_point()
    elbow = circle.arm.poses(circle.q, "frame4").position
    vertices, _, colours = mesh(scene, "path")
    drawn = vertices.reshape(-1, 6, 3).mean(axis=1)
    # Every posture is on it.
    distance = np.linalg.norm(drawn[:, None] - elbow[None], axis=2)
    assert distance.min(axis=0).max() < 1e-6
    assert distance.min(axis=1).max() < 1e-6
    is_grey = np.ptp(colours[::6], axis=1) < 1e-6
    assert (is_grey == ~circle.within_limits[distance.argmin(axis=1)]).all()


def test_the_line_has_the_colours_of_the_accuracy():
    circle, scene = sino6_circle(), at_the_point()
    accuracy = circle_accuracy(circle)
    volume = accuracy.volume / MM3
    low, high = volume.min(), volume.max()
    expected = colormaps["viridis"]((volume - low) / (high - low))[:, :3]
    elbow = circle.arm.poses(accuracy.q, "frame4").position
    vertices, _, colours = mesh(scene, "path")
    centre = vertices.reshape(-1, 6, 3).mean(axis=1)
    distance = np.linalg.norm(centre[:, None] - elbow[None], axis=2)
    within = distance.min(axis=1) < 1e-6
    assert within.any()
    close(colours[::6][within], expected[distance.argmin(axis=1)][within], 1e-6)


def test_the_ellipsoid_holds_95_percent():
    """Its axes are those of S diag(u²) Sᵀ by Pinocchio, times k and the stated magnification."""
    circle, scene = sino6_circle(), at_the_point()
    rows = shown_rows(scene)
    u = np.array([p.u for p in circle.arm.parameters])
    sensitivity = dh_sensitivity(circle.arm, circle.q[rows], ["frame5"])["frame5"] * u
    covariance = sensitivity @ sensitivity.transpose(0, 2, 1)
    placements, factor = decoded(scene, "accuracy"), factor_of(scene)
    size = placements[:, :3, :3] @ placements[:, :3, :3].transpose(0, 2, 1)
    expected = chi2.ppf(0.95, 3) * factor**2 * covariance
    close(size, expected, 1e-5 * np.abs(expected).max())
    close(placements[:, :3, 3], np.tile(POINT, (len(rows), 1)), SINGLE)
    assert (np.linalg.det(placements[:, :3, :3]) > 0).all()
    axes = np.sort(np.linalg.norm(placements[:, :3, :3], axis=1), axis=1)
    np.testing.assert_allclose(axes, np.sqrt(np.linalg.eigvalsh(expected)), rtol=1e-3)


def test_postures_of_an_arm_without_a_dh_table():
    """Curves of self-motion have the path of the joint that goes about most; single postures have
    none.
    """
    arm = Arm.from_urdf("ur5", translation_half_width=5e-5, rotation_half_width=1e-4)
    pose = arm.poses(np.array([[0.3, -1.2, 1.4, -1.6, -1.5, 0.4]])).placement[0]
    found = reaching_postures(arm, pose[:3, 3], axis=pose[:3, 2], count=30)
    scene = scenes.circle_scene(found, circle_accuracy(found))
    origins, data = np.zeros((len(found.q), 6, 3)), arm.model.createData()
    for k, row in enumerate(found.q):
        pin.forwardKinematics(arm.model, data, row)
        origins[k] = [data.oMi[j].translation for j in range(1, 7)]
    widest = int(np.linalg.norm(np.ptp(origins, axis=0), axis=1).argmax())
    runs = [mesh(scene, p)[0] for p in commands(scene, "set_object") if p == "path"]
    drawn = np.vstack([vertices.reshape(-1, 6, 3).mean(axis=1) for vertices in runs])
    assert (
        np.linalg.norm(drawn[:, None] - origins[None, :, widest], axis=2).min(axis=1).max() < 1e-6
    )
    single = reaching_postures(arm, pose[:3, 3], rotation=pose[:3, :3])
    scene = scenes.circle_scene(single, circle_accuracy(single))
    assert not any(path.startswith("path") for path in commands(scene, "set_object"))


# --- diagnosis, calibration


@cache
def measured() -> Any:
    arm = Arm.load("sino6")
    hidden = ErrorModel(arm, (EncoderEccentricity(joint=3, values=(1e-4, 0.0)),))
    return simulate_measurements(hidden, "free", 60, rng=np.random.default_rng(1))


@cache
@ECCENTRICITY_ALONE
def diagnosed() -> Any:
    return diagnose(Arm.load("sino6"), measured(), encoder_noise=8e-6, hold_out=False)


def spikes_of(scene: Scene) -> tuple[Array, Array, Array]:
    """Middle of the foot, end, and colour of each spike."""
    vertices, _, colours = mesh(scene, "residuals")
    ends = vertices.reshape(-1, 2, 6, 3)
    return ends[:, 0].mean(axis=1), ends[:, 1, 0], colours.reshape(-1, 2, 6, 3)[:, 1, 0]


def test_residuals_of_the_simulation_by_pinocchio(sino6):
    data = measured()
    scene = scenes.residual_scene(diagnosed(), "nominal")
    foot, end, colour = spikes_of(scene)
    rows = np.array([int(row[0]) for row in readings(scene)])
    records = np.array([int(np.flatnonzero(data.row == row)[0]) for row in rows])
    tips = sino6.poses(data.q[records], "tip").position
    factor = factor_of(scene)
    close(foot, data.reference[records], 1e-6)
    close((end - foot) / factor, tips - data.reference[records], 1e-6 / factor + 1e-9)
    off = np.linalg.norm(tips - data.reference[records], axis=1)
    assert (np.diff(off) <= 1e-12).all()  # the largest first
    shade = (off - off.min()) / (off.max() - off.min())
    close(colour, colormaps["plasma"](shade)[:, :3], 0.01)
    close(decoded(scene, "record")[:, :3, 3], data.reference[records], SINGLE)
    assert f"{off[0] / MM:.4f} mm" in readings(scene)[0]
    foot, end, _ = spikes_of(extended := scenes.residual_scene(diagnosed()))
    size = np.sqrt(np.square((end - foot) / factor_of(extended)).sum(axis=1).mean())
    assert size == pytest.approx(diagnosed().rms["extended"], rel=0.01)


def test_residuals_in_a_frame_of_their_own_are_drawn_in_the_base(sino6):
    """References of a tracker: the scene is that of the base frame, whatever the frame of the
    references.
    """
    data = measured()
    turn = Rotation.from_rotvec([0.3, -0.8, 1.9]).as_matrix()
    shift = np.array([1.5, -2.0, 0.7])
    table = data.to_frame()
    table[["x_mm", "y_mm", "z_mm"]] = (data.reference @ turn.T + shift) / MM
    moved = type(data).from_frame(pd.DataFrame(table))
    result = calibrate(
        sino6, moved, ["geometry"], reference_frame="external", encoder_noise=8e-6, hold_out=False
    )
    scene = scenes.residual_scene(result, "after")
    foot, end, _ = spikes_of(scene)
    rows = np.array([int(row[0]) for row in readings(scene)])
    records = np.array([int(np.flatnonzero(moved.row == row)[0]) for row in rows])
    frame = result.fit.point.frame
    close(foot, (moved.reference[records] - frame.shift) @ frame.rotation, 1e-6)
    # The frame is known that well.
    close(foot, data.reference[records], 2e-4)
    tips = result.model.correct(moved.q[records])
    close(foot + (end - foot) / factor_of(scene), tips, 1e-6)


# --- scene and page


def outside_viewer(html: str) -> str:
    assert viewer_script() in html
    return html.replace(viewer_script(), "")


def test_a_file_and_a_notebook_have_the_same_page(tmp_path):
    target, scene = tmp_path / "scene.html", Scene('the "arm"')
    scene.save(target)
    assert target.read_text(encoding="utf-8") == scene.html()
    inner = re.search(r'srcdoc="([^"]*)"', scene._repr_html_())
    assert markup.unescape(inner[1]) == scene.html()


def test_text_is_text():
    scene = Scene("<b>1 & 2</b>", "</script><script>alert(1)</script>")
    scene.notes = ["<i>"]
    scene.frames = Frames({"arm": np.eye(4)[None]}, {"</script>": ["<!--"]}, ["red"])
    rest = outside_viewer(scene.html())
    for text in ("<b>1", "alert(1)</script>", "<i>", "<!--"):
        assert text not in rest.replace("<!-- viewer -->", "")
    assert page_data(rest)["frames"]["labels"] == ["</script>"]


def test_what_is_refused(sino6, zero6):
    circle = sino6_circle()
    other = circle_accuracy(configuration_circle(sino6, POINT, count=30))
    nowhere = configuration_circle(sino6, [0.0, 5.0, 0.0])
    calls = [
        (AacmmError, "no posture", lambda: scenes.circle_scene(nowhere)),
        (ShapeError, "within limits", lambda: scenes.circle_scene(circle, other)),
        (UnknownNameError, "extended", lambda: scenes.residual_scene(diagnosed(), "best")),
    ]
    for error, words, call in calls:
        with pytest.raises(error, match=words):
            call()
    scene = scenes.circle_scene(configuration_circle(zero6, np.array([0.4, 0.0, 0.1]), count=12))
    assert scene.bar is None  # an arm without uncertainties has no accuracy
    assert "accuracy" not in commands(scene, "set_object")


def test_readings_of_joints_that_turn_and_slide(sino6):
    q = np.zeros((2, 6))
    q[1, 1] = 0.5  # joint 2 stays below 0
    rows = readings(scenes.arm_scene(sino6, q))
    assert [row[-1] for row in rows] == ["within", "outside: joint 2"]
    assert rows[1][2] == f"{0.5 / DEG:.2f}°"
    model = pin.Model()
    model.addJoint(
        0, pin.JointModelPX(), pin.SE3.Identity(), "rail", *(s * np.ones(1) for s in (1, 1, -1, 1))
    )
    model.addFrame(
        pin.Frame("hand", 1, pin.SE3(np.eye(3), np.array([0.5, 0, 0])), pin.FrameType.OP_FRAME)
    )
    rail = scenes.arm_scene(Arm.from_model(model, "hand"), np.array([[0.25]]))
    assert "250.00 mm" in readings(rail)[0]
    tip = decoded(rail, "arm/body 1")[0] @ transform(rail, "arm/body 1/tip")
    close(tip[:3, 3], [0.75, 0.0, 0.0], SINGLE)
