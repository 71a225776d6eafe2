"""Output files, written whole and put in place together.

They are written into hidden folders beside their places, and renamed when all are complete. If one
fails, former files are restored.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from aacmm_pin._support.input_files import are_same, is_input
from aacmm_pin._support.text_escaping import encodable, stdout
from aacmm_pin.errors import OutputError

HIDDEN = ".aacmm-pin-"
"""Begins names of hidden folders."""
STDOUT = ("-", "/dev/stdout")


def json_text(content: dict[str, Any]) -> str:
    return encodable(json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2) + "\n")


class OutputFiles:
    """A context for the files of one task, put in place at its end.

    Links are followed; a replaced file keeps its mode. Output for a pipe, a terminal or ``-``
    (standard output) is copied when all files are in place.

    Args:
        force: replace files.
        inputs: read by the task, never replaced.
    """

    def __init__(self, force: bool = False, inputs: Iterable[str | Path] = ()) -> None:
        self._force = force
        self._inputs = list(inputs)
        self._stack = ExitStack()  # removes the hidden folders
        self._files: dict[Path, Path] = {}  # temporary file by its place
        self._updated: set[Path] = set()  # places whose file the work has read and extends
        self.written: list[str] = []
        """Regular files, as named."""

    def check(self, *paths: str | Path) -> None:
        """Refuse, before long work, names that :meth:`file` would refuse after it.

        Raises:
            OutputError: one exists without ``force``, is an input, no regular file or pipe, in no
                writable folder, or twice.
        """
        places = [self._checked_place(Path(path)) for path in paths]
        for path, place in zip(paths, places, strict=True):
            if places.count(place) > 1:
                raise _named_twice(path)

    def file(self, path: str | Path, update: bool = False) -> Path:
        """Temporary file for ``path``; with ``update`` it replaces an input.

        Raises:
            OutputError: see :meth:`check`; or repeated.
        """
        path = Path(path)
        if path.parent.name.startswith(HIDDEN):  # temporary already
            return path
        place = self._checked_place(path, update)
        if place in self._files:
            raise _named_twice(path)
        if update:
            self._updated.add(place)
        parent = None  # for a stream, the temporary folder of the system
        if not _is_stream(place):
            parent = place.parent
            self.written.append(str(path))
        with _as_output_errors(path):
            hidden = tempfile.TemporaryDirectory(prefix=HIDDEN, dir=parent)
            self._files[place] = Path(self._stack.enter_context(hidden)) / place.name
        return self._files[place]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._stack:
            if kind is None:
                self._put_in_place()
            elif isinstance(error, OSError) and self._files:
                is_of_input = error.filename is not None and HIDDEN not in str(error.filename)
                if not is_of_input:
                    raise _write_error([*self._files][-1], error) from None

    def _checked_place(self, path: Path, update: bool = False) -> Path:
        """The file behind links, if it can be written; a pipe or device as named."""
        with _as_output_errors(path):
            if _is_stream(path):
                return path
            if path.is_dir():
                raise OutputError(f"{path}: this is a folder; expected the name of a file")
            place = Path(os.path.realpath(path))
            leads_to_itself = place.is_symlink()
            if leads_to_itself or (path.exists() and not path.is_file()):
                raise OutputError(
                    f"{path}: this is no regular file; expected the name of a regular or new file"
                )
            if not update:
                self._require_free(path)
            _check_folder(path, place.parent)
            return place

    def _require_free(self, path: Path) -> None:
        if any(are_same(path, file) for file in self._inputs):
            raise is_input(path)
        if path.exists() and not self._force:
            raise OutputError(
                f"{path}: the file exists already; expected a new name; to replace the file, use "
                "--force (in Python force=True)"
            )

    def _put_in_place(self) -> None:
        """Rename every file, then copy the streams, or restore everything."""
        with ExitStack() as undo:
            for place in sorted(self._files, key=_is_stream):
                with _as_output_errors(place):
                    if _is_stream(place):
                        _copy_to_stream(self._files[place], place)
                    else:
                        self._rename(self._files[place], place, undo)
            undo.pop_all()

    def _rename(self, temporary: Path, place: Path, undo: ExitStack) -> None:
        """Put one file in place; ``undo`` restores."""
        if place not in self._updated:
            self._require_free(place)
        if place.exists():
            former = Path(tempfile.mkdtemp(dir=temporary.parent)) / "before"
            shutil.copy2(place, former)
            os.chmod(temporary, stat.S_IMODE(place.stat().st_mode))
            undo.callback(os.replace, former, place)
        else:
            undo.callback(place.unlink, missing_ok=True)
        os.replace(temporary, place)


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """Temporary file for a single ``path``, see :class:`OutputFiles`."""
    with OutputFiles(force) as files:
        yield files.file(path)


def _check_folder(path: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise OutputError(
            f"{path}: the folder {folder} does not exist; create this folder, or name another "
            "folder"
        )
    if not os.access(folder, os.W_OK):
        raise OutputError(
            f"{path}: you cannot write to the folder {folder}; expected a folder with write "
            "permission"
        )


def _named_twice(path: str | Path) -> OutputError:
    return OutputError(f"{path}: two results have this name; expected a file for each result")


def _write_error(path: Path, error: OSError) -> OutputError:
    where = "standard output" if str(path) in STDOUT else path
    return OutputError(f"{where}: the output cannot be written: {error.strerror or error}")


@contextmanager
def _as_output_errors(path: Path) -> Iterator[None]:
    """System errors as :class:`OutputError`, except that the reader of standard output ended."""
    try:
        yield
    except OSError as error:
        if isinstance(error, BrokenPipeError) and str(path) in STDOUT:
            raise
        raise _write_error(path, error) from None


def _is_stream(path: Path) -> bool:
    """Standard output, a pipe or a terminal: never replaced."""
    return str(path) in STDOUT or path.is_fifo() or path.is_char_device()


def _copy_to_stream(temporary: Path, stream: Path) -> None:
    content = temporary.read_bytes()
    if str(stream) not in STDOUT:
        stream.write_bytes(content)
        return
    out = stdout()
    out.flush()
    if hasattr(out, "buffer"):
        out.buffer.write(content)
    else:  # a notebook, or a test, that collects text
        out.write(content.decode("utf-8"))
    out.flush()
