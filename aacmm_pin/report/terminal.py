"""A document at the shell: as wide as the terminal, plain in a pipe, no cell ever cut off."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column
from rich.table import Table as Grid

from aacmm_pin._support.text_escaping import note, printable, say
from aacmm_pin.report.document import Bullets, Document, Notes, Paragraph, Table, are_numbers

WIDTH = 118
"""Columns of a table in a pipe or a file, where nothing says how wide it may be."""
LONGEST = 30
"""Longer words are broken."""
LABEL = re.compile(r"[a-z_]+:?\w*")
"""A cause and its place, a parameter."""


def show(document: Document) -> None:
    """Print the short form of a document; its notes go to the error stream."""
    for block in document.short():
        match block:
            case Paragraph(text=text, head=head):
                say(f"{head} {text}".strip())
            case Bullets(items=items, head=head):
                say("\n".join([*([head] if head else []), *(f"  {item}" for item in items)]))
            case Notes(items=items):
                show_notes(items)
            case Table():
                _print_table(block)


def show_notes(items: Iterable[str]) -> None:
    """Write what was assumed, or found beside, to the error stream."""
    for item in items:
        note(f"note: {item}")


def _print_table(table: Table) -> None:
    if table.caption:
        say(f"{table.caption}:")
    cells = table.cells().map(printable).rename(columns=printable)
    grid = Grid(*(_column(head, list(texts)) for head, texts in cells.items()), box=SIMPLE, pad_edge=False)
    grid.collapse_padding = True
    for row in cells.itertuples(index=False):
        grid.add_row(*row)
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    console = Console(width=None if known else WIDTH, markup=False, highlight=False, emoji=False)
    width = console.width
    with console.capture() as first:
        console.print(grid, crop=False)
    if (beyond := max(map(len, first.get().splitlines())) - width) > 0:  # names are in one piece: the rest has to be narrower
        console.width = max(1, width - beyond)
    console.print(grid, crop=False)  # a terminal that is too narrow even so breaks the lines; nothing is left out
    if len(cells) < len(table.frame):
        say(f"  … and {len(table.frame) - len(cells)} more")


def _column(name: object, texts: list[str]) -> Column:
    """Numbers to the right; names, as commands and files take them, in one piece; long texts on several lines."""
    labels = all(LABEL.fullmatch(text) for text in texts)
    names = [word for text in texts for word in text.split() if "_" in word and len(word) <= LONGEST]
    least = max(map(len, [*str(name).split(), *names]))
    right = are_numbers(texts)
    return Column(str(name), justify="right" if right else "left", no_wrap=labels, overflow="fold", min_width=least)
