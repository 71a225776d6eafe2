"""The demo: whole, strict, and in agreement with itself."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib import pyplot as plt

from aacmm_pin import WorkspaceMap
from aacmm_pin.errors import AacmmError, OutputError
from aacmm_pin.report.demo_page import FILES, run_demo
from tests.few_causes import FEW
from tests.oracle import close
from tests.pages import Page

mpl.use("Agg")


class Demo(NamedTuple):
    folder: Path
    text: str

    @property
    def files(self) -> set[str]:
        return {path.name for path in self.folder.iterdir()}


@pytest.fixture(scope="module")
def figures_left_by_demo() -> list[int]:
    return []


@pytest.fixture(scope="module")
def demo(tmp_path_factory, figures_left_by_demo) -> Demo:
    plt.close("all")
    with FEW:
        folder = tmp_path_factory.mktemp("demo") / "out"
        text = run_demo(folder=folder, cells=(6, 8), sectors=4)
    figures_left_by_demo += plt.get_fignums()
    return Demo(folder, text)


def test_demo_writes_the_whole_tour(demo, figures_left_by_demo):
    assert demo.files == {*FILES, "index.html", "sino6.urdf"} - {"site/index.html"}
    assert figures_left_by_demo == []


def test_demo_pages_fetch_nothing_and_their_links_lead_somewhere(demo):
    html = (demo.folder / "index.html").read_text(encoding="utf-8")
    assert len(html.encode()) < 5_000_000
    assert not re.search(r"https?:", html)
    index = Page(html)
    assert len(index.all("img")) >= 4
    assert all(
        image["src"].startswith("data:image/png;base64,") and image["alt"]
        for image in index.all("img")
    )
    assert not re.search(r"\bnan\b|\binf\b|None", index.text)
    sections = {section["id"] for section in index.all("section")}
    for target in (link["href"] for link in index.all("a")):
        assert target.removeprefix("#") in sections | set(demo.files) | {"site/index.html"}
    assert {link["href"] for link in index.all("a")} >= set(demo.files) - {"index.html"}


def test_demo_data_agree(demo):
    accuracy = json.loads((demo.folder / "accuracy.json").read_text(encoding="utf-8"))
    assert accuracy["point_mm"] == [33.6323, -671.8702, 182.9355]
    frame = pd.read_csv(demo.folder / "configurations.csv")
    assert frame["within_limits"].sum() == accuracy["configurations"]
    close(frame[["x_mm", "y_mm", "z_mm"]], np.tile(accuracy["point_mm"], (len(frame), 1)), 1e-6)
    map_ = WorkspaceMap(xr.load_dataset(demo.folder / "map.nc"), 0.0)
    summary = json.loads((demo.folder / "map.json").read_text(encoding="utf-8"))
    assert (summary["unreachable"], summary["cells"]) == (map_.unreachable, [6, 8])
    index = Page((demo.folder / "index.html").read_text(encoding="utf-8")).text
    lines = demo.text.splitlines()
    assert [line in index for line in lines[:2]] == [True] * 2
    assert "index.html" in lines[-1]
    ends = " to ".join(f"{2 * accuracy['u_mm'][end]:.4f}" for end in ("min", "max"))
    assert f"U (k = 2) = {ends} mm" in lines[0]


def test_demo_pages_in_a_browser(demo, page):
    page.open(demo.folder / "postures.html")
    page.wait_for("!!document.querySelector('canvas')")
    assert page.errors == []
    schemes = {request.split(":")[0] for request in page.requests}
    assert schemes <= {"file", "data", "about", "blob"}
    for name in ("index",):  # on a phone
        page.open(demo.folder / f"{name}.html", (390, 800), touch=True)
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
        sizes = (
            "[...document.querySelectorAll('p')].map(p => parseFloat(getComputedStyle(p).fontSize))"
        )
        assert page.evaluate(f"Math.min(...{sizes})") > 13
        assert page.errors == []


def test_demo_finds_what_it_hides(demo):
    found = json.loads((demo.folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "explained"
    assert [(f["cause"], f["joint"]) for f in found["findings"]] == [("encoder_eccentricity", 3)]
    amplitude = found["findings"][0]["parameters"]["amplitude_rad"]
    assert abs(amplitude["value"] - 1e-4) < 3 * amplitude["u"]


def test_demo_refuses(demo, tmp_path):
    with pytest.raises(OutputError, match="files"):
        run_demo(folder=demo.folder)
    with pytest.raises(AacmmError, match="has an uncertainty"):
        run_demo("zero6", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
