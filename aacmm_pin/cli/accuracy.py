"""How accurate the arm is at a point, in which posture, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import pandas as pd
import typer

from aacmm_pin.accuracy.volume import METHODS, AccuracyVolume, Method, circle_accuracy
from aacmm_pin.cli.arm_options import FrameName, MaybeArm, RotationHalfWidth, TranslationHalfWidth, Urdf, model_of
from aacmm_pin.cli.common import EncoderNoise, Force, Json, Plot, Results, Sectors, command, note, say
from aacmm_pin.cli.pose_options import Axis, Count, Point, RollPitchYaw, Tip, ToolAxis, postures_at
from aacmm_pin.cli.tables import show
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures.general_ik import ReachingPostures
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.summaries import accuracy_summary, accuracy_table


@command()
def accuracy(
    point: Point,
    arm: MaybeArm = None,
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "zonotope",
    count: Count = 360,
    sectors: Sectors = 12,
    tip: Tip = False,
    axis: Axis = None,
    tool_axis: ToolAxis = None,
    rpy_deg: RollPitchYaw = None,
    urdf: Urdf = None,
    frame: FrameName = None,
    translation_half_width_mm: TranslationHalfWidth = None,
    rotation_half_width_rad: RotationHalfWidth = None,
    encoder_noise_rad: EncoderNoise = None,
    seed: Annotated[int, typer.Option(help="Seed of the Monte Carlo method.")] = 1,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="CSV file: every posture with its accuracy.")] = None,
    json_: Json = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """How accurate the arm is at a point, in which posture, and why."""
    with Results(force, output, plot=plot, json_=json_) as results:
        model = model_of(arm, urdf, frame, translation_half_width_mm, rotation_half_width_rad)
        if urdf is not None:
            _require_uncertainty(translation_half_width_mm, rotation_half_width_rad, encoder_noise_rad)
        circle = postures_at(model.arm, point, tip or urdf is not None, axis, tool_axis, rpy_deg, count)
        result = circle_accuracy(
            circle, model, method=cast(Method, method), encoder_noise=encoder_noise_rad, rng=np.random.default_rng(seed)
        )
        summary = accuracy_summary(circle, result, sectors)
        if method == "monte-carlo":
            summary["seed"] = seed
        if output is not None:
            results.text(accuracy_table(circle, result).to_csv(index=False), output)
        if plot is not None:
            results.picture(_drawn(circle, result), plot)
        if json_ is not None:
            results.json(summary, json_)
    if json_ != "-":
        _show_accuracy(circle, result, summary)
        if encoder_noise_rad is None and model.arm.encoder_noise is None:
            note("note: nobody states the noise of the encoders; u is of the parameters alone (--encoder-noise-rad adds it)")


def _drawn(circle: PosturesAtPoint, result: AccuracyVolume) -> Any:
    from aacmm_pin.report import plots

    if isinstance(circle, ReachingPostures):
        return plots.plot_accuracy_of_postures(circle, result).figure
    return plots.plot_accuracy_over_swivel(circle, result).figure


def _require_uncertainty(*stated: float | None) -> None:
    """A URDF states no uncertainty, so that the command has to."""
    if not any(stated):
        raise AacmmError(
            "a URDF states no uncertainties; expected --translation-half-width-mm and --rotation-half-width-rad (bounds of "
            "the joint placements), or --encoder-noise-rad with --method ellipsoid"
        )


def _show_accuracy(circle: PosturesAtPoint, result: AccuracyVolume, summary: dict[str, Any]) -> None:
    volume = summary["volume_mm3"]
    say(str(circle))
    say(str(result))
    if volume["comprehensive"] is not None:
        say(f"comprehensive accuracy {volume['comprehensive']:.4g} mm³")
    postures = {"best": "smallest volume", "worst": "largest volume", "smallest_u": "smallest u", "largest_u": "largest u"}
    elbow = summary["best"]["swivel_deg"] is not None
    say("postures, swivel 0 where the elbow is highest:" if elbow else "postures:")
    rows = [
        {
            "posture": words,
            "swivel [°]": summary[which]["swivel_deg"],
            "θ1 … θn [°]": " ".join(f"{theta:.0f}" for theta in summary[which]["theta_deg"]),
            "volume [mm³]": summary[which]["volume_mm3"],
            "u [mm]": summary[which]["u_mm"],
        }
        for which, words in postures.items()
    ]
    table = pd.DataFrame(rows) if elbow else pd.DataFrame(rows).drop(columns="swivel [°]")
    show(table, {"swivel [°]": ".1f", "volume [mm³]": ".4g", "u [mm]": ".4f"})
    if summary["taken_as_exact"]:
        say(f"no uncertainty is stated for, and so taken as exact: {', '.join(summary['taken_as_exact'])}")
    budget = result.budget().head(8)[["parameter", "joint", "u_mm", "share"]].rename(columns={"u_mm": "u [mm]"})
    head = "where the uncertainty comes from, mean over the postures:"
    show(budget, {"u [mm]": ".4f", "share": ".1%"}, head)
