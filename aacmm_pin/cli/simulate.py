"""Virtual measurements of an arm with known errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.cli.arm_options import (
    FrameName,
    MaybeArm,
    ProbeNoise,
    ReferenceNoise,
    RotationHalfWidth,
    TranslationHalfWidth,
    Urdf,
    bar_length,
    model_of,
    noise_in_words,
    noise_of,
)
from aacmm_pin.cli.common import EncoderNoise, Force, Output, Results, Seed, command, note
from aacmm_pin.cli.effect_options import EffectTexts, check_rows, effects_of
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.simulate import PLANS, Plan, simulate_measurements


@command()
def simulate(
    arm: MaybeArm = None,
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
    encoder_noise_rad: EncoderNoise = None,
    reference_noise_mm: ReferenceNoise = None,
    probe_noise_mm: ProbeNoise = None,
    urdf: Urdf = None,
    frame: FrameName = None,
    translation_half_width_mm: TranslationHalfWidth = None,
    rotation_half_width_rad: RotationHalfWidth = None,
    output: Output = None,
    truth: Annotated[Path | None, typer.Option(help="File for the arm that made the data, with its effects.")] = None,
    force: Force = False,
) -> None:
    """Virtual measurements of an arm with known errors, as CSV."""
    if unknown and plan != "seats":
        raise typer.BadParameter("--unknown goes with --plan seats")
    rng = np.random.default_rng(seed)
    with Results(force, output, truth) as results:
        model = model_of(arm, urdf, frame, translation_half_width_mm, rotation_half_width_rad)
        effects = effects_of(effect)
        check_rows(effects, model)
        if perturb:
            model = perturbed_model(model, rng.spawn(1)[0])  # a stream of its own: the plan is the same without it
            note(f"note: the true geometry was drawn within the uncertainties of {model.arm.name}, seed {seed}")
        model = model.with_effects(*effects)
        for given in effects:
            if not any(given.values):
                raise AacmmError(f"--effect {given.key}: no size is given, expected {', '.join(given.described())}")
        noise = noise_of(model.arm, encoder_noise_rad, reference_noise_mm, probe_noise_mm)
        length = bar_length(plan, bar_length_mm)
        data = simulate_measurements(
            model, cast(Plan, plan), records, rng=rng, noise=noise, seats=seats, known=not unknown, bar_length=length
        )
        data.save(results.file(output))
        if truth is not None:
            model.save(results.file(truth), comment=f"The arm behind: {data.source}; {noise_in_words(noise)}.")
    note(f"{data}; {noise_in_words(noise)}")
