"""Whether an arm meets its specification."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin._support.plausible import BAR_LENGTH
from aacmm_pin.cli.acceptance_options import Mpe, Standard, arms_of, files_argument, limits_of
from aacmm_pin.cli.arm_options import UrdfArm, in_metres
from aacmm_pin.cli.common import (
    Force,
    Json,
    Plot,
    Results,
    command,
    length_option,
    note,
    output_option,
    page_option,
)
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements import Measurements
from aacmm_pin.verification import AcceptanceResult, History, accept, in_utc

CONFORMITY, NONCONFORMITY, INCONCLUSIVE = 0, 3, 4
EXIT_STATUS = {"conformity": CONFORMITY, "non-conformity": NONCONFORMITY}
"""Of ``--exit-status``, by verdict; others are inconclusive, for a script would take 0 for
conformity."""


@command(
    "aacmm-pin accept probed.csv --mpe E_Uni=0.1 -o report.html",
    "aacmm-pin accept nominal.toml calibrated.toml probed.csv --mpe limits.toml",
)
def run(
    files: Annotated[
        list[str],
        files_argument(
            "ARM: arm to compute coordinates from readings (repeatable). DATA: file of probed "
            "points (CSV)."
        ),
    ],
    mpe: Mpe = None,
    standard: Standard = None,
    measuring_range_mm: Annotated[
        float | None,
        length_option(
            "Measuring range of the arm. The report has length errors only if the longest length "
            "is at least 66 % of this range.",
            BAR_LENGTH,
        ),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="ISO8601",
            help="Time of the check, in UTC unless you state an offset. Default: time of the last "
            "change of DATA.",
        ),
    ] = None,
    instrument: Annotated[
        str, typer.Option(metavar="NAME", help="Name or serial number of the checked arm.")
    ] = "",
    notes: Annotated[
        list[str] | None,
        typer.Option(
            "--note", metavar="NAME=TEXT", help="Add this line to the test report (repeatable)."
        ),
    ] = None,
    *,
    robot: UrdfArm,
    output: Annotated[Path | None, page_option("the test report", "--report", "-o")] = None,
    history: Annotated[
        Path | None,
        output_option("FILE.csv", "Append the results of this check to this CSV file."),
    ] = None,
    plot: Plot = None,
    exit_status: Annotated[
        bool,
        typer.Option(
            "--exit-status",
            help=f"Exit with status {NONCONFORMITY} if a characteristic is nonconforming, and with "
            f"{INCONCLUSIVE} if the verdict is inconclusive. Requires --mpe.",
        ),
    ] = False,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Evaluate an acceptance test (ISO 10360-12, ASME B89.4.22).

    The definitions of the test values come from public descriptions of ISO 10360-12:2016 and
    ASME B89.4.22-2004. Nobody has compared these definitions with the texts of the standards.
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
    if plot is not None and history is None:
        raise typer.BadParameter("--plot requires --history")
    if exit_status and not mpe:
        raise typer.BadParameter("--exit-status requires --mpe")
    with Results(force, page=output, plot=plot, json_=json_) as results:
        arms = arms_of(names, robot)
        past = None if history is None else History.read(history)
        result = accept(
            path,
            arms,
            mpe=limits_of(mpe or []),
            standard=standard,
            measuring_range=in_metres(measuring_range_mm),
        )
        when, summary, told = _when(time, path), result.summary(), acceptance_document(result)
        checks = None if past is None else past.with_check(result, when, instrument)
        if checks is not None and history is not None:
            summary["history"] = checks.summary()
            if checks.appended:
                checks.write(results, history)
            results.picture(lambda: plots.plot_history(checks), plot)
        if output is not None:
            details = CheckDetails(when, instrument, _further_lines(notes or []), checks)
            results.document(acceptance_document(result, details), output)
        results.json(summary, json_)
    terminal.show(told, json_ == "-")
    terminal.show(Document("", [] if checks is None else history_blocks(checks)), json_ == "-")
    for text in [] if checks is None else _of_history(checks, history):
        note(text)
    if (failed := _failed_arm(result, list(arms))) is not None and Path(path).is_file():
        note(_next_step(robot.urdf_words if failed == robot.urdf else [failed], path))
    if exit_status:
        raise typer.Exit(EXIT_STATUS.get(result.verdict or "", INCONCLUSIVE))


def _of_history(checks: History, path: Path | None) -> Iterator[str]:
    """Which other arms the file has if this one has no name, and why nothing was appended."""
    others = ", ".join(repr(name) for name in sorted(checks.checks["instrument"].unique()) if name)
    if others and not checks.instrument:
        yield (
            f"the control chart compares only checks without an instrument; to compare with the "
            f"checks of {others} in {path}, use --instrument"
        )
    if not checks.appended:
        same = f"its check of {checks.time} has the same values" if checks.charts() else ""
        why = same or "the probed points give no test value"
        yield f"accept appended no check to {path}, because {why}"


def _when(time: str | None, path: str) -> datetime:
    """When the arm was checked: as stated, or when the file was written."""
    if time is None:
        return datetime.fromtimestamp(Path(path).stat().st_mtime, UTC).replace(microsecond=0)
    try:
        return in_utc(time)
    except ValueError:
        raise typer.BadParameter(
            f"--time {time}: expected a time such as 2026-01-31T09:30"
        ) from None


def _further_lines(lines: list[str]) -> dict[str, str]:
    found = dict(line.split("=", 1) for line in lines if "=" in line)
    if len(found) < len(lines):
        raise typer.BadParameter("--note: expected NAME=TEXT, and each NAME once")
    return found


def _failed_arm(result: AcceptanceResult, arms: list[str]) -> str | None:
    """The first arm that does not conform; ``ARM`` if only the coordinates of the file were
    evaluated; None if all conform.
    """
    failed = {figure.source for figure in result.failed}
    return next((arm for arm in arms if arm in failed), "ARM" if failed and not arms else None)


def _next_step(arm: list[str], path: str) -> str:
    """How to find the cause of a nonconformity from the same points, or why it cannot be found."""
    try:
        seats = Measurements.read(path).seats()
    except MeasurementFileError:
        return (
            "if you add readings (theta1_deg …) to the coordinates, aacmm-pin diagnose can look "
            "for the cause"
        )
    if not seats:
        return (
            "aacmm-pin diagnose cannot use these points; to find the cause, state "
            "feature_diameter_mm and probe_diameter_mm of the spheres, or add single points or "
            "lengths"
        )
    return f"to find the cause, run {shlex.join(['aacmm-pin', 'diagnose', *arm, path])}"
