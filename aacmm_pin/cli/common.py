"""What the subcommands share: how they are registered, the types of their arguments, and how
results leave them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, get_type_hints

import typer

from aacmm_pin._support.input_files import outputs_refused
from aacmm_pin._support.output_files import OutputFiles, json_text
from aacmm_pin._support.text_escaping import encodable, without_notes
from aacmm_pin._support.text_escaping import note as note
from aacmm_pin._support.text_escaping import say as say
from aacmm_pin._support.text_escaping import status as status
from aacmm_pin._support.text_escaping import warn as warn
from aacmm_pin._support.units import ANGLES, MM, in_radians
from aacmm_pin.errors import AacmmError

if TYPE_CHECKING:
    from aacmm_pin._support.plausible import Range
    from aacmm_pin.effects import ErrorModel
    from aacmm_pin.report import Document

PLOT_SUFFIXES = (".png", ".svg", ".pdf")
ARM, NOISE, OUTPUT = "Arm", "Noise", "Output"
"""Headings of options in a help text; the others are listed under *Options*."""


def command(*examples: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """What a subcommand does, with the options that typer sees, and examples under its help.

    A parameter whose type is a dataclass stands for the fields of it, which are options that
    several commands share.
    """

    def with_options(function: Callable[..., None]) -> Callable[..., None]:
        run = _with_options(function)
        run.examples = examples  # type: ignore[attr-defined]
        return run

    return with_options


def _with_options(function: Callable[..., None]) -> Callable[..., None]:
    types = get_type_hints(function, include_extras=True)
    groups: dict[str, Any] = {key: kind for key, kind in types.items() if is_dataclass(kind)}
    options: dict[str, inspect.Parameter] = {}
    for key, parameter in inspect.signature(function).parameters.items():
        here = {key: (types[key], parameter.default)}
        if key in groups:
            here = _fields(groups[key])
        for option, (kind, default) in here.items():
            options[option] = inspect.Parameter(
                option, parameter.KEYWORD_ONLY, default=default, annotation=kind
            )

    options["quiet"] = inspect.Parameter(
        "quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet
    )

    def guarded(quiet: bool, **typed: Any) -> None:
        made = {}
        for key, kind in groups.items():
            own = {name: typed.pop(name) for name in _fields(kind)}
            made[key] = kind(**own)
        with without_notes() if quiet else nullcontext():
            function(**made, **typed)

    guarded.__doc__ = function.__doc__
    guarded.__annotations__ = {name: option.annotation for name, option in options.items()}
    guarded.__signature__ = inspect.Signature([*options.values()])  # type: ignore[attr-defined]
    return guarded


def _fields(group: Any) -> dict[str, tuple[Any, Any]]:
    """Type and default of every option of a group."""
    types = get_type_hints(group, include_extras=True)
    found = {}
    for field in fields(group):
        default = inspect.Parameter.empty if field.default is MISSING else field.default
        found[field.name] = (types[field.name], default)
    return found


def angle_option(help_: str, range_: Range, panel: str | None = None) -> Any:
    """An option for an angle within ``range_``: in radians, or with its unit behind it."""

    def angle(text: str) -> float:
        try:
            return in_radians(text)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r}; expected a number with a decimal point, in rad or with a unit: "
                f"{', '.join(ANGLES)}"
            ) from None

    return typer.Option(
        parser=angle,
        callback=_within(range_),
        metavar="ANGLE",
        help=help_,
        rich_help_panel=panel,
    )


def length_option(help_: str, range_: Range, panel: str | None = None, metavar: str = "MM") -> Any:
    """An option for lengths in millimetres; ``range_`` is in metres."""
    callback = _within(range_.of_unit("mm", MM))
    return typer.Option(metavar=metavar, callback=callback, help=help_, rich_help_panel=panel)


def _within(range_: Range) -> Callable[..., Any]:
    """A callback that refuses numbers outside a range."""

    def checked(parameter: typer.CallbackParam, value: Any) -> Any:
        if value is not None:
            range_.check(value, str(parameter.name).removesuffix("_mm"))
        return value

    return checked


def output_option(metavar: str, help_: str, *names: str) -> Any:
    """An option for a file to write."""
    return typer.Option(*names, metavar=metavar, help=help_, rich_help_panel=OUTPUT)


def page_option(page: str, *names: str) -> Any:
    """An option for a document, in the format that the end of its name chooses."""
    from aacmm_pin.report import suffixes  # the list of commands needs none

    return output_option("FILE.html", f"Write {page} ({', '.join(suffixes())}).", *names)


Json = Annotated[
    str | None,
    output_option(
        "FILE.json",
        "Write the results as one JSON object; - is standard output.",
        "--json",
    ),
]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the random generator.")]
Sectors = Annotated[
    int, typer.Option(metavar="N", min=1, help="Number of sectors of the swivel angle.")
]
EffectTexts = Annotated[
    list[str] | None,
    typer.Option(
        "--cause",
        metavar="CAUSE[:PLACE][,NAME=VALUE…]",
        help="Cause of error, such as encoder_eccentricity:3,amplitude_rad=20urad (repeatable).",
    ),
]
WorkerCount = Annotated[int, typer.Option(metavar="N", min=1, help="Number of worker processes.")]
Output = Annotated[Path | None, output_option("FILE", "File to write.", "--output", "-o")]
CsvOutput = Annotated[
    Path | None,
    output_option("FILE.csv", "CSV file to write. Default: standard output.", "--csv", "-o"),
]
Plot = Annotated[
    Path | None,
    output_option("FILE.png", f"Draw the result ({', '.join(PLOT_SUFFIXES)}).", "--plot"),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="Show results, warnings and errors only.", rich_help_panel=OUTPUT
    ),
]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files that exist.", rich_help_panel=OUTPUT)
]


def refuse(context: typer.Context, options: Iterable[str], why: str) -> None:
    """Refuse those of the ``options``, by the names of their arguments, that were given with a
    command.
    """
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if parameter.name in options and source is not None and source.name != "DEFAULT":
            raise typer.BadParameter(f"{parameter.opts[0]} {why}")


class Results(OutputFiles):
    """The files of one command, and what it prints in their stead: all of it in the end, or
    nothing.

    Reading a file that is to be written is refused; so is, at once, writing a file of a plugin.
    """

    plugins: ClassVar[tuple[str, ...]] = ()
    """Files of ``--plugin`` and of all that it imports, which every command reads."""

    def __init__(
        self,
        force: bool,
        *paths: Path | None,
        page: Path | None = None,
        plot: Path | None = None,
        json_: str | None = None,
        inputs: Iterable[str] = (),
    ) -> None:
        """Check before long work that everything can be written.

        Args:
            force: replace files that exist.
            paths: files that will be written; None where one was not asked for.
            page: a document.
            plot: a picture.
            json_: a file for JSON, ``-`` for stdout.
            inputs: files that other processes read.

        Raises:
            AacmmError: a file cannot be written, exists, is read by the command, or is asked for
                twice.
        """
        super().__init__(force, (*self.plugins, *inputs))
        outputs = (*paths, page, plot, json_)
        self._outputs = tuple(Path(path) for path in outputs if path is not None)
        self.check(*self._outputs)
        if page is not None:
            from aacmm_pin.report import require_format  # the list of commands needs none

            require_format(page)
        if plot is not None and plot.suffix not in PLOT_SUFFIXES:
            raise AacmmError(
                f"--plot {plot}: expected a name that ends in {' or '.join(PLOT_SUFFIXES)}"
            )

    def __enter__(self) -> Self:
        self._stack.enter_context(outputs_refused(self._outputs))
        return super().__enter__()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put the files in their places, and name them."""
        super().__exit__(kind, error, trace)
        if kind is None and self.written:
            status(f"written: {', '.join(self.written)}")

    def text(self, text: str, path: str | Path | None) -> None:
        """Write ``text`` to a file, or print it where ``path`` is None."""
        file = self.file("-" if path is None else path)
        file.write_text(encodable(text), encoding="utf-8", newline="")

    def arm(self, model: ErrorModel, path: Path, comment: str) -> None:
        """Write the arm file of a model.

        An estimate that is larger than any file may state is written and shown, for it took long to
        find.
        """
        from aacmm_pin.effects import require_plausible  # the list of commands needs none

        for effect in model.effects:
            try:
                require_plausible(effect)
            except AacmmError as error:
                note(f"{error}; because of this value, no command can read {path}")
        self.text(model.text(comment, path), path)

    def document(self, document: Document, path: Path) -> None:
        """Write a document in the format that the end of the name chooses."""
        from aacmm_pin.report import content  # the list of commands needs none

        self.file(path).write_bytes(content(document, path))

    def json(self, content: dict[str, Any], target: str | None) -> None:
        """Write one JSON object to the file ``target``, or to stdout where that is ``-``; nothing
        where it is None.
        """
        if target is not None:
            self.text(json_text(content), target)

    def picture(self, drawn: Callable[[], Any], path: Path | None) -> None:
        """Write the matplotlib figure that ``drawn`` gives; nothing where ``path`` is None."""
        if path is not None:
            from aacmm_pin.report import without_latex

            with without_latex():
                drawn().savefig(
                    self.file(path), dpi=150, bbox_inches="tight", format=path.suffix[1:]
                )
