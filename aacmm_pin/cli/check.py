"""What was read of an arm and its measurements, and what they lack."""

from __future__ import annotations

from aacmm_pin.cli.arm_options import ArmAndData
from aacmm_pin.cli.common import Force, Json, Results, command
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.diagnosis import check_measurements
from aacmm_pin.report import check_document, check_summary, terminal


@command(
    "aacmm-pin check my_arm.toml data.csv",
    "aacmm-pin check ur5 poses.csv --reference-frame external --target unknown",
)
def run(
    arm: ArmAndData,
    how: MeasuredHow,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Check that a measurement file fits an arm, and list the columns that the file lacks."""
    with Results(force, json_=json_) as results:
        model, path = arm.model_and_data()
        found = check_measurements(model, arm.records(model, path), **how.keywords())
        results.json(check_summary(found), json_)
    terminal.show(check_document(found), json_ == "-")
