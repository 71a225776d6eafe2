"""Text that pages take from the package: ``<!-- generated: WHAT -->`` in a page becomes it before the page is read.

``![words](picture:NAME)`` is a picture that is drawn into the build.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from building import pictures
from building.causes import causes_table

MARK = re.compile(r"<!-- generated: (\S+)(?: (.*?))? -->")
PICTURE = re.compile(r"\(picture:([\w.]+)\)")
ELSEWHERE = ("Effect",)
"""Names of the package that have a page of their own."""


def api(module: str) -> str:
    """Everything public in a module; nothing where this version has no such module."""
    if importlib.util.find_spec(module) is None:
        return f"(`{module}` is not part of this version.)"
    options = [
        "members:",
        "imported-members:",
        *([f"exclude-members: {', '.join(ELSEWHERE)}"] if module == "aacmm_pin" else []),
    ]
    return "\n".join(["```{eval-rst}", f".. automodule:: {module}", *(f"   :{option}" for option in options), "```"])


def commands() -> str:
    """What typer itself writes about the command, the title left out."""
    words = [sys.executable, "-m", "typer", "aacmm_pin.cli", "utils", "docs", "--name", "aacmm-pin"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return done.stdout.partition("\n")[2]


GENERATED: dict[str, Callable[..., str]] = {"api": api, "commands": commands, "causes": causes_table}


def _read(app: Sphinx, docname: str, content: list[str]) -> None:
    folder = Path(app.env.doc2path(docname)).parent
    drawn = os.path.relpath(_folder(app), folder)
    text = MARK.sub(lambda mark: GENERATED[mark[1]](*filter(None, [mark[2]])), content[0])
    content[0] = PICTURE.sub(lambda name: f"({drawn}/{name[1]})", text)


def _folder(app: Sphinx) -> Path:
    return Path(app.doctreedir) / "pictures"


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw first, so that pages find their pictures."""
    app.connect("builder-inited", lambda app: pictures.draw(_folder(app)))
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}
