"""Tables on stdout, in one style: as wide as the terminal, plain in a pipe, no cell ever cut off."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping

import pandas as pd
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from aacmm_pin._support.table_cells import NOTHING, cells
from aacmm_pin.cli.common import say

WIDTH = 118
"""Columns of a table in a pipe or a file, where nothing says how wide it may be."""
NUMBER = re.compile(r"[*<> ]*[-+]?\d+(\.\d+)?(e[-+]?\d+)?( \S+|%)?")
"""A number, perhaps with a mark before and one unit behind."""
LABEL = re.compile(r"[a-z_]+:?\w*")
"""A cause and its place, a parameter."""


def show(frame: pd.DataFrame, formats: Mapping[str, str] | None = None, head: str = "") -> None:
    """Print a frame as a table, under a line of its own; nothing where it has no row. Long cells are wrapped.

    Args:
        frame: the data; the index is not shown. Numbers stand right.
        formats: see :func:`aacmm_pin._support.table_cells.cells`.
        head: what it shows.
    """
    if not len(frame):
        return
    if head:
        say(head)
    text = cells(frame, formats)
    columns = [_column(str(name), list(text[name])) for name in text]
    table = Table(*columns, box=SIMPLE, pad_edge=False, collapse_padding=True)
    for row in text.itertuples(index=False):
        table.add_row(*row)
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    Console(width=None if known else WIDTH, markup=False, highlight=False, emoji=False).print(table)


def _column(name: str, texts: list[str]) -> Column:
    """Numbers to the right; labels, as commands take them, in one piece."""
    numbers = all(NUMBER.fullmatch(text) or text in ("", NOTHING) for text in texts)
    labels = all(LABEL.fullmatch(text) for text in texts)
    word = max(map(len, name.split()))
    return Column(name, justify="right" if numbers else "left", no_wrap=labels, overflow="fold", min_width=word)
