"""Plan of an acceptance test: the points to probe, as a CSV to fill in and a sheet to print."""

from __future__ import annotations

import shlex
from typing import Annotated

import numpy as np

from aacmm_pin._support.plausible import BAR_LENGTH, DIAMETER, PROBE_DIAMETER
from aacmm_pin._support.units import MM
from aacmm_pin.cli.acceptance_options import Standard
from aacmm_pin.cli.arm_options import UncertainArm, in_metres, restrict_to_known_range
from aacmm_pin.cli.common import (
    Results,
    Seed,
    command,
    length_option,
    say,
)
from aacmm_pin.cli.plan_options import PlanFiles, TableHeight, note_lowest_tip
from aacmm_pin.report import procedure_document, terminal
from aacmm_pin.verification import PROBE_DIAMETER_MM, SPHERE_DIAMETER_MM, acceptance_procedure


@command(
    "aacmm-pin plan acceptance my_arm.toml -o procedure.csv --sheet sheet.html",
    "aacmm-pin plan acceptance --urdf ur5 --length-mm 300 --length-mm 600 -o procedure.csv",
)
def run(
    arm: UncertainArm,
    standard: Standard = None,
    measuring_range_mm: Annotated[
        float | None,
        length_option(
            "Measuring range of the arm. Default: twice the reach from joint 2.", BAR_LENGTH
        ),
    ] = None,
    length_mm: Annotated[
        list[float] | None,
        length_option(
            "Calibrated length (repeatable). ISO 10360-12 needs five lengths, and ASME B89.4.22 "
            "needs two. Default: equally spaced lengths up to 2/3 of the measuring range.",
            BAR_LENGTH,
        ),
    ] = None,
    sphere_mm: Annotated[
        float, length_option("Diameter of the test sphere.", DIAMETER)
    ] = SPHERE_DIAMETER_MM,
    probe_mm: Annotated[
        float, length_option("Diameter of the stylus tip.", PROBE_DIAMETER)
    ] = PROBE_DIAMETER_MM,
    table_height_mm: TableHeight = None,
    seed: Seed = 1,
    *,
    files: PlanFiles,
) -> None:
    """Plan the probed points of an acceptance test (CSV to fill in).

    The definitions of the test values come from public descriptions of ISO 10360-12:2016 and
    ASME B89.4.22-2004.
    """
    lengths = [length * MM for length in length_mm] if length_mm else None
    with Results(files.force, files.output, page=files.sheet) as results:
        procedure = acceptance_procedure(
            restrict_to_known_range(arm.model()),
            standard=standard,
            measuring_range=in_metres(measuring_range_mm),
            lengths=lengths,
            sphere_diameter=sphere_mm * MM,
            probe_diameter=probe_mm * MM,
            above=in_metres(table_height_mm),
            rng=np.random.default_rng(seed),
        )
        results.text(procedure.csv(), files.output)
        if files.sheet is not None:
            results.document(procedure_document(procedure), files.sheet)
    if files.output is not None:
        terminal.show(procedure_document(procedure))
        accept_command = shlex.join(["aacmm-pin", "accept", *arm.urdf_words, str(files.output)])
        note_lowest_tip(procedure.points @ procedure.arm.up, table_height_mm)
        say(
            f"Fill in x_mm, y_mm, z_mm or theta1_deg … in {files.output}. Then run "
            f"{accept_command}."
        )
