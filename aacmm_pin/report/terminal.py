"""A document at the shell: as wide as the terminal, plain in a pipe, no cell ever cut off."""

from __future__ import annotations

import os
import re
from typing import Literal

import pandas as pd
from rich.box import SIMPLE
from rich.cells import cell_len
from rich.console import Console
from rich.table import Column
from rich.table import Table as Grid

from aacmm_pin._support.text_escaping import note, printable, say, stdout, warn
from aacmm_pin.report.document import Bullets, Document, Notes, Paragraph, Table, are_numbers

WARNINGS = {"records_used_before"}
"""Codes of notes of which a result may be wrong."""
WIDTH = 118
"""Columns of a table in a pipe or a file, where no width is stated."""
GAP = 2
"""Columns of the terminal beside each column of a table."""
SPARE = 28
"""A column of a table that is spare stands where there is room for so many characters."""
LONGEST_WORD = 40
"""Longer words are broken."""
LABEL = re.compile(r"[a-z_]+:?\w*")
"""A cause and its place, a parameter."""


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to the command, as every other way of printing does."""
        raise BrokenPipeError


def show(document: Document, notes_alone: bool = False) -> None:
    """Print the short form of a document, or nothing but its notes, which go to the error
    stream.
    """
    for block in document.short():
        match block:
            case Notes(items=items):
                for item in items:
                    print_item = warn if item.code in WARNINGS else note
                    print_item(item)
            case _ if notes_alone:
                pass
            case Paragraph(text=text, head=head):
                say(f"{head} {text}".strip())
            case Bullets(items=items, head=head):
                say("\n".join([*([head] if head else []), *(f"  {item}" for item in items)]))
            case Table():
                _print_table(block)


def _print_table(table: Table) -> None:
    if table.caption:
        say(f"{table.caption}:")
    cells = table.cells().map(printable).rename(columns=printable)
    known = stdout().isatty() or "COLUMNS" in os.environ
    console = _Console(
        file=stdout(), width=None if known else WIDTH, markup=False, highlight=False, emoji=False
    )
    others = cells.drop(columns=table.spare, errors="ignore")
    if sum(_widths(others)) + GAP * len(cells.columns) + SPARE > console.width:
        cells = others
    columns = _columns(cells, console.width)
    console.width = max(
        console.width, sum(column.width or 0 for column in columns) + GAP * len(columns)
    )
    grid = Grid(*columns, box=SIMPLE, pad_edge=False, collapse_padding=True)
    for row in cells.itertuples(index=False):
        grid.add_row(*row)
    # A terminal that is too narrow for the names breaks the lines; nothing is left out.
    console.print(grid, crop=False)
    if len(cells) < len(table.frame):
        say(f"  … and {len(table.frame) - len(cells)} more rows of this table")


def _columns(cells: pd.DataFrame, width: int) -> list[Column]:
    """Numbers to the right; the widest are narrowed, to their words and, if need be, to the names
    of files and commands.
    """
    columns = {str(head): [str(text) for text in texts] for head, texts in cells.items()}
    widths = _widths(cells)
    for kept in (r"\S+", r"\S*_\S*"):
        least = [_least(head, texts, kept) for head, texts in columns.items()]
        while sum(widths) + GAP * len(widths) > width:
            wide = [w if w > few else 0 for w, few in zip(widths, least, strict=True)]
            if not any(wide):
                break
            widths[wide.index(max(wide))] -= 1
    ways: list[Literal["right", "left"]] = [
        "right" if are_numbers(texts) else "left" for texts in columns.values()
    ]
    return [
        Column(head, justify=way, width=w, overflow="fold")
        for head, way, w in zip(columns, ways, widths, strict=True)
    ]


def _widths(cells: pd.DataFrame) -> list[int]:
    widths = []
    for head, texts in cells.items():
        widths.append(max(cell_len(str(text)) for text in (head, *texts)))
    return widths


def _least(head: str, texts: list[str], kept: str) -> int:
    """Width of a column in which numbers, labels, words of the head and words that match ``kept``
    are in one piece.
    """
    in_one = are_numbers(texts) or all(LABEL.fullmatch(text) for text in texts)
    words = texts if in_one else re.findall(kept, "\n".join(texts))
    lengths = [min(LONGEST_WORD, cell_len(word)) for word in words]
    return max([*map(cell_len, head.split()), *lengths])
