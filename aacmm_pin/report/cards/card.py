"""What a card is made of: paragraphs, lists and tables as HTML that needs no style sheet and sets no colour.

Text is text: it is escaped, never read as markup.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping
from functools import singledispatch

import pandas as pd

from aacmm_pin._support.shown import Shown
from aacmm_pin._support.table_cells import cells


@singledispatch
def html_of(value: Shown) -> str:
    """The card of a value, as HTML.

    Raises:
        TypeError: its type has none.
    """
    raise TypeError(f"{type(value).__name__} has no card")


def paragraph(text: str, head: str = "") -> str:
    """A paragraph; its first words stand out."""
    strong = f"<strong>{html.escape(head)}</strong> " if head else ""
    return f"<p>{strong}{html.escape(text)}</p>" if text or head else ""


def bullets(items: Iterable[str], head: str = "") -> str:
    """A list, under a line of its own; nothing where there is no item."""
    found = "".join(f"<li>{html.escape(item)}</li>" for item in items)
    return f"{paragraph(head)}<ul>{found}</ul>" if found else ""


def table(frame: pd.DataFrame, formats: Mapping[str, str] | None = None, head: str = "", most: int | None = None) -> str:
    """A table, under a line of its own; nothing where it has no row.

    Args:
        frame: the data; the index is not shown.
        formats: see :func:`aacmm_pin._support.table_cells.cells`.
        head: what it shows.
        most: at most so many rows, and how many more there are.
    """
    if not len(frame):
        return ""
    shown = frame if most is None else frame.head(most)
    with pd.option_context("display.max_colwidth", None):
        text = cells(shown, formats).to_html(index=False, border=0, escape=True, justify="left")
    more = paragraph(f"… and {len(frame) - len(shown)} more rows") if len(shown) < len(frame) else ""
    return paragraph(head) + text + more


def details(summary: str, inside: str) -> str:
    """HTML that is folded away."""
    return f"<details><summary>{html.escape(summary)}</summary>{inside}</details>"
