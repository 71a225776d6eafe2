"""Records that distinguish causes of error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin.cli.arm_options import UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import command, note, output_option, say
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.cli.plan_options import PlannedRecords
from aacmm_pin.planning import MeasurementPlan, plan_measurements
from aacmm_pin.report import plan_document


def _two_causes(causes: tuple[str, str] | None) -> tuple[str, str] | None:
    """The causes, of which none is the next option."""
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
    arm_out: Annotated[
        Path | None,
        output_option("FILE.toml", "Write the arm file with the set-up that the plan proposes."),
    ] = None,
    *,
    planned: PlannedRecords,
    how: MeasuredHow,
) -> None:
    """Plan records that distinguish causes of error (CSV to fill in)."""
    if keep_set_up and causes is None:
        raise typer.BadParameter(
            "--keep-set-up requires --causes; without --causes a plan never changes load or mount"
        )
    with planned.results(arm_out) as results:
        model = restrict_to_known_range(arm.model())
        existing = planned.existing_records(model, how)
        plan = plan_measurements(
            model, causes, existing=existing, as_it_stands=keep_set_up, **planned.keywords(how)
        )
        document = plan_document(plan)
        planned.write(results, plan, existing, document)
        if arm_out is not None:
            results.arm(plan.model, arm_out, f"Set-up of a plan: {plan.setup}.")
    planned.show(plan, document)
    if not planned.csv_on_stdout:
        _say_what_to_do(plan, planned)
    if plan.changes_arm and arm_out is None:
        note(
            "the set-up of this plan requires another arm file; write this file with --arm-out, "
            "and use it to diagnose the new records"
        )


def _say_what_to_do(plan: MeasurementPlan, planned: PlannedRecords) -> None:
    """How the file is filled in, and from what it was chosen."""
    fill = "Fill" if plan.needed else "To check this result, fill"
    say(
        f"{fill} in x_mm, y_mm, z_mm in {planned.output}. Replace the planned angles by the "
        "readings."
    )
    note(f"the plan chose its records from {planned.postures} postures (seed {planned.seed})")
