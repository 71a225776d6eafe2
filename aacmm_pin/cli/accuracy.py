"""Predict the uncertainty at a point in each posture, or of a length, with its budget."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.accuracy import METHODS, AccuracyVolume, Method, circle_accuracy
from aacmm_pin.cli.arm_options import EncoderNoise, UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    Force,
    Json,
    Plot,
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
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import PosturesAtPoint
from aacmm_pin.report import (
    accuracy_document,
    accuracy_summary,
    accuracy_table,
    length_document,
    length_summary,
    terminal,
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
    json_: Json = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """Predict the uncertainty of a position in each posture, or of a length."""
    with Results(force, output, plot=plot, json_=json_) as results:
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
            if output is not None or plot is not None or method != METHODS[0]:
                raise typer.BadParameter("--to cannot be combined with --csv, --plot or --method")
            _length(
                results, (circle, orientation.postures(model.arm, to)), model, encoder_noise, json_
            )
            return
        result = circle_accuracy(
            circle,
            model,
            method=method,
            encoder_noise=encoder_noise,
            rng=np.random.default_rng(seed),
        )
        summary = accuracy_summary(circle, result, sectors) | (
            {"seed": seed} if method == "monte-carlo" else {}
        )
        if output is not None:
            results.text(csv_text(accuracy_table(circle, result)), output)
        results.picture(lambda: _drawn(circle, result), plot)
        results.json(summary, json_)
    if json_ != "-":
        say(str(circle))
        terminal.show(accuracy_document(result, summary))
        _note_noise(model, encoder_noise)


def _length(
    results: Results,
    ends: tuple[PosturesAtPoint, PosturesAtPoint],
    model: ErrorModel,
    encoder_noise: float | None,
    json_: str | None,
) -> None:
    """The same of the distance between two points."""
    from aacmm_pin.accuracy import length_uncertainty_between

    length = length_uncertainty_between(*ends, model, encoder_noise)
    results.json(length_summary(*ends, length), json_)
    if json_ != "-":
        terminal.show(length_document(length))
        _note_noise(model, encoder_noise)


def _note_noise(model: ErrorModel, encoder_noise: float | None) -> None:
    if encoder_noise is None and model.arm.encoder_noise is None:
        note(
            "u contains only the uncertainties of the parameters; to add the noise of readings, "
            "use --encoder-noise"
        )


def _drawn(circle: PosturesAtPoint, result: AccuracyVolume) -> Any:
    from aacmm_pin.report import plots

    return plots.plot_accuracy_of_postures(circle, result).figure
