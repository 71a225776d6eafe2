"""What the subcommands share: the application, the types of its arguments, and how results leave it."""

from __future__ import annotations

import functools
import importlib.util
import inspect
import os
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from importlib.metadata import entry_points, version
from pathlib import Path
from types import FrameType, ModuleType
from typing import Annotated, Any, get_type_hints

import typer

from aacmm_pin._support.output_files import OutputFiles, json_text
from aacmm_pin.errors import AacmmError

app = typer.Typer(
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
    """Register a subcommand; errors that the package raises on purpose become one message and exit status 1.

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
            try:
                made = {key: kind(**{f: typed.pop(f) for f in _fields(kind)}) for key, kind in groups.items()}
                function(**made, **typed)
            except AacmmError as error:
                note(f"aacmm-pin: {error}")
                raise typer.Exit(1) from None
            except KeyboardInterrupt as interrupt:
                note("aacmm-pin: interrupted; no output was left half-written")
                raise typer.Exit(143 if isinstance(interrupt, Terminated) else 130) from None

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


class Terminated(KeyboardInterrupt):
    """SIGTERM came, as ``timeout`` and batch systems send it; so what is half-written is taken away."""


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated


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


def say(text: str) -> None:
    """Tell what was found, on stdout."""
    typer.echo(text)


def note(text: str) -> None:
    """Tell what was assumed or went wrong, on stderr."""
    typer.echo(text, err=True)


class Results(OutputFiles):
    """The files of one command and what it prints in their stead: all of it in the end, or nothing."""

    def __init__(self, force: bool, *paths: Path | None, plot: Path | None = None, json_: str | None = None) -> None:
        """Look, before long work begins, whether everything can be written.

        Args:
            force: replace files that exist.
            paths: files that will be written; None where one was not asked for.
            plot: a picture.
            json_: a file for JSON, ``-`` for stdout.

        Raises:
            AacmmError: a file cannot be written, is there already, or is asked for twice.
        """
        super().__init__(force)
        self.check(*[path for path in (*paths, plot, json_) if path is not None])
        if plot is not None and plot.suffix not in PLOT_SUFFIXES:
            raise AacmmError(f"{plot}: expected a name that ends in one of {', '.join(PLOT_SUFFIXES)}")

    def text(self, text: str, path: str | Path | None) -> None:
        """Write ``text`` to a file, or print it where ``path`` is None."""
        self.file("-" if path is None else path).write_text(text, encoding="utf-8", newline="")

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
    if threading.current_thread() is threading.main_thread():  # only that one may
        signal.signal(signal.SIGTERM, _terminate)
    loaders: list[tuple[str, Callable[[], Any]]] = []
    loaders += [(f"--plugin {name}", functools.partial(_import, name)) for name in plugin or []]
    loaders += [(f"entry point {point.name}", point.load) for point in entry_points(group="aacmm_pin.causes")]
    for what, load in loaders:
        try:
            load()
        except Exception as error:
            note(f"aacmm-pin: {what}: {type(error).__name__}: {error}")
            raise typer.Exit(1) from None


def _import(name: str) -> ModuleType:
    """A module by its name or by the path of its file."""
    if not name.endswith(".py"):
        return importlib.import_module(name)
    spec = importlib.util.spec_from_file_location(Path(name).stem, name)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
