"""Scenes in a real browser: pages draw, move, read out, fit, and
say when they cannot.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin import Arm, circle_accuracy, configuration_circle
from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Scene
from tests.browser import Page
from tests.oracle import close

POINT = np.array([33.6323, -671.8702, 182.9355]) * MM
DESK, PHONE, STRIP = (1200, 800), (390, 800), (300, 1000)
PLACE = """
((path) => {
  page.viewer.scene.updateMatrixWorld(true);
  const node = page.viewer.scene_tree.find(["meshcat", ...path.split("/")]).object;
  const at = node.getWorldPosition(new MeshCat.THREE.Vector3());
  return [at.x, -at.z, at.y];
})
"""
"""Place of a node in the base: three.js has y up."""
SEEN = """
((points) => {
  const { Vector3 } = MeshCat.THREE;
  page.viewer.render();
  page.viewer.camera.updateMatrixWorld(true);
  return points.map(([x, y, z]) => new Vector3(x, z, -y).project(page.viewer.camera).toArray());
})
"""


@cache
def circle_scene() -> Scene:
    circle = configuration_circle(Arm.load("sino6"), POINT, count=20)
    return scenes.circle_scene(circle, circle_accuracy(circle))


def opened(page: Page, where: Path | str, size: tuple[int, int] = DESK) -> None:
    """Open a scene that holds still."""
    page.open(
        f"{where.as_uri() if isinstance(where, Path) else where}#still", size, touch=size != DESK
    )
    page.wait_for("window.page !== undefined")


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("scenes") / "circle.html"
    circle_scene().save(target)
    return target


def place(page: Page, path: str) -> Array:
    return np.array(page.evaluate(f"{PLACE}({path!r})"))


def stage(picture: Array) -> Array:
    """The part of a picture that the scene is drawn in."""
    return picture[40:-80, :880] if picture.shape[1] > 700 else picture[40:440]


def colours(picture: Array) -> int:
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def test_the_slider_moves_the_arm_where_the_arm_goes(page, file):
    opened(page, file)
    frames = circle_scene().frames
    arm, pictures = Arm.load("sino6"), []
    for number in (2, 13):
        page.evaluate(
            f"slider.value = {number}; slider.dispatchEvent(new Event('input', {{bubbles: true}}))"
        )
        assert page.evaluate("page.current") == number
        texts = page.evaluate(
            "[...document.querySelectorAll('#readings dd')].map((cell) => cell.textContent)"
        )
        assert texts == [each[number] for each in frames.texts.values()]
        q = np.radians([float(text.removesuffix("°")) for text in texts[2:8]])
        close(place(page, "arm/body 6/tip"), arm.poses(q[None]).position[0], 5e-4)
        close(place(page, "accuracy"), POINT, 1e-6)
        pictures.append(stage(page.screenshot()))
    changed = (pictures[0] != pictures[1]).any(axis=2).mean()
    assert 0.02 < changed < 0.6
    assert page.errors == []


def test_the_keyboard_and_play(page, file):
    opened(page, file)
    page.evaluate("page.show(5)")
    for key, expected in (
        ("ArrowRight", 6),
        ("ArrowLeft", 5),
        ("End", 19),
        ("ArrowRight", 0),
        ("ArrowLeft", 19),
        ("Home", 0),
    ):
        page.key(key)
        assert page.evaluate("page.current") == expected
    page.key(" ")
    page.wait_for("page.current > 3")
    assert page.evaluate("play.getAttribute('aria-label')") == "pause"
    page.evaluate("play.click()")
    still = page.evaluate("page.current")
    page.screenshot()
    assert page.evaluate("page.current") == still
    assert page.evaluate("slider.getAttribute('aria-valuetext')").startswith("component ")


@pytest.mark.parametrize("size", [DESK, PHONE, STRIP], ids=["desk", "phone", "strip"])
def test_all_of_the_arm_is_seen_and_nothing_covers_it(page, file, size):
    opened(page, file, size)
    corners = []
    for number in range(0, 20, 3):
        page.evaluate(f"page.show({number})")
        corners += [place(page, f"arm/body {body}").tolist() for body in range(1, 7)]
        corners.append(place(page, "arm/body 6/tip").tolist())
    seen = np.array(page.evaluate(f"{SEEN}({corners})"))
    assert np.abs(seen[:, :2]).max() < 1.0
    assert np.ptp(seen[:, :2], axis=0).max() > 1.2  # and fills the picture
    pane, panel, controls = (
        page.evaluate(
            f"(({{left, top, right, bottom}}) => [left, top, right, bottom])"
            f"({name}.getBoundingClientRect())"
        )
        for name in ("pane", "panel", "controls")
    )
    for other in (panel, controls):
        assert pane[2] <= other[0] + 1 or pane[3] <= other[1] + 1
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert controls[3] <= size[1]  # the slider is in sight without scrolling
    assert (pane[2] - pane[0]) * (pane[3] - pane[1]) > 0.45 * size[0] * size[1]


@pytest.mark.long
def test_a_scene_on_a_page(page, tmp_path):
    report = tmp_path / "report.html"
    frame = circle_scene().embedded()
    report.write_text(f"<!DOCTYPE html><meta charset=utf-8><body>{frame}", encoding="utf-8")
    page.open(report)
    inner = "document.querySelector('iframe').contentWindow"
    page.wait_for(f"Boolean({inner}.page)")
    assert page.evaluate(f"{inner}.page.current") == 0  # it does not play by itself
    page.evaluate(f"{inner}.page.show(4)")
    assert page.evaluate(f"{inner}.document.querySelectorAll('#readings dd')[0].textContent") == "1"
    assert colours(page.screenshot()) > 300
    assert page.errors == []


def test_without_webgl_the_page_says_so(file):
    with Page("--disable-3d-apis") as blind:
        blind.open(file)
        assert blind.evaluate("document.getElementById('no-webgl').checkVisibility()")
        assert "WebGL" in blind.evaluate("document.body.innerText")
        assert not blind.evaluate(
            "document.getElementById('controls').checkVisibility({visibilityProperty: true})"
        )
        assert blind.errors == []
