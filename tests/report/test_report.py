"""The page: self-contained, escaped, readable; the demo: whole, strict, and in agreement with itself."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from aacmm_pin import Arm, Measurements, calibrate
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.effects import EncoderEccentricity
from aacmm_pin.errors import AacmmError, OutputError
from aacmm_pin.report.demo import DemoSummary, run_demo
from aacmm_pin.report.demo.paper import elbow_goes_round
from aacmm_pin.report.html import Bullets, Download, Paragraph, Picture, SceneView, Section, Table, render_report
from aacmm_pin.report.scenes import arm_scene
from aacmm_pin.report.scenes.page import viewer_script
from tests.browser import Page as Browser

mpl.use("Agg")

PNG = b"\x89PNG\r\n\x1a\n"
VOID = {"meta", "link", "img", "br"}


class Page(HTMLParser):
    """Tags with their attributes, visible text, and whether every tag is closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("style", "script"):
            self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


def picture() -> Picture:
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().plot([0, 1])
    return Picture.of(figure, "A line", "A line from 0 to 1")


def page(*parts: object) -> Page:
    return Page(render_report("Title", "Below it", [Section("First", parts)]))  # type: ignore[arg-type]


def test_a_page_fetches_nothing() -> None:
    html = render_report("T", "S", [Section("First", ["Text", picture(), Download("a.csv", b"a,b\n", "text/csv", "data")])])
    assert "http:" not in html
    assert "https:" not in html
    parsed = Page(html)
    assert parsed.open == []
    for tag, attributes in parsed.tags:
        assert tag not in {"script", "iframe", "object"}
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("data:", "#"))
    assert "url(" not in html
    assert "@import" not in html


def test_phone_and_paper_are_thought_of() -> None:
    html = render_report("T", "S", [])
    assert '<meta name="viewport" content="width=device-width' in html
    assert "@media print" in html
    assert "overflow-x: auto" in html
    assert '<html lang="en">' in html


def test_text_is_escaped() -> None:
    evil = '<script>alert("x")</script> & {{ 7 * 7 }}'
    frame = pd.DataFrame({evil: [evil]})
    parsed = page(evil, Paragraph(evil, finding=True), Bullets([evil]), Table(frame, evil), Picture(PNG, evil, evil))
    assert parsed.all("script") == []
    assert parsed.text.count(evil) >= 6
    assert parsed.all("img")[0]["alt"] == evil


def test_pictures_are_embedded_with_alt_and_caption() -> None:
    parsed = page(picture())
    (image,) = parsed.all("img")
    head, data = image["src"].split(",")
    assert head == "data:image/png;base64"
    assert base64.b64decode(data).startswith(PNG)
    assert image["alt"] == "A line"
    assert "A line from 0 to 1" in parsed.text


@pytest.mark.parametrize(("size", "kind"), [((10, 3), "wide"), ((4, 2), ""), ((2, 4), "")])
def test_wide_pictures_stay_readable_on_a_phone(size: tuple[float, float], kind: str) -> None:
    figure = Figure(figsize=size)
    figure.add_subplot().plot([0, 1])
    parsed = page(Picture.of(figure, "A line", ""))
    assert [attributes.get("class", "") for attributes in parsed.all("figure")] == [kind]


def test_scenes_share_one_viewer() -> None:
    scene = arm_scene(Arm.load("sino6"), np.zeros((1, 6)))
    html = render_report("T", "S", [Section(t, [SceneView(scene, t)]) for t in ("First", "Second")])
    assert html.count(viewer_script()) == 1
    assert len(html) < 2 * len(scene.html())
    parsed = Page(html)
    assert parsed.open == []
    assert [frame["class"] for frame in parsed.all("iframe")] == ["aacmm-scene"] * 2
    assert "First" in parsed.text
    assert page("No scene").all("script") == []


def test_tables_format_numbers_and_show_what_is_missing() -> None:
    frame = pd.DataFrame({"name": ["a", "b"], "u_mm": [0.12345, np.nan], "n": [1, 2]})
    table = Table(frame, "caption", {"u_mm": ".3f"}, {"u_mm": "u [mm]"})
    assert table.rows == [["a", "0.123", "1"], ["b", "–", "2"]]
    assert table.columns == [("name", "short"), ("u [mm]", "number"), ("n", "number")]
    assert Table(pd.DataFrame({"t": ["x" * 60]}), "").columns == [("t", "long")]
    assert len(page(table).all("tr")) == 3


