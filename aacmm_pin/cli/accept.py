"""Whether an arm meets its specification."""

from __future__ import annotations

import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin._support.units import MM
from aacmm_pin.cli.common import Force, Json, Results, command, note
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.verification import accept


@command
def run(
    files: Annotated[
        list[str],
        typer.Argument(metavar="[ARM]... DATA", help="Arms that make coordinates of indications, and the touches (CSV)."),
    ],
    mpe: Annotated[
        list[str] | None,
        typer.Option(metavar="FIGURE=MM", help="Maximum permissible error, or a TOML file of such; several times."),
    ] = None,
    standard: Annotated[str | None, typer.Option(help="Only iso10360-12, or asme-b89.4.22.")] = None,
    range_mm: Annotated[float | None, typer.Option(help="Measuring range of the arm, in mm.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="HTML page to print: the certificate.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Whether the arm meets its specification: figures of ISO 10360-12 and ASME B89.4.22 from touches, with verdicts."""
    from aacmm_pin.report import html, terminal  # these load what draws
    from aacmm_pin.report.acceptance import acceptance_document

    *arms, path = files
    with Results(force, output, json_=json_, reads=[*files, *(m for m in mpe or [] if "=" not in m)]) as results:
        result = accept(
            path,
            {arm: ErrorModel.load(arm) for arm in arms},
            mpe=_limits(mpe or []),
            standard=standard,
            measuring_range=None if range_mm is None else range_mm * MM,
        )
        if output is not None:
            document = acceptance_document(result, f"{datetime.now(UTC):%Y-%m-%d}", Path(path).read_bytes())
            results.text(html.page(document), output)
        results.json(result.summary(), json_)
    if json_ != "-":
        terminal.show(acceptance_document(result))
    else:
        terminal.show_notes(result.notes)
    if result.failed and arms:
        note(f"note: aacmm-pin diagnose {arms[-1]} {path} looks for the cause, where the file has seats or references")


def _limits(texts: list[str]) -> dict[str, float]:
    """MPEs by name of the figure [m], each from ``FIGURE=MM`` or a file of them.

    Raises:
        AacmmError: one is no number, or a file cannot be read.
    """
    given: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if equals:
            given[name] = value
            continue
        try:
            given |= tomllib.loads(Path(text).read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise AacmmError(f"{text}: not TOML: {error}") from None
    limits: dict[str, float] = {}
    for name, limit in given.items():
        try:
            limits[name] = float(str(limit)) * MM
        except ValueError:
            raise AacmmError(f"MPE of {name} is {limit!r}, expected a number of millimetres") from None
    return limits
