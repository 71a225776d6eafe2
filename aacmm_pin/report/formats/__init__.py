"""Formats of documents: the module ``html`` writes files ``.html``.

A new format is one module, named as its suffix, with a function ``page(document)`` that
returns text or bytes.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from aacmm_pin._support.text_escaping import encodable
from aacmm_pin.errors import OutputError
from aacmm_pin.report.document import Document

DEFAULT_FORMAT = "html"
"""Format of standard output, and of files without suffix."""


def suffixes() -> list[str]:
    """Suffixes with a format: ``[".html"]``."""
    return [f".{module.name}" for module in iter_modules(__path__)]


def require_format(path: str | Path) -> str:
    """The format of the suffix of a path.

    Raises:
        OutputError: there is no such format.
    """
    chosen = Path(path).suffix[1:].lower() or DEFAULT_FORMAT
    if f".{chosen}" not in suffixes():
        raise OutputError(f"{path}: expected a name that ends in {' or '.join(suffixes())}")
    return chosen


def content(document: Document, path: str | Path) -> bytes:
    """The content of a file with this document.

    Raises:
        OutputError: there is no such format.
    """
    module = import_module(f"{__name__}.{require_format(path)}")
    page: str | bytes = module.page(document)
    return page if isinstance(page, bytes) else encodable(page).encode()
