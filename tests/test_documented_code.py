"""Every code block of the README and of the documentation runs, and says what the page says that it
says.

The blocks of a page build on each other: they run in order, in one folder, the Python ones in one
module. A ``python`` block is run statement by statement, a ``sh`` block line by line: commands of
the package in this process, as by a shell. Then

- a ``text`` block is the output of the block before it; ``…`` stands for anything;
- a number with a decimal point in a comment behind a statement is among the numbers that this
  statement printed;
- ``python``, ``toml``, ``csv`` and ``json`` behind ``<!-- file: NAME -->`` are files that later
  blocks use, too; ``toml``, ``csv`` and ``json`` without it are read.

Only commands that ``.ci/run`` takes from the README and runs itself are left out, behind the mark
that it looks for.
"""

from __future__ import annotations

import ast
import contextlib
import csv
import io
import json
import os
import re
import shlex
import subprocess
import sys
import tokenize
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import matplotlib as mpl
import pytest
from markdown_it import MarkdownIt
from typer.testing import CliRunner

from aacmm_pin.cli.root_command import app
from aacmm_pin.effects import CAUSES
from tests.again import again

ROOT = Path(__file__).parents[1]
SITE = ROOT / "notebooks" / "site"
PAGES = [ROOT / "README.md", *sorted(SITE.rglob("*.md"))]
LONG = (
    "acceptance",
    "calibrate",
    "diagnose",
    "diagnosis",
    "other_arms",
    "own_cause",
    "python",
    "tour",
)
"""Pages that take long, or whose code other tests run: CI runs them by themselves."""
RUN_BY_CI = ("demo-command", "test-command", "docs-command")
DIRECTIVES = ("{include}", "{toctree}", "{eval-rst}", "{figure}", "{raw}")
DATA = {
    "toml": tomllib.loads,
    "json": json.loads,
    "csv": lambda text: list(csv.reader(io.StringIO(text), strict=True)),
}
KNOWN = dict(CAUSES)
PLAIN = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
NUMBER = re.compile(r"(?<![\w.])-?\d+\.\d+(?:e[+-]?\d+)?(?![\w.]*\d)")


@dataclass(frozen=True)
class Block:
    """A fenced block, its first line in the page, and the comment that stands directly
    before it.
    """

    language: str
    text: str
    line: int
    mark: str


def blocks(page: str) -> list[Block]:
    found, mark = [], ""
    for token in MarkdownIt().parse(page):
        if token.type == "fence":
            found.append(Block(token.info.partition(" ")[0], token.content, token.map[0] + 2, mark))
        comment = (
            re.fullmatch(r"<!-- (.*) -->\s*", token.content) if token.type == "html_block" else None
        )
        mark = comment[1] if comment else ""
    return found


