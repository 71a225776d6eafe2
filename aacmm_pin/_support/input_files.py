"""Input files: regular ones, pipes, and devices, which may be endless."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from aacmm_pin.errors import AacmmError, OutputError

_OUTPUTS: ContextVar[tuple[Path, ...]] = ContextVar("outputs", default=())


@contextmanager
def outputs_refused(outputs: tuple[Path, ...]) -> Iterator[None]:
    """Meanwhile refuse to read ``outputs``: a command replaces no file that it reads."""
    token = _OUTPUTS.set(outputs)
    try:
        yield
    finally:
        _OUTPUTS.reset(token)


def are_same(path: str | Path, other: str | Path) -> bool:
    """Whether both are one existing file."""
    try:
        return os.path.samefile(path, other)
    except OSError:
        return False


def is_input(path: str | Path) -> OutputError:
    """Refusal to write an input file."""
    return OutputError(
        f"{path}: this command reads this file and does not overwrite it; expected another name "
        "for the output"
    )


def content_of(
    path: str | Path, most: int, expected: str, refused: Callable[[str], AacmmError]
) -> bytes:
    """The content, of at most ``most`` bytes; ``expected`` describes it.

    Raises:
        AacmmError: missing, a folder, too large or unreadable; made by ``refused``.
        OutputError: an output of the command.
    """
    if "\0" in str(path):
        raise refused("the name contains the character NUL; expected a name without this character")
    for output in _OUTPUTS.get():
        if output.is_file() and are_same(output, path):
            raise is_input(output)
    try:
        with open(path, "rb") as file:
            content = file.read(most + 1)
    except FileNotFoundError:
        hint = "; standard input is /dev/stdin" if str(path) == "-" else ""
        raise refused(f"no such file; expected {expected}{hint}") from None
    except IsADirectoryError:
        raise refused(f"this is a folder; expected {expected}") from None
    except OSError as error:
        raise refused(f"the file cannot be read: {error.strerror}") from None
    if len(content) > most:
        raise refused(
            f"the file is larger than {most / 1e6:g} MB; expected {expected} of at most this size"
        )
    return content
