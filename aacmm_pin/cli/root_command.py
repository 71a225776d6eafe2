"""``aacmm-pin``: its options, its end, and its subcommands."""

from __future__ import annotations

import errno
import importlib
import inspect
import io
import logging
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from aacmm_pin._support.text_escaping import print_error, results_alone_on_stdout, say, warn
from aacmm_pin.errors import AacmmError

COMMANDS = {
    "accept": "Evaluate an acceptance test (ISO 10360-12, ASME B89.4.22).",
    "accuracy": "Predict the uncertainty of a position in each posture, or of a length.",
    "calibrate": "Estimate the parameters of an arm from measurements.",
    "causes": "List the known causes of error, or describe one.",
    "check": "Check that a measurement file fits an arm, and list the columns that the file lacks.",
    "configurations": "List the postures that reach a point (CSV).",
    "correct": "Compute tip coordinates and their uncertainty from readings (CSV).",
    "demo": "Run a demonstration with bundled data, and write one HTML page.",
    "diagnose": "Find causes of error that the model of an arm lacks.",
    "diagnose-files": "Diagnose many measurement files, and write one table.",
    "map": "Compute flexibility and accuracy in each cell of the workspace (netCDF).",
    "plan": "Plan measurements for a calibration, an acceptance test or a diagnosis.",
    "plan acceptance": "Plan the probed points of an acceptance test (CSV to fill in).",
    "plan calibration": "Plan records that determine the geometry of the arm (CSV to fill in).",
    "plan distinguish": "Plan records that distinguish causes of error (CSV to fill in).",
    "show": "Show the arm in 3D in all postures that reach a point, or in one posture.",
    "simulate": "Simulate measurements of an arm with known errors (CSV).",
    "urdf": "Write the URDF of an arm, or the DH table of a URDF.",
}
"""Sentence of each command; the docstring of ``run`` in its module adds paragraphs. The first word
of several commands is a group without module.
"""
HELP_NAMES = {"help_option_names": ["-h", "--help"]}
USAGE_ERROR: Any = typer.BadParameter.__base__
"""Of click, which versions of typer have in different places."""
INTERRUPTED = "interrupted; each output file is complete or unchanged"
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
RECEIVED: list[int] = []
"""Signals received: while compiled code is loaded, an interrupt may raise another error."""


