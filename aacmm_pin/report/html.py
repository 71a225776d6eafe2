"""One self-contained HTML page: paragraphs, tables, pictures and downloads in sections; nothing is fetched from anywhere.

Text is text: it is escaped, never read as markup.
"""

from __future__ import annotations

import base64
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, cast

import jinja2
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin.report.scenes import Scene, shared_script

DPI = 130
"""Resolution of embedded pictures; they are shown at most as wide as the text."""

WIDE = 1050
"""A picture of more columns than this has several panels side by side; on a phone it is scrolled, not shrunk [pixels]."""

_TIES = re.compile(r"(?<=[0-9=]) (?=(?:mm³|mm|µm|kB|%|°)(?!\w))|(?<==) (?=[-0-9])|(?<=[\wθζ]) (?==\s-?[0-9])")
SHORT = 22
"""Texts up to this many characters stay on one line of a table."""


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text; ``finding`` sets it off from the rest."""

    text: str
    finding: bool = False
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Bullets:
    """A list of short plain texts."""

    items: Sequence[str]
    kind: ClassVar[str] = "bullets"


@dataclass(frozen=True, eq=False)
class Table:
    """A data frame as a table.

    Attributes:
        frame: the data; the index is not shown.
        caption: what it shows.
        formats: format of the numbers of a column, such as ``{"u_mm": ".4f"}``; others as they print.
        heads: heads of columns whose name is not what a reader should see, such as ``{"u_mm": "u [mm]"}``.
    """

    frame: pd.DataFrame
    caption: str
    formats: Mapping[str, str] = field(default_factory=dict)
    heads: Mapping[str, str] = field(default_factory=dict)
    kind: ClassVar[str] = "table"

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Head and style of every column: ``number``, ``short`` (not broken into lines) or ``long`` text."""
        texts = zip(*self.rows, strict=True) if len(self.frame) else [()] * len(self.frame.columns)
        return [
            (self.heads.get(name, name), "number" if _numeric(self.frame[name]) else _text_style(cells))
            for name, cells in zip(self.frame.columns, texts, strict=True)
        ]

    @property
    def rows(self) -> list[list[str]]:
        """All cells as text; a dash where there is no number."""
        columns = [[_cell(v, self.formats.get(c, "")) for v in self.frame[c]] for c in self.frame.columns]
        return [list(row) for row in zip(*columns, strict=True)]


@dataclass(frozen=True, eq=False)
class Picture:
    """An embedded PNG.

    Attributes:
        png: the picture.
        alt: what it shows, for those who cannot see it.
        caption: text below.
    """

    png: bytes
    alt: str
    caption: str
    kind: ClassVar[str] = "picture"

    @staticmethod
    def of(drawn: Figure | Axes, alt: str, caption: str) -> Picture:
        """A matplotlib figure, or the one that the axes are in, as a picture."""
        return Picture(png_bytes(drawn if isinstance(drawn, Figure) else cast(Figure, drawn.figure)), alt, caption)

    @property
    def wide(self) -> bool:
        """Whether it would be unreadable on a phone unless it can be scrolled."""
        return int.from_bytes(self.png[16:20], "big") > WIDE  # bytes 16 to 19 of a PNG are its width

    @property
    def uri(self) -> str:
        """The picture as a ``data:`` URI."""
        return data_uri(self.png, "image/png")


@dataclass(frozen=True)
class Download:
    """A file inside the page."""

    name: str
    content: bytes
    media: str
    text: str
    kind: ClassVar[str] = "download"

    @property
    def uri(self) -> str:
        """The file as a ``data:`` URI."""
        return data_uri(self.content, self.media)

    @property
    def size(self) -> str:
        """Size for the reader."""
        return f"{len(self.content) / 1e3:.0f} kB" if len(self.content) >= 1000 else f"{len(self.content)} B"


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene in three dimensions that can be turned, on a screen; paper has no use for it.

    Attributes:
        scene: what is shown.
        caption: text below.
        height: of the frame that it is shown in [px].
    """

    scene: Scene
    caption: str
    height: int = 520
    kind: ClassVar[str] = "scene"

    @property
    def markup(self) -> Markup:
        """The frame and what fills it."""
        return Markup(self.scene.embedded(self.height))


Part = str | Paragraph | Bullets | Table | Picture | SceneView | Download


@dataclass(frozen=True)
class Section:
    """A section of the page; a plain string among its parts is a paragraph."""

    title: str
    parts: Sequence[Part]


def render_report(title: str, subtitle: str, sections: Sequence[Section], *, language: str = "en") -> str:
    """The page as HTML.

    Args:
        title: title of the page.
        subtitle: one line below it.
        sections: in the order in which they are read.
        language: language of the text, as in HTML's ``lang``.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aacmm_pin.report", "templates"),
        autoescape=True,
        finalize=_kept_together,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    content = [
        {"id": f"s{number}", "title": section.title, "parts": [_as_part(part) for part in section.parts]}
        for number, section in enumerate(sections, start=1)
    ]
    # The viewer of scenes is large, and stands on the page once, however many there are.
    viewer = Markup(shared_script() if any(isinstance(part, SceneView) for s in sections for part in s.parts) else "")
    template = environment.get_template("report.html.j2")
    return template.render(title=title, subtitle=subtitle, sections=content, language=language, viewer=viewer)


def blank_axes(width: float, height: float) -> Axes:
    """Axes of a figure that pyplot does not know [inches]."""
    return Figure(figsize=(width, height), layout="constrained").add_subplot()


def png_bytes(figure: Figure, dpi: int = DPI) -> bytes:
    """A matplotlib figure as PNG, cut to what is drawn."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, bbox_inches="tight", facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def data_uri(content: bytes, media: str) -> str:
    """``content`` as a ``data:`` URI of the given media type."""
    return f"data:{media};base64,{base64.b64encode(content).decode('ascii')}"


def _as_part(part: Part) -> Paragraph | Bullets | Table | Picture | SceneView | Download:
    return Paragraph(part) if isinstance(part, str) else part


def _numeric(column: pd.Series[Any]) -> bool:
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def _kept_together(value: object) -> object:
    """Text with its numbers tied to their units and to equals signs by spaces that do not break."""
    return _TIES.sub("\u00a0", value) if type(value) is str else value


def _text_style(cells: Sequence[str]) -> str:
    return "short" if max(map(len, cells), default=0) <= SHORT else "long"


def _cell(value: object, spec: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, str):
        return value
    return format(cast(Any, value), spec) if spec else str(value)
