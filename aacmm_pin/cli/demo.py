"""The whole tour on bundled input."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin.cli.common import Force, command, say


@command(
    "aacmm-pin demo -o out/",
    "aacmm-pin demo -o out/ --force",
)
def run(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out"
    ),
    cells: Annotated[
        tuple[int, int],
        typer.Option(metavar="NX NZ", help="Number of cells of the map along x and z."),
    ] = (48, 48),
    force: Force = False,
) -> None:
    from aacmm_pin.report import run_demo  # loads what draws

    say(run_demo(folder=output, cells=cells, force=force))