class _Subcommand(TyperCommand):
    """It removes incomplete files if a signal stops it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        with self._options_named():
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        with _stopping_signals(), results_alone_on_stdout(), self._options_named():
            return super().invoke(ctx)

    @contextmanager
    def _options_named(self) -> Iterator[None]:
        """In messages, options replace Python arguments, and quotes mark a text that is no
        number.
        """
        try:
            yield
        except AacmmError as error:
            # The argument in ``axis is [0, 0, 0]; …`` becomes the option: ``--axis 0 0 0: …``.
            options = {str(option.name): option.opts[0] for option in self.params}
            message = str(error)
            refused_argument = re.match(r"(\w+)(?:\[\d+\])? (?:is|are) ([^;]+); ", message)
            if refused_argument is not None and refused_argument[1] in options:
                value = re.sub(r"[][(),]", "", refused_argument[2])
                message = (
                    f"{options[refused_argument[1]]} {value}: {message[refused_argument.end() :]}"
                )
            error.args = (message,)
            raise
        except typer.BadParameter as error:
            if error.param is None:
                raise USAGE_ERROR(error.message, error.ctx) from None
            from aacmm_pin._support.plausible import expected_words  # the list needs none

            for problem in getattr(error.__cause__, "errors", list)():
                if problem["type"] != "value_error":
                    error.message = f"{problem['input']!r}; expected {expected_words(problem)}"
            error.message = error.message.removeprefix("Value error, ")
            raise


class _Commands(TyperGroup):
    """The commands whose names share a ``beginning``; only the command that runs is imported."""

    def __init__(self, beginning: str = "", **named: Any) -> None:
        super().__init__(**named)
        self._beginning = beginning
        for name, sentence in COMMANDS.items():
            word = name.removeprefix(beginning)
            if name.startswith(beginning) and " " not in word:
                self.commands[word] = TyperCommand(word, short_help=sentence)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        name = self._beginning + cmd_name
        if any(command.startswith(f"{name} ") for command in COMMANDS):
            return _Commands(
                f"{name} ",
                name=cmd_name,
                help=COMMANDS[name],
                no_args_is_help=True,
                context_settings=HELP_NAMES,
                rich_markup_mode=None,
            )
        if name not in COMMANDS:
            return None
        run = importlib.import_module(f"aacmm_pin.cli.{re.sub('[ -]', '_', name)}").run
        alone = typer.Typer(
            add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False
        )
        alone.command(
            cmd_name,
            cls=_Subcommand,
            help=f"{COMMANDS[name]}\n\n{inspect.getdoc(run) or ''}",
            epilog="\n".join(["\b", "Examples:", *(f"  {line}" for line in run.examples)]),
        )(run)
        return typer.main.get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(word, self.commands[word].short_help) for word in self.commands])


class Shell(_Commands):
    """An error ends the command with one message on stderr and its exit status."""

    def main(self, *args: Any, **named: Any) -> Any:
        """Run the command line with streams that can be written, and end with messages."""
        sys.stdout = sys.stdout or open(1, closefd=False)  # noqa: SIM115, refuses what is written
        sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # what a terminal cannot show is escaped
                stream.reconfigure(errors="backslashreplace")
        with _errors_as_messages(), _warnings_as_notes():
            try:
                return super().main(*args, **named)
            finally:
                sys.stdout.flush()

    def invoke(self, ctx: Any) -> Any:
        """See :meth:`main`; typer would answer some errors before."""
        with _errors_as_messages():
            return super().invoke(ctx)


@contextmanager
def _stopping_signals() -> Iterator[None]:
    """Interrupt the command at each signal of :data:`STOPPING`, unless the caller ignores it."""

    def stop(number: int, frame: FrameType | None) -> None:
        RECEIVED.append(number)
        raise KeyboardInterrupt

    RECEIVED.clear()
    with ExitStack() as undo:
        for number in STOPPING:
            former_handler = signal.getsignal(number)
            if former_handler != signal.SIG_IGN:
                signal.signal(number, stop)
                undo.callback(signal.signal, number, former_handler)
        yield


@contextmanager
def _errors_as_messages() -> Iterator[None]:
    """End with one line on stderr for every error but bugs of this package."""
    try:
        yield
    except BaseException as error:
        ending = _ending(error)
        if ending is None:
            raise
        status, message = ending
        with suppress(OSError):  # nobody may read it
            if message:
                print_error(f"aacmm-pin: {message}")
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:  # it would be tried again at exit, with a message of Python's own
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        raise SystemExit(status) from None


def _ending(error: BaseException) -> tuple[int, str] | None:
    """Exit status and message; None if typer reports the error, or for a bug."""
    match error:
        case USAGE_ERROR() | typer.Exit() | typer.Abort():  # typer's own
            return None
        case AacmmError():
            return 1, str(error)
        case Exception() | KeyboardInterrupt() if RECEIVED:
            return 128 + RECEIVED[0], INTERRUPTED
        case KeyboardInterrupt():
            return 128 + signal.SIGINT, INTERRUPTED
        case MemoryError():
            return 1, f"not enough memory: {error}".removesuffix(": ")
        case BrokenPipeError():  # the reader of the output, such as head, has closed it
            return 128 + signal.SIGPIPE, ""
        case OSError():
            words = error.strerror or str(error)
            of_stream = error.errno == errno.ENOSPC or isinstance(error, io.UnsupportedOperation)
            place = error.filename or ("standard output" if of_stream else "")
            return 1, f"{place}: {words}".removeprefix(": ")
    if "aacmm_pin.cli.plugins" not in sys.modules:
        return None
    from aacmm_pin.cli.plugins import plugin_error

    message = plugin_error(error)
    return None if message is None else (1, message)


OF_PROGRAMS = (
    DeprecationWarning,
    PendingDeprecationWarning,
    FutureWarning,
    ImportWarning,
    ResourceWarning,
)
"""For programmers; users do not need them."""


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Print warnings without file and line of code; tests can turn them into errors."""

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        if not issubclass(category, OF_PROGRAMS):
            warn(str(message))

    # Matplotlib warns if it cannot write its cache, which changes no result.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.showwarning = show
        yield


app = typer.Typer(
    cls=Shell,
    name="aacmm-pin",
    help="Predict the uncertainty of articulated-arm coordinate measuring machines, calibrate "
    "them, find causes of error, and evaluate acceptance tests.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help without boxes, which take longer to load than all the rest of it
    context_settings=HELP_NAMES,
)

os.environ["MPLBACKEND"] = (
    "Agg"  # the command writes files and never opens a window; matplotlib is loaded to draw only
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        say(f"aacmm-pin {version('aacmm-pin')}")
        raise typer.Exit


@app.callback()
def _root(
    plugin: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MODULE",
            help="Module or .py file that registers your own causes. State this option before the "
            "command.",
        ),
    ] = None,
    version_: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Options of the command itself."""
    from importlib.metadata import entry_points

    points = entry_points(group="aacmm_pin.causes")
    if plugin or points:
        from aacmm_pin.cli.plugins import load_plugins

        load_plugins(plugin or [], points)
