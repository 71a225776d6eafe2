"""Docstrings with Google's sections, and signatures that say ``Array`` where the package
says so.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numpy.typing import ArrayLike
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.util.typing import stringify_annotation

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.effects.conditions import Labels

CONFIG = Config(napoleon_use_ivar=True, napoleon_use_rtype=False, napoleon_attr_annotations=False)
ALIASES = {"Array": Array, "Index": Index, "Labels": Labels, "ArrayLike": ArrayLike}


def _sections(
    app: Sphinx, what: str, name: str, thing: object, options: Any, lines: list[str]
) -> None:
    """Read as a method's: of an attribute ``a length: how long`` would be taken for a type."""
    kind = "method" if what in ("attribute", "data", "property") else what
    lines[:] = GoogleDocstring(list(lines), CONFIG, app, kind, name, thing, options).lines()


@cache
def _spelled_out() -> list[tuple[str, str]]:
    """What the aliases stand for, longest first."""
    found = {
        stringify_annotation(thing, mode, short_literals=True): name
        for name, thing in ALIASES.items()
        for mode in ("smart", "fully-qualified-except-typing")
    }
    return sorted(found.items(), key=lambda item: -len(item[0]))


def _shorter(
    app: Sphinx,
    what: str,
    name: str,
    thing: object,
    options: Any,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    # What dataclasses write there is no Python.
    for long, short in (("<factory>", "..."), *_spelled_out()):
        signature, returned = (text and text.replace(long, short) for text in (signature, returned))
    return signature, returned


def setup(app: Sphinx) -> dict[str, Any]:
    """Hear what autodoc finds."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", _sections)
    app.connect("autodoc-process-signature", _shorter)
    return {"parallel_read_safe": True}
