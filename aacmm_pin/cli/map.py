"""Flexibility and accuracy over the workspace."""

from __future__ import annotations

from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin._support.units import MM
from aacmm_pin.accuracy.volume import Method
from aacmm_pin.accuracy.workspace import map_caveats, map_workspace
from aacmm_pin.cli.arm_options import FrameName, MaybeArm, Urdf, model_of
from aacmm_pin.cli.common import Force, Json, Output, Plot, Results, Sectors, command, note, say
from aacmm_pin.cli.tables import show
from aacmm_pin.report.summaries import map_summary, map_table

Processes = Annotated[int, typer.Option(min=1, help="Worker processes.")]


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
        result = map_workspace(machine, cells, sectors, extent=extent, method=cast(Method, method), processes=processes)
        if output is not None:
            result.save(results.file(output))
        if plot is not None:
            results.picture(result.plot().figure, plot)
        if json_ is not None:
            results.json(map_summary(result), json_)
    if json_ != "-":
        say(str(result))
        show(map_table(result))
