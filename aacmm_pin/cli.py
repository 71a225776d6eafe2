"""The command ``aacmm-pin``: one function for each subcommand, no logic of its own."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, ParamSpec

import matplotlib
import numpy as np
import pandas as pd
import typer
from rich.box import SIMPLE
from rich.console import Console
from rich.table import Column, Table

from aacmm_pin import plots
from aacmm_pin.accuracy import METHODS, AccuracyVolume, Method, circle_accuracy
from aacmm_pin.arm import Arm
from aacmm_pin.arm_file import bundled_arms, load_arm_file
from aacmm_pin.configurations import ConfigurationCircle, configuration_circle
from aacmm_pin.demo import run_demo
from aacmm_pin.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.outputs import check_output, whole_file
from aacmm_pin.summaries import accuracy_summary, accuracy_table, map_summary
from aacmm_pin.units import MM
from aacmm_pin.urdf import urdf_text
from aacmm_pin.workspace import map_caveats, map_workspace

app = typer.Typer(
    name="aacmm-pin",
    help="Postures and accuracy of articulated-arm coordinate measuring machines, on Pinocchio.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

matplotlib.use("Agg")  # the command writes files and never opens a window

PLOT_SUFFIXES = (".png", ".svg", ".pdf")

P = ParamSpec("P")


def _command(name: str | None = None) -> Callable[[Callable[P, None]], Callable[P, None]]:
    """Register a subcommand; errors that the package raises on purpose become one message and exit status 1."""

    def register(function: Callable[P, None]) -> Callable[P, None]:
        @functools.wraps(function)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
            try:
                function(*args, **kwargs)
            except AacmmError as error:
                _note(f"aacmm-pin: {error}")
                raise typer.Exit(1) from None
            except KeyboardInterrupt:
                _note("aacmm-pin: interrupted; no output was left half-written")
                raise typer.Exit(130) from None

        app.command(name)(guarded)
        return function

    return register


ArmName = Annotated[
    str, typer.Argument(metavar="ARM", help=f"Bundled arm ({', '.join(bundled_arms())}) or the path of an arm file.")
]
Point = Annotated[
    tuple[float, float, float], typer.Option("--point", metavar="X Y Z", help="Working point in the base frame, in mm.")
]
Count = Annotated[int, typer.Option(min=3, help="Configurations on each closed component.")]
Tip = Annotated[bool, typer.Option("--tip", help="The point is for the tip, not for the wrist; give --axis too.")]
Axis = Annotated[
    tuple[float, float, float] | None, typer.Option("--axis", metavar="X Y Z", help="With --tip: direction of the stylus.")
]
Json = Annotated[str | None, typer.Option("--json", metavar="FILE", help="Write one JSON object; - for stdout.")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="File to write.")]
Plot = Annotated[Path | None, typer.Option("--plot", help="Draw the result into this file (.png, .svg, .pdf).")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Processes = Annotated[int, typer.Option(min=1, help="Worker processes.")]
Sectors = Annotated[int, typer.Option(min=1, help="Sectors of the configuration circle.")]


@_command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")] = Path("out"),
    cells: Annotated[tuple[int, int], typer.Option(metavar="NX NZ", help="Cells of the map.")] = (48, 48),
    force: Force = False,
) -> None:
    """The whole tour on bundled input: SINO6 at a point and over its workspace, as one HTML page."""
    summary = run_demo(folder=output, cells=cells, force=force)
    _say(str(summary))


@_command()
def urdf(arm: ArmName, output: Output = None, force: Force = False) -> None:
    """URDF of an arm, from its DH table."""
    _text_out(urdf_text(load_arm_file(arm)), output, force)


@_command()
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
    _check(output, force)
    circle = _circle(Arm.load(arm), point, tip, axis, count)
    _note(str(circle))
    _text_out(circle.to_frame().to_csv(index=False), output, force)


@_command()
def accuracy(
    arm: ArmName,
    point: Point,
    method: Annotated[str, typer.Option(help=f"One of {', '.join(METHODS)}.")] = "zonotope",
    count: Count = 360,
    sectors: Sectors = 12,
    tip: Tip = False,
    axis: Axis = None,
    encoder_noise_rad: Annotated[float | None, typer.Option(help="Standard uncertainty of one reading, in rad.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the Monte Carlo method.")] = 1,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="CSV file: every posture with its accuracy.")] = None,
    json_: Json = None,
    plot: Plot = None,
    force: Force = False,
) -> None:
    """How accurate the arm is at a point, in which posture, and why."""
    _check(output, force)
    _check_plot(plot, force)
    _check_json(json_, force)
    model = ErrorModel.load(arm)
    circle = _circle(model.arm, point, tip, axis, count)
    result = circle_accuracy(
        circle, model, method=_method(method), encoder_noise=encoder_noise_rad, rng=np.random.default_rng(seed)
    )
    summary = accuracy_summary(circle, result, sectors)
    if method == "monte-carlo":
        summary["seed"] = seed
    if json_ is None:
        _show_accuracy(circle, result, summary)
    else:
        _json_out(summary, json_, force)
    if output is not None:
        _text_out(accuracy_table(circle, result).to_csv(index=False), output, force)
    if plot is not None:
        _save_plot(plots.plot_accuracy_over_swivel(circle, result), plot, force)


@_command("map")
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
    _check(output, force)
    _check_plot(plot, force)
    _check_json(json_, force)
    extent = None if extent_mm is None else np.array(extent_mm) * MM
    machine = ErrorModel.load(arm)
    for caveat in map_caveats(machine.arm):
        _note(f"note: {caveat}")
    result = map_workspace(machine, cells, sectors, extent=extent, method=_method(method), processes=processes)
    if output is not None:
        with whole_file(output, force) as path:
            result.save(path)
    if plot is not None:
        _save_plot(plots.plot_comprehensive(result), plot, force)
    if json_ is None:
        _say(str(result))
    else:
        _json_out(map_summary(result), json_, force)


def _circle(
    arm: Arm, point: tuple[float, ...], tip: bool, axis: tuple[float, ...] | None, count: int
) -> ConfigurationCircle:
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
    _say(str(circle))
    _say(str(result))
    _say(f"comprehensive accuracy {volume['comprehensive']:.4g} mm³")
    postures = {"best": "smallest volume", "worst": "largest volume", "smallest_u": "smallest u", "largest_u": "largest u"}
    _say("postures, angles in degrees, swivel 0 where the elbow is highest:")
    table = Table(Column("posture", no_wrap=True), "swivel", Column("θ1 … θn", no_wrap=True), "mm³", "u in mm", box=SIMPLE)
    for which, words in postures.items():
        row = summary[which]
        angles = " ".join(f"{theta:.0f}" for theta in row["theta_deg"])
        table.add_row(words, f"{row['swivel_deg']:.1f}", angles, f"{row['volume_mm3']:.4g}", f"{row['u_mm']:.4f}")
    Console().print(table)
    if summary["taken_as_exact"]:
        _say(f"no uncertainty is stated for, and so taken as exact: {', '.join(summary['taken_as_exact'])}")
    _say("where the uncertainty comes from, mean over the postures:")
    table = Table("parameter", "joint", "u in mm", "share", box=SIMPLE)
    for row in result.budget().head(8).itertuples():
        joint = "" if row.joint is pd.NA else str(row.joint)
        table.add_row(str(row.parameter), joint, f"{row.u_mm:.4f}", f"{row.share:.1%}")
    Console().print(table)


def _say(text: str) -> None:
    typer.echo(text)


def _note(text: str) -> None:
    typer.echo(text, err=True)


def _check(path: Path | None, force: bool) -> None:
    if path is not None:
        check_output(path, force)


def _check_plot(path: Path | None, force: bool) -> None:
    _check(path, force)
    if path is not None and path.suffix not in PLOT_SUFFIXES:
        raise AacmmError(f"{path}: expected a name that ends in one of {', '.join(PLOT_SUFFIXES)}")


def _check_json(target: str | None, force: bool) -> None:
    if target not in (None, "-"):
        _check(Path(str(target)), force)


def _json_out(content: dict[str, Any], target: str, force: bool) -> None:
    text = json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    _text_out(text, None if target == "-" else Path(target), force)


def _text_out(text: str, output: Path | None, force: bool) -> None:
    if output is None:
        sys.stdout.write(text)
        return
    with whole_file(output, force) as path:
        path.write_text(text, encoding="utf-8", newline="")


def _save_plot(axes: Any, path: Path, force: bool) -> None:
    with whole_file(path, force) as temporary:
        axes.figure.savefig(temporary, dpi=150, bbox_inches="tight")


def _version(wanted: bool) -> None:
    if wanted:
        _say(f"aacmm-pin {version('aacmm-pin')}")
        raise typer.Exit


@app.callback()
def _root(
    version_: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")] = False,
) -> None:
    """Options of the command itself."""


if __name__ == "__main__":
    app()
