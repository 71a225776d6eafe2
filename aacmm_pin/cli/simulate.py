"""Virtual measurements of an arm with known errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.calibration.random_arm import perturbed_model
from aacmm_pin.cli.arm_options import ContactNoise, UncertainArm, in_metres, restrict_to_known_range
from aacmm_pin.cli.common import (
    CsvOutput,
    EffectTexts,
    Force,
    Results,
    Seed,
    angle_option,
    command,
    note,
    refuse,
)
from aacmm_pin.effects import Effect, ErrorModel, require_shown, stated_cause
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import (
    PLANS,
    Measurements,
    Noise,
    Plan,
    simulate_measurements,
    simulate_touches,
)
from aacmm_pin.verification import Procedure

OPTION_OF = {
    "records": PLANS,
    "no_seat_coordinates": ("seats",),
    "seats": ("seats", "ball-bar"),
    "bar_length_mm": ("ball-bar",),
    "reference_noise_mm": ("free", "seats", "ball-bar"),
    "orientation_noise_rad": ("free", "seats"),
}
"""Which plans use an option, by the name of its argument."""
BAR_LENGTH_MM = 500.0
"""Length of a ball bar where none is stated."""


@dataclass(frozen=True)
class Planned:
    """What is measured."""

    plan: Annotated[
        str,
        typer.Option(
            help=f"One of {', '.join(PLANS)}; or a procedure (CSV) by plan --for acceptance, "
            "whose touches are filled in."
        ),
    ] = "seats"
    records: Annotated[int, typer.Option(help="Number of records.")] = 300
    seats: Annotated[
        int, typer.Option(help="With plans seats, ball-bar: number of seats; two for each bar.")
    ] = 10
    no_seat_coordinates: Annotated[
        bool,
        typer.Option(
            "--no-seat-coordinates", help="With plan seats: do not state their coordinates."
        ),
    ] = False
    bar_length_mm: Annotated[
        float | None, typer.Option(help="With plan ball-bar: length of the bars.")
    ] = None
    orientation_noise_rad: Annotated[
        float | None,
        angle_option(
            "With coordinates: orientations of the tip too, with this standard uncertainty, in "
            "rad or as 50urad."
        ),
    ] = None

    def refuse_others(self, context: typer.Context) -> None:
        """Refuse options that this plan has no use for."""
        for option, plans in OPTION_OF.items():
            if (self.plan in PLANS or self.plan.endswith(".csv")) and self.plan not in plans:
                refuse(context, [option], f"requires --plan {' or '.join(plans)}")
        if self.no_seat_coordinates:
            refuse(
                context,
                ["reference_noise_mm", "orientation_noise_rad"],
                "cannot be combined with --no-seat-coordinates, which states no reference",
            )

    def measured(self, model: ErrorModel, noise: Noise, rng: np.random.Generator) -> Measurements:
        """Records of an arm, by a plan that is no procedure."""
        length = in_metres(self.bar_length_mm)
        if self.plan == "ball-bar" and length is None:
            note(
                f"note: bar length not given: {BAR_LENGTH_MM:g} mm assumed; --bar-length-mm "
                "replaces it"
            )
            length = BAR_LENGTH_MM * MM
        return simulate_measurements(
            model,
            cast(Plan, self.plan),
            self.records,
            rng=rng,
            encoder_noise=noise.encoder,
            reference_noise=noise.reference,
            probe_noise=noise.probe,
            seats=self.seats,
            known=not self.no_seat_coordinates,
            bar_length=length,
            orientation_noise=self.orientation_noise_rad,
        )


@command(
    "aacmm-pin simulate sino6 --plan free --records 200 --random-geometry -o data.csv",
    "aacmm-pin simulate sino6 --plan seats --cause joint_compliance:2,"
    "compliance_rad_per_nm=2e-5 -o data.csv",
)
def run(
    context: typer.Context,
    arm: UncertainArm,
    planned: Planned,
    effect: EffectTexts = None,
    random_geometry: Annotated[
        bool,
        typer.Option(
            "--random-geometry", help="Draw the true geometry within the arm's uncertainties."
        ),
    ] = False,
    seed: Seed = 1,
    *,
    stated: ContactNoise,
    output: CsvOutput = None,
    arm_out: Annotated[
        Path | None, typer.Option(help="Arm file of the simulated arm, with its effects.")
    ] = None,
    force: Force = False,
) -> None:
    """Simulate measurements of an arm with known errors (CSV)."""
    planned.refuse_others(context)
    rng = np.random.default_rng(seed)
    procedure = planned.plan if planned.plan.endswith(".csv") else None
    with Results(force, output, arm_out) as results:
        model = as_filed = arm.model()
        touches = None if procedure is None else Procedure.read(procedure, model.arm)
        effects = [stated_cause(text, model) for text in effect or []]
        if random_geometry:
            # A stream of its own: the plan is the same without it.
            model = perturbed_model(model, rng.spawn(1)[0])
            note(
                f"note: the true geometry was drawn within the uncertainties of {model.arm.name}, "
                f"seed {seed}"
            )
        model = restrict_to_known_range(model.with_effects(*effects))
        noise = stated.simulated(model.arm)
        if touches is None:
            data = planned.measured(model, noise, rng)
        else:
            data = simulate_touches(model, touches.q, touches.points, rng=rng, noise=noise)
        results.text(
            data.csv() if touches is None else csv_text(touches.filled(data, as_filed)), output
        )
        _require_effects_shown(effects, model, data)
        encoder = ", ".join(f"{u:g}" for u in dict.fromkeys(noise.encoder))
        words = (
            f"noise: readings {encoder} rad, references {noise.reference / MM:g} mm, contacts "
            f"{noise.probe / MM:g} mm"
        )
        if arm_out is not None:
            results.arm(model, arm_out, f"The arm behind: {data.source}; {words}.")
    note(f"{data}; {words}")


def _require_effects_shown(effects: list[Effect], model: ErrorModel, data: Measurements) -> None:
    """Refuse effects without a size, and those that no record shows."""
    for given in effects:
        if not any(given.values):
            raise AacmmError(
                f"--cause {given.key}: no value is given; expected "
                f"{', '.join(given.notation.parameters(given))}"
            )
        require_shown(given, model.arm, data.q, data.conditions, "this plan")
        if given.of_reference and not data.known.any():
            raise AacmmError(
                f"--cause {given.key}: is of stated coordinates, which records of this plan do "
                "not have"
            )