def test_an_empty_table_has_its_heads() -> None:
    assert len(page(Table(pd.DataFrame({"a": [], "b": []}), "none")).all("th")) == 2


def test_numbers_stay_with_their_units() -> None:
    text = page("u = 0.07 mm, 5 %, 3 mmHg").text
    assert "u\u00a0=\u00a00.07\u00a0mm, 5\u00a0%, 3 mmHg" in text


def test_downloads_are_inside() -> None:
    parsed = page(Download("a.csv", b"a,b\n", "text/csv", "data"))
    (link,) = (a for a in parsed.all("a") if "download" in a)
    assert link["download"] == "a.csv"
    assert base64.b64decode(link["href"].split(",")[1]) == b"a,b\n"


def test_sections_are_linked() -> None:
    parsed = Page(render_report("T", "S", [Section("One", []), Section("Two", [])]))
    ids = {attributes["id"] for attributes in parsed.all("section")}
    assert {a["href"].removeprefix("#") for a in parsed.all("a")} == ids
    assert len(ids) == 2


@pytest.fixture(scope="module")
def figures_left_by_demo() -> list[int]:
    return []


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory, figures_left_by_demo: list[int]) -> DemoSummary:
    plt.close("all")
    summary = run_demo(folder=tmp_path_factory.mktemp("demo") / "out", progress=False, cells=(6, 8), sectors=4)
    figures_left_by_demo += plt.get_fignums()
    return summary


def test_demo_writes_the_whole_tour(demo: DemoSummary) -> None:
    written = {path.name for path in demo.folder.iterdir()}
    assert written == set(demo.files)
    data = {"index.html", "sino6.urdf", "configurations.csv", "accuracy.json", "map.nc", "map.json"}
    data |= {"measured.csv", "diagnosis.json", "diagnosis.html"}
    pictures = {"circle", "accuracy_over_swivel", "accuracy_over_theta3", "budget_by_parameter", "budget_by_joint"}
    pictures |= {"flexibility", "comprehensive", "uncertainty", "table2", "table3"}
    pictures |= {"spreads", "bayes_factors", "part_and_rest", "records", "hidden_rms", "hidden_cause1"}
    assert written == data | {f"{name}.png" for name in pictures}
    for name in pictures:
        assert (demo.folder / f"{name}.png").read_bytes().startswith(PNG)


def test_demo_leaves_no_figure_open(demo: DemoSummary, figures_left_by_demo: list[int]) -> None:
    assert demo.files
    assert figures_left_by_demo == []


def test_demo_page_is_self_contained(demo: DemoSummary) -> None:
    html = (demo.folder / "index.html").read_text(encoding="utf-8")
    assert len(html.encode()) < 5_000_000
    assert html.count(viewer_script()) == 1
    assert not re.search(r"https?:", html.replace(viewer_script(), ""))  # the viewer's licences name their places
    parsed = Page(html)
    assert parsed.open == []
    assert len(parsed.all("img")) == 16
    assert all(image["src"].startswith("data:image/png;base64,") and image["alt"] for image in parsed.all("img"))
    for attributes in parsed.all("a"):
        assert attributes["href"].startswith(("#", "data:"))
    assert not re.search(r"\bnan\b|\binf\b|None", parsed.text)
    for link in (a for a in parsed.all("a") if "download" in a):
        assert base64.b64decode(link["href"].split(",")[1]) == (demo.folder / link["download"]).read_bytes()


def test_demo_data_agree(demo: DemoSummary) -> None:
    accuracy = json.loads((demo.folder / "accuracy.json").read_text(encoding="utf-8"))
    assert accuracy == demo.accuracy
    assert accuracy["point_mm"] == [33.6323, -671.8702, 182.9355]
    frame = pd.read_csv(demo.folder / "configurations.csv")
    assert frame["within_limits"].sum() == accuracy["configurations"]
    np.testing.assert_allclose(frame[["x_mm", "y_mm", "z_mm"]], np.tile(accuracy["point_mm"], (len(frame), 1)), atol=1e-6)
    map_ = WorkspaceMap.load(demo.folder / "map.nc")
    assert map_.unreachable == demo.map["unreachable"]
    assert demo.map["cells"] == [6, 8]
    assert json.loads((demo.folder / "map.json").read_text(encoding="utf-8")) == demo.map


