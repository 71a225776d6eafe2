"""What ``plan --for acceptance`` does: the touches of an acceptance test, as a file to be filled in
and a sheet.
"""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.cli.arm_options import UncertainArm, in_metres, restrict_to_known_range
from aacmm_pin.cli.common import Results, note, say
from aacmm_pin.report import procedure_document, terminal
from aacmm_pin.verification import PROBE, SPHERE, acceptance_procedure

FOR = "With --for acceptance: "


@dataclass(frozen=True)
class Artefacts:
    """What is there to be touched."""

    standard: Annotated[
        str | None, typer.Option(help=f"{FOR}only iso10360-12, or asme-b89.4.22.")
    ] = None
    measuring_range_mm: Annotated[
        float | None,
        typer.Option(help=f"{FOR}measuring range, in mm; else twice the reach from joint 2."),
    ] = None
    length_mm: Annotated[
        list[float] | None,
        typer.Option(
            help=f"{FOR}a calibrated length, in mm; five times, for asme-b89.4.22 twice. Else "
            "parts of 2/3 of the range."
        ),
    ] = None
    sphere_mm: Annotated[
        float | None, typer.Option(help=f"{FOR}diameter of the sphere, in mm. Default {SPHERE:g}.")
    ] = None
    probe_mm: Annotated[
        float | None, typer.Option(help=f"{FOR}diameter of the probe, in mm. Default {PROBE:g}.")
    ] = None

    def plan(
        self,
        arm: UncertainArm,
        table_height_mm: float | None,
        seed: int,
        output: Path | None,
        sheet: Path | None,
        force: bool,
    ) -> None:
        """Plan the touches, and write the file and the sheet."""
        with Results(force, output, page=sheet) as results:
            procedure = acceptance_procedure(
                restrict_to_known_range(arm.model()),
                standard=self.standard,
                measuring_range=in_metres(self.measuring_range_mm),
                lengths=None
                if self.length_mm is None
                else [length * MM for length in self.length_mm],
                sphere_diameter=(SPHERE if self.sphere_mm is None else self.sphere_mm) * MM,
                probe_diameter=(PROBE if self.probe_mm is None else self.probe_mm) * MM,
                above=in_metres(table_height_mm),
                rng=np.random.default_rng(seed),
            )
            results.text(procedure.csv(), output)
            if sheet is not None:
                results.document(procedure_document(procedure), sheet)
        if output is not None:
            terminal.show(procedure_document(procedure))
            then = shlex.join(["aacmm-pin", "accept", *arm.urdf_words, str(output)])
            note_lowest_tip(procedure.points @ procedure.arm.up, table_height_mm)
            say(f"{output}: fill in x_mm, y_mm, z_mm, or theta1_deg …; then: {then}")


def note_lowest_tip(heights: Array, table_height_mm: float | None) -> None:
    """How far below the base the lowest tip is [m], where no table was stated."""
    if table_height_mm is None and heights.min() < 0:
        note(
            f"note: the lowest tip is {-heights.min() / MM:.0f} mm below the base; "
            "--table-height-mm sets the height of a table"
        )
