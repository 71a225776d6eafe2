"""The notebooks as they are kept: without outputs, code that parses and is formatted, nothing of one machine in them."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
OF_ONE_MACHINE = re.compile(r"""(?:^|[\s"'`(=])(?:/(?:home|tmp|usr|root|work|Users|opt|mnt|var)\b|[A-Za-z]:\\|~/|file://)""")
"""Absolute paths in text or code."""


def cells(path: Path) -> list[dict[str, Any]]:
    return list(json.loads(path.read_text(encoding="utf-8"))["cells"])


def faults(notebook: dict[str, Any]) -> list[str]:
    """What a stripped notebook does not have."""
    found = [] if notebook["metadata"] == KERNEL else ["metadata"]
    for cell in notebook["cells"]:
        if cell["metadata"]:
            found.append(f"{cell['id']}: metadata")
        if cell["cell_type"] == "code" and (cell["outputs"] or cell["execution_count"] is not None):
            found.append(f"{cell['id']}: outputs")
        if OF_ONE_MACHINE.search("".join(cell["source"])):
            found.append(f"{cell['id']}: absolute path")
    return found


def test_there_are_notebooks() -> None:
    assert len(NOTEBOOKS) >= 7


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stripped(path: Path) -> None:
    assert faults(json.loads(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_code_parses_and_text_comes_first(path: Path) -> None:
    every = cells(path)
    assert every[0]["cell_type"] == "markdown"
    assert "".join(every[0]["source"]).startswith("# ")
    for cell in every:
        if cell["cell_type"] == "code":
            ast.parse("".join(cell["source"]))
    assert len({cell["id"] for cell in every}) == len(every)


def test_formatted_and_linted() -> None:
    pytest.importorskip("ruff", reason="ruff comes with the extra 'lint'")
    for command in (["check"], ["format", "--check"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "notebooks"], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"outputs": [{"output_type": "stream"}]}, "outputs"),
        ({"execution_count": 3}, "outputs"),
        ({"metadata": {"scrolled": True}}, "metadata"),
        ({"source": ['open("/home/me/data.csv")']}, "absolute path"),
        ({"source": ["Path('~/data.csv')"]}, "absolute path"),
    ],
)
def test_faults_are_seen(change: dict[str, Any], fault: str) -> None:
    cell = {"cell_type": "code", "id": "c", "metadata": {}, "outputs": [], "execution_count": None, "source": ["a / b"]}
    assert faults({"metadata": KERNEL, "cells": [cell]}) == []
    assert faults({"metadata": KERNEL, "cells": [cell | change]}) == [f"c: {fault}"]
