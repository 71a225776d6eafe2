"""Diagnoses of many files at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.arm import EXAMPLE_ROBOTS
from aacmm_pin.cli.arm_options import AnyArm, ApproachFromOrder, UrdfArm
from aacmm_pin.cli.common import JsonFile, Results, Seed, WorkerCount, command, output_option
from aacmm_pin.cli.measuring_options import MeasuredHow, NoCrossValidation
from aacmm_pin.diagnosis import diagnose_files
from aacmm_pin.effects import GivenModel
from aacmm_pin.errors import AacmmError

ARM_SUFFIXES = ("", ".toml")
"""Of arguments that are arms: names, and arm files."""


@command(
    "aacmm-pin diagnose-files my_arm.toml checks/*.csv --encoder-noise 8e-6 -o table.csv",
    "aacmm-pin diagnose-files arm1.toml arm1/*.csv arm2.toml arm2/*.csv --workers 4",
)
def run(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="ARM DATA...",
            help="ARM: name or arm file (*.toml). DATA: measurement files (CSV) of this arm. "
            "To use other arms too, repeat ARM and DATA. With --urdf, omit ARM.",
        ),
    ],
    robot: UrdfArm,
    how: MeasuredHow,
    approach_from_order: ApproachFromOrder = False,
    no_cross_validation: NoCrossValidation = False,
    seed: Seed = 1,
    workers: WorkerCount = 1,
    output: Annotated[
        Path | None,
        output_option("FILE.csv", "Write a table with one row for each file (CSV).", "--csv", "-o"),
    ] = None,
    *,
    options: JsonFile,
) -> None:
    """If the command cannot use a file, the table states the error in the row of this file, and the
    exit status is 1.
    """
    from aacmm_pin.report import (  # these load what draws
        diagnoses_document,
        diagnoses_summary,
        with_cause_texts,
    )

    pairs = _pairs(files, robot)
    with Results(options, output, inputs=files) as results:
        table = diagnose_files(
            pairs,
            approach_from_order=approach_from_order,
            seed=seed,
            workers=workers,
            hold_out=not no_cross_validation,
            **how.keywords(),
        )
        if output is not None:
            results.text(csv_text(with_cause_texts(table)), output)
        results.json(diagnoses_summary(table) | {"seed": seed})
    results.show(diagnoses_document(table))
    unused = int((table["error"] != "").sum())
    if unused:
        raise AacmmError(
            f"diagnose-files cannot use {unused} of {len(table)} files; see the errors of these "
            "files in the table"
        )


def _pairs(files: list[str], robot: UrdfArm) -> list[tuple[GivenModel, str]]:
    """Each file with the arm before it, or that of ``--urdf``."""
    expected = "expected ARM (name or *.toml) and then its measurement files, or --urdf"
    pairs: list[tuple[GivenModel, str]] = []
    arm: GivenModel | None = robot.of_urdf()
    for name, following in zip(files, [*files[1:], ""], strict=True):
        if Path(name).suffix in ARM_SUFFIXES:
            if robot.urdf is not None:
                raise typer.BadParameter(
                    f"{name} is an arm and cannot be combined with --urdf; omit one of the two"
                )
            if Path(following).suffix in ARM_SUFFIXES:
                raise typer.BadParameter(
                    f"{name}: no measurement file follows this arm; {expected}"
                )
            arm = AnyArm(arm=name).model() if name in EXAMPLE_ROBOTS else name
        elif arm is None:
            raise typer.BadParameter(f"{name}: no arm precedes this file; {expected}")
        else:
            pairs.append((arm, name))
    return pairs
