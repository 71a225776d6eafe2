"""Files of results are written whole, all together or none, and never over what is there unless that was asked for.

Each is first written into a hidden folder beside its place, which its process holds locked. When all are complete they are
put in their places; if that fails, what was there before is put back. Folders that a killed process left are removed by the
next one that writes beside them; a mark in them says that they are ours, and one without it is removed if it is empty.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from aacmm_pin._support.stop_signals import signals_wait
from aacmm_pin._support.text_escaping import encodable, note, stdout
from aacmm_pin.errors import OutputError

HIDDEN = ".aacmm-pin-"
"""How the hidden folders begin."""
MARK = ".of-aacmm-pin"
"""The file in them without which a folder of such a name that holds anything is somebody else's."""
STDOUT = ("-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")


def json_text(content: dict[str, Any]) -> str:
    """Strict JSON of a result, as every command writes it."""
    return encodable(json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2) + "\n")


_OURS: set[Path] = set()
"""Hidden folders of this process: what is in them is temporary already."""


class OutputFiles:
    """The files that one piece of work writes; a context, at whose end they take their places.

    Symbolic links are followed, a replaced file keeps its mode. What is written for a pipe, a terminal or ``-`` (standard
    output) is passed on when all files are in place. ``inputs`` are files that the work reads: they are never replaced, by
    whatever name.
    """

    def __init__(self, force: bool = False, inputs: Iterable[str | Path] = ()) -> None:
        self._force = force
        self._inputs = list(inputs)
        self._checked: list[Path] = []
        self._stack = ExitStack()
        self._hidden: dict[Path, Path] = {}  # the hidden folder in each folder that is written to
        self._files: dict[Path, Path] = {}  # temporary file by the regular file that it becomes
        self._instead_of: dict[Path, bytes] = {}  # what a file held from which the one in its place was made
        self._streams: list[tuple[Path, Path]] = []  # temporary file, and the pipe or device it is written to
        self._folders: dict[Path, Path] = {}  # hidden folder by the folder that receives its files
        self._last: Path | None = None
        self.written: list[str] = []
        """The regular files, as they were named."""

    def check(self, *paths: str | Path) -> None:
        """Look, before long work begins, whether files can be written.

        Raises:
            OutputError: one exists and ``force`` is not given, is an input, is neither a regular file nor a pipe, its
                folder does not exist or cannot be written to, or two are the same.
        """
        targets = [self._target(path) for path in paths]
        for path, target in zip(paths, targets, strict=True):
            if targets.count(target) > 1:
                raise _asked_twice(path)
        self._checked += map(Path, paths)

    def refuse_to_read(self, path: str | Path) -> None:
        """Refuse a file that is about to be read, and that :meth:`check` was told will be written; then it is an input.

        Raises:
            OutputError: it is such a file, by whatever name.
        """
        for output in self._checked:
            if not _is_stream(output) and _are_same(output, path):
                raise _is_read(output)
        self._inputs.append(path)  # a name of an output may lead to it only later

    def _target(self, path: str | Path, replaces: bool = False) -> Path:
        """The regular file that is meant, links followed; a pipe or device as it was named."""
        path = Path(path)
        with _told(path):
            if _is_stream(path):
                return path
            if path.is_dir():
                raise OutputError(f"{path}: is a folder, expected the name of a file")
            if path.exists() and not path.is_file():
                raise OutputError(f"{path}: is not a regular file and is left as it is")
            if not replaces and any(_are_same(path, read) for read in self._inputs):
                raise _is_read(path)
            if path.exists() and not (self._force or replaces):
                raise OutputError(f"{path}: exists already; --force, in Python force=True, replaces it")
            target = Path(os.path.realpath(path))
            if target.is_symlink():
                raise OutputError(f"{path}: is a symbolic link that leads back to itself")
            _check_folder(path, target.parent)
            return target

    def file(self, path: str | Path, instead_of: bytes | None = None) -> Path:
        """A temporary name to write to what shall stand in ``path``, in the place of a file with the content ``instead_of``.

        No content (``b""``) is that of no file.

        Raises:
            OutputError: see :meth:`check`; or ``path`` was given before.
        """
        if Path(path).parent in _OURS:
            return Path(path)
        target = self._target(path, replaces=instead_of is not None)
        if instead_of is not None:
            self._instead_of[target] = instead_of
        self._last = Path(path)
        if target in self._files:
            raise _asked_twice(path)
        with _told(path):
            if _is_stream(target):
                temporary = Path(self._stack.enter_context(tempfile.TemporaryDirectory())) / "stream"
                self._streams.append((temporary, target))
            else:
                temporary = self._files[target] = self._hidden_in(target.parent) / target.name
                self.written.append(str(path))
        return temporary

    def folder(self, path: str | Path) -> Path:
        """A temporary folder, whose files shall stand in ``path``; files of other names there stay.

        Raises:
            OutputError: it is not a folder, is not empty and ``force`` is not given, or cannot be written to.
        """
        path = Path(path)
        self._last = path
        with _told(path):
            if path.exists() and not path.is_dir():
                raise OutputError(f"{path}: is a file, expected the name of a folder")
            if path.is_dir() and any(not entry.name.startswith(HIDDEN) for entry in path.iterdir()) and not self._force:
                raise OutputError(f"{path}: exists already and is not empty; --force replaces its files of the same names")
            target = Path(os.path.realpath(path))
            _check_folder(path, target.parent)
            if path.is_dir():
                _check_folder(path / "…", target)
            inner = Path(tempfile.mkdtemp(dir=self._hidden_in(target if target.is_dir() else target.parent)))
        self._folders[target] = inner
        return inner

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._stack:  # the hidden folders go in any case
            if kind is None:
                with _told(self._last):
                    self._put_in_place()
            elif isinstance(error, OSError) and self._last is not None and self._is_ours(error):
                raise _refusal(self._last, error) from None

    def _is_ours(self, error: OSError) -> bool:
        """Writing failed, and not the reading of something else."""
        return error.filename is None or HIDDEN in str(error.filename)

    def _hidden_in(self, folder: Path) -> Path:
        if folder not in self._hidden:
            with _alone_in(folder):  # or what another process has just made, and not locked yet, seemed to be left
                _remove_what_dead_processes_left(folder)
                self._hidden[folder] = self._stack.enter_context(_locked_folder(folder))
        return self._hidden[folder]

    def _put_in_place(self) -> None:
        with ExitStack() as undo:
            with signals_wait():
                for target, inner in self._folders.items():
                    if not target.is_dir():
                        target.mkdir()
                        undo.callback(target.rmdir)
                    self._files |= {target / entry.name: entry for entry in sorted(inner.iterdir())}
                for target, temporary in self._files.items():
                    self._last = target
                    with _alone_in(target.parent) if target in self._instead_of else nullcontext():
                        self._place(temporary, target, undo)
            for temporary, target in self._streams:  # these may wait for a reader, who may be interrupted
                self._last = target
                _pass_on(temporary, target)
            undo.pop_all()

    def _place(self, temporary: Path, target: Path, undo: ExitStack) -> None:
        """Put one file in its place; ``undo`` learns how to go back."""
        found = target.read_bytes() if target in self._instead_of and target.exists() else b""
        if found != self._instead_of.get(target, b""):
            raise OutputError(f"{target}: another process wrote it meanwhile, and it is left as it is; try again")
        if not self._force and target not in self._instead_of:
            _move_where_nothing_is(temporary, target)
            undo.callback(target.unlink)
            return
        if target.exists():
            before = _kept(target, temporary.parent)
            old = target.stat()
            os.chmod(temporary, stat.S_IMODE(old.st_mode))
            if os.geteuid() == 0:  # only root may give a file to its owner
                os.chown(temporary, old.st_uid, old.st_gid)
            undo.callback(os.replace, before, target)
        else:
            undo.callback(target.unlink, missing_ok=True)
        os.replace(temporary, target)


