"""Records that determine the geometry of an arm."""

from __future__ import annotations

from aacmm_pin.cli.arm_options import UncertainArm
from aacmm_pin.cli.common import command
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.cli.plan_records import PlannedRecords, plan_records
from aacmm_pin.planning import plan_calibration
from aacmm_pin.report import calibration_plan_document


@command(
    "aacmm-pin plan calibration my_arm.toml --records 60 -o plan.csv --sheet plan.html",
    "aacmm-pin plan calibration my_arm.toml --existing data.csv -o more.csv",
)
def run(arm: UncertainArm, how: MeasuredHow, planned: PlannedRecords) -> None:
    plan_records(arm, planned, how, plan_calibration, calibration_plan_document)
