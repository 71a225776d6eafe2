"""Files that are read: regular ones, pipes, and devices, which may be without end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from aacmm_pin.errors import AacmmError

WATCHERS: list[Callable[[str | Path], None]] = []
"""Told of every file that is about to be read; one of them may refuse it."""


def to_be_read(path: str | Path) -> None:
    """Tell :data:`WATCHERS` of a file."""
    for watcher in WATCHERS:
        watcher(path)


def content_of(path: str | Path, most: int, expected: str, refused: Callable[[str], AacmmError]) -> bytes:
    """The content of a file of at most ``most`` bytes; ``expected`` says in words what it should be.

    Raises:
        AacmmError: it is not there, is a folder, is too large, or cannot be read: as ``refused`` makes it of the message.
    """
    to_be_read(path)
    try:
        if "\0" in str(path):
            raise refused("cannot be read: no file has a NUL in its name")
        if Path(path).is_fifo():
            from aacmm_pin._support.text_escaping import note  # few are

            note(f"note: {path} is a pipe; waiting for its end")
        with open(path, "rb") as file:
            content = file.read(most + 1)
    except FileNotFoundError:
        raise refused("no such file" + "; standard input is /dev/stdin" * (str(path) == "-")) from None
    except IsADirectoryError:
        raise refused(f"is a folder, expected {expected}") from None
    except OSError as error:
        raise refused(f"cannot be read: {error.strerror}") from None
    if len(content) > most:
        raise refused(f"is larger than {most / 1e6:g} MB, the most that {expected} may have")
    return content
