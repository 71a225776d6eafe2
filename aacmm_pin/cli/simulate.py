"""Virtual measurements of an arm with known errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin._support.units import MM
from aacmm_pin.calibration.random_arm import perturbed_model
from aacmm_pin.cli.arm_options import ContactNoise, UncertainArm, in_metres
from aacmm_pin.cli.common import EffectTexts, Force, Output, Results, Seed, command, note
from aacmm_pin.effects.cause_text import stated_cause
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.simulate import PLANS, Plan, simulate_measurements

BAR_LENGTH_MM = 500.0
"""Length of a ball bar where none is stated."""


@command
def run(
    arm: UncertainArm,
    plan: Annotated[str, typer.Option(help=f"One of {', '.join(PLANS)}.")] = "seats",
    records: Annotated[int, typer.Option(help="Number of records.")] = 300,
    seats: Annotated[int, typer.Option(help="Number of seats; two for each ball bar.")] = 10,
    unknown: Annotated[bool, typer.Option("--unknown", help="With plan seats: without their coordinates.")] = False,
    bar_length_mm: Annotated[float | None, typer.Option(help="With plan ball-bar: length of the bars.")] = None,
    effect: EffectTexts = None,
    perturb: Annotated[
        bool, typer.Option("--perturb", help="Draw the true geometry within the arm's uncertainties.")
    ] = False,
    seed: Seed = 1,
    *,
    stated: ContactNoise,
    output: Output = None,
    truth: Annotated[Path | None, typer.Option(help="File for the arm that made the data, with its effects.")] = None,
    force: Force = False,
) -> None:
    """Virtual measurements of an arm with known errors, as CSV."""
    if unknown and plan != "seats":
        raise typer.BadParameter("--unknown goes with --plan seats")
    rng = np.random.default_rng(seed)
    with Results(force, output, truth, reads=arm.files) as results:
        model = arm.model()
        effects = [stated_cause(text, model) for text in effect or []]
        if perturb:
            model = perturbed_model(model, rng.spawn(1)[0])  # a stream of its own: the plan is the same without it
            note(f"note: the true geometry was drawn within the uncertainties of {model.arm.name}, seed {seed}")
        model = model.with_effects(*effects)
        for given in effects:
            if not any(given.values):
                raise AacmmError(f"--effect {given.key}: no size is given, expected {', '.join(given.described())}")
        if plan == "ball-bar" and bar_length_mm is None:
            note(f"note: bars of {BAR_LENGTH_MM:g} mm are assumed; --bar-length-mm states another length")
            bar_length_mm = BAR_LENGTH_MM
        noise, length = stated.simulated(model.arm), in_metres(bar_length_mm)
        data = simulate_measurements(
            model, cast(Plan, plan), records, rng=rng, noise=noise, seats=seats, known=not unknown, bar_length=length
        )
        encoder = ", ".join(f"{u:g}" for u in dict.fromkeys(noise.encoder))
        words = f"noise: readings {encoder} rad, references {noise.reference / MM:g} mm, contacts {noise.probe / MM:g} mm"
        data.save(results.file(output or "-"))
        if truth is not None:
            model.save(results.file(truth), comment=f"The arm behind: {data.source}; {words}.")
    note(f"{data}; {words}")
