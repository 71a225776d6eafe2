"""Every configuration that reaches a point."""

from __future__ import annotations

from aacmm_pin.cli.arm_options import FrameName, MaybeArm, Urdf, model_of
from aacmm_pin.cli.common import Force, Output, Results, command, note
from aacmm_pin.cli.pose_options import Axis, Count, Point, RollPitchYaw, Tip, ToolAxis, postures_at


@command()
def configurations(
    point: Point,
    arm: MaybeArm = None,
    count: Count = 360,
    tip: Tip = False,
    axis: Axis = None,
    tool_axis: ToolAxis = None,
    rpy_deg: RollPitchYaw = None,
    urdf: Urdf = None,
    frame: FrameName = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Every configuration that reaches a point, as CSV."""
    with Results(force, output) as results:
        machine = model_of(arm, urdf, frame).arm
        circle = postures_at(machine, point, tip or urdf is not None, axis, tool_axis, rpy_deg, count)
        note(str(circle))
        results.text(circle.to_frame().to_csv(index=False), output)
