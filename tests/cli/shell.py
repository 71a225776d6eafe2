"""Commands run in this process, as a shell would run them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Iterator
from typing import Any

from typer.testing import CliRunner

from aacmm_pin.cli.root_command import app

POINT = "--point 33.6323 -671.8702 182.9355"
NOISE = "--encoder-noise 8e-6"


def split(*words: object) -> Iterator[str]:
    """Text split as a shell does, lists word by word, paths and numbers as they are."""
    for word in words:
        if isinstance(word, list | tuple):
            yield from split(*word)
        else:
            yield from shlex.split(word) if isinstance(word, str) else [str(word)]


def run(*words: object, columns: int | None = None) -> tuple[int, str, str]:
    """Exit status, stdout and stderr."""
    env = {"COLUMNS": columns and str(columns)}
    result = CliRunner().invoke(app, [*split(*words)], env=env)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def done(*words: object) -> tuple[str, str]:
    """Stdout and stderr of a command that works."""
    status, out, err = run(*words)
    assert status == 0, err
    return out, err


def found(*words: object) -> dict[str, Any]:
    """The JSON object that a command writes alone on stdout."""
    return json.loads(done(*words, "--json -")[0])


def refused(*words: object, said: Iterable[str] = ()) -> str:
    """Stderr of a command that ends with exit status 1: one message with all words of ``said``."""
    status, out, err = run(*words)
    assert (status, out) == (1, ""), words
    assert err.splitlines()[-1].startswith("aacmm-pin: ") or "\naacmm-pin: " in f"\n{err}"
    for word in said:
        assert word in err, (words, word, err)
    return err
