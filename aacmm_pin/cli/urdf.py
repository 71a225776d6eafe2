"""URDF of an arm."""

from __future__ import annotations

from typing import Annotated

import typer

from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.arm.urdf import urdf_text
from aacmm_pin.cli.arm_options import BUNDLED
from aacmm_pin.cli.common import Force, Output, Results, command

ArmName = Annotated[str, typer.Argument(metavar="ARM", help=f"Bundled arm ({BUNDLED}) or the path of an arm file.")]


@command
def run(arm: ArmName, output: Output = None, force: Force = False) -> None:
    """URDF of an arm, from its DH table."""
    with Results(force, output, reads=[arm]) as results:
        results.text(urdf_text(load_arm_file(arm), with_stylus_offset=True), output)
