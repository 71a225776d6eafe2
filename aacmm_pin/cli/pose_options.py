"""Where the arm shall be, as the commands are told: a point, and for the tip a direction or a whole pose."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.corrected_urdf import from_roll_pitch_yaw
from aacmm_pin.cli.common import note
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures.configurations import configuration_circle
from aacmm_pin.postures.general_ik import reaching_postures
from aacmm_pin.postures.solution_set import PosturesAtPoint

Triple = tuple[float, float, float]

Point = Annotated[Triple, typer.Option("--point", metavar="X Y Z", help="Working point in the base frame, in mm.")]
Count = Annotated[int, typer.Option(min=3, help="Configurations on each closed component.")]
Tip = Annotated[
    bool, typer.Option("--tip", help="The point is for the tip, not for the wrist; give --axis or --rpy-deg too.")
]
Axis = Annotated[
    Triple | None,
    typer.Option("--axis", metavar="X Y Z", help="With --tip or --urdf: direction of the stylus (of the tool) in the base."),
]
ToolAxis = Annotated[
    Triple | None,
    typer.Option(
        "--tool-axis", metavar="X Y Z", help="With --urdf and --axis: which direction of the frame; default its z."
    ),
]
RollPitchYaw = Annotated[
    Triple | None,
    typer.Option(
        "--rpy-deg", metavar="R P Y", help="With --tip or --urdf: the whole pose, roll-pitch-yaw as in URDF, in degrees."
    ),
]


def postures_at(
    arm: Arm, point: Triple, tip: bool, axis: Triple | None, tool: Triple | None, rpy_deg: Triple | None, count: int
) -> PosturesAtPoint:
    """Every posture there; what is to be known besides goes to stderr.

    Raises:
        AacmmError: there is none, or the arm cannot be asked that.
    """
    if tool is not None and (axis is None or arm.dh is not None):
        raise typer.BadParameter("--tool-axis goes with --urdf and --axis; an arm file names its stylus")
    if axis is not None and rpy_deg is not None:
        raise typer.BadParameter("--axis and --rpy-deg: expected one of them; a whole pose holds every axis")
    oriented = axis is not None or rpy_deg is not None
    if (oriented and not tip) or (tip and not oriented and arm.dh is not None):
        raise typer.BadParameter("--tip goes with --axis, or with --rpy-deg")
    found = _asked(arm, np.array(point) * MM, tip, axis, tool, rpy_deg, count)
    if found.reason:
        raise AacmmError(str(found))
    for line in getattr(found, "notes", ()):
        note(f"note: {line}")
    return found


def _asked(
    arm: Arm, where: Array, tip: bool, axis: Triple | None, tool: Triple | None, rpy_deg: Triple | None, count: int
) -> PosturesAtPoint:
    if arm.dh is not None and rpy_deg is None:
        return configuration_circle(arm, where, tip=tip, axis=axis, count=count)
    rotation = None if rpy_deg is None else from_roll_pitch_yaw(np.array(rpy_deg) * DEG)
    return reaching_postures(arm, where, axis=axis, tool=tool, rotation=rotation, count=count)
