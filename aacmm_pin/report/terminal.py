"""A document at the shell: as wide as the terminal, plain in a pipe, cells not cut."""

from __future__ import annotations

import os
import re
from typing import Literal

from rich.box import SIMPLE
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table as Grid

from aacmm_pin._support.text_escaping import note, printable, say, stdout, warn
from aacmm_pin.report.document import Bullets, Document, Notes, Paragraph, Table, are_numbers

WARNINGS = {"records_used_before"}
"""Notes according to which a result may be wrong."""
WIDTH = 118
"""Characters of a table in a pipe or a file."""
GAP = 2
"""Characters between columns."""
LONGEST_WORD = 40
"""Longer words are broken."""
LABEL = re.compile(r"[a-z_]+:?\w*")
"""A cause with place, or a parameter."""


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Let the command handle it."""
        raise BrokenPipeError


def show(document: Document, notes_alone: bool = False) -> None:
    """Print the short form of a document, or only its notes, which go to stderr."""
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
    """Print a table; narrow wide columns to whole words, then to whole names."""
    if table.caption:
        say(f"{table.caption}:")
    width_is_known = stdout().isatty() or "COLUMNS" in os.environ
    console = _Console(
        file=stdout(),
        width=None if width_is_known else WIDTH,
        markup=False,
        highlight=False,
        emoji=False,
    )
    cells = table.cells().map(printable).rename(columns=printable)
    widths = {str(head): max(map(cell_len, [head, *texts])) for head, texts in cells.items()}
    for unbroken_pattern in (r"\S+", r"\S*_\S*"):
        least_widths = {
            head: _least_width(head, [*cells[head]], unbroken_pattern) for head in widths
        }
        while sum(widths.values()) + GAP * len(widths) > console.width:
            wide = {head: width for head, width in widths.items() if width > least_widths[head]}
            if not wide:
                break
            widths[max(wide, key=wide.__getitem__)] -= 1
    console.width = max(console.width, sum(widths.values()) + GAP * len(widths))
    grid = Grid(box=SIMPLE, pad_edge=False, collapse_padding=True)
    for head, width in widths.items():
        justify: Literal["right", "left"] = "right" if are_numbers(cells[head]) else "left"
        grid.add_column(head, justify=justify, width=width, overflow="fold")
    for row in cells.itertuples(index=False):
        grid.add_row(*row)
    # A terminal that is too narrow for the names breaks the lines; nothing is left out.
    console.print(grid, crop=False)
    if len(cells) < len(table.frame):
        say(f"  … and {len(table.frame) - len(cells)} more rows of this table")


def _least_width(head: str, texts: list[str], unbroken_pattern: str) -> int:
    """Width of a column that breaks no number, label, word of the head or match of the pattern."""
    unbroken = are_numbers(texts) or all(LABEL.fullmatch(text) for text in texts)
    words = texts if unbroken else re.findall(unbroken_pattern, "\n".join(texts))
    lengths = [min(LONGEST_WORD, cell_len(word)) for word in words]
    return max([*map(cell_len, head.split()), *lengths])