class Page:
    """A page as it runs, in the current folder."""

    def __init__(self, module: ModuleType) -> None:
        self.module, self.said = module, ""

    def run(self, block: Block) -> None:
        if block.mark in RUN_BY_CI:
            self.said = ""
        elif block.language == "python":
            if block.mark.startswith("file: "):
                Path(block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
            self.said = "".join(self.python(block))
        elif block.language == "sh":
            self.said = "".join(map(shell, lines(block.text)))
        elif block.language == "text":
            assert says(self.said, block.text), f"said:\n{self.said}\nclaimed:\n{block.text}"
        elif block.language in DATA:
            assert DATA[block.language](block.text)
            if block.mark.startswith("file: "):
                Path(block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
        else:
            known = block.language in DIRECTIVES
            assert known, (
                f"a block of {block.language!r}; expected python, sh, text, toml, csv or json"
            )
            assert "```" not in block.text, (
                "a directive with code inside is not looked into; use :::"
            )

    def python(self, block: Block) -> list[str]:
        said, comments = [], comments_of(block.text)
        for statement in ast.parse(block.text).body:
            code = compile(ast.Module([statement], []), f"<line {block.line} on>", "exec")
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(code, self.module.__dict__)
            said.append(out.getvalue())
            for line in range(statement.lineno, (statement.end_lineno or 0) + 1):
                if said[-1] and not isinstance(statement, ast.FunctionDef | ast.ClassDef):
                    missing = not_said(comments.get(line, ""), said[-1])
                    assert not missing, (
                        f"{missing} claimed in line {block.line + line - 1}, said: {said[-1]}"
                    )
        return said


def comments_of(code: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(code).readline)
    return {token.start[0]: token.string for token in tokens if token.type == tokenize.COMMENT}


def lines(text: str) -> list[str]:
    return [
        line
        for line in text.replace("\\\n", " ").splitlines()
        if line.strip() and not line.startswith("#")
    ]


def shell(line: str) -> str:
    if line.startswith("aacmm-pin "):
        # What a page makes known a new process does not know.
        with patch.dict(CAUSES, KNOWN, clear=True):
            done = CliRunner().invoke(app, shlex.split(line, comments=True)[1:], env=PLAIN)
        status, said, error = done.exit_code, done.output, done.exception
    else:
        run = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            env=environment(),
            capture_output=True,
            text=True,
        )
        status, said, error = run.returncode, run.stdout + run.stderr, None
    if status != 0:
        raise AssertionError(f"{line}: exit status {status}\n{said}") from error
    return said


def environment() -> dict[str, str]:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return os.environ | PLAIN | {"PATH": path}


def says(said: str, claimed: str) -> bool:
    """Whether an output is the claimed one, ``…`` being anything; blanks at the ends of lines do
    not count.
    """
    said, claimed = (
        "\n".join(map(str.rstrip, text.strip("\n").splitlines())) for text in (said, claimed)
    )
    return re.fullmatch(".*?".join(map(re.escape, claimed.split("…"))), said, re.DOTALL) is not None


def not_said(comment: str, said: str) -> list[str]:
    """Numbers of a comment that no number of the output rounds to."""
    printed = [float(number) for number in re.findall(r"-?\d+\.?\d*(?:e[+-]?\d+)?", said)]

    def rounded(value: float, like: str) -> str:
        mantissa, _, exponent = like.partition("e")
        digits = len(mantissa.partition(".")[2])
        return f"{value:.{digits}e}" if exponent else f"{value:.{digits}f}"

    return [
        n
        for n in NUMBER.findall(comment)
        if not any(rounded(p, n) == rounded(float(n), n) for p in printed)
    ]


@pytest.mark.parametrize(
    "path",
    [again(p) if p.stem in LONG else p for p in PAGES],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_every_block_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = ModuleType("documented")
    monkeypatch.setitem(sys.modules, "documented", module)
    page = Page(module)
    with mpl.rc_context({"backend": "Agg"}):
        for block in blocks(path.read_text(encoding="utf-8")):
            try:
                page.run(block)
            except BaseException as error:
                error.add_note(
                    f"{path.relative_to(ROOT)}, the {block.language} block at line {block.line}"
                )
                raise


def test_what_is_left_out_is_run_by_ci():
    script, readme = (
        (ROOT / ".ci" / "run").read_text(encoding="utf-8"),
        blocks(PAGES[0].read_text(encoding="utf-8")),
    )
    for mark in RUN_BY_CI:
        assert f"readme_command {mark})" in script
        (command,) = [block for block in readme if block.mark == mark]
        assert command.language == "sh"
        assert len(lines(command.text)) == 1


PAGE = """
```python
x = 0.25
print(x)  # {claim}, a quarter
```

```text
{output}
```

<!-- file: data.csv -->
```csv
a,b
```

```sh
cat data.csv  # the file
{command}
```
"""


@pytest.mark.parametrize(
    ("claim", "output", "command", "complaint"),
    [
        ("0.25", "0.25", "true", None),
        ("0.26", "0.25", "true", r"\['0.26'\] claimed in line 4"),
        ("0.25", "0.26", "true", "claimed"),
        ("0.25", "0.25", "false", "exit status 1"),
        ("0.25", "0.25", "true\n```\n\n```ruby\nputs 1", "a block of 'ruby'"),
        ("0.25", "0.25\n```\n\n```python\n1/0", "true", "division by zero"),
    ],
)
def test_what_is_wrong_is_seen(claim, output, command, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = blocks(PAGE.format(claim=claim, output=output, command=command))
    page = Page(ModuleType("documented"))
    expected = (
        contextlib.nullcontext() if complaint is None else pytest.raises(Exception, match=complaint)
    )
    with expected:
        for block in found:
            page.run(block)
    assert complaint is not None or page.said == "a,b\n"
