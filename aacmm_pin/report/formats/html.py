"""A document as one self-contained HTML page, or a fragment for Jupyter; text is escaped."""

from __future__ import annotations

import base64
import mimetypes
from collections.abc import Iterable
from typing import Any

from markupsafe import Markup

from aacmm_pin.report.document import (
    Block,
    Document,
    Download,
    Figure,
    Folded,
    Heading,
    Notes,
    SceneView,
    Table,
    are_numbers,
)
from aacmm_pin.report.numbers import capital
from aacmm_pin.report.templates import environment

SHORT_TEXT = 22
"""Characters of a text that stays on one line of a table."""
ALIGNED = {
    "number": "",
    "short": Markup(' style="text-align: left"'),
    "long": Markup(' style="text-align: left"'),
}
"""Attribute of a cell without our style sheet: Jupyter aligns all to the right."""


def page(document: Document) -> str:
    """The document as an HTML page; blocks before the first heading precede the contents."""
    sections: list[dict[str, Any]] = [{"blocks": []}]
    for block in document.blocks:
        if isinstance(block, Heading):
            sections.append({"id": f"s{len(sections)}", "title": block.text, "blocks": []})
        else:
            sections[-1]["blocks"].append(block)
    opening, *contents = [
        section | {"blocks": _template_data(section["blocks"], on_page=True)}
        for section in sections
    ]
    template = environment().get_template("report.html.j2")
    return template.render(
        title=document.title,
        subtitle=document.subtitle,
        sheet=document.sheet,
        by_hand=document.by_hand,
        opening=opening["blocks"],
        sections=[section for section in contents if section["blocks"]],
    )


def fragment(document: Document) -> str:
    """The short form as HTML without style sheet and colours."""
    macros: Any = environment().get_template("blocks.html.j2").module
    return str(macros.shown(_template_data(document.short(), on_page=False)))


def data_uri(content: bytes, media: str) -> str:
    """``content`` as a ``data:`` URI of the given media type."""
    return f"data:{media};base64,{base64.b64encode(content).decode('ascii')}"


def _template_data(blocks: Iterable[Block], *, on_page: bool) -> list[dict[str, Any]]:
    """The fields of each block, and what the template of its ``kind`` needs besides."""
    data_of_blocks = []
    for block in blocks:
        data: dict[str, Any] = {"kind": type(block).__name__, **vars(block)}
        match block:
            case Notes(items=items):
                data |= {"items": [f"{capital(str(note))}." for note in items], "head": "Notes:"}
            case Table():
                data |= _table_data(block, on_page)
            case Figure(png=png):
                data["uri"] = data_uri(png, "image/png")
            case SceneView(scene=scene):
                data["markup"] = Markup(scene().embedded())
            case Folded(blocks=blocks_inside):
                data["blocks"] = _template_data(blocks_inside, on_page=on_page)
            case Download(content=bytes(content)):
                size = len(content)
                data["size"] = f"{size / 1e3:.0f} kB" if size >= 1000 else f"{size} B"
                media = mimetypes.guess_type(block.name)[0] or "application/octet-stream"
                data["uri"] = data_uri(content, media)
        data_of_blocks.append(data)
    return data_of_blocks


def _table_data(table: Table, on_page: bool) -> dict[str, Any]:
    """Rows of text; columns as heads with a style: ``number``, ``short`` (one line) or ``long``."""
    cells, columns = table.cells(), []
    for head, texts in cells.items():
        style = "short" if all(len(text) <= SHORT_TEXT for text in texts) else "long"
        columns.append((head, "number" if are_numbers(texts) else style))
    return {
        "columns": columns,
        "rows": cells.to_numpy().tolist(),
        "more": len(table.frame) - len(cells),
        "explained": table.explained if on_page else "",
        "aligned": dict.fromkeys(ALIGNED, "") if on_page else ALIGNED,
    }
