"""URDF of an arm, or the DH table of a URDF."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.text_escaping import encodable
from aacmm_pin.arm import ArmFile, arm_text, dh_file, urdf_text
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.cli.arm_options import AnyArm
from aacmm_pin.cli.command import command
from aacmm_pin.cli.common import Output, Replacing, Results, note
from aacmm_pin.effects import ErrorModel, StylusOffset


@command(
    "aacmm-pin urdf sino6 -o sino6.urdf",
    "aacmm-pin urdf --to-dh ur5 -o ur5.toml",
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
    output: Output = None,
    *,
    files: Replacing,
) -> None:
    with Results(files, output) as results:
        model = arm.model()
        if to_dh:
            table = arm_text(dh_file(model.arm))
            if model.effects:
                names = ", ".join(effect.label for effect in model.effects)
                note(f"the DH table does not contain the causes of error {names}")
            if np.diag(model.covariance()).any():
                note("the DH table does not contain the uncertainties of the arm")
            results.text(table, output)
        else:
            results.file(output or "-").write_bytes(urdf_of(model))


def urdf_of(model: ErrorModel) -> bytes:
    """An arm as URDF, as far as a URDF can say it."""
    offsets = [e for e in model.effects if isinstance(e, StylusOffset) and e.marker is None]
    lost = [effect.label for effect in model.effects if effect not in offsets]
    if lost:
        note(f"the URDF does not contain the causes {', '.join(lost)}, which no URDF can state")
    file = model.file()
    if isinstance(file, ArmFile):
        return encodable(urdf_text(file, with_stylus_offset=True)).encode()
    offset = np.sum([effect.values for effect in offsets], axis=0) if offsets else None
    return corrected_urdf(model.arm, offset)
