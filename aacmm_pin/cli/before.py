"""What can be asked before anything is measured: postures, accuracy, maps, URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.units import MM
from aacmm_pin.accuracy.volume import METHODS, AccuracyVolume, Method, circle_accuracy
from aacmm_pin.accuracy.workspace import map_caveats, map_workspace
from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.arm.urdf import urdf_text
from aacmm_pin.cli.common import ArmName, EncoderNoise, Force, Json, Output, Plot, Results, command, note, say
from aacmm_pin.cli.given import FrameName, MaybeArm, RotationHalfWidth, TranslationHalfWidth, Urdf, model_of
from aacmm_pin.cli.reached import Axis, Count, Point, RollPitchYaw, Tip, ToolAxis, postures_at
from aacmm_pin.cli.tables import show
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.postures.general_ik import ReachingPostures
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.summaries import accuracy_summary, accuracy_table, map_summary, map_table

Processes = Annotated[int, typer.Option(min=1, help="Worker processes.")]
Sectors = Annotated[int, typer.Option(min=1, help="Sectors of the configuration circle.")]


@command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path("out"),
    cells: Annotated[tuple[int, int], typer.Option(metavar="NX NZ", help="Cells of the map.")] = (48, 48),
    force: Force = False,
) -> None:
    """The whole tour on bundled input: SINO6 at a point and over its workspace, as one HTML page."""
    from aacmm_pin.report.demo import run_demo  # here and below: what draws is loaded only where it is drawn

    summary = run_demo(folder=output, cells=cells, force=force)
    say(str(summary))


@command()
def urdf(arm: ArmName, output: Output = None, force: Force = False) -> None:
    """URDF of an arm, from its DH table."""
    with Results(force, output) as results:
        results.text(urdf_text(load_arm_file(arm), with_stylus_offset=True), output)


@command()
def configurations(
    point: Point,
    arm: MaybeArm = None,
    count: Count = 360,
    tip: Tip = False,
    axis: Axis = None,
    tool_axis: ToolAxis = None,
    rpy_deg: RollPitchYaw = None,
    urdf: Urdf = None,
    frame: FrameName = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Every configuration that reaches a point, as CSV."""
    with Results(force, output) as results:
        machine = model_of(arm, urdf, frame).arm
        circle = postures_at(machine, point, tip or urdf is not None, axis, tool_axis, rpy_deg, count)
        note(str(circle))
        results.text(circle.to_frame().to_csv(index=False), output)


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
            circle, model, method=_method(method), encoder_noise=encoder_noise_rad, rng=np.random.default_rng(seed)
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


@command("map")
def map_(
    arm: MaybeArm = None,
    cells: Annotated[tuple[int, int], typer.Option(metavar="NX NZ", help="Cells along x and z.")] = (48, 48),
    sectors: Sectors = 12,
    extent_mm: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 X1 Z0 Z1", help="Part of the half-plane, in mm; default the arm's reach."),
    ] = None,
    method: Annotated[str, typer.Option(help="One of zonotope, jointwise, ellipsoid.")] = "zonotope",
    processes: Processes = 1,
    urdf: Urdf = None,
    frame: FrameName = None,
    output: Output = None,
    plot: Plot = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Flexibility and accuracy over the workspace, as netCDF."""
    with Results(force, output, plot=plot, json_=json_) as results:
        extent = None if extent_mm is None else np.array(extent_mm) * MM
        machine = model_of(arm, urdf, frame)
        machine.arm.require_dh("a map (its cells are reached by the wrist, with joints 1 to 4)")
        for caveat in map_caveats(machine.arm):
            note(f"note: {caveat}")
        result = map_workspace(machine, cells, sectors, extent=extent, method=_method(method), processes=processes)
        if output is not None:
            result.save(results.file(output))
        if plot is not None:
            results.picture(result.plot().figure, plot)
        if json_ is not None:
            results.json(map_summary(result), json_)
    if json_ != "-":
        say(str(result))
        show(map_table(result))


def _method(name: str) -> Method:
    for method in METHODS:
        if method == name:
            return method
    raise UnknownNameError("method", name, list(METHODS))


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
