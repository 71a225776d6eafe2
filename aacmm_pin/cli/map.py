"""Flexibility and accuracy over the workspace."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin.accuracy import Quantity, map_caveats, map_workspace
from aacmm_pin.cli.arm_options import AnyArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    Output,
    PlotAndJson,
    Results,
    Sectors,
    WorkerCount,
    command,
    length_option,
    note,
)
from aacmm_pin.cli.pose_options import Triple
from aacmm_pin.errors import AacmmError
from aacmm_pin.report import map_document, map_summary


@command(
    "aacmm-pin map sino6 --cells 24 24 --sectors 12 -o map.nc --plot map.png",
    "aacmm-pin map my_arm.toml --axis 0 0 -1 --workers 4 --plot u.png --quantity largest_u_mm",
)
def run(
    arm: AnyArm,
    cells: Annotated[
        tuple[int, int], typer.Option(metavar="NX NZ", help="Number of cells along x and z.")
    ] = (48, 48),
    sectors: Sectors = 12,
    extent: Annotated[
        tuple[float, float, float, float] | None,
        length_option(
            "--extent-mm",
            "Compute this part of the half-plane y = 0, in mm. Default: the reach of the arm.",
            COORDINATE,
            metavar="X0 X1 Z0 Z1",
        ),
    ] = None,
    axis: Annotated[
        Triple | None,
        typer.Option(
            metavar="X Y Z",
            help="Place the tip in each cell, with the stylus in this direction. Default: place "
            "the wrist there.",
        ),
    ] = None,
    method: Annotated[
        Literal["zonotope", "jointwise", "ellipsoid"],
        typer.Option(help="Method for the volume of possible positions."),
    ] = "zonotope",
    workers: WorkerCount = 1,
    output: Output = None,
    quantity: Annotated[
        Quantity | None,
        typer.Option(help="With --plot: draw this quantity. Default: comprehensive_mm3."),
    ] = None,
    *,
    files: PlotAndJson,
) -> None:
    if quantity is not None and files.plot is None:
        raise typer.BadParameter("--quantity requires --plot")
    with Results(files, output) as results:
        model = restrict_to_known_range(arm.model())
        model.arm.require_dh("a map of the workspace", revolute=True)
        for caveat in map_caveats(model.arm, axis):
            note(caveat)
        result = map_workspace(
            model, cells, sectors, extent=extent, method=method, workers=workers, axis=axis
        )
        for caveat in result.caveats:
            note(caveat)
        if result.unreachable == cells[0] * cells[1]:
            hint = "increase --cells" if extent is None else "check that --extent-mm is in mm"
            raise AacmmError(f"{result}; {hint}")
        if output is not None:
            result.save(results.file(output))
        results.picture(lambda: result.plot(quantity or "comprehensive_mm3").figure)
        results.json(map_summary(result))
    results.show(map_document(result))
