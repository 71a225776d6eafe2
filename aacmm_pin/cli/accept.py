"""Whether an arm meets its specification."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import fields
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.units import MM, number
from aacmm_pin.arm import MOST_BYTES, toml_of
from aacmm_pin.cli.accept_prediction import BeforeTheTest
from aacmm_pin.cli.arm_options import UrdfArm, in_metres
from aacmm_pin.cli.common import Force, Json, Plot, Results, command, note, page_option, refuse
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements
from aacmm_pin.verification import AcceptanceResult, History, accept, in_utc


@command(
    "aacmm-pin accept probed.csv --mpe E_Uni=0.1 -o report.html",
    "aacmm-pin accept --predict my_arm.toml plan.csv --encoder-noise-rad 8e-6",
)
def run(
    context: typer.Context,
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="[ARM]... DATA",
            help="Arms that compute coordinates from readings, and the probed points (CSV).",
        ),
    ],
    mpe: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FIGURE=MM",
            help="Maximum permissible error, or a TOML file of MPEs (repeatable).",
        ),
    ] = None,
    standard: Annotated[
        str | None, typer.Option(help="Evaluate only this standard: iso10360-12 or asme-b89.4.22.")
    ] = None,
    measuring_range_mm: Annotated[
        float | None, typer.Option(help="Measuring range of the arm, in mm.")
    ] = None,
    output: Annotated[
        Path | None, page_option("Page to print: the test report", "--report", "-o")
    ] = None,
    history: Annotated[
        Path | None, typer.Option(help="CSV of all checks; this check is appended.")
    ] = None,
    plot: Plot = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="ISO8601",
            help="Time of the check, UTC if without an offset. Default: that of the file.",
        ),
    ] = None,
    instrument: Annotated[
        str, typer.Option(help="The checked arm, such as its serial number.")
    ] = "",
    about: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TEXT", help="Further line of the test report (repeatable)."),
    ] = None,
    *,
    robot: UrdfArm,
    before: BeforeTheTest,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Evaluate an acceptance test by descriptions of ISO 10360-12:2016 and ASME B89.4.22-2004.

    The definitions come from public descriptions and were never compared with the standards' texts.
    """
    from aacmm_pin.report import (  # these load what draws
        CheckDetails,
        Document,
        acceptance_document,
        history_blocks,
        plots,
        terminal,
    )

    *names, path = files
    if before.predict:
        refuse(
            context,
            ("measuring_range_mm", "history", "plot", "time", "instrument", "about"),
            "cannot be combined with --predict",
        )
    else:
        refuse(context, [f.name for f in fields(before)], "requires --predict")
    if plot is not None and history is None:
        raise typer.BadParameter("--plot requires --history FILE, whose checks it draws")
    with Results(force, page=output, plot=plot, json_=json_) as results:
        arms, limits = {name: ErrorModel.load(name) for name in names}, _limits(mpe or [])
        if (by_urdf := robot.of_urdf()) is not None:
            arms[str(robot.urdf)] = by_urdf
        if before.predict:
            before.show(arms, path, limits, standard, results, output, json_)
            return
        past = None if history is None else History.read(history)
        result = accept(
            path, arms, mpe=limits, standard=standard, measuring_range=in_metres(measuring_range_mm)
        )
        when, summary, told = _when(time, path), result.summary(), acceptance_document(result)
        checks = None if past is None else past.with_check(result, when, instrument)
        if checks is not None and history is not None:
            summary["history"] = checks.summary()
            if checks.appended:
                checks.write(results, history)
            results.picture(lambda: plots.plot_history(checks), plot)
        if output is not None:
            details = CheckDetails(when, instrument, _about(about or []), checks)
            results.document(acceptance_document(result, details), output)
        results.json(summary, json_)
    terminal.show(told, json_ == "-")
    terminal.show(Document("", [] if checks is None else history_blocks(checks)), json_ == "-")
    for text in [] if checks is None else _of_history(checks, history):
        note(f"note: {text}")
    if (failed := _failed_arm(result, list(arms))) is not None and Path(path).is_file():
        note(f"note: {_next_step(robot.urdf_words if failed == robot.urdf else [failed], path)}")


def _of_history(checks: History, path: Path | None) -> Iterator[str]:
    """Which other arms the file has where this one has no name, and why nothing was appended."""
    others = ", ".join(repr(name) for name in sorted(checks.checks["instrument"].unique()) if name)
    if others and not checks.instrument:
        yield (
            f"--instrument not given: this check is listed without an instrument; {path} also has "
            f"checks of {others}"
        )
    if not checks.appended:
        same = (
            f"its check of {checks.time} has the same values and counts as this one"
            if checks.charts()
            else ""
        )
        yield f"nothing appended to {path}: {same or 'no test value was found'}"


def _when(time: str | None, path: str) -> datetime:
    """When the arm was checked: as stated, or when the file was written."""
    if time is None:
        return datetime.fromtimestamp(Path(path).stat().st_mtime, UTC).replace(microsecond=0)
    try:
        return in_utc(time)
    except ValueError:
        raise typer.BadParameter(
            f"--time {time!r}; expected a time such as 2026-01-31T09:30"
        ) from None


def _about(lines: list[str]) -> dict[str, str]:
    found = dict(line.split("=", 1) for line in lines if "=" in line)
    if len(found) < len(lines):
        raise typer.BadParameter("--about: expected each NAME=TEXT once")
    return found


def _failed_arm(result: AcceptanceResult, arms: list[str]) -> str | None:
    """The first arm that fails; of no name where only the coordinates of the file were judged; None
    where none fails.
    """
    failed = {figure.source for figure in result.failed}
    return next((arm for arm in arms if arm in failed), "ARM" if failed and not arms else None)


def _next_step(arm: list[str], path: str) -> str:
    """How the cause of a failed check is found from the same touches, or why it is not."""
    try:
        seats = Measurements.read(path).seats()
    except MeasurementFileError:
        return (
            "add readings (theta1_deg …) to the coordinates; aacmm-pin diagnose can then look for "
            "the cause"
        )
    if not seats:
        return (
            "probed points on spheres cannot be used to find the cause; single points, and ends of "
            "lengths that are touched once, can"
        )
    return f"to find the cause, run {shlex.join(['aacmm-pin', 'diagnose', *arm, path])}"


def _refused(path: str, message: str) -> AacmmError:
    return AacmmError(f"{path}: {message}")


def _limits(texts: list[str]) -> dict[str, float]:
    """MPEs by name of the figure [m], each from ``FIGURE=MM`` or a file of them.

    Raises:
        AacmmError: one is no number, or a file cannot be read.
    """
    given: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        refused = partial(_refused, text)
        if not equals and Path(text).suffix != ".toml" and not Path(text).exists():
            raise typer.BadParameter(
                f"--mpe {text}, expected FIGURE=MM, such as E_Uni=0.1, or a TOML file of such"
            )
        of_file = (
            {}
            if equals
            else toml_of(content_of(text, MOST_BYTES, "MPEs, *.toml,", refused), refused)
        )
        for figure, limit in {name: value}.items() if equals else of_file.items():
            if figure in given:
                raise typer.BadParameter(f"--mpe states {figure} twice")
            given[figure] = limit
    limits: dict[str, float] = {}
    for name, limit in given.items():
        try:
            limits[name] = number(str(limit)) * MM
        except ValueError:
            raise AacmmError(
                f"MPE of {name} is {limit!r}, expected a number of millimetres, with a "
                "decimal point"
            ) from None
    return limits
