"""Results are written whole or not at all, and never over what is there unless that was asked for."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aacmm_pin.errors import OutputError


def json_text(content: dict[str, Any]) -> str:
    """Strict JSON of a result, as every command writes it."""
    return json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2) + "\n"


def check_output(path: str | Path, force: bool) -> Path:
    """Look, before long work begins, whether ``path`` can be written.

    Raises:
        OutputError: it exists and ``force`` is not given, its folder does not exist or cannot be written to, or it is a
            folder where a file is meant.
    """
    path = Path(path)
    if path.is_dir():
        raise OutputError(f"{path}: is a folder, expected the name of a file")
    if path.exists() and not force:
        raise OutputError(f"{path}: exists already; --force replaces it")
    _check_folder(path)
    return path


def check_output_folder(path: str | Path, force: bool) -> Path:
    """The same for a folder of results: it may exist when it is empty or ``force`` is given.

    Raises:
        OutputError: see :func:`check_output`.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path}: is a file, expected the name of a folder")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise OutputError(f"{path}: exists already and is not empty; --force replaces its files of the same names")
    _check_folder(path.absolute())
    return path


def _check_folder(path: Path) -> None:
    folder = path.parent
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """A temporary folder beside ``path``; what the system refuses is an OutputError."""
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.absolute().parent) as folder:
            yield Path(folder)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """A temporary name beside ``path`` to write to; it takes the place of ``path`` when all went well, else it vanishes.

    Raises:
        OutputError: see :func:`check_output`, or the system refuses to write.
    """
    path = check_output(path, force)
    with _beside(path) as folder:
        yield folder / path.name
        os.replace(folder / path.name, path)


@contextmanager
def whole_folder(path: str | Path, force: bool = False) -> Iterator[Path]:
    """A temporary folder beside ``path``; its files take their places in ``path`` when all went well.

    Raises:
        OutputError: see :func:`check_output_folder`, or the system refuses to write.
    """
    path = check_output_folder(path, force)
    with _beside(path) as folder:
        yield folder
        path.mkdir(exist_ok=True)
        for entry in sorted(folder.iterdir()):
            target = path / entry.name
            if target.is_dir() and not target.is_symlink():
                shutil.rmtree(target)
            elif entry.is_dir():
                target.unlink(missing_ok=True)
            os.replace(entry, target)
