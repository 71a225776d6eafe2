"""A result as blocks; the shell, Jupyter and a page each show the same :class:`Document`.

    document = Document(
        "SINO6: calibration",
        [
            Heading("Residuals"),
            Paragraph("The residuals fell by 29 %.", finding=True),
            Table(frame, "RMS distance of tip and target"),
            Figure(lambda: plots.plot_groups(found, blank_axes(9.3, 4.0)), "RMS by group", "RMS of
                the residuals."),
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
from dataclasses import dataclass, field, fields
from functools import cached_property, singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin.report.numbers import in_one_unit

if TYPE_CHECKING:  # a document without pictures needs neither matplotlib nor meshcat
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

    from aacmm_pin.report.scenes import Scene

DPI = 130
"""Resolution of embedded figures; they are shown at most as wide as the text."""
MARK = "✗"
"""Begins a cell that must not be overlooked; a page has it in bold."""
NO_NUMBER = "–"
"""Stands where there is no number."""
NUMBER = re.compile(r"[*<> ]*[-+]?\d+(\.\d+)?(e[-+]?\d+)?( \S+)?")
"""A number, perhaps with a mark before and one unit behind."""
FORMATS = {"mm": "z.4f", "µm": "z.2f", "°": "z.1f"}
"""How numbers are written under a head with such a unit; others have four digits."""

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
        items: the texts.
        head: the line above.
    """

    items: Sequence[str]
    head: str = ""


@dataclass(frozen=True)
class Notes:
    """Assumptions and findings of a result; the shell writes them to the error stream."""

    items: Sequence[Note]


@dataclass(frozen=True, eq=False)
class Table:
    """A data frame as a table.

    Attributes:
        frame: the data; the index is not shown. Units stand at the end of names, ``u_mm`` or ``u
            [mm]``; lengths of the first kind are in mm, and shown in µm where all of them are
            small.
        caption: its content, in a few words.
        formats: formats of columns, such as ``{"r": ".2f"}``, if not those of their unit or type.
        heads: heads of columns, if not their names, such as ``{"value_mm": "value [mm]"}``.
        explained: how to read it, for pages.
        most: at most so many rows, and how many more there are.
        spare: head of a column that the shell leaves out where the table would be too wide with it.
        detail: for pages only.
    """

    frame: pd.DataFrame
    caption: str = ""
    formats: Mapping[str, Format] = field(default_factory=dict)
    heads: Mapping[str, str] = field(default_factory=dict)
    explained: str = ""
    most: int | None = None
    detail: bool = False
    spare: str = ""

    def cells(self) -> pd.DataFrame:
        """The rows that are shown, with text in every cell, under the heads that a reader sees."""
        (frame,) = in_one_unit(self.frame.rename(columns=self.heads))
        forms = {self.heads.get(name, name): form for name, form in self.formats.items()}
        shown = frame.head(self.most or len(frame))
        texts = {}
        for name in shown:
            head = str(name)
            unit = head.rpartition("[")[2].removesuffix("]")
            form = forms.get(head) or FORMATS.get(unit, "")
            texts[head] = [cell(value, form) for value in shown[name]]
        return pd.DataFrame(texts, dtype=object)


@dataclass(frozen=True, eq=False)
class Figure:
    """A drawing with matplotlib, for pages.

    Attributes:
        drawn: draws a figure, or axes of one, when a page needs it.
        alt: what it shows, for those who cannot see it.
        caption: text below.
    """

    drawn: Callable[[], Drawing | Axes]
    alt: str
    caption: str

    @cached_property
    def png(self) -> bytes:
        """The figure as PNG, cut to what is drawn."""
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
    """A scene in three dimensions that can be turned, on the screen of a page.

    Attributes:
        scene: makes what is shown when a page needs it.
        caption: text below.
        height: of the frame that it is shown in [px].
    """

    scene: Callable[[], Scene]
    caption: str
    height: int = 520


@dataclass(frozen=True)
class Download:
    """A file inside a page, or beside it.

    Attributes:
        name: the name under which it is saved, or where it is.
        text: what it holds.
        content: the file; None where it stands beside the page.
    """

    name: str
    text: str
    content: bytes | None = None


@dataclass(frozen=True, eq=False)
class Folded:
    """Blocks of a page that are shown when the reader asks for them, and never on paper.

    Attributes:
        head: what they are.
        blocks: what is shown.
    """

    head: str
    blocks: Sequence[Block]


Block = Heading | Paragraph | Bullets | Notes | Table | Figure | SceneView | Download | Folded | str
FOR_PAGES = (Heading, Figure, SceneView, Download, Folded)


class Document:
    """A result as blocks.

    Attributes:
        title: title of the page.
        blocks: in the order in which they are read, those left out that have nothing to show.
        subtitle: one line below the title.
        sheet: rows of tables that it has where it is to take one sheet of paper to be signed, and
            is set closely for it; 0 where not.
        by_hand: what is filled in by hand on paper, below the blocks before the first heading.
    """

    def __init__(
        self,
        title: str,
        blocks: Iterable[Block],
        subtitle: str = "",
        sheet: int = 0,
        by_hand: Sequence[str] = (),
    ) -> None:
        """A plain string among the blocks is a paragraph."""
        self.title, self.subtitle, self.sheet = title, subtitle, sheet
        self.by_hand = by_hand or ("Operator", "Date", "Signature") * bool(sheet)
        given = [Paragraph(b) if isinstance(b, str) else b for b in blocks]
        self.blocks = [block for block in given if not _is_empty(block)]

    def short(self) -> list[Block]:
        """The blocks that the shell and Jupyter show."""
        shown = [block for block in self.blocks if not isinstance(block, FOR_PAGES)]
        return [block for block in shown if not getattr(block, "detail", False)]


def _is_empty(block: Block) -> bool:
    """Whether there is nothing to show: no text, no item, no row."""
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
    """The document of a result: ``@document_of.register`` gives another class one.

    Raises:
        TypeError: its class has none.
    """
    raise TypeError(f"{type(result).__name__} has no document; expected a result of this package")


@document_of.register
def shown_document(result: Shown) -> Document:
    """A result by its text; one without text by its fields and properties that are numbers or
    words.
    """
    kind = type(result)
    if kind.__str__ is not object.__str__:
        return Document(kind.__name__, [Paragraph(str(result), head=f"{kind.__name__}:")])
    names = [f.name for f in fields(result)]  # type: ignore[arg-type]
    names += [name for name, member in vars(kind).items() if isinstance(member, property)]
    values = {name: getattr(result, name) for name in names}
    row = {
        name: [value]
        for name, value in values.items()
        if isinstance(value, str | int | float | tuple | None)
    }
    return Document(kind.__name__, [Table(pd.DataFrame(row), f"{kind.__name__}, in SI units")])


def cell(value: object, form: Format = "") -> str:
    """A value of a table as text; a dash where there is none."""
    if value is None or value is pd.NA or (isinstance(value, float) and np.isnan(value)):
        return NO_NUMBER
    if callable(form):
        return form(value)
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ", ".join(map(cell, value))
    return format(value, form or ".4g") if isinstance(value, float) else str(value)


def blank_axes(width: float, height: float) -> Axes:
    """Axes of a figure that pyplot does not know [inches]."""
    from matplotlib.figure import Figure as Drawing

    return Drawing(figsize=(width, height), layout="constrained").add_subplot()


def are_numbers(texts: Iterable[str]) -> bool:
    """Whether every cell of a column is one number, or nothing."""
    return all(text in ("", NO_NUMBER) or NUMBER.fullmatch(text) for text in texts)
