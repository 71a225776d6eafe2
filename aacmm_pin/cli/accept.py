"""Whether an arm meets its specification."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.plausible import BAR_LENGTH, MPE
from aacmm_pin._support.units import MM, number
from aacmm_pin.arm import MOST_BYTES, toml_of
from aacmm_pin.cli.arm_options import UrdfArm
from aacmm_pin.cli.common import (
    PlotAndJson,
    Results,
    command,
    length_option,
    note,
    output_option,
    page_option,
)
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements
from aacmm_pin.verification import History, StandardName, accept, in_utc

CONFORMITY, NONCONFORMITY, INCONCLUSIVE = 0, 3, 4
EXIT_STATUS = {"conformity": CONFORMITY, "non-conformity": NONCONFORMITY}
"""Of ``--exit-status``; other verdicts are inconclusive, for a script would take 0 for
conformity.
"""

Standard = Annotated[
    StandardName | None, typer.Option(help="Use this standard only. Default: both standards.")
]


@command(
    "aacmm-pin accept probed.csv --mpe E_Uni=0.1 -o report.html",
    "aacmm-pin accept nominal.toml calibrated.toml probed.csv --mpe limits.toml",
)
def run(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="[ARM]... DATA",
            help="ARM: arm to compute coordinates from readings (repeatable). DATA: file of probed "
            "points (CSV).",
        ),
    ],
    mpe: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CHARACTERISTIC=MM",
            help="Maximum permissible error (MPE) of a characteristic, or a TOML file of MPEs "
            "(repeatable).",
        ),
    ] = None,
    standard: Standard = None,
    measuring_range: Annotated[
        float | None,
        length_option(
            "--measuring-range-mm",
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
    exit_status: Annotated[
        bool,
        typer.Option(
            "--exit-status",
            help=f"Exit with status {NONCONFORMITY} if a characteristic is nonconforming, and with "
            f"{INCONCLUSIVE} if the verdict is inconclusive. Requires --mpe.",
        ),
    ] = False,
    outputs: PlotAndJson,
) -> None:
    """The definitions of the test values come from public descriptions of ISO 10360-12:2016 and
    ASME B89.4.22-2004. Nobody has compared these definitions with the texts of the standards.
    """
    # These load what draws.
    from aacmm_pin.report import (
        CheckDetails,
        Document,
        acceptance_document,
        history_blocks,
        plots,
    )

    *names, path = files
    if outputs.plot is not None and history is None:
        raise typer.BadParameter("--plot requires --history")
    if exit_status and not mpe:
        raise typer.BadParameter("--exit-status requires --mpe")
    with Results(outputs, page=output) as results:
        arms = {name: ErrorModel.load(name) for name in names}
        of_urdf = robot.of_urdf()
        if of_urdf is not None:
            arms[str(robot.urdf)] = of_urdf
        past = None if history is None else History.read(history)
        result = accept(
            path,
            arms,
            mpe=_limits(mpe or []),
            standard=standard,
            measuring_range=measuring_range,
        )
        when, summary = _when(time, path), result.summary()
        checks = None if past is None else past.with_check(result, when, instrument)
        if checks is not None and history is not None:
            summary["history"] = checks.summary()
            if checks.appended:
                checks.write(results, history)
            results.picture(lambda: plots.plot_history(checks))
        if output is not None:
            lines = dict(line.split("=", 1) for line in notes or [] if "=" in line)
            if len(lines) < len(notes or []):
                raise typer.BadParameter("--note: expected NAME=TEXT, and each NAME once")
            details = CheckDetails(when, instrument, lines, checks)
            results.document(acceptance_document(result, details), output)
        results.json(summary)
    results.show(acceptance_document(result))
    if checks is not None:
        results.show(Document("", history_blocks(checks)))
        _note_history(checks, history)
    if result.failed and Path(path).is_file():
        failed = {figure.source for figure in result.failed}
        # Without ARM, the coordinates of the file fail, and diagnose needs an arm.
        arm = next((name for name in arms if name in failed), None if arms else "ARM")
        if arm is not None:
            note(_next_step(robot.urdf_words if arm == robot.urdf else [arm], path))
    if exit_status:
        raise typer.Exit(EXIT_STATUS.get(result.verdict or "", INCONCLUSIVE))


def _limits(texts: list[str]) -> dict[str, float]:
    """MPEs [m] by the name of the characteristic, from the texts of ``--mpe``."""
    limits: dict[str, float] = {}
    for text in texts:
        for name, stated in _stated_limits(text).items():
            if name in limits:
                raise typer.BadParameter(
                    f"--mpe states {name} twice; expected each characteristic once"
                )
            try:
                limit = number(str(stated))
            except ValueError:
                raise AacmmError(
                    f"MPE of {name}: {stated!r}; expected a number in mm with a decimal point"
                ) from None
            MPE.of_unit("mm", MM).check(limit, f"MPE of {name}")
            limits[name] = limit * MM
    return limits


def _stated_limits(text: str) -> dict[str, Any]:
    """MPEs [mm], not yet checked, by name: one as typed, or those of a TOML file."""
    name, equals, value = text.partition("=")
    if equals:
        return {name: value}
    if Path(text).suffix != ".toml" and not Path(text).exists():
        raise typer.BadParameter(
            f"--mpe {text}: expected CHARACTERISTIC=MM, such as E_Uni=0.1, or a TOML file of MPEs"
        )

    def refused(message: str) -> AacmmError:
        return AacmmError(f"{text}: {message}")

    return toml_of(content_of(text, MOST_BYTES, "a TOML file of MPEs", refused), refused)


def _note_history(checks: History, path: Path | None) -> None:
    instruments = ", ".join(
        repr(name) for name in sorted(checks.checks["instrument"].unique()) if name
    )
    if instruments and not checks.instrument:
        note(
            f"the control chart compares only checks without an instrument; to compare with the "
            f"checks of {instruments} in {path}, use --instrument"
        )
    if not checks.appended:
        reason = "the probed points give no test value"
        if checks.charts():
            reason = f"its check of {checks.time} has the same values"
        note(f"accept appended no check to {path}, because {reason}")


def _when(time: str | None, path: str) -> datetime:
    if time is None:
        return datetime.fromtimestamp(Path(path).stat().st_mtime, UTC).replace(microsecond=0)
    try:
        return in_utc(time)
    except ValueError:
        raise typer.BadParameter(
            f"--time {time}: expected a time such as 2026-01-31T09:30"
        ) from None


def _next_step(arm: list[str], path: str) -> str:
    """How to find the cause of a nonconformity; ``arm``: words for the command."""
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
