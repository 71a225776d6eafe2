"""The command itself: its options, what ends it, and its subcommands, of which only the one that runs is imported."""

from __future__ import annotations

import ast
import errno
import functools
import importlib.machinery
import importlib.util
import io
import logging
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from types import FrameType, ModuleType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from aacmm_pin._support.text_escaping import note, results_alone_on_stdout, say
from aacmm_pin.cli.common import Results
from aacmm_pin.errors import AacmmError

COMMANDS = (
    "accept",
    "accuracy",
    "calibrate",
    "causes",
    "configurations",
    "correct",
    "demo",
    "diagnose",
    "map",
    "plan",
    "show",
    "simulate",
    "urdf",
)
"""Each is a module beside this one, and its function ``run``."""
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a process to stop."""
FOLDERS = [*sys.path]
"""Where modules are found, before plugins add their folders."""
INTERRUPTED = "interrupted; every file is there whole, or as it was before"
CAME: list[int] = []
"""Signals that came: compiled code that is being loaded makes other errors of what they raise."""


class Stopped(BaseException):
    """A signal came that ends the command, as ``timeout`` and batch systems send it."""

    def __init__(self, number: int) -> None:
        self.number = number


def _stop(number: int, frame: FrameType | None) -> None:
    CAME.append(number)
    raise KeyboardInterrupt if number == signal.SIGINT else Stopped(number)


class _Subcommand(TyperCommand):
    """One that may write files: signals let it take away what is half-written."""

    def invoke(self, ctx: Any) -> Any:
        """Do what was asked."""
        with _signals(), results_alone_on_stdout():
            return super().invoke(ctx)


class Shell(TyperGroup):
    """All commands: whatever ends one of them is one message on stderr, and its exit status."""

    def __init__(self, **named: Any) -> None:
        super().__init__(**named)
        self.commands = {name: TyperCommand(name) for name in COMMANDS}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command with its options; its module is imported."""
        if cmd_name not in COMMANDS:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        alone.command(cmd_name, cls=_Subcommand)(importlib.import_module(f"aacmm_pin.cli.{cmd_name}").run)
        return typer.main.get_command(alone)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The list of commands, of which none is imported."""
        listed = [TyperCommand(name, short_help=_sentence(name)) for name in COMMANDS]
        TyperGroup(commands=listed, params=self.params, help=self.help, rich_markup_mode=None).format_help(ctx, formatter)

    def main(self, *args: Any, **named: Any) -> Any:
        """Run the command, with the streams as it needs them."""
        sys.stdout = sys.stdout or _Closed()
        sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # what a terminal cannot show is escaped
                stream.reconfigure(errors="backslashreplace")
        with _told(), _warnings_as_notes():
            try:
                return super().main(*args, **named)
            finally:
                sys.stdout.flush()

    def make_context(self, *args: Any, **named: Any) -> Any:
        """See :meth:`main`; typer would answer some errors before they come there."""
        with _told():
            return super().make_context(*args, **named)

    def invoke(self, ctx: Any) -> Any:
        """See :meth:`make_context`."""
        with _told():
            return super().invoke(ctx)


def _sentence(name: str) -> str:
    """The first sentence of a command's docstring, read from its file."""
    tree = ast.parse(Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8"))
    (function,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "run")
    return (ast.get_docstring(function) or "").partition("\n\n")[0]


class _Closed(io.StringIO):
    """Standard output where the caller has closed it."""

    def write(self, text: str) -> int:
        """Refuse it."""
        raise OSError(errno.EBADF, "standard output is closed")


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except AacmmError as error:
        _end(1, str(error))
    except MemoryError as error:
        _end(1, f"not enough memory: {error}".removesuffix(": "))
    except RecursionError:
        _end(1, "the input is nested too deep")
    except UnicodeEncodeError as error:
        _end(1, f"{error.object[error.start : error.end]!r} cannot be written as {error.encoding}")
    except BrokenPipeError:  # whoever read has what it wanted, as head has
        _end(128 + signal.SIGPIPE)
    except OSError as error:
        words, of_stream = error.strerror or str(error), error.errno == errno.ENOSPC
        where = error.filename or ("standard output" if of_stream else None)  # other files are told by their names
        _end(1, words if where is None else f"{where}: {words}")
    except KeyboardInterrupt:
        _end(128 + signal.SIGINT, INTERRUPTED)
    except Stopped as stopped:
        _end(128 + stopped.number, INTERRUPTED)
    except BaseException as error:
        if CAME and isinstance(error, Exception):
            _end(128 + CAME[0], INTERRUPTED)
        if (said := _of_a_plugin(error) or _of_matplotlib(error)) is None:
            raise
        _end(1, said)


def _of_a_plugin(error: BaseException) -> str | None:
    """What a class that a plugin registered has raised, in one line; None where the mistake is ours, or it is the end."""
    if "aacmm_pin.effects.causes" not in sys.modules:
        return None
    from aacmm_pin.effects.causes import CAUSES, raised

    passed = [frame.f_code.co_filename for frame, _ in traceback.walk_tb(error.__traceback__)]
    own = {name: cause.__module__ for name, cause in CAUSES.items() if not cause.__module__.startswith("aacmm_pin.")}
    for name, module in own.items():
        if (file := getattr(sys.modules.get(module), "__file__", None)) in passed:
            return f"{name}: {raised(error, file)}"
    # What it states of itself may be found wrong far from its lines.
    return (
        f"{', '.join(own)}, or what uses it: {raised(error, passed[-1])}" if own and isinstance(error, Exception) else None
    )


def _of_matplotlib(error: BaseException) -> str | None:
    """What drawing has raised, in one line: what it is set to is the user's, and may be anything."""
    passed = [frame.f_code.co_filename for frame, _ in traceback.walk_tb(error.__traceback__)]
    if not isinstance(error, Exception) or not any("/matplotlib/" in file for file in passed):
        return None
    from aacmm_pin.effects.causes import raised

    return f"matplotlib, set by matplotlibrc and SOURCE_DATE_EPOCH, raised {raised(error, '')}"


def _end(status: int, message: str = "") -> None:
    """Say why, if anybody reads it, and give up what standard output did not take."""
    with suppress(OSError):
        if message:
            note(f"aacmm-pin: {message}")
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # it would be tried again at exit, with a message of Python's own
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    raise SystemExit(status)


@contextmanager
def _signals() -> Iterator[None]:
    """Those that end a command raise, so that what is half-written is taken away; those that are ignored stay so."""
    if threading.current_thread() is not threading.main_thread():  # only that one may
        yield
        return
    CAME.clear()
    before = {number: signal.getsignal(number) for number in STOPPING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


OF_PROGRAMS = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ImportWarning, ResourceWarning)
"""Warnings for those who write programs, and no matter of those who run them."""


def _noted(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    if not issubclass(category, OF_PROGRAMS):
        note(f"note: {message}")


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """What a library warns of, without its file and line; a test that makes errors of warnings still has them."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # that its cache has no place is nobody's concern
    with warnings.catch_warnings():
        warnings.showwarning = _noted
        yield


app = typer.Typer(
    cls=Shell,
    name="aacmm-pin",
    help="Postures, accuracy and calibration of articulated-arm coordinate measuring machines, on Pinocchio.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help without boxes, which take longer to load than all the rest of it
    context_settings={"help_option_names": ["-h", "--help"]},
)

os.environ["MPLBACKEND"] = "Agg"  # the command writes files and never opens a window; matplotlib is loaded to draw only


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        say(f"aacmm-pin {version('aacmm-pin')}")
        raise typer.Exit


@app.callback()
def _root(
    plugin: Annotated[
        list[str] | None,
        typer.Option(metavar="MODULE", help="Module or .py file that registers causes of your own; before the command."),
    ] = None,
    version_: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")] = False,
) -> None:
    """Options of the command itself."""
    from importlib.metadata import entry_points

    loaded_before = {*sys.modules}
    loaders: list[tuple[str, Callable[[], Any]]] = []
    loaders += [(f"--plugin {name}", functools.partial(_import, name)) for name in plugin or []]
    loaders += [(f"entry point {point.name}", point.load) for point in entry_points(group="aacmm_pin.causes")]
    if loaders:
        from aacmm_pin.effects.causes import CAUSES, raised
    for what, load in loaders:
        known = dict(CAUSES)
        try:
            with redirect_stdout(sys.stderr):  # what a module prints is no result
                load()
        except (KeyboardInterrupt, Stopped):
            raise
        except BaseException as error:
            raise AacmmError(f"{what}: {raised(error, os.path.abspath(what.removeprefix('--plugin ')))}") from None
        if known == CAUSES:
            note(f"note: {what} registers no cause")
    loaded = [getattr(sys.modules[name], "__file__", None) for name in {*sys.modules} - loaded_before if loaders]
    Results.plugins = (*(plugin or ()), *filter(None, loaded))


def _import(name: str) -> ModuleType:
    """A module by its name or by the path of its file."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path, stem = Path(name).absolute(), Path(name).stem
    if path.exists() and not path.is_file():  # reading a pipe may never end
        raise AacmmError("is not a regular file, expected a module of Python")
    other = importlib.machinery.PathFinder.find_spec(stem, FOLDERS)
    if stem in sys.stdlib_module_names or (other is not None and other.origin != str(path)):
        raise AacmmError(f"{stem} is the name of another module, which programs import; expected another name of the file")
    spec = importlib.util.spec_from_file_location(stem, path)
    assert spec is not None
    if str(path.parent) not in sys.path:  # worker processes have the same and import it by its name
        sys.path.append(str(path.parent))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    # What it says now: bytecode that Python keeps is told by second and size, and may be of what the file was before.
    exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), vars(module))
    return module
