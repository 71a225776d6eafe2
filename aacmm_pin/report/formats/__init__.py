"""Formats of documents on files: a file that ends in ``.html`` is made by the module ``html`` here.

A new format is one module, named as its files end, with a function ``page(document) -> str``.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from aacmm_pin._support.text_escaping import encodable
from aacmm_pin.errors import OutputError
from aacmm_pin.report.document import Document

DEFAULT_FORMAT = "html"
"""Of standard output, and of a file whose name has no ending."""


def suffixes() -> list[str]:
    """How names of files end for which there is a format: ``[".html"]``."""
    return [f".{module.name}" for module in iter_modules(__path__)]


def require_format(path: str | Path) -> str:
    """The format that the end of a name chooses.

    Raises:
        OutputError: there is no such format.
    """
    chosen = Path(path).suffix[1:].lower() or DEFAULT_FORMAT
    if f".{chosen}" not in suffixes():
        raise OutputError(f"{path}: expected a name that ends in {' or '.join(suffixes())}")
    return chosen


def content(document: Document, path: str | Path) -> bytes:
    """What a file of this name holds of a document.

    Raises:
        OutputError: there is no format for such a name.
    """
    module = import_module(f"{__name__}.{require_format(path)}")
    return encodable(module.page(document)).encode()