def test_demo_says_what_it_found(demo: DemoSummary) -> None:
    lines = str(demo).splitlines()
    assert 8 <= len(lines) <= 14
    assert all(re.search(r"mm|µm|%|cells", line) for line in lines[:-1])
    assert "index.html" in lines[-1]


def test_demo_page_in_a_browser(demo: DemoSummary, browser: Browser) -> None:
    browser.open(demo.folder / "index.html")
    frames = browser.evaluate("document.querySelectorAll('iframe.aacmm-scene').length")
    assert frames >= 1
    for number in range(frames):
        frame = f"document.querySelectorAll('iframe.aacmm-scene')[{number}]"
        browser.evaluate(f"{frame}.scrollIntoView({{block: 'center'}})")
        browser.wait_for(f"!!{frame}.contentDocument && !!{frame}.contentDocument.querySelector('canvas')")
    assert browser.errors == []
    assert {request.split(":")[0] for request in browser.requests} <= {"file", "data", "about", "blob"}


@pytest.mark.parametrize("name", ["index", "diagnosis"])
def test_demo_pages_fit_a_phone(demo: DemoSummary, browser: Browser, name: str) -> None:
    browser.open(demo.folder / f"{name}.html", (390, 800), touch=True)
    assert browser.evaluate("document.scrollingElement.scrollWidth") <= 390
    assert (
        browser.evaluate(
            "Math.min(...[...document.querySelectorAll('p')].map(p => parseFloat(getComputedStyle(p).fontSize)))"
        )
        > 13
    )
    assert browser.errors == []


def test_demo_finds_what_it_hides(demo: DemoSummary) -> None:
    found = json.loads((demo.folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "explained"
    assert [(f["cause"], f["joint"]) for f in found["findings"]] == [("encoder_eccentricity", 3)]
    records = Measurements.read(demo.folder / "measured.csv", 6)
    again = calibrate(Arm.load("sino6"), records, ["geometry", EncoderEccentricity(3)], encoder_noise=8e-6)
    amplitude = found["findings"][0]["parameters"]["amplitude_rad"]
    fitted = next(e for e in again.model.effects if isinstance(e, EncoderEccentricity))
    assert abs(np.hypot(*fitted.values) - amplitude["value"]) < 0.3 * amplitude["u"]
    assert abs(amplitude["value"] - 1e-4) < 3 * amplitude["u"]


def test_demo_page_and_terminal_give_monte_carlo_alike(demo: DemoSummary) -> None:
    text = Page((demo.folder / "index.html").read_text(encoding="utf-8")).text.replace("\u00a0", " ")
    words = r"[-+][0-9.]+ % where the volume is smallest and [-+][0-9.]+ % where it is largest"
    assert re.findall(words, text) == re.findall(words, str(demo)) != []


def test_demo_page_says_what_is_compared(demo: DemoSummary) -> None:
    text = Page((demo.folder / "index.html").read_text(encoding="utf-8")).text.replace("\u00a0", " ")
    assert "-1.57184 ± 27.1 µrad" in text
    assert "-0.01226 ± 180 µrad" in text
    assert "total variation distance" in text
    assert "total variation distance" in str(demo)
    assert "found by looking for one that gives the printed counts" in text
    assert "68 are not explained that way" in text
    assert "the wrist reaches 1210.7 mm" in text


@pytest.mark.parametrize(("x_mm", "z_mm", "round_the_axis"), [(30.0, 700.0, True), (700.0, 300.0, False)])
def test_path_of_the_elbow_round_the_base_axis(x_mm: float, z_mm: float, round_the_axis: bool) -> None:
    cells = pd.DataFrame({"x_mm": [x_mm], "z_mm": [z_mm]})
    assert elbow_goes_round(cells).tolist() == [round_the_axis]


def test_demo_does_not_replace_files_without_force(demo: DemoSummary) -> None:
    with pytest.raises(OutputError, match="not empty"):
        run_demo(folder=demo.folder, progress=False)


def test_demo_of_an_arm_without_uncertainties_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(AacmmError, match="has an uncertainty"):
        run_demo("zero6", tmp_path / "out", progress=False)
    assert list(tmp_path.iterdir()) == []
