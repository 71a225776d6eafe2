"""What was read of an arm and its measurements, and what they lack."""

from __future__ import annotations

from aacmm_pin.cli.arm_options import ArmAndData
from aacmm_pin.cli.common import JsonFile, Results, command
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.diagnosis import check_measurements
from aacmm_pin.report import check_document, check_summary


@command(
    "aacmm-pin check my_arm.toml data.csv",
    "aacmm-pin check ur5 poses.csv --reference-frame external --target unknown",
)
def run(
    arm: ArmAndData,
    how: MeasuredHow,
    files: JsonFile,
) -> None:
    with Results(files) as results:
        model, path = arm.model_and_data()
        result = check_measurements(model, arm.records(model, path), **how.keywords())
        results.json(check_summary(result))
    results.show(check_document(result))
