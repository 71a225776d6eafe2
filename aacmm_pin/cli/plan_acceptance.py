"""Plan of an acceptance test: points to probe, as a CSV to fill in and a sheet."""

from __future__ import annotations

import shlex
from typing import Annotated

import numpy as np

from aacmm_pin._support.plausible import BAR_LENGTH, DIAMETER, PROBE_DIAMETER
from aacmm_pin.cli.accept import Standard
from aacmm_pin.cli.arm_options import UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import CsvOutput, Replacing, Results, Seed, command, length_option, say
from aacmm_pin.cli.plan_records import Sheet, TableHeight, note_lowest_tip
from aacmm_pin.report import procedure_document
from aacmm_pin.verification import PROBE_DIAMETER_MM, SPHERE_DIAMETER_MM, acceptance_procedure


@command(
    "aacmm-pin plan acceptance my_arm.toml -o procedure.csv --sheet sheet.html",
    "aacmm-pin plan acceptance --urdf ur5 --length-mm 300 --length-mm 600 -o procedure.csv",
)
def run(
    arm: UncertainArm,
    standard: Standard = None,
    measuring_range: Annotated[
        float | None,
        length_option(
            "--measuring-range-mm",
            "Measuring range of the arm. Default: twice the reach from joint 2.",
            BAR_LENGTH,
        ),
    ] = None,
    lengths: Annotated[
        list[float] | None,
        length_option(
            "--length-mm",
            "Calibrated length (repeatable). ISO 10360-12 needs five lengths, and ASME B89.4.22 "
            "needs two. Default: equally spaced lengths up to 2/3 of the measuring range.",
            BAR_LENGTH,
        ),
    ] = None,
    sphere_diameter: Annotated[
        float, length_option("--sphere-mm", "Diameter of the test sphere.", DIAMETER)
    ] = SPHERE_DIAMETER_MM,
    probe_diameter: Annotated[
        float, length_option("--probe-mm", "Diameter of the stylus tip.", PROBE_DIAMETER)
    ] = PROBE_DIAMETER_MM,
    above: TableHeight = None,
    seed: Seed = 1,
    *,
    output: CsvOutput = None,
    sheet: Sheet = None,
    files: Replacing,
) -> None:
    """The definitions of the test values come from public descriptions of ISO 10360-12:2016 and
    ASME B89.4.22-2004.
    """
    with Results(files, output, page=sheet) as results:
        procedure = acceptance_procedure(
            restrict_to_known_range(arm.model()),
            standard=standard,
            measuring_range=measuring_range,
            lengths=lengths or None,
            sphere_diameter=sphere_diameter,
            probe_diameter=probe_diameter,
            above=above,
            rng=np.random.default_rng(seed),
        )
        results.text(procedure.csv(), output)
        document = procedure_document(procedure)
        results.document(document, sheet)
    if output is not None:
        results.show(document)
        accept_command = shlex.join(["aacmm-pin", "accept", *arm.urdf_words, str(output)])
        note_lowest_tip(procedure.points @ procedure.arm.up, above)
        say(f"Fill in x_mm, y_mm, z_mm or theta1_deg … in {output}. Then run {accept_command}.")
