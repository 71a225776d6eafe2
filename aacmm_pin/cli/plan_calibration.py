"""Records that determine the geometry of an arm."""

from __future__ import annotations

from aacmm_pin.cli.arm_options import UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import command
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.cli.plan_options import PlannedRecords
from aacmm_pin.planning import plan_calibration
from aacmm_pin.report import calibration_plan_document


@command(
    "aacmm-pin plan calibration my_arm.toml --records 60 -o plan.csv --sheet plan.html",
    "aacmm-pin plan calibration my_arm.toml --existing data.csv -o more.csv",
)
def run(arm: UncertainArm, planned: PlannedRecords, how: MeasuredHow) -> None:
    """Plan records that determine the geometry of the arm (CSV to fill in)."""
    with planned.results() as results:
        model = restrict_to_known_range(arm.model())
        existing = planned.existing_records(model, how)
        plan = plan_calibration(model, existing=existing, **planned.keywords(how))
        document = calibration_plan_document(plan)
        planned.write(results, plan, existing, document)
    planned.show(plan, document)
