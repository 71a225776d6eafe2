"""Documents: the same blocks in the shell, in Jupyter and on a page, escaped, whole, and fetching nothing."""

from __future__ import annotations

import base64

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Drawing

from aacmm_pin import Arm
from aacmm_pin.report import html
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Details,
    Document,
    Download,
    Figure,
    Heading,
    Link,
    Notes,
    Paragraph,
    SceneView,
    Table,
    cell,
)
from aacmm_pin.report.scenes import arm_scene
from aacmm_pin.report.scenes.page import viewer_script
from tests.pages import Page

EVIL = '<script>alert("x")</script> & {{ 7 * 7 }} [red]'


def line(size: tuple[float, float] = (2, 1)) -> Drawing:
    figure = Drawing(figsize=size)
    figure.add_subplot().plot([0, 1])
    return figure


def every_block(text: str = "words") -> list[Block]:
    frame = pd.DataFrame({text: [text, "b"], "n": [1, 2]})
    return [
        Heading(text),
        text,
        Paragraph(text, finding=True, head=text),
        Bullets([text], text),
        Notes([text]),
        Table(frame, text, explained=text, most=1),
        Figure(line, text, text),
        Download("a.csv", b"a,b\n", "text/csv", text),
        Link("other.html", text),
        Details(text, [text, Bullets([text])]),
    ]


def page_of(*blocks: Block) -> Page:
    return Page(html.page(Document("Title", [Heading("First"), *blocks], "Below it")))


def test_a_page_has_every_block_and_fetches_nothing() -> None:
    text = html.page(Document("T", every_block(), "S"))
    parsed = Page(text)
    assert "http" not in text
    assert "url(" not in text
    assert "@import" not in text
    for tag, attributes in parsed.tags:
        assert tag not in {"script", "iframe", "object"}
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("data:", "#", "other.html"))
    (image,) = parsed.all("img")
    head, data = image["src"].split(",")
    assert head == "data:image/png;base64"
    assert base64.b64decode(data).startswith(b"\x89PNG")
    (link,) = (a for a in parsed.all("a") if "download" in a)
    assert (link["download"], base64.b64decode(link["href"].split(",")[1])) == ("a.csv", b"a,b\n")
    assert len(parsed.all("tr")) == 3
    assert '<meta name="viewport" content="width=device-width' in text
    assert "@media print" in text
    assert '<html lang="en">' in text


def test_text_is_never_markup() -> None:
    parsed = page_of(*every_block(EVIL))
    assert parsed.all("script") == []
    assert parsed.text.count(EVIL) >= 14
    assert parsed.all("img")[0]["alt"] == EVIL
    card = Page(html.fragment(Document("T", every_block(EVIL))))
    assert card.all("script") == []
    assert card.text.count(EVIL) >= 9


def test_a_fragment_is_short_and_needs_no_style_sheet() -> None:
    blocks = [
        *every_block(),
        Paragraph("LONG", detail=True),
        Bullets(["LONG"], detail=True),
        "",
        Bullets([]),
        Table(pd.DataFrame()),
    ]
    text = html.fragment(Document("T", blocks, "S"))
    card = Page(text)
    assert "LONG" not in text
    assert not {"img", "a", "style", "h1", "h2"} & {tag for tag, _ in card.tags}
    assert len(card.all("tr")) == 2
    assert "1 more" in card.text
    assert "LONG" in Page(html.page(Document("T", blocks))).text


def test_wide_figures_stay_readable_on_a_phone() -> None:
    for size, kind in (((10, 3), "wide"), ((4, 2), ""), ((2, 4), "")):
        parsed = page_of(Figure(line(size), "A line", ""))
        assert [attributes.get("class", "") for attributes in parsed.all("figure")] == [kind]


def test_scenes_share_one_viewer() -> None:
    scene = arm_scene(Arm.load("sino6"), np.zeros((1, 6)))
    text = html.page(
        Document("T", [Heading("A"), SceneView(scene, "First"), Heading("B"), SceneView(lambda: scene, "Second")])
    )
    assert text.count(viewer_script()) == 1
    assert len(text) < 2 * len(scene.html())
    parsed = Page(text)
    assert [frame["class"] for frame in parsed.all("iframe")] == ["aacmm-scene"] * 2
    assert page_of("No scene").all("script") == []


def test_cells_are_text() -> None:
    frame = pd.DataFrame(
        {
            "u_mm": [0.12345, np.nan],
            "whole": pd.array([3, None], dtype="Int64"),
            "flag": [True, False],
            "names": [("a", "b"), ()],
            "word": ["<b>", None],
            "long": ["x" * 60, ""],
        }
    )
    text = Table(frame, "caption", {"u_mm": ".2f", "flag": lambda yes: "on" if yes else "off"}, {"u_mm": "u [mm]"}).cells()
    assert text.to_dict("list") == {
        "u [mm]": ["0.12", "–"],
        "whole": ["3", "–"],
        "flag": ["on", "off"],
        "names": ["a, b", ""],
        "word": ["<b>", "–"],
        "long": ["x" * 60, ""],
    }
    assert (cell(1.23456789), cell(True), cell(None)) == ("1.23457", "yes", "–")
    heads = [attributes["class"] for attributes in page_of(Table(frame)).all("th")]
    assert heads == ["number", "number", "short", "short", "short", "long"]


def test_numbers_stay_with_their_units() -> None:
    text = html.page(Document("T", ["u = 0.07 mm, 5 %, 3 mmHg"]))
    assert "u\u00a0=\u00a00.07\u00a0mm, 5\u00a0%, 3 mmHg" in text


def test_sections_are_linked() -> None:
    parsed = Page(html.page(Document("T", ["Before", Heading("One"), Heading("Two")])))
    ids = {attributes["id"] for attributes in parsed.all("section")}
    assert {a["href"].removeprefix("#") for a in parsed.all("a")} == ids
    assert len(ids) == 2
