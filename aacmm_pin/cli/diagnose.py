"""What the model gets wrong, and why."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin.cli.arm_options import ArmAndData
from aacmm_pin.cli.common import (
    JsonFile,
    Results,
    Seed,
    arm_file_option,
    command,
    page_option,
    warn,
)
from aacmm_pin.cli.measuring_options import MeasuredHow, NoCrossValidation
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import listed
from aacmm_pin.errors import AacmmError


@command(
    "aacmm-pin diagnose my_arm.toml data.csv --encoder-noise 8e-6 -o report.html",
    "aacmm-pin diagnose my_arm.toml data.csv --arm-out extended.toml --with-discrepancy",
)
def run(
    arm: ArmAndData,
    how: MeasuredHow,
    no_cross_validation: NoCrossValidation = False,
    with_discrepancy: Annotated[
        bool,
        typer.Option(
            "--with-discrepancy",
            help="Also save the discrepancy (structure that no cause explains) and its uncertainty "
            "in the arm file of --arm-out.",
        ),
    ] = False,
    seed: Seed = 1,
    output: Annotated[Path | None, page_option("a page with all results", "--report", "-o")] = None,
    arm_out: Annotated[
        Path | None, arm_file_option("Write the arm file of the extended arm.")
    ] = None,
    *,
    files: JsonFile,
) -> None:
    from aacmm_pin.report import diagnosis_document  # loads what draws

    with Results(files, arm_out, page=output) as results:
        if with_discrepancy and arm_out is None:
            raise AacmmError("--with-discrepancy requires --arm-out")
        model, path = arm.model_and_data()
        if arm_out is not None:
            model.file()  # or refused before the work
        records, rng = arm.records(model, path), np.random.default_rng(seed)
        result = diagnose(
            model,
            records,
            hold_out=not no_cross_validation,
            with_discrepancy=with_discrepancy,
            rng=rng,
            **how.keywords(),
        )
        if arm_out is not None:
            if result.no_better:
                warn(
                    f"{arm_out} has the recalibrated arm, because the extended arm does not "
                    "predict held-out records better"
                )
            if result.findings and result.extended.too_many_excluded:
                out = int(result.extended.excluded.sum())
                warn(
                    f"{arm_out}: diagnose excluded {out} records, which are too many for gross "
                    "errors. At new postures the extended arm may be worse than the arm of "
                    "aacmm-pin calibrate"
                )
            if with_discrepancy and result.not_saved:
                warn(
                    f"{arm_out} does not have the discrepancy that depends on "
                    f"{listed(result.not_saved)}, because new readings do not state these values"
                )
            results.arm(
                result.model, arm_out, f"Extended by aacmm-pin diagnose from {path}: {result}"
            )
        summary = result.summary() | {"source": path, "seed": seed}
        document = diagnosis_document(result, summary, f"{datetime.now(UTC):%Y-%m-%d}")
        results.document(document, output)
        results.json(summary)
    results.show(document)
