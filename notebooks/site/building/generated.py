"""Text that pages take from the package: ``<!-- generated: WHAT -->`` in a page becomes it before
the page is read.

``![words](picture:NAME)`` is a picture that is drawn into the build.
"""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from aacmm_pin.diagnosis.thresholds import THRESHOLDS, Thresholds
from aacmm_pin.effects import CAUSES, Effect
from aacmm_pin.report.verdicts import VERDICTS, WORDS_OF_DOUBTS
from building import pictures
from building.causes import causes_table

MARK = re.compile(r"<!-- generated: (\S+)(?: (.*?))? -->")
PICTURE = re.compile(r"\(picture:([\w.]+)\)")
ELSEWHERE = {"aacmm_pin": "Effect", "aacmm_pin.errors": "AacmmError"}
"""Names that are explained on another page."""
MEASURED = Path(__file__).parents[3] / "tests" / "measured.py"
"""Says which code some rooms have."""
INHERITED = ", ".join(sorted({*dir(Effect), "component", "flexibility", "turns"}))
"""What all causes have; it is shown once, at their base."""


def api(module: str) -> str:
    """Everything public in a module; nothing where this version has no such module."""
    found = importlib.util.find_spec(module)
    if found is None:
        return f"(`{module}` is not part of this version.)"
    # What a package collects is its own.
    imported = ["imported-members:"] if found.submodule_search_locations else []
    options = [
        "members:",
        *imported,
        *([f"exclude-members: {ELSEWHERE[module]}"] if module in ELSEWHERE else []),
    ]
    return _restructured(f".. automodule:: {module}", *(f"   :{option}" for option in options))


def effects() -> str:
    """What a cause of one's own uses, the base of all causes with all that it has, each cause with
    what only it has.
    """
    lines = [".. currentmodule:: aacmm_pin.effects", ""]
    for name in (
        "register",
        "about_axis",
        "twist",
        "sensitivity",
        "cause_of",
        "all_candidates",
        "example",
    ):
        lines += [f".. autofunction:: {name}", ""]
    for name in (
        "Effect",
        "Nonlinear",
        "TimeConstant",
        "Term",
        "Reading",
        "Displacement",
        "OfAngle",
        "State",
        "Records",
    ):
        lines += [f".. autoclass:: {name}", "   :members:", ""]
    for cause in CAUSES.values():
        lines += [
            f".. autoclass:: {cause.__name__}",
            "   :members:",
            f"   :exclude-members: {INHERITED}",
            "",
        ]
    return _restructured(*lines)


def _restructured(*lines: str) -> str:
    return "\n".join(["```{eval-rst}", *lines, "```"])


def commands() -> str:
    """What typer itself writes about the command, without the title; the list of commands with
    their whole sentences.
    """
    words = [
        sys.executable,
        "-m",
        "typer",
        "aacmm_pin.cli.root_command",
        "utils",
        "docs",
        "--name",
        "aacmm-pin",
    ]
    text = subprocess.run(words, capture_output=True, text=True, check=True).stdout.partition("\n")[
        2
    ]
    sentences = dict(re.findall(r"^##+ `aacmm-pin (?:\S+ )?(\S+)`\n\n(.+)$", text, re.MULTILINE))
    return re.sub(
        r"^\* `(\w[\w-]*)`: .+$",
        lambda line: f"* `{line[1]}`: {sentences[line[1]]}",
        text,
        flags=re.MULTILINE,
    )


def code_age(measured: str) -> str:
    """Whether the code of some rooms is still the measured one, by its hash and their names."""
    digest, *rooms = measured.split()
    now = runpy.run_path(str(MEASURED))["digest"](*rooms)
    if now == digest:
        return "*These results hold for the present code.*"
    return (
        f"**The code has changed since these results were measured**: it was `{digest}`, and is "
        f"now `{now}`."
    )


def thresholds() -> str:
    """Every threshold of the diagnosis, its value and what it decides, from their docstring, as a
    Markdown table.
    """
    found = re.findall(
        r"^    (\w+): (.+(?:\n {8}.+)*)", inspect.getdoc(Thresholds) or "", re.MULTILINE
    )
    rows = [
        f"| `{name}` | {_in_row(getattr(THRESHOLDS, name))} | {' '.join(words.split())} |"
        for name, words in found
    ]
    return "\n".join(["| threshold | value | meaning |", "|---|---|---|", *rows])


def doubts() -> str:
    """Every doubt of a diagnosis and what it means, from the docstring of its sentence, as a
    Markdown table.
    """
    rows = [f"| `{name}` | {inspect.getdoc(words)} |" for name, words in WORDS_OF_DOUBTS.items()]
    return "\n".join(["| doubt | meaning |", "|---|---|", *rows])


def verdicts(columns: str = "meaning and advice") -> str:
    """Every verdict of a diagnosis, what it means and what to do, from the docstring of its
    sentence, as a Markdown table.
    """
    heads = ["Verdict", "Meaning", "What to do"]
    rows = [heads, ["---"] * len(heads)]
    for name, text in VERDICTS.items():
        paragraphs = (inspect.getdoc(text.sentence) or "").split("\n\n")
        rows.append([f"`{name}`", *(" ".join(paragraph.split()) for paragraph in paragraphs)])
    if columns == "advice":
        rows = [[name, advice] for name, _, advice in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _in_row(value: float | tuple[float, ...]) -> str:
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


GENERATED: dict[str, Callable[..., str]] = {
    "api": api,
    "effects": effects,
    "commands": commands,
    "causes": causes_table,
    "thresholds": thresholds,
    "doubts": doubts,
    "code-age": code_age,
    "verdicts": verdicts,
}


def _read(app: Sphinx, docname: str, content: list[str]) -> None:
    folder = Path(app.env.doc2path(docname)).parent
    drawn = os.path.relpath(_folder(app), folder)
    text = MARK.sub(lambda mark: GENERATED[mark[1]](*filter(None, [mark[2]])), content[0])
    content[0] = PICTURE.sub(lambda name: f"({drawn}/{name[1]})", text)


def _draw(app: Sphinx) -> None:
    """Pictures, and the scenes as files of the site."""
    pictures.draw(_folder(app))
    scenes = Path(app.doctreedir) / "scenes"
    pictures.draw_scenes(scenes)
    app.config.html_extra_path.append(str(scenes))


def _folder(app: Sphinx) -> Path:
    return Path(app.doctreedir) / "pictures"


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw first, so that pages find their pictures."""
    app.connect("builder-inited", _draw)
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}
