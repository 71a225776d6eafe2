"""The page with the measured tables of diagnosis: of a commit of this history, and known to be old where code changed."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from blind.study import page, sources
from blind.study.experiments import EXPERIMENTS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "notebooks" / "site" / "study.md"


def stated(name: str) -> str:
    found = re.search(rf"^\| {name} \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None, f"{PAGE.name} states no {name}"
    return found[1].strip("`")


def git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


def test_the_commit_is_of_this_history() -> None:
    if git("rev-parse", "--is-shallow-repository") != "false":
        pytest.skip("no whole git history")
    assert git("merge-base", stated("commit"), "HEAD") == stated("commit")


def test_the_experiments_exist() -> None:
    assert {name.strip("` ") for name in stated("experiments").split(",")} <= {e.name for e in EXPERIMENTS}


def test_the_diagnosis_code_is_the_one_measured() -> None:
    """Skipped, and said, where it is not: a change of code need not wait for hours of measurement."""
    if stated("diagnosis code") != sources.digest():
        pytest.skip(f"the tables of {PAGE.name} are of older diagnosis code: measure again with --table")


def test_a_page_of_other_code_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="other diagnosis code"):
        page.write(tmp_path / "study.md", [{"sources": "0", "experiment": "regimes"}], "today", "made up")
    assert not (tmp_path / "study.md").exists()


def test_the_diagnosis_code_is_what_diagnosis_imports() -> None:
    modules, package = sources.modules(), ROOT / "aacmm_pin"
    assert {package / "diagnosis" / "forward_backward_selection.py", package / "effects" / "compliance.py"} <= modules
    assert not {path for path in modules if "plots" in path.parts or "cli" in path.parts}
