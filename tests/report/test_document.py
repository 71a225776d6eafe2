"""Documents: the same blocks in the shell, in Jupyter and on a page, escaped, whole, and fetching
nothing.
"""

from __future__ import annotations

import base64
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure as Drawing

from aacmm_pin import ErrorModel
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import count
from aacmm_pin.errors import OutputError
from aacmm_pin.report import formats, results
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Download,
    Figure,
    Folded,
    Heading,
    Notes,
    Paragraph,
    SceneView,
    Table,
)
from aacmm_pin.report.formats import html
from aacmm_pin.report.numbers import in_one_unit, lengths, p_equals, small, spread
from tests.pages import Page

EVIL = '<script>alert("x")</script> & {{ 7 * 7 }} [red]'


def line(size: tuple[float, float] = (2, 1)) -> Drawing:
    figure = Drawing(figsize=size)
    figure.add_subplot().plot([0, 1])
    return figure


def every_block(text: str = "words") -> list[Block]:
    return [
        "Before",
        Heading(text),
        text,
        Paragraph(text, finding=True, head=text),
        Bullets([text], text),
        Notes([text]),
        Table(pd.DataFrame({text: [text, "b"], "n": [1, 2]}), text, explained=text, most=1),
        Figure(line, text, text),
        Download("a.csv", text, b"a,b\n"),
        Download("other.html", text),
        Heading("Left out, as it has nothing to show"),
        *("", Bullets([]), Table(pd.DataFrame())),
        Heading("Details"),
        Paragraph("LONG", detail=True),
    ]


def test_a_page_has_every_block_and_fetches_nothing():
    text = html.page(Document("T", every_block(), "S"))
    parsed = Page(text)
    for forbidden in ("http", "url(", "@import"):
        assert forbidden not in text
    for tag, attributes in parsed.tags:
        assert tag not in {"script", "iframe", "object"}
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("data:", "#", "other.html"))
    (image,) = parsed.all("img")
    head, data = image["src"].split(",")
    assert head == "data:image/png;base64"
    assert base64.b64decode(data).startswith(b"\x89PNG")
    assert parsed.downloads() == {"a.csv": b"a,b\n"}
    assert len(parsed.all("tr")) == 2
    assert "1 more" in parsed.text
    assert parsed.text.count("LONG") == 1
    ids = {attributes["id"] for attributes in parsed.all("section")}
    assert {
        a["href"].removeprefix("#") for a in parsed.all("a") if a["href"].startswith("#")
    } == ids
    assert len(ids) == 2


def test_text_is_never_markup_and_a_fragment_is_short():
    blocks = every_block(EVIL)
    page, card = Page(html.page(Document("T", blocks))), Page(html.fragment(Document("T", blocks)))
    assert page.all("script") == card.all("script") == []
    assert page.text.count(EVIL) >= 14
    assert page.all("img")[0]["alt"] == EVIL
    assert card.text.count(EVIL) >= 8
    assert "LONG" not in card.text
    assert not {"img", "a", "style", "h1", "h2"} & {tag for tag, _ in card.tags}


def test_cells_are_text_with_the_unit_in_the_head():
    frame = pd.DataFrame(
        {
            "u_mm": [0.01234, np.nan],
            "length a_mm": [-0.05, 1e-9],
            "swivel_deg": [1.26, -0.04],
            "largest_volume_mm3": [0.0123456, 1.0],
            "T": [1234.5, 0.1],
            "whole": pd.array([3, None], dtype="Int64"),
            "flag": [True, False],
            "names": [("a", "b"), ()],
            "share": [0.25, 1.0],
            "long": ["x" * 60, None],
        }
    )
    table = Table(
        frame,
        "caption",
        {"T": ".1f", "share": lambda share: f"{100 * share:.0f} %"},
        {"T": "times"},
    )
    assert table.cells().to_dict("list") == {
        "u [µm]": ["12.34", "–"],
        "length a [µm]": ["-50.00", "0.00"],
        "swivel [°]": ["1.3", "0.0"],
        "largest volume [mm³]": ["0.01235", "1"],
        "times": ["1234.5", "0.1"],
        "whole": ["3", "–"],
        "flag": ["yes", "no"],
        "names": ["a, b", ""],
        "share": ["25 %", "100 %"],
        "long": ["x" * 60, "–"],
    }
    heads = [
        attributes["class"] for attributes in Page(html.page(Document("T", [table]))).all("th")
    ]
    assert heads == [*["number"] * 6, "short", "short", "number", "long"]
    small, large = in_one_unit(
        frame[["u_mm"]], pd.DataFrame({"x_mm": [500.0], "point [mm]": [1.0]})
    )
    assert (list(small), list(large)) == (["u [mm]"], ["x [mm]", "point [mm]"])


