"""Every configuration that reaches a point."""

from __future__ import annotations

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.cli.arm_options import AnyArm
from aacmm_pin.cli.common import CsvOutput, Replacing, Results, command, status
from aacmm_pin.cli.pose_options import Orientation, Point, note_wrist


@command(
    "aacmm-pin configurations sino6 --point 400 0 300 -o postures.csv",
    "aacmm-pin configurations sino6 --point 400 0 300 --axis 0 0 -1",
)
def run(
    point: Point,
    arm: AnyArm,
    orientation: Orientation,
    output: CsvOutput = None,
    *,
    files: Replacing,
) -> None:
    with Results(files, output) as results:
        circle = orientation.postures(arm.model().arm, point)
        note_wrist(circle)
        status(circle)
        results.text(csv_text(circle.columns()), output)
