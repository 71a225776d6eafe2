"""Predict the uncertainty at a point in each posture, or of a length."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.accuracy import (
    METHODS,
    Method,
    circle_accuracy,
    length_uncertainty,
    usable_postures,
)
from aacmm_pin.cli.arm_options import EncoderNoise, UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    PlotAndJson,
    Results,
    Sectors,
    Seed,
    command,
    length_option,
    note,
    output_option,
    say,
)
from aacmm_pin.cli.pose_options import Orientation, Point, Triple, note_wrist
from aacmm_pin.errors import AacmmError
from aacmm_pin.report import (
    accuracy_document,
    accuracy_summary,
    accuracy_table,
    length_document,
    length_summary,
)


@command(
    "aacmm-pin accuracy sino6 --point 400 0 300 --encoder-noise 8e-6",
    "aacmm-pin accuracy sino6 --point 400 0 300 --to 400 300 300",
)
def run(
    point: Point,
    arm: UncertainArm,
    orientation: Orientation,
    noise: EncoderNoise,
    to: Annotated[
        Triple | None,
        length_option(
            "--to",
            "Predict the uncertainty of the length from --point to this point, in mm.",
            COORDINATE,
            metavar="X Y Z",
        ),
    ] = None,
    method: Annotated[
        Method, typer.Option(help="Method for the volume of possible positions.")
    ] = "zonotope",
    sectors: Sectors = 12,
    seed: Seed = 1,
    output: Annotated[
        Path | None,
        output_option(
            "FILE.csv", "Write the sampled postures and their accuracy (CSV).", "--csv", "-o"
        ),
    ] = None,
    *,
    files: PlotAndJson,
) -> None:
    from aacmm_pin.report import plots  # loads matplotlib at the first picture

    with Results(files, output) as results:
        model, encoder_noise = restrict_to_known_range(arm.model()), noise.encoder_noise
        if (
            model.arm.dh is None
            and encoder_noise is None
            and not any(p.u for p in model.parameters)
        ):
            raise AacmmError(
                "a URDF states no uncertainties; state --translation-half-width-mm and "
                "--rotation-half-width, or --encoder-noise with --method ellipsoid"
            )
        circle = orientation.postures(model.arm, point)
        note_wrist(circle)
        if to is not None:
            if output is not None or files.plot is not None or method != METHODS[0]:
                raise typer.BadParameter("--to cannot be combined with --csv, --plot or --method")
            ends = circle, orientation.postures(model.arm, to)
            length = length_uncertainty(
                model, *map(usable_postures, ends), at=circle.at, encoder_noise=encoder_noise
            )
            summary, document = length_summary(*ends, length), length_document(length)
        else:
            rng = np.random.default_rng(seed)
            result = circle_accuracy(
                circle, model, method=method, encoder_noise=encoder_noise, rng=rng
            )
            summary = accuracy_summary(circle, result, sectors)
            if method == "monte-carlo":
                summary["seed"] = seed
            document = accuracy_document(result, summary)
            if output is not None:
                results.text(csv_text(accuracy_table(circle, result)), output)
            results.picture(lambda: plots.plot_accuracy_of_postures(circle, result).figure)
        results.json(summary)
    if results.json_on_stdout:
        return
    if to is None:
        say(str(circle))
    results.show(document)
    if encoder_noise is None and model.arm.encoder_noise is None:
        note(
            "u contains only the uncertainties of the parameters; to add the noise of readings, "
            "use --encoder-noise"
        )