def test_numbers_have_one_style():
    sizes = [3.12e-4, 99.96e-6, 52.34e-6, 1.5e-6, 0.0, 1.0]
    assert [lengths([size])[0] for size in sizes] == [
        "0.312 mm",
        "0.100 mm",
        "52.3 µm",
        "1.50 µm",
        "0 µm",
        "1000 mm",
    ]
    assert lengths([3.12e-4, 5.234e-5]) == ["0.312 mm", "0.0523 mm"]
    assert [p_equals(p) for p in (0.0312, 3e-7, 0.0)] == ["p = 0.03", "p = 3e-07", "p < 1e-16"]
    units = {"mm": "µm", "rad": "µrad", "rad/(N·m)": "µrad/(N·m)", "1/K": "ppm/K", "1": "ppm"}
    assert {unit: small(0.0, unit).partition(" ")[2] for unit in units} == units
    assert [small(0.13456, unit) for unit in ("m", "mm", "rad", "1")] == [
        "134.6 mm",
        "134.6 µm",
        "134.6 mrad",
        "1.346e+05 ppm",
    ]
    assert (count(1, "record"), count(2, "record")) == ("1 record", "2 records")
    ends = spread(pd.DataFrame({"v": [np.nan, 1.0, 4.0, 3.0, np.inf]}), "over")
    assert ends["v"].to_list() == [1.0, 3.0, 4.0]
    text = html.page(Document("T", ["u = 0.07 mm, 5 %, 3 mmHg"]))
    assert "u\u00a0=\u00a00.07\u00a0mm, 5\u00a0%, 3 mmHg" in text


def test_no_column_of_a_table_with_long_names_is_cut(page, tmp_path):
    names = [
        f"seat granite_table_north_east_corner_hole_{k}_of_the_second_fixture" for k in range(3)
    ]
    frame = pd.DataFrame({"where": names, "records": 30})
    frame = frame.assign(
        **{f"{name}_mm": 0.1234 for name in ("nominal", "predicted", "extended")}, times=1.5
    )
    (tmp_path / "page.html").write_text(
        html.page(Document("Page", [Table(frame, "Where")])), encoding="utf-8"
    )
    page.open(tmp_path / "page.html", (1000, 800))
    wide, there = (
        page.evaluate(f"document.querySelector('.scroll').{name}Width")
        for name in ("scroll", "client")
    )
    assert wide == there


@pytest.mark.parametrize("suffix", formats.suffixes())
def test_every_format_has_the_text_of_every_block(suffix):
    scene = SimpleNamespace(embedded=lambda: "")
    blocks = [
        Heading("heading"),
        Paragraph("paragraph", head="opening"),
        Paragraph("particular", detail=True),
        Bullets(["item"], "several"),
        Notes([Note("copies", {"rows": [3, 4]})]),
        Table(pd.DataFrame({"column": ["cell"]}), "table", explained="reading"),
        Figure(line, "drawing", "legend"),
        SceneView(lambda: scene, "view"),
        Download("data.csv", "measured", b"a,b\n"),
        Folded("unfold", [Paragraph("within")]),
    ]
    assert {type(block) for block in blocks} | {str} == {*get_args(Block)}
    text = formats.content(Document("title", blocks, "subtitle"), f"page{suffix}").decode()
    words = "title subtitle heading paragraph opening particular item several column cell table "
    words += "reading drawing legend view data.csv measured unfold within"
    missing = [word for word in words.split() if word not in text]
    assert missing == []
    assert "3, 4" in text


def test_the_end_of_a_name_chooses_the_format(tmp_path, monkeypatch):
    arm = ErrorModel.load("sino6").arm
    with pytest.raises(OutputError, match="html"):
        results.write(arm, tmp_path / "arm.titles")
    code = "def page(document):\n    return document.title\n"
    (tmp_path / "titles.py").write_text(code, encoding="utf-8")
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    results.write(arm, tmp_path / "arm.titles")
    assert "SINO6" in (tmp_path / "arm.titles").read_text(encoding="utf-8")
    results.write(arm, tmp_path / "arm")
    assert "</html>" in (tmp_path / "arm").read_text(encoding="utf-8")