@contextmanager
def whole_file(path: str | Path, force: bool = False) -> Iterator[Path]:
    """One file alone: a temporary name to write to, see :class:`OutputFiles`."""
    with OutputFiles(force) as files:
        yield files.file(path)


def _is_stream(path: Path) -> bool:
    """Standard output, a pipe, a terminal: what is written to and cannot be replaced."""
    if str(path) in STDOUT:
        return True
    mode = path.stat().st_mode if path.exists() else 0
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


def _kept(target: Path, folder: Path) -> Path:
    """A second name, or a copy, of what is to be replaced."""
    before = Path(tempfile.mkdtemp(dir=folder)) / "before"
    try:
        os.link(target, before)
    except OSError:  # a file system without links, or a file of somebody else
        shutil.copy2(target, before)
    return before


def _refusal(path: str | Path | None, error: OSError) -> OutputError:
    where = "standard output" if str(path) in STDOUT else path
    return OutputError(f"{where}: cannot be written: {error.strerror or error}")


def _are_same(path: str | Path, other: str | Path) -> bool:
    return os.path.exists(path) and os.path.exists(other) and os.path.samefile(path, other)


def _is_read(path: Path) -> OutputError:
    return OutputError(f"{path}: is read by this command and is left as it is; expected another name")


def _asked_twice(path: str | Path) -> OutputError:
    return OutputError(f"{path}: is to hold two results; expected a file for each")


