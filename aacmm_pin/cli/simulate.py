"""Virtual measurements of an arm with known errors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.plausible import ROTATION_NOISE
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM, UM
from aacmm_pin.calibration.random_arm import perturbed_model
from aacmm_pin.cli.arm_options import ContactNoise, UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    CsvOutput,
    EffectTexts,
    Replacing,
    Results,
    Seed,
    angle_option,
    arm_file_option,
    command,
    length_option,
    note,
    status,
)
from aacmm_pin.effects import Effect, ErrorModel, cause_of, require_shown
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import (
    SIMULATED_BAR,
    Measurements,
    Scheme,
    simulate_measurements,
    simulate_touches,
)
from aacmm_pin.verification import Procedure

SCHEMES_WITH = {
    "no_seat_coordinates": ("seats",),
    "seats": ("seats", "ball-bar"),
    "bar_length": ("ball-bar",),
    "reference_noise": ("free", "seats", "ball-bar"),
    "orientation_noise": ("free", "seats"),
}
"""Which schemes an option is for, by its argument."""
BAR_LENGTH_MM = 500.0
"""Assumed length of a ball bar."""


@command(
    "aacmm-pin simulate sino6 --scheme free --records 200 --random-geometry -o data.csv",
    "aacmm-pin simulate sino6 --scheme seats --cause joint_compliance:2,"
    "compliance_rad_per_nm=2e-5 -o data.csv",
)
def run(
    context: typer.Context,
    arm: UncertainArm,
    scheme: Annotated[
        Scheme,
        typer.Option(
            help="Kind of reference data. free: coordinates of each record. seats: points that are "
            "touched in several postures. ball-bar: bars of known length. single-point: one seat "
            "without coordinates."
        ),
    ] = "seats",
    procedure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv", help="Fill in this procedure, which plan acceptance wrote."
        ),
    ] = None,
    records: Annotated[int, typer.Option(metavar="N", help="Number of records to simulate.")] = 300,
    seats: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="With --scheme seats or ball-bar: number of seats. Each bar has two seats.",
        ),
    ] = 10,
    no_seat_coordinates: Annotated[
        bool,
        typer.Option(
            "--no-seat-coordinates",
            help="With --scheme seats: write no coordinates of the seats.",
        ),
    ] = False,
    bar_length: Annotated[
        float | None,
        length_option(
            "--bar-length-mm",
            f"With --scheme ball-bar: length of the bars. Default: {BAR_LENGTH_MM:g}.",
            SIMULATED_BAR,
        ),
    ] = None,
    orientation_noise: Annotated[
        float | None,
        angle_option(
            "With --scheme free or seats: add orientations of the tip with this standard "
            "uncertainty, in rad or with a unit, such as 50urad.",
            ROTATION_NOISE,
        ),
    ] = None,
    effect: EffectTexts = None,
    random_geometry: Annotated[
        bool,
        typer.Option(
            "--random-geometry",
            help="Choose the true geometry at random within the uncertainties of the arm.",
        ),
    ] = False,
    seed: Seed = 1,
    *,
    stated: ContactNoise,
    output: CsvOutput = None,
    arm_out: Annotated[
        Path | None,
        arm_file_option("Write the arm file of the simulated arm, with its causes."),
    ] = None,
    files: Replacing,
) -> None:
    """The default noise (standard uncertainty) of readings is the value in the arm file. If the arm
    file states no noise, the default is 8 µrad. The default noise of references is 0.012 mm.
    Contacts have no noise by default.
    """
    _refuse_options_without_use(context, scheme, procedure, no_seat_coordinates)
    rng = np.random.default_rng(seed)
    with Results(files, output, arm_out) as results:
        model = model_of_file = arm.model()
        to_fill_in = None if procedure is None else Procedure.read(procedure, model.arm)
        effects = [cause_of(text, model) for text in effect or []]
        if random_geometry:
            # A stream of its own: the plan is the same without it.
            model = perturbed_model(model, rng.spawn(1)[0])
            note(
                "simulate chose the true geometry at random within the uncertainties of "
                f"{model.arm.name}, seed {seed}"
            )
        model = restrict_to_known_range(model.with_effects(*effects))
        noise = stated.simulated(model.arm)
        if to_fill_in is None:
            if scheme == "ball-bar" and bar_length is None:
                note(
                    f"the length of the bars is assumed to be {BAR_LENGTH_MM:g} mm; to replace "
                    "this value, use --bar-length-mm"
                )
                bar_length = BAR_LENGTH_MM * MM
            data = simulate_measurements(
                model,
                scheme,
                records,
                rng=rng,
                encoder_noise=noise.encoder,
                reference_noise=noise.reference,
                probe_noise=noise.probe,
                seats=seats,
                known=not no_seat_coordinates,
                bar_length=bar_length,
                orientation_noise=orientation_noise,
            )
            text = data.csv()
        else:
            data = simulate_touches(model, to_fill_in.q, to_fill_in.points, rng=rng, noise=noise)
            text = csv_text(to_fill_in.filled(data, model_of_file))
        results.text(text, output)
        _require_effects_shown(effects, model, data)
        encoder = ", ".join(f"{u / UM:.3g}" for u in dict.fromkeys(noise.encoder))
        words = f"the noise is {encoder} µrad (readings)"
        for source, size in (("references", noise.reference), ("contacts", noise.probe)):
            words += f", {size / MM:g} mm ({source})" if size else ""
        if arm_out is not None:
            results.arm(model, arm_out, f"The simulated arm of {data.source}; {words}.")
    status(f"{data}; {words}")


def _refuse_options_without_use(
    context: typer.Context, scheme: Scheme, procedure: Path | None, no_seat_coordinates: bool
) -> None:
    reasons = {
        option: f"requires --scheme {' or '.join(schemes)}"
        for option, schemes in SCHEMES_WITH.items()
        if scheme not in schemes
    }
    if no_seat_coordinates:
        without_reference = (
            "cannot be combined with --no-seat-coordinates, which states no reference"
        )
        reasons = (
            dict.fromkeys(("reference_noise", "orientation_noise"), without_reference) | reasons
        )
    if procedure is not None:
        options = ("scheme", "records", *SCHEMES_WITH)
        reasons = dict.fromkeys(options, "cannot be combined with --procedure")
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if parameter.name in reasons and source is not None and source.name != "DEFAULT":
            raise typer.BadParameter(f"{parameter.opts[0]} {reasons[parameter.name]}")


def _require_effects_shown(effects: list[Effect], model: ErrorModel, data: Measurements) -> None:
    for effect in effects:
        if not any(effect.values):
            values = ",".join(f"{name}=VALUE" for name in effect.file_values())
            raise AacmmError(f"--cause {effect.key}: no value; expected {effect.key},{values}")
        require_shown(effect, model.arm, data.q, data.conditions, "these records")
        if effect.of_reference and not data.known.any():
            raise AacmmError(
                f"--cause {effect.key}: this cause changes coordinates, but the records have none; "
                "use another scheme, or omit --no-seat-coordinates"
            )
