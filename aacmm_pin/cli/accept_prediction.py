"""What ``accept --predict`` does: the figures of an acceptance test before it is made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin.cli.arm_options import EncoderNoise, in_metres
from aacmm_pin.cli.common import Results, angle_option
from aacmm_pin.effects import ErrorModel
from aacmm_pin.verification import RUNS, predict_acceptance


@dataclass(frozen=True)
class BeforeTheTest(EncoderNoise):
    """Options of a prediction."""

    encoder_noise_rad: Annotated[
        float | None,
        angle_option(
            "With --predict: standard uncertainty of one reading of each joint, in rad or as "
            "8urad, 1.65arcsec."
        ),
    ] = None
    probe_noise_mm: Annotated[
        float | None,
        typer.Option(
            help="With --predict: standard uncertainty of a coordinate of one contact, in mm."
        ),
    ] = None
    predict: Annotated[
        bool,
        typer.Option(
            "--predict",
            help="DATA is a procedure by plan --for acceptance: predict its figures by "
            "virtual runs.",
        ),
    ] = False
    runs: Annotated[int, typer.Option(min=20, help="With --predict: number of virtual runs.")] = (
        RUNS
    )
    seed: Annotated[
        int, typer.Option(min=0, help="With --predict: seed of the random generator.")
    ] = 1

    def show(
        self,
        arms: dict[str, ErrorModel],
        path: str,
        limits: dict[str, float],
        standard: str | None,
        results: Results,
        output: Path | None,
        json_: str | None,
    ) -> None:
        """Predict, write what was asked for, and show it."""
        from aacmm_pin.report import (
            prediction_document,
            terminal,  # these load what draws
        )

        result = predict_acceptance(
            path,
            arms,
            mpe=limits,
            standard=standard,
            encoder_noise=self.encoder_noise_rad,
            probe_noise=in_metres(self.probe_noise_mm) or 0.0,
            runs=self.runs,
            rng=np.random.default_rng(self.seed),
        )
        document = prediction_document(result)
        if output is not None:
            results.document(document, output)
        results.json(result.summary(), json_)
        terminal.show(document, json_ == "-")
