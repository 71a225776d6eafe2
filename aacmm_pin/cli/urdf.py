"""URDF of an arm, DH table of a URDF, files of Universal Robots."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.text_escaping import encodable
from aacmm_pin._support.units import MM
from aacmm_pin.arm import (
    UR_FILES,
    UR_ROBOTS,
    Arm,
    ArmFile,
    UrKinematics,
    arm_text,
    dh_file,
    spread_postures,
    urdf_text,
)
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.calibration import ASSEMBLED, UNCHANGED, is_of_setup, rms
from aacmm_pin.cli.arm_options import AnyArm
from aacmm_pin.cli.common import Output, Replacing, Results, command, note, warn
from aacmm_pin.effects import Effect, ErrorModel, StylusOffset
from aacmm_pin.errors import MissingConditionError, UnsupportedArmError

POSTURES = 300
"""For an RMS displacement with a standard deviation of a few per cent."""


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
        robot = None
        if ur_robot and not (arm.arm or "").lower().endswith(".conf"):
            raise typer.BadParameter("--ur-robot requires calibration.conf as ARM")
        if arm.arm is not None and arm.arm.lower().endswith(UR_FILES):
            robot = UrKinematics.read(arm.arm, ur_robot)
        model = ErrorModel(robot.arm()) if robot else arm.model()
        if to_ur:
            kinematics = robot or UrKinematics.of(model.arm)
            _note_of_causes(model, "kinematics file")
            if undetermined := _undetermined_tool(model.arm):
                warn(
                    f"the calibration did not determine {', '.join(undetermined)}, so that the "
                    "placement of the tool is uncertain; measure targets at known places of the "
                    "flange, or orientations with --target frame"
                )
            if kinematics.tool_moved:
                note(
                    "the kinematics file does not contain the placement of the tool in the last "
                    "link"
                )
            if not kinematics.name.startswith("calib_"):
                note(
                    f"replace the hash {kinematics.name} in the kinematics file by the hash of "
                    "your robot"
                )
            results.text(kinematics.text(), output)
        elif to_dh:
            table = arm_text(dh_file(model.arm))
            _note_of_causes(model, "DH table")
            if np.diag(model.covariance()).any():
                note("the DH table does not contain the uncertainties of the arm")
            results.text(table, output)
        elif robot:
            results.text(robot.urdf(), output)
        else:
            results.file(output or "-").write_bytes(urdf_of(model))


def _undetermined_tool(arm: Arm) -> list[str]:
    """Parameters along and about the last axis that a calibration left as stated."""
    if arm.covariance is None:
        return []
    u = {parameter.name: parameter.u for parameter in arm.parameters}
    stated = {p.name: p.u or ASSEMBLED[p.unit] for p in arm.uncorrected.parameters}
    names = [f"{kind}{arm.nq}" for kind in ("z", "rz")]
    return [
        name
        for name in names
        if name not in arm.covariance.parameters or u[name] > UNCHANGED * stated[name]
    ]


def _note_of_causes(model: ErrorModel, form: str, contained: Sequence[Effect] = ()) -> None:
    """Note causes that a file of this ``form`` lacks, and how far they move the tip, if known."""
    acting = [effect for effect in model.effects if not is_of_setup(effect)]
    left_out = [effect.label for effect in acting if effect not in contained]
    if not left_out:
        return
    arm_itself = model.restricted(tuple(acting))
    q = spread_postures(model.arm, POSTURES, np.zeros((1, model.arm.nq)))
    q = q[arm_itself.known_at(q).all(axis=1)]
    displaces = ""
    with suppress(MissingConditionError, UnsupportedArmError):
        if len(q):
            of_file = arm_itself.restricted(tuple(contained))
            displacement = arm_itself.predict(q) - of_file.predict(q)
            rms_mm = rms(np.linalg.norm(displacement, axis=1)) / MM
            displaces = (
                f", which displace the tip by {rms_mm:.2g} mm (RMS over the ranges of the joints)"
            )
    note(
        f"the {form} does not contain the causes of error {', '.join(left_out)}{displaces}. "
        "For the most accurate geometry alone, export an arm that calibrate estimated "
        "without these causes"
    )


def urdf_of(model: ErrorModel) -> bytes:
    """The URDF, with a note on causes that it cannot state."""
    offsets = [e for e in model.effects if isinstance(e, StylusOffset) and e.marker is None]
    _note_of_causes(model, "URDF", offsets)
    file = model.file()
    if isinstance(file, ArmFile):
        return encodable(urdf_text(file, with_stylus_offset=True)).encode()
    offset = np.sum([effect.values for effect in offsets], axis=0) if offsets else None
    return corrected_urdf(model.arm, offset)
