"""What the subcommands share: the application, the types of its arguments, and how results leave it."""

from __future__ import annotations

import errno
import functools
import importlib.util
import inspect
import io
import logging
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import MISSING, fields, is_dataclass
from importlib.metadata import entry_points, version
from pathlib import Path
from types import FrameType, ModuleType
from typing import Annotated, Any, ClassVar, get_type_hints

import typer
from typer.core import TyperGroup

from aacmm_pin._support.output_files import STOPPING, OutputFiles, json_text
from aacmm_pin._support.text_escaping import encodable
from aacmm_pin._support.text_escaping import note as note
from aacmm_pin._support.text_escaping import say as say
from aacmm_pin.errors import AacmmError

INTERRUPTED = "interrupted; every file is there whole, or as it was before"


class Stopped(BaseException):
    """A signal came that ends the command, as ``timeout`` and batch systems send it."""

    def __init__(self, number: int) -> None:
        self.number = number


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


class Shell(TyperGroup):
    """All commands: whatever ends one of them is one message on stderr, and its exit status."""

    def main(self, *args: Any, **named: Any) -> Any:
        """Run the command, with the streams and signals as it needs them."""
        sys.stdout = sys.stdout or _Closed()
        sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # what a terminal cannot show is escaped
                stream.reconfigure(errors="backslashreplace")
        with _signals(), _told(), _warnings_as_notes():
            try:
                return super().main(*args, **named)
            finally:
                sys.stdout.flush()

    def invoke(self, ctx: Any) -> Any:
        """See :meth:`main`; typer would answer some errors before they come there."""
        with _told():
            return super().invoke(ctx)


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
    except OSError as error:
        words = error.strerror or str(error)
        _end(1, words if error.filename is None else f"{error.filename}: {words}")
    except KeyboardInterrupt:
        _end(128 + signal.SIGINT, INTERRUPTED)
    except Stopped as stopped:
        _end(128 + stopped.number, INTERRUPTED)
    except Exception as error:
        if (said := _of_a_plugin(error)) is None:
            raise
        _end(1, said)


def _of_a_plugin(error: Exception) -> str | None:
    """What a class that a plugin registered has raised, in one line; None where the mistake is ours."""
    from aacmm_pin.effects.causes import CAUSES, raised

    passed = {frame.filename for frame in traceback.extract_tb(error.__traceback__)}
    for cause in CAUSES.values():
        file = getattr(sys.modules.get(cause.__module__), "__file__", None)
        if file in passed and not cause.__module__.startswith("aacmm_pin."):
            return f"{cause.cause}: {raised(error, file)}"
    return None


