"""A result as blocks; shell, Jupyter and pages show the same :class:`Document`.

    document = Document("SINO6", [Heading("Residuals"), Table(frame, "RMS distance")])
    terminal.show(document)        # the shell: blocks that are not ``detail``
    html.fragment(document)        # the same for Jupyter
    html.page(document)            # all blocks, with headings, figures, scenes and files

No renderer reads text as markup.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Note, Shown
from aacmm_pin.report.numbers import in_one_unit

if TYPE_CHECKING:  # a document without pictures needs neither matplotlib nor meshcat
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from aacmm_pin.report.scenes import Scene

DPI = 130
"""Resolution of embedded figures."""
MARK = "✗"
"""Begins an important cell; bold on pages."""
NO_NUMBER = "–"
"""Replaces a missing number."""
NUMBER = re.compile(r"[*<> ]*[-+]?\d+(\.\d+)?(e[-+]?\d+)?( \S+)?")
"""A number, perhaps with a mark before and one unit after it."""
FORMATS = {"mm": "z.4f", "µm": "z.2f", "°": "z.1f"}
"""Formats of numbers by the unit of their head; others have four digits."""

Format = str | Callable[[Any], str]
"""Of a column: a format specification, or a function that returns the text."""


@dataclass(frozen=True)
class Heading:
    """Begins a section of a page; omitted by shell and Jupyter."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text.

    Attributes:
        text: one sentence or more.
        finding: emphasised on pages.
        head: emphasised words at the beginning.
        detail: for pages only.
    """

    text: str
    finding: bool = False
    head: str = ""
    detail: bool = False


@dataclass(frozen=True)
class Bullets:
    """A list of short plain texts; ``head`` is a line above."""

    items: Sequence[str]
    head: str = ""


@dataclass(frozen=True)
class Notes:
    """Assumptions and findings; the shell writes them to stderr."""

    items: Sequence[Note]


@dataclass(frozen=True, eq=False)
class Table:
    """A data frame as a table.

    Attributes:
        frame: the data without index. Names end in a unit, ``u_mm`` or ``u [mm]``; lengths ``_mm``
            appear in µm if all are small.
        caption: its content, in a few words.
        formats: of columns, such as ``{"r": ".2f"}``; default by unit or type.
        heads: of columns, such as ``{"value_mm": "value [mm]"}``; default their names.
        explained: how to read it, for pages.
        most: number of rows to show.
        detail: for pages only.
    """

    frame: pd.DataFrame
    caption: str = ""
    formats: Mapping[str, Format] = field(default_factory=dict)
    heads: Mapping[str, str] = field(default_factory=dict)
    explained: str = ""
    most: int | None = None
    detail: bool = False

    def cells(self) -> pd.DataFrame:
        """The rows to show, as text, with the heads for readers."""
        (frame,) = in_one_unit(self.frame.rename(columns=self.heads))
        format_of_head = {self.heads.get(name, name): form for name, form in self.formats.items()}
        shown_rows = frame.head(self.most or len(frame))
        texts = {}
        for name in shown_rows:
            head = str(name)
            unit = head.rpartition("[")[2].removesuffix("]")
            form = format_of_head.get(head) or FORMATS.get(unit, "")
            texts[head] = [cell(value, form) for value in shown_rows[name]]
        return pd.DataFrame(texts, dtype=object)


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawing with matplotlib, for pages; ``alt`` is for readers who cannot see it."""

    drawn: Callable[[], Drawing | Axes]
    alt: str
    caption: str

    @cached_property
    def png(self) -> bytes:
        """The cropped figure as PNG."""
        from aacmm_pin.report.plots.style import without_latex

        buffer = io.BytesIO()
        with without_latex():
            drawn = self.drawn()
            figure: Any = drawn if hasattr(drawn, "savefig") else drawn.figure
            figure.savefig(
                buffer, format="png", dpi=DPI, facecolor="white", metadata={"Software": None}
            )
        return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class SceneView:
    """A 3D scene on a page."""

    scene: Callable[[], Scene]
    caption: str


@dataclass(frozen=True)
class Download:
    """A file inside a page, or without ``content`` beside it; ``text`` describes the file."""

    name: str
    text: str
    content: bytes | None = None


@dataclass(frozen=True, eq=False)
class Folded:
    """Blocks of a page that the reader can open; never on paper."""

    head: str
    blocks: Sequence[Block]


Block = Heading | Paragraph | Bullets | Notes | Table | Figure | SceneView | Download | Folded | str
FOR_PAGES = (Heading, Figure, SceneView, Download, Folded)


class Document:
    """A result as blocks.

    Attributes:
        blocks: in order, without empty ones.
        sheet: table rows that fit if the document is one sheet of paper to sign; else 0.
        by_hand: fields to fill in by hand, below the blocks before the first heading.
    """

    def __init__(
        self,
        title: str,
        blocks: Iterable[Block],
        subtitle: str = "",
        sheet: int = 0,
        by_hand: Sequence[str] = (),
    ) -> None:
        """Make paragraphs of plain strings, and omit empty blocks."""
        self.title, self.subtitle, self.sheet = title, subtitle, sheet
        self.by_hand = by_hand or (("Operator", "Date", "Signature") if sheet else ())
        given = [Paragraph(b) if isinstance(b, str) else b for b in blocks]
        self.blocks = [block for block in given if not _is_empty(block)]

    def short(self) -> list[Block]:
        """The blocks that the shell and Jupyter show."""
        shown = [block for block in self.blocks if not isinstance(block, FOR_PAGES)]
        return [block for block in shown if not getattr(block, "detail", False)]


def _is_empty(block: Block) -> bool:
    match block:
        case Paragraph(text=text, head=head):
            return not (text or head)
        case Bullets(items=items) | Notes(items=items):
            return not items
        case Table(frame=frame):
            return frame.empty
    return False


@singledispatch
def document_of(result: object) -> Document:
    """The document of a result; add a class by ``@document_of.register``.

    Raises:
        TypeError: the class has no document.
    """
    raise TypeError(f"{type(result).__name__} has no document; expected a result of this package")


@document_of.register
def shown_document(result: Shown) -> Document:
    """A result by its text, else by those of its fields and properties that are numbers or
    words.
    """
    kind = type(result)
    if kind.__str__ is not object.__str__:
        return Document(kind.__name__, [Paragraph(str(result), head=f"{kind.__name__}:")])
    names = [f.name for f in fields(result)]  # type: ignore[arg-type]
    names += [name for name, member in vars(kind).items() if isinstance(member, property)]
    values = {name: getattr(result, name) for name in names}
    row = {name: [value] for name, value in values.items() if isinstance(value, str | int | float)}
    return Document(kind.__name__, [Table(pd.DataFrame(row), f"{kind.__name__}, in SI units")])


def cell(value: object, form: Format = "") -> str:
    """A value of a table as text."""
    if value is None or value is pd.NA or (isinstance(value, float) and np.isnan(value)):
        return NO_NUMBER
    if callable(form):
        return form(value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ", ".join(map(cell, value))
    return format(value, form or ".4g") if isinstance(value, float) else str(value)


def blank_axes(width: float, height: float, **kind: Any) -> Any:
    """Axes of a new figure outside pyplot [inches]; ``kind`` as for ``add_subplot``."""
    from matplotlib.figure import Figure as Drawing

    return Drawing(figsize=(width, height), layout="constrained").add_subplot(**kind)


def are_numbers(texts: Iterable[str]) -> bool:
    """Whether every cell is one number, or empty."""
    return all(text in ("", NO_NUMBER) or NUMBER.fullmatch(text) for text in texts)
