"""What subcommands share: their decorator, types of arguments, and output."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, Self, get_type_hints

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


def angle_option(help_: str, range_: Range) -> Any:
    """An angle within ``range_``: in radians, or with its unit behind it."""

    def angle(text: str) -> float:
        try:
            return in_radians(text)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r}; expected a number with a decimal point, in rad or with a unit: "
                f"{', '.join(ANGLES)}"
            ) from None

    return typer.Option(parser=angle, callback=_within(range_), metavar="ANGLE", help=help_)


def length_option(name: str, help_: str, range_: Range, metavar: str = "MM") -> Any:
    """Lengths typed in millimetres, that come in metres, as ``range_``."""
    callback = _within(range_.of_unit("mm", MM), MM)
    return typer.Option(name, metavar=metavar, callback=callback, help=help_)


def _within(range_: Range, unit: float = 1.0) -> Callable[..., Any]:
    """A callback that refuses numbers outside a range in ``unit``, and gives others in SI."""

    def checked(parameter: typer.CallbackParam, value: Any) -> Any:
        if value is None:
            return None
        range_.check(value, str(parameter.name))
        return value * unit if isinstance(value, float) else tuple(part * unit for part in value)

    return checked


def output_option(metavar: str, help_: str, *names: str) -> Any:
    return typer.Option(*names, metavar=metavar, help=help_)


def arm_file_option(help_: str, *names: str) -> Any:
    def checked(path: Path | None) -> Path | None:
        from aacmm_pin.report import suffixes  # the list of commands needs none

        if path is not None and path.suffix in (*suffixes(), *PLOT_SUFFIXES):
            raise typer.BadParameter(
                f"{path}: expected a name for an arm file (.toml); a page is written by --report"
            )
        return path

    return typer.Option(*names, metavar="FILE.toml", help=help_, callback=checked)


def page_option(page: str, *names: str) -> Any:
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
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]


@dataclass(frozen=True)
class Replacing:
    """Options of a command that writes only files."""

    force: Force = False


@dataclass(frozen=True)
class JsonFile:
    """Options of a command with JSON."""

    json_: Json = None
    force: Force = False


@dataclass(frozen=True)
class PlotAndJson:
    """Options of a command with JSON and a picture."""

    plot: Plot = None
    json_: Json = None
    force: Force = False


class FileOptions(Protocol):
    """Of a command that writes files, perhaps with ``plot`` and ``json_``."""

    @property
    def force(self) -> bool:
        """Replace files that exist."""


class Results(OutputFiles):
    """Files and printed results of one command: all in the end, or nothing.

    It cannot write a file that it reads.
    """

    def __init__(
        self,
        options: FileOptions,
        *paths: Path | None,
        page: Path | None = None,
        inputs: Iterable[str] = (),
    ) -> None:
        """Check before long work that everything can be written.

        Args:
            options: options of the command.
            paths, page: files and a document to write.
            inputs: read by other processes.

        Raises:
            AacmmError: one cannot be written, exists, is read, or stated twice.
        """
        super().__init__(options.force, inputs)
        self._plot: Path | None = getattr(options, "plot", None)
        self._json: str | None = getattr(options, "json_", None)
        outputs = (*paths, page, self._plot, self._json)
        self._outputs = tuple(Path(path) for path in outputs if path is not None)
        self.check(*self._outputs)
        if page is not None:
            from aacmm_pin.report import require_format  # the list of commands needs none

            require_format(page)
        if self._plot is not None and self._plot.suffix not in PLOT_SUFFIXES:
            raise AacmmError(
                f"--plot {self._plot}: expected a name that ends in {' or '.join(PLOT_SUFFIXES)}"
            )

    def __enter__(self) -> Self:
        self._stack.enter_context(outputs_refused(self._outputs))
        return super().__enter__()

    def __exit__(self, kind: type[BaseException] | None, *raised: Any) -> None:
        """Put the files in place, and list them on stderr."""
        super().__exit__(kind, *raised)
        if kind is None and self.written:
            status(f"written: {', '.join(self.written)}")

    def text(self, text: str, path: Path | str | None) -> None:
        """To a file, or printed if ``path`` is None."""
        file = self.file(path or "-")
        file.write_text(encodable(text), encoding="utf-8", newline="")

    def arm(self, model: ErrorModel, path: Path, comment: str) -> None:
        """Write an arm file, with a note if an estimate is too large to be read."""
        from aacmm_pin.effects import require_plausible  # the list of commands needs none

        for effect in model.effects:
            try:
                require_plausible(effect)
            except AacmmError as error:
                note(f"{error}; because of this value, no command can read {path}")
        self.text(model.text(comment, path), path)

    def document(self, document: Document, path: Path | None) -> None:
        """Write in the format of the suffix, if there is a path."""
        if path is not None:
            from aacmm_pin.report import content  # the list of commands needs none

            self.file(path).write_bytes(content(document, path))

    def json(self, content: dict[str, Any]) -> None:
        """To the file of ``--json``; ``-`` is stdout."""
        if self._json is not None:
            self.text(json_text(content), self._json)

    def picture(self, drawn: Callable[[], Any]) -> None:
        """The matplotlib figure of ``drawn``, to the file of ``--plot``."""
        if self._plot is not None:
            from aacmm_pin.report import without_latex

            file, kind = self.file(self._plot), self._plot.suffix[1:]
            with without_latex():
                drawn().savefig(file, dpi=150, bbox_inches="tight", format=kind)

    @property
    def json_on_stdout(self) -> bool:
        """Whether no other result may be on stdout."""
        return self._json == "-"

    def show(self, document: Document) -> None:
        """At the terminal; beside JSON on stdout, only its notes."""
        from aacmm_pin.report import terminal  # the list of commands needs none

        terminal.show(document, self.json_on_stdout)


Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Show results, warnings and errors only."),
]


def command(*examples: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate the function of a subcommand; a parameter that is a dataclass stands for its
    fields.
    """

    def with_options(function: Callable[..., None]) -> Callable[..., None]:
        types = get_type_hints(function)
        groups: dict[str, Any] = {key: kind for key, kind in types.items() if is_dataclass(kind)}

        def run(quiet: bool, **typed: Any) -> None:
            for key, kind in groups.items():
                values = {field.name: typed.pop(field.name) for field in fields(kind)}
                typed[key] = kind(**values)
            with without_notes() if quiet else nullcontext():
                function(**typed)

        options = [*_options(function)]
        quiet = inspect.Parameter(
            "quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet
        )
        run.__signature__ = inspect.Signature([*options, quiet])  # type: ignore[attr-defined]
        run.__doc__ = function.__doc__
        run.examples = examples  # type: ignore[attr-defined]
        return run

    return with_options


def _options(function: Callable[..., Any]) -> Iterator[inspect.Parameter]:
    """Parameters, where fields replace those that are dataclasses."""
    types = get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        if is_dataclass(types[name]):
            yield from _options(types[name])
        else:
            yield parameter.replace(annotation=types[name], kind=parameter.KEYWORD_ONLY)
