"""Parameters of an arm from measurements."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.calibration import calibrate
from aacmm_pin.cli.arm_options import ArmAndData
from aacmm_pin.cli.common import (
    EffectTexts,
    PlotAndJson,
    Results,
    Seed,
    arm_file_option,
    command,
    note,
    output_option,
    page_option,
)
from aacmm_pin.cli.measuring_options import MeasuredHow, NoCrossValidation
from aacmm_pin.cli.urdf import urdf_of
from aacmm_pin.effects import cause_of


@command(
    "aacmm-pin calibrate my_arm.toml data.csv --encoder-noise 8e-6 -o calibrated.toml",
    "aacmm-pin calibrate --urdf robot.urdf --frame tool0 data.csv --reference-frame external",
)
def run(
    arm: ArmAndData,
    how: MeasuredHow,
    parameters: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Parameters to estimate: geometry, zero-offsets, tool (place of the target on the "
            "last body), names such as d3 or patterns such as theta_offset*, with commas between. "
            "Other parameters keep their values.",
        ),
    ] = "geometry",
    effect: EffectTexts = None,
    no_cross_validation: NoCrossValidation = False,
    seed: Seed = 1,
    output: Annotated[
        Path | None,
        arm_file_option("Write the arm file of the calibrated arm.", "--arm-out", "-o"),
    ] = None,
    urdf_out: Annotated[
        Path | None,
        output_option("FILE.urdf", "Write the URDF of the calibrated arm."),
    ] = None,
    residuals: Annotated[
        Path | None,
        output_option("FILE.csv", "Write all records with their residuals (CSV)."),
    ] = None,
    report: Annotated[Path | None, page_option("a page with all results")] = None,
    *,
    files: PlotAndJson,
) -> None:
    """The command also reports the uncertainties of the parameters, and which parameters the data
    do not determine.
    """
    # These load what draws.
    from aacmm_pin.report import calibration_document, calibration_summary, comment

    with Results(files, output, urdf_out, residuals, page=report) as results:
        model, path = arm.model_and_data()
        if output is not None:
            model.file()  # or refused before the work
        effects = [cause_of(text, model) for text in effect or []]
        stated = how.keywords() | {"hold_out": not no_cross_validation}
        records, rng = arm.records(model, path), np.random.default_rng(seed)
        result = calibrate(model, records, [*parameters.split(","), *effects], rng=rng, **stated)
        when, summary = f"{datetime.now(UTC):%Y-%m-%d}", calibration_summary(result, path, seed)
        if output is not None:
            results.arm(result.model, output, comment(result, path, when))
        if urdf_out is not None:
            results.file(urdf_out).write_bytes(urdf_of(result.model))
        if residuals is not None:
            results.text(csv_text(result.residuals), residuals)
        results.picture(result.plot)
        results.document(calibration_document(result, summary, when), report)
        results.json(summary)
        shown = calibration_document(result)
    results.show(shown)
    estimated = {effect.label for effect in result.fit.effects}
    unchanged = [effect.label for effect in model.effects if effect.label not in estimated]
    if unchanged:
        note(
            f"calibrate did not change the causes of error of {model.arm.name} "
            f"({', '.join(unchanged)}); to estimate them again, run aacmm-pin diagnose"
        )
