"""What can be asked before anything is measured: postures, accuracy, maps, URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from aacmm_pin import plots
from aacmm_pin.accuracy import METHODS, AccuracyVolume, Method, circle_accuracy
from aacmm_pin.arm import Arm
from aacmm_pin.arm_file import load_arm_file
from aacmm_pin.cli.common import ArmName, EncoderNoise, Force, Json, Output, Plot, Results, command, note, say
from aacmm_pin.configurations import ConfigurationCircle, configuration_circle
from aacmm_pin.demo import run_demo
from aacmm_pin.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.summaries import accuracy_summary, accuracy_table, map_summary
from aacmm_pin.units import MM
from aacmm_pin.urdf import urdf_text
from aacmm_pin.workspace import map_caveats, map_workspace

Point = Annotated[
    tuple[float, float, float], typer.Option("--point", metavar="X Y Z", help="Working point in the base frame, in mm.")
]
Count = Annotated[int, typer.Option(min=3, help="Configurations on each closed component.")]
Tip = Annotated[bool, typer.Option("--tip", help="The point is for the tip, not for the wrist; give --axis too.")]
Axis = Annotated[
    tuple[float, float, float] | None, typer.Option("--axis", metavar="X Y Z", help="With --tip: direction of the stylus.")
]
Processes = Annotated[int, typer.Option(min=1, help="Worker processes.")]
Sectors = Annotated[int, typer.Option(min=1, help="Sectors of the configuration circle.")]


@command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path("out"),
    cells: Annotated[tuple[int, int], typer.Option(metavar="NX NZ", help="Cells of the map.")] = (48, 48),
    force: Force = False,
) -> None:
    """The whole tour on bundled input: SINO6 at a point and over its workspace, as one HTML page."""
    summary = run_demo(folder=output, cells=cells, force=force)
    say(str(summary))


@command()
def urdf(arm: ArmName, output: Output = None, force: Force = False) -> None:
    """URDF of an arm, from its DH table."""
    with Results(force, output) as results:
        results.text(urdf_text(load_arm_file(arm), with_stylus_offset=True), output)


@command()
def configurations(
    arm: ArmName,
    point: Point,
    count: Count = 360,
    tip: Tip = False,
    axis: Axis = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Every configuration that reaches a point, as CSV."""
    with Results(force, output) as results:
        circle = circle_of(Arm.load(arm), point, tip, axis, count)
        note(str(circle))
        results.text(circle.to_frame().to_csv(index=False), output)


@command()
def accuracy(
    arm: ArmName,
    point: Point,
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "zonotope",
    count: Count = 360,
    sectors: Sectors = 12,
    tip: Tip = False,
    axis: Axis = None,
    encoder_noise_rad: EncoderNoise = None,
    seed: Annotated[int, typer.Option(help="Seed of the Monte Carlo method.")] = 1,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="CSV file: every posture with its accuracy.")] = None,
    json_: Json = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """How accurate the arm is at a point, in which posture, and why."""
    with Results(force, output, plot=plot, json_=json_) as results:
        model = ErrorModel.load(arm)
        circle = circle_of(model.arm, point, tip, axis, count)
        result = circle_accuracy(
            circle, model, method=_method(method), encoder_noise=encoder_noise_rad, rng=np.random.default_rng(seed)
        )
        summary = accuracy_summary(circle, result, sectors)
        if method == "monte-carlo":
            summary["seed"] = seed
        if output is not None:
            results.text(accuracy_table(circle, result).to_csv(index=False), output)
        if plot is not None:
            results.picture(plots.plot_accuracy_over_swivel(circle, result).figure, plot)
        if json_ is not None:
            results.json(summary, json_)
    if json_ is None:
        _show_accuracy(circle, result, summary)
        if encoder_noise_rad is None and model.arm.encoder_noise is None:
            note("note: nobody states the noise of the encoders; u is of the parameters alone (--encoder-noise-rad adds it)")


@command("map")
def map_(
    arm: ArmName,
    cells: Annotated[tuple[int, int], typer.Option(metavar="NX NZ", help="Cells along x and z.")] = (48, 48),
    sectors: Sectors = 12,
    extent_mm: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 X1 Z0 Z1", help="Part of the half-plane, in mm; default the arm's reach."),
    ] = None,
    method: Annotated[str, typer.Option(help="One of zonotope, jointwise, ellipsoid.")] = "zonotope",
    processes: Processes = 1,
    output: Output = None,
    plot: Plot = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Flexibility and accuracy over the workspace, as netCDF."""
    with Results(force, output, plot=plot, json_=json_) as results:
        extent = None if extent_mm is None else np.array(extent_mm) * MM
        machine = ErrorModel.load(arm)
        for caveat in map_caveats(machine.arm):
            note(f"note: {caveat}")
        result = map_workspace(machine, cells, sectors, extent=extent, method=_method(method), processes=processes)
        if output is not None:
            result.save(results.file(output))
        if plot is not None:
            results.picture(plots.plot_comprehensive(result).figure, plot)
        if json_ is not None:
            results.json(map_summary(result), json_)
    if json_ is None:
        say(str(result))


def circle_of(
    arm: Arm, point: tuple[float, ...], tip: bool, axis: tuple[float, ...] | None, count: int
) -> ConfigurationCircle:
    """The circle of a point in mm.

    Raises:
        AacmmError: no configuration reaches it.
    """
    if tip != (axis is not None):
        raise typer.BadParameter("--tip and --axis go together")
    where = np.array(point) * MM
    circle = configuration_circle(arm, where, tip=tip, axis=axis, count=count)
    if circle.reason:
        raise AacmmError(str(circle))
    return circle


def _method(name: str) -> Method:
    for method in METHODS:
        if method == name:
            return method
    raise UnknownNameError("method", name, list(METHODS))


def _show_accuracy(circle: ConfigurationCircle, result: AccuracyVolume, summary: dict[str, Any]) -> None:
    volume = summary["volume_mm3"]
    say(str(circle))
    say(str(result))
    say(f"comprehensive accuracy {volume['comprehensive']:.4g} mm³")
    postures = {"best": "smallest volume", "worst": "largest volume", "smallest_u": "smallest u", "largest_u": "largest u"}
    say("postures, angles in degrees, swivel 0 where the elbow is highest:")
    table = Table(Column("posture", no_wrap=True), "swivel", Column("θ1 … θn", no_wrap=True), "mm³", "u in mm", box=SIMPLE)
    for which, words in postures.items():
        row = summary[which]
        angles = " ".join(f"{theta:.0f}" for theta in row["theta_deg"])
        table.add_row(words, f"{row['swivel_deg']:.1f}", angles, f"{row['volume_mm3']:.4g}", f"{row['u_mm']:.4f}")
    Console().print(table)
    if summary["taken_as_exact"]:
        say(f"no uncertainty is stated for, and so taken as exact: {', '.join(summary['taken_as_exact'])}")
    say("where the uncertainty comes from, mean over the postures:")
    table = Table("parameter", "joint", "u in mm", "share", box=SIMPLE)
    for row in result.budget().head(8).itertuples():
        joint = "" if row.joint is pd.NA else str(row.joint)
        table.add_row(str(row.parameter), joint, f"{row.u_mm:.4f}", f"{row.share:.1%}")
    Console().print(table)
