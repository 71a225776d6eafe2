"""Records that distinguish causes of error."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin.cli.arm_options import UncertainArm
from aacmm_pin.cli.common import arm_file_option, command, note, say
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.cli.plan_records import PlannedRecords, plan_records
from aacmm_pin.measurements import REFERENCE
from aacmm_pin.planning import plan_measurements
from aacmm_pin.report import plan_document


def _two_causes(causes: tuple[str, str] | None) -> tuple[str, str] | None:
    for text in causes or ():
        if text.startswith("-"):
            raise typer.BadParameter(f"{text!r}; expected two causes, not an option")
    return causes


@command(
    "aacmm-pin plan distinguish sino6 --causes encoder_gain:3 encoder_eccentricity:3 -o plan.csv",
    "aacmm-pin plan distinguish my_arm.toml --existing data.csv -o plan.csv",
)
def run(
    arm: UncertainArm,
    causes: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="CAUSE CAUSE",
            callback=_two_causes,
            help="Distinguish these two causes, such as encoder_eccentricity:3 "
            "joint_compliance:3,compliance_rad_per_nm=2e-5. A cause without values has its typical "
            "magnitude. Default: all known causes.",
        ),
    ] = None,
    keep_set_up: Annotated[
        bool,
        typer.Option("--keep-set-up", help="Keep the load and the mount of the arm."),
    ] = False,
    *,
    how: MeasuredHow,
    planned: PlannedRecords,
    arm_out: Annotated[
        Path | None,
        arm_file_option("Write the arm file with the set-up that the plan proposes."),
    ] = None,
) -> None:
    if keep_set_up and causes is None:
        raise typer.BadParameter(
            "--keep-set-up requires --causes; without --causes a plan never changes load or mount"
        )
    choose = partial(plan_measurements, split=causes, as_it_stands=keep_set_up)
    plan = plan_records(arm, planned, how, choose, plan_document, arm_out)
    if not planned.csv_on_stdout:
        fill = "Fill" if plan.needed else "To check this result, fill"
        empty = plan.records.columns[plan.records.isna().all()]
        others = empty[~empty.str.startswith("u_")].difference([*REFERENCE], sort=False)
        say(
            f"{fill} in {', '.join([*REFERENCE, *others])} in {planned.output}. Replace the "
            "planned angles by the readings."
        )
        note(f"the plan chose its records from {planned.postures} postures (seed {planned.seed})")
    if plan.changes_arm and arm_out is None:
        note(
            "the set-up of this plan requires another arm file; write this file with --arm-out, "
            "and use it to diagnose the new records"
        )
