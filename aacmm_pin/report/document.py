"""A result told once, as blocks; the shell, Jupyter and a page each show the same :class:`Document`.

    document = Document(
        "SINO6: calibration",
        [
            Heading("Residuals"),
            Paragraph("The residuals fell by 29 %.", finding=True),
            Table(frame, "RMS distance of tip and target", {"before [mm]": ".4f"}),
            Figure(lambda: plots.plot_groups(found, blank_axes(9.3, 4.0)), "RMS by group", "RMS of the residuals."),
        ],
        "300 records of data.csv",
    )
    terminal.show(document)        # the shell: what is not ``detail``
    html.fragment(document)        # the same for Jupyter
    html.page(document)            # all of it, with headings, figures, scenes and files

Text is text: no renderer reads it as markup.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

if TYPE_CHECKING:  # a document without pictures needs neither matplotlib nor meshcat
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from aacmm_pin.report.scenes import Scene

DPI = 130
"""Resolution of embedded figures; they are shown at most as wide as the text."""
NOTHING = "–"
"""Stands where there is no number."""
NUMBER = re.compile(r"[*<> ]*[-+]?\d+(\.\d+)?(e[-+]?\d+)?( \S+)?")
"""A number, perhaps with a mark before and one unit behind."""

Format = str | Callable[[Any], str]
"""How a value of a column is written: a format specification, or a function that gives its text."""


@dataclass(frozen=True)
class Heading:
    """Begins a section of a page; the shell and Jupyter have no sections."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text.

    Attributes:
        text: one sentence or more.
        finding: it is set off from the rest of a page.
        head: words in front that stand out.
        detail: for pages only.
    """

    text: str
    finding: bool = False
    head: str = ""
    detail: bool = False


@dataclass(frozen=True)
class Bullets:
    """A list of short plain texts under a line of its own.

    Attributes:
        items: the texts; nothing is shown where there are none.
        head: the line above.
        detail: for pages only.
    """

    items: Sequence[str]
    head: str = ""
    detail: bool = False


@dataclass(frozen=True)
class Notes:
    """What was assumed or found beside; the shell writes it to the error stream."""

    items: Sequence[str]


@dataclass(frozen=True, eq=False)
class Table:
    """A data frame as a table.

    Attributes:
        frame: the data; the index is not shown.
        caption: what it shows, in a few words.
        formats: how the values of a column are written, such as ``{"u_mm": ".4f"}``; others as they print.
        heads: heads of columns whose name is not what a reader should see, such as ``{"u_mm": "u [mm]"}``.
        explained: how to read it, for pages.
        most: at most so many rows in the shell and Jupyter, and how many more there are.
        most_on_page: the same of a page.
        on_page, in_short: names of columns for pages only, and for the shell and Jupyter only.
        detail: for pages only.
    """

    frame: pd.DataFrame
    caption: str = ""
    formats: Mapping[str, Format] = field(default_factory=dict)
    heads: Mapping[str, str] = field(default_factory=dict)
    explained: str = ""
    most: int | None = None
    most_on_page: int | None = None
    on_page: Sequence[str] = ()
    in_short: Sequence[str] = ()
    detail: bool = False

    def cells(self, most: int | None = None, *, short: bool = False) -> pd.DataFrame:
        """The first ``most`` rows with text in every cell, under the heads that a reader sees."""
        rows = self.frame.head(most) if most is not None else self.frame
        hidden = self.on_page if short else self.in_short
        names = [str(name) for name in rows if name not in hidden]
        found = {self.heads.get(n, n): [cell(value, self.formats.get(n, "")) for value in rows[n]] for n in names}
        return pd.DataFrame(found, dtype=object)


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawing with matplotlib, for pages.

    Attributes:
        drawn: a figure, axes of one, or a function that draws it when a page needs it.
        alt: what it shows, for those who cannot see it.
        caption: text below.
    """

    drawn: Drawing | Axes | Callable[[], Drawing | Axes]
    alt: str
    caption: str

    @cached_property
    def png(self) -> bytes:
        """The figure as PNG, cut to what is drawn."""
        drawn = self.drawn() if callable(self.drawn) else self.drawn
        figure: Any = drawn if hasattr(drawn, "savefig") else drawn.figure
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=DPI, bbox_inches="tight", facecolor="white", metadata={"Software": None})
        return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene in three dimensions that can be turned, on the screen of a page.

    Attributes:
        scene: what is shown, or a function that makes it when a page needs it.
        caption: text below.
        height: of the frame that it is shown in [px].
    """

    scene: Scene | Callable[[], Scene]
    caption: str
    height: int = 520


@dataclass(frozen=True)
class Download:
    """A file inside a page.

    Attributes:
        name: the name under which it is saved.
        content: the file.
        media: its media type, such as ``text/csv``.
        text: what it holds.
    """

    name: str
    content: bytes
    media: str
    text: str


@dataclass(frozen=True)
class Link:
    """A line with a link to another page.

    Attributes:
        target: where it leads, such as ``diagnosis.html``.
        text: what is there.
    """

    target: str
    text: str


@dataclass(frozen=True)
class Details:
    """Blocks that a reader may fold out; the shell leaves them out."""

    summary: str
    blocks: Sequence[Block]


Block = Heading | Paragraph | Bullets | Notes | Table | Figure | SceneView | Download | Link | Details | str


@dataclass(frozen=True)
class Document:
    """What is told of a result.

    Attributes:
        title: title of the page.
        blocks: in the order in which they are read; a plain string is a paragraph, and an empty one nothing.
        subtitle: one line below the title.
    """

    title: str
    blocks: Sequence[Block]
    subtitle: str = ""

    def short(self) -> list[Block]:
        """The blocks that the shell and Jupyter show."""
        for_pages = (Heading, Figure, SceneView, Download, Link)
        shown = [Paragraph(b) if isinstance(b, str) else b for b in self.blocks if not isinstance(b, for_pages)]
        return [b for b in shown if not getattr(b, "detail", False) and not is_empty(b)]


@singledispatch
def document_of(result: object) -> Document:
    """The document that tells of a result: ``@document_of.register`` gives another class one.

    Raises:
        TypeError: its class has none.
    """
    raise TypeError(f"{type(result).__name__} has no document")


def is_empty(block: Block) -> bool:
    """Whether there is nothing to show: no text, no item, no row."""
    match block:
        case Paragraph(text=text, head=head):
            return not (text or head)
        case Bullets(items=items) | Notes(items=items):
            return not items
        case Table(frame=frame):
            return frame.empty
        case Details(blocks=blocks):
            return not blocks
        case str():
            return not block
    return False


def cell(value: object, form: Format = "") -> str:
    """A value of a table as text; a dash where there is none."""
    if value is None or value is pd.NA or (isinstance(value, float) and np.isnan(value)):
        return NOTHING
    if callable(form):
        return form(value)
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ", ".join(map(str, value))
    return format(value, form) if form else f"{value:.6g}" if isinstance(value, float) else str(value)


def blank_axes(width: float, height: float) -> Axes:
    """Axes of a figure that pyplot does not know [inches]."""
    from matplotlib.figure import Figure as Drawing

    return Drawing(figsize=(width, height), layout="constrained").add_subplot()


def are_numbers(texts: Iterable[str]) -> bool:
    """Whether every cell of a column is one number, or nothing."""
    return all(NUMBER.fullmatch(text) or text in ("", NOTHING) for text in texts)
