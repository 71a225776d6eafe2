"""URDF of an arm; the DH table of a URDF; files of Universal Robots."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.text_escaping import encodable
from aacmm_pin.arm import (
    UR_FILES,
    UR_ROBOTS,
    ArmFile,
    UrKinematics,
    arm_text,
    dh_file,
    urdf_text,
)
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.cli.arm_options import AnyArm
from aacmm_pin.cli.command import command
from aacmm_pin.cli.common import Output, Replacing, Results, note
from aacmm_pin.effects import ErrorModel, StylusOffset


@command(
    "aacmm-pin urdf sino6 -o sino6.urdf",
    "aacmm-pin urdf --to-dh ur5 -o ur5.toml",
    "aacmm-pin urdf my_robot_calibration.yaml -o my_robot.urdf",
)
def run(
    arm: AnyArm,
    to_dh: Annotated[
        bool,
        typer.Option(
            "--to-dh",
            help="Write an arm file with the DH table of a URDF, or of the URDF that an arm file "
            "names.",
        ),
    ] = False,
    to_ur: Annotated[
        bool,
        typer.Option(
            "--to-ur",
            help="Write the kinematics file of the ROS description of Universal Robots.",
        ),
    ] = False,
    ur_robot: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="With calibration.conf of a controller of Universal Robots as ARM: the robot "
            f"({', '.join(UR_ROBOTS)}).",
        ),
    ] = "",
    output: Output = None,
    *,
    files: Replacing,
) -> None:
    with Results(files, output) as results:
        if to_dh and to_ur:
            raise typer.BadParameter("--to-dh cannot be combined with --to-ur")
        if arm.arm is not None and arm.arm.lower().endswith(UR_FILES):
            robot = UrKinematics.read(arm.arm, ur_robot)
            results.text(_kinematics_of(robot) if to_ur else robot.urdf(), output)
            return
        model = arm.model()
        if to_ur:
            if model.effects:
                names = ", ".join(effect.label for effect in model.effects)
                note(f"the kinematics file does not contain the causes of error {names}")
            results.text(_kinematics_of(UrKinematics.of(model.arm)), output)
        elif to_dh:
            table = arm_text(dh_file(model.arm))
            if model.effects:
                names = ", ".join(effect.label for effect in model.effects)
                note(f"the DH table does not contain the causes of error {names}")
            if np.diag(model.covariance()).any():
                note("the DH table does not contain the uncertainties of the arm")
            results.text(table, output)
        else:
            results.file(output or "-").write_bytes(urdf_of(model))


def _kinematics_of(robot: UrKinematics) -> str:
    if robot.tool_moved:
        note("the kinematics file does not contain the placement of the tool in the last link")
    if not robot.name.startswith("calib_"):
        note(f"replace the hash {robot.name} in the kinematics file by the hash of your robot")
    return robot.text()


def urdf_of(model: ErrorModel) -> bytes:
    """The URDF of an arm, with a note on causes that a URDF cannot state."""
    offsets = [e for e in model.effects if isinstance(e, StylusOffset) and e.marker is None]
    lost = [effect.label for effect in model.effects if effect not in offsets]
    if lost:
        note(f"the URDF does not contain the causes {', '.join(lost)}, which no URDF can state")
    file = model.file()
    if isinstance(file, ArmFile):
        return encodable(urdf_text(file, with_stylus_offset=True)).encode()
    offset = np.sum([effect.values for effect in offsets], axis=0) if offsets else None
    return corrected_urdf(model.arm, offset)
