"""The characteristics of an acceptance test before it is made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin.cli.acceptance_options import Mpe, Standard, arms_of, files_argument, limits_of
from aacmm_pin.cli.arm_options import MeasuringNoise, UrdfArm, in_metres
from aacmm_pin.cli.common import Force, Json, Results, Seed, command, page_option
from aacmm_pin.verification import RUNS, predict_acceptance


@command(
    "aacmm-pin predict-acceptance my_arm.toml procedure.csv --mpe E_Uni=0.1",
    "aacmm-pin predict-acceptance sino6 procedure.csv --encoder-noise 8urad -o prediction.html",
)
def run(
    files: Annotated[
        list[str],
        files_argument(
            "ARM: arm to predict (repeatable). DATA: procedure that plan acceptance wrote (CSV)."
        ),
    ],
    mpe: Mpe = None,
    standard: Standard = None,
    runs: Annotated[int, typer.Option(metavar="N", min=20, help="Number of virtual runs.")] = RUNS,
    seed: Seed = 1,
    *,
    robot: UrdfArm,
    noise: MeasuringNoise,
    output: Annotated[
        Path | None, page_option("a page with the prediction", "--report", "-o")
    ] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Predict the result of an acceptance test by virtual runs."""
    from aacmm_pin.report import (
        prediction_document,
        terminal,  # these load what draws
    )

    *names, procedure = files
    with Results(force, page=output, json_=json_) as results:
        result = predict_acceptance(
            procedure,
            arms_of(names, robot),
            mpe=limits_of(mpe or []),
            standard=standard,
            encoder_noise=noise.encoder_noise,
            probe_noise=in_metres(noise.probe_noise_mm) or 0.0,
            runs=runs,
            rng=np.random.default_rng(seed),
        )
        document = prediction_document(result)
        if output is not None:
            results.document(document, output)
        results.json(result.summary(), json_)
    terminal.show(document, json_ == "-")
