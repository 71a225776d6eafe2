"""URDF of an arm."""

from __future__ import annotations

from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.arm.urdf_writer import urdf_text
from aacmm_pin.cli.common import ArmName, Force, Output, Results, command


@command()
def urdf(arm: ArmName, output: Output = None, force: Force = False) -> None:
    """URDF of an arm, from its DH table."""
    with Results(force, output) as results:
        results.text(urdf_text(load_arm_file(arm), with_stylus_offset=True), output)