@contextmanager
def _told(path: str | Path | None) -> Iterator[None]:
    """Refusals of the system as our own."""
    try:
        yield
    except OSError as error:
        if isinstance(error, BrokenPipeError) and str(path) in STDOUT:
            raise  # whoever read standard output has enough: no refusal
        raise _refusal(path, error) from None


def _check_folder(path: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist")
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """While no other process is in here: what a file holds is compared and replaced in one piece."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _locked_folder(parent: Path) -> Iterator[Path]:
    """A hidden folder that is locked as long as this process lives, and marked as ours; it is removed in the end."""
    with ExitStack() as stack:
        with signals_wait():  # or one that comes now would leave a folder that nothing takes away
            folder = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=parent))
            lock = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, lock)
            stack.callback(_remove, folder)
            stack.callback(_OURS.discard, folder)
            _OURS.add(folder)
            fcntl.flock(lock, fcntl.LOCK_EX)
            (folder / MARK).touch()
        yield folder


def _remove(folder: Path) -> None:
    """Remove a hidden folder, its mark last: what a process that is killed meanwhile leaves is still known as ours."""
    with signals_wait(), suppress(OSError):
        for entry in folder.iterdir():
            if entry.is_dir():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != MARK:
                entry.unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)


def _remove_what_dead_processes_left(parent: Path) -> None:
    for folder in parent.glob(f"{HIDDEN}{'?' * 8}"):  # as tempfile names them
        with suppress(OSError):  # locked: of a living process; or not ours to open
            lock = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if (folder / MARK).exists():
                    _remove(folder)
                else:
                    folder.rmdir()  # killed before it was marked, or after; refused where somebody's files are in it
            finally:
                os.close(lock)


def _move_where_nothing_is(temporary: Path, target: Path) -> None:
    """Put a file where none is, even if another process writes there at the same time."""
    taken = f"{target}: another process wrote it meanwhile; --force replaces it"
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise OutputError(taken) from None
    except OSError:  # a file system without links
        if not temporary.exists():
            raise
        try:
            target.touch(exist_ok=False)
        except FileExistsError:
            raise OutputError(taken) from None
        os.replace(temporary, target)


def _pass_on(temporary: Path, target: Path) -> None:
    if str(target) in STDOUT:
        out = stdout()
        out.flush()
        if hasattr(out, "buffer"):
            out.buffer.write(temporary.read_bytes())
        else:  # a notebook, or a test, that collects text
            out.write(temporary.read_text(encoding="utf-8"))
        out.flush()
        return
    try:
        stream = os.open(target, os.O_WRONLY | os.O_NONBLOCK)
        os.set_blocking(stream, True)
    except OSError as error:
        if error.errno != errno.ENXIO or not target.is_fifo():
            raise
        note(f"note: {target} is a pipe that nothing reads; waiting for a reader")
        stream = os.open(target, os.O_WRONLY)
    with open(temporary, "rb") as source, open(stream, "wb", buffering=0) as sink:
        shutil.copyfileobj(source, sink)
