"""The notebooks as they are kept: without outputs, code that parses and is formatted, nothing of
one machine in them; and the pictures that they show when they run.
"""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.notebook_pictures import draws, missing

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
OF_ONE_MACHINE = re.compile(
    r"""(?:^|[\s"'`(=])(?:/(?:home|tmp|usr|root|work|Users|opt|mnt|var)\b|[A-Za-z]:\\|~/|file://)"""
)
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


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stripped(path):
    assert faults(json.loads(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_code_parses_and_text_comes_first(path):
    every = cells(path)
    assert every[0]["cell_type"] == "markdown"
    assert "".join(every[0]["source"]).startswith("# ")
    assert len({cell["id"] for cell in every}) == len(every)
    code = ["".join(cell["source"]) for cell in every if cell["cell_type"] == "code"]
    assert sum(map(draws, code)) >= 2


DRAWN = """
from aacmm_pin import Arm, accuracy_volume
from aacmm_pin.report import plots
accuracy = accuracy_volume(Arm.load("sino6"), [[0.1] * 6])
plots.plot_budget(accuracy);
"""
BY_HAND = """
from matplotlib import pyplot as plt
plt.plot([1, 2, 3]);
"""


@pytest.fixture(scope="module")
def executed(tmp_path_factory) -> dict[str, Any]:
    """A notebook that draws with the package, with pyplot, and with the package again, as a kernel
    leaves it.
    """
    import nbformat  # takes seconds, in every worker
    from nbclient import NotebookClient

    cells = [nbformat.v4.new_code_cell(source) for source in (DRAWN, BY_HAND, DRAWN)]
    notebook = nbformat.v4.new_notebook(cells=cells)
    with pytest.MonkeyPatch.context() as patched:
        patched.delenv("MPLBACKEND", raising=False)  # a kernel of Jupyter chooses its own
        client = NotebookClient(notebook, timeout=120, kernel_name="python3")
        client.create_kernel_manager()
        # No port that another takes.
        client.km.transport, client.km.ip = ("ipc", str(tmp_path_factory.mktemp("k") / "k"))
        client.execute(cwd=str(ROOT))
    return notebook


def test_every_picture_is_shown(executed):
    assert all(draws(cell["source"]) for cell in executed["cells"])
    assert missing(executed) == []
    without = copy.deepcopy(executed)
    without["cells"][1]["outputs"] = []
    (fault,) = missing(without)
    assert without["cells"][1]["id"] in fault


def test_a_cell_draws_outside_functions():
    assert draws("for f in found.findings:\n    plots.plot_cause(found, f)")
    assert draws("ax = plt.subplots(2)[1]")
    assert not draws("def look():\n    plots.plot_groups(found)\nfound.plotted(x)")