def _end(status: int, message: str) -> None:
    """Say why, if anybody reads it, and give up what standard output did not take."""
    with suppress(OSError):
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
    ours = dict.fromkeys(STOPPING, _stop) | {signal.SIGINT: signal.default_int_handler}
    before = {number: signal.getsignal(number) for number in STOPPING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, ours[number])
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """What a library warns of, without its file and line; a test that makes errors of warnings still has them."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # that its cache has no place is nobody's concern
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: note(f"note: {message}")
        yield


app = typer.Typer(
    cls=Shell,
    name="aacmm-pin",
    help="Postures, accuracy and calibration of articulated-arm coordinate measuring machines, on Pinocchio.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

os.environ["MPLBACKEND"] = "Agg"  # the command writes files and never opens a window; matplotlib is loaded to draw only

PLOT_SUFFIXES = (".png", ".svg", ".pdf")


def command(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a subcommand.

    A parameter whose type is a dataclass stands for the fields of it, which are options that several commands share.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        types = get_type_hints(function, include_extras=True)
        groups: dict[str, Any] = {key: kind for key, kind in types.items() if is_dataclass(kind)}
        options: dict[str, inspect.Parameter] = {}
        for key, parameter in inspect.signature(function).parameters.items():
            here = {key: (types[key], parameter.default)} if key not in groups else _fields(groups[key])
            for option, (kind, default) in here.items():
                options[option] = inspect.Parameter(option, parameter.KEYWORD_ONLY, default=default, annotation=kind)

        def guarded(**typed: Any) -> None:
            made = {key: kind(**{f: typed.pop(f) for f in _fields(kind)}) for key, kind in groups.items()}
            function(**made, **typed)

        guarded.__doc__ = function.__doc__
        guarded.__annotations__ = {option: parameter.annotation for option, parameter in options.items()}
        guarded.__signature__ = inspect.Signature([*options.values()])  # type: ignore[attr-defined]
        app.command(name)(guarded)
        return function

    return register


def _fields(group: Any) -> dict[str, tuple[Any, Any]]:
    """Type and default of every option of a group."""
    types = get_type_hints(group, include_extras=True)
    return {f.name: (types[f.name], inspect.Parameter.empty if f.default is MISSING else f.default) for f in fields(group)}


Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help="Write one JSON object; - for stdout.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")]
Sectors = Annotated[int, typer.Option(min=1, help="Sectors of the configuration circle.")]
EffectTexts = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="CAUSE[:PLACE][,NAME=VALUE…]",
        help="A cause of error, such as encoder_eccentricity:3,amplitude_rad=20urad; may be given several times.",
    ),
]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="File to write.")]
Plot = Annotated[Path | None, typer.Option("--plot", help="Draw the result into this file (.png, .svg, .pdf).")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]


class Results(OutputFiles):
    """The files of one command and what it prints in their stead: all of it in the end, or nothing."""

    plugins: ClassVar[tuple[str, ...]] = ()
    """What ``--plugin`` named, which every command reads."""

    def __init__(
        self,
        force: bool,
        *paths: Path | None,
        plot: Path | None = None,
        json_: str | None = None,
        reads: Iterable[str | None] = (),
    ) -> None:
        """Look, before long work begins, whether everything can be written.

        Args:
            force: replace files that exist.
            paths: files that will be written; None where one was not asked for.
            plot: a picture.
            json_: a file for JSON, ``-`` for stdout.
            reads: files that the command reads, which it never replaces; names of bundled arms among them are no files.

        Raises:
            AacmmError: a file cannot be written, is there already, is read by the command, or is asked for twice.
        """
        super().__init__(force, [*self.plugins, *(name for name in reads if name is not None)])
        self.check(*[path for path in (*paths, plot, json_) if path is not None])
        if plot is not None and plot.suffix not in PLOT_SUFFIXES:
            raise AacmmError(f"{plot}: expected a name that ends in one of {', '.join(PLOT_SUFFIXES)}")

    def text(self, text: str, path: str | Path | None) -> None:
        """Write ``text`` to a file, or print it where ``path`` is None."""
        self.file("-" if path is None else path).write_text(encodable(text), encoding="utf-8", newline="")

    def json(self, content: dict[str, Any], target: str | None) -> None:
        """Write one JSON object to the file ``target``, or to stdout where that is ``-``; nothing where it is None."""
        if target is not None:
            self.text(json_text(content), target)

    def picture(self, drawn: Callable[[], Any], path: Path | None) -> None:
        """Write the matplotlib figure that ``drawn`` gives; nothing where ``path`` is None."""
        if path is not None:
            drawn().savefig(self.file(path), dpi=150, bbox_inches="tight", format=path.suffix[1:])


def _version(wanted: bool) -> None:
    if wanted:
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
    Results.plugins = tuple(plugin or ())
    loaders: list[tuple[str, Callable[[], Any]]] = []
    loaders += [(f"--plugin {name}", functools.partial(_import, name)) for name in plugin or []]
    loaders += [(f"entry point {point.name}", point.load) for point in entry_points(group="aacmm_pin.causes")]
    for what, load in loaders:
        try:
            with redirect_stdout(sys.stderr):  # what a module prints is no result
                load()
        except (Exception, SystemExit) as error:
            from aacmm_pin.effects.causes import raised

            raise AacmmError(f"{what}: {raised(error, os.path.abspath(what.removeprefix('--plugin ')))}") from None


def _import(name: str) -> ModuleType:
    """A module by its name or by the path of its file."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    if Path(name).exists() and not Path(name).is_file():  # reading a pipe may never end
        raise AacmmError("is not a regular file, expected a module of Python")
    spec = importlib.util.spec_from_file_location(Path(name).stem, name)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
