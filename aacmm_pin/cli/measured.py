"""What needs measurements: virtual ones, calibration, correction."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy.volume import accuracy_volume
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.arm.urdf import urdf_text
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.calibration.calibrate import ReferenceFrame
from aacmm_pin.calibration.parameters import Target
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.cli.common import EncoderNoise, Force, Json, Output, Plot, Results, command, note
from aacmm_pin.cli.effect_option import EffectTexts, check_rows, effects_of, known_effects
from aacmm_pin.cli.given import (
    Data,
    FrameName,
    MaybeArm,
    ProbeNoise,
    ReferenceNoise,
    RotationHalfWidth,
    TranslationHalfWidth,
    Urdf,
    bar_length,
    in_metres,
    model_and_data,
    model_of,
    noise_in_words,
    noise_of,
)
from aacmm_pin.cli.readings import read_readings
from aacmm_pin.cli.said import say_calibration
from aacmm_pin.effects import JointErrorCurve, StylusOffset
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnsupportedArmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import PLANS, Plan, simulate_measurements
from aacmm_pin.report.calibration_findings import calibration_summary, comment, not_in_urdf

CORRECTED = ("corrected_x_mm", "corrected_y_mm", "corrected_z_mm", "u_mm")
"""The columns that ``correct`` adds."""

Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is drawn.")]


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


@command("calibrate")
def calibrate_(
    arm: MaybeArm = None,
    data: Data = None,
    parameters: Annotated[str, typer.Option(help="One of zero-offsets, geometry.")] = "geometry",
    effect: EffectTexts = None,
    reference_frame: Annotated[str, typer.Option(help="base, or external: an unknown frame.")] = "base",
    target: Annotated[str, typer.Option(help="tip, or unknown: some point on the last body.")] = "tip",
    no_prior: Annotated[bool, typer.Option("--no-prior", help="Do not use the arm's stated uncertainties.")] = False,
    encoder_noise_rad: EncoderNoise = None,
    reference_noise_mm: ReferenceNoise = None,
    probe_noise_mm: ProbeNoise = None,
    length_noise_mm: Annotated[float | None, typer.Option(help="Standard uncertainty of a bar's length, in mm.")] = None,
    no_held_out: Annotated[bool, typer.Option("--no-held-out", help="Do not predict records left out of the fit.")] = False,
    seed: Seed = 1,
    urdf: Urdf = None,
    frame: FrameName = None,
    translation_half_width_mm: TranslationHalfWidth = None,
    rotation_half_width_rad: RotationHalfWidth = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Arm file for the calibrated arm.")] = None,
    urdf_out: Annotated[Path | None, typer.Option(help="URDF for the calibrated arm.")] = None,
    residuals: Annotated[Path | None, typer.Option(help="CSV file: every record with its residuals.")] = None,
    plot: Plot = None,
    report: Annotated[Path | None, typer.Option(help="HTML page of all that was found.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Parameters of an arm from measurements, with their uncertainty and what the data cannot tell."""
    with Results(force, output, urdf_out, residuals, report, plot=plot, json_=json_) as results:
        model, path = model_and_data(arm, data, urdf, frame, translation_half_width_mm, rotation_half_width_rad)
        if output is not None and model.arm.dh is None:
            raise UnsupportedArmError(
                f"{output}: an arm file needs a DH table, {model.arm.name} came as URDF; use --urdf-out"
            )
        effects = known_effects(effect, model)
        check_rows(effects, model)
        result = calibrate(
            model,
            Measurements.read(path, model.arm.nq),
            [parameters, *effects],
            reference_frame=cast(ReferenceFrame, reference_frame),
            target=cast(Target, target),
            prior=False if no_prior else None,
            encoder_noise=encoder_noise_rad,
            reference_noise=in_metres(reference_noise_mm),
            probe_noise=in_metres(probe_noise_mm),
            length_noise=in_metres(length_noise_mm),
            hold_out=not no_held_out,
            rng=np.random.default_rng(seed),
        )
        when = f"{datetime.now(UTC):%Y-%m-%d}"
        if output is not None:
            result.model.save(results.file(output), comment=comment(result, path, when))
        if urdf_out is not None:
            results.file(urdf_out).write_bytes(_urdf(model, result))
        if residuals is not None:
            results.text(result.residuals.to_csv(index=False), residuals)
        if plot is not None:
            results.picture(result.plot("all")[0].figure, plot)
        summary = calibration_summary(result, path, seed)
        if report is not None:
            from aacmm_pin.report.calibration_page import calibration_page  # loads what draws

            results.text(calibration_page(result, summary, when), report)
        if json_ is not None:
            results.json(summary, json_)
    if json_ != "-":
        say_calibration(result)


def _urdf(model: ErrorModel, result: Calibration) -> bytes:
    """The calibrated arm as URDF, as far as a URDF can say it."""
    lost = not_in_urdf(result)
    if lost:
        note(f"note: a URDF has no place for {', '.join(lost)}")
    arm = result.model.arm
    if arm.dh is not None:
        return urdf_text(result.model.file(), with_stylus_offset=True).encode()
    offsets = [e.values for e in result.model.effects if isinstance(e, StylusOffset) and e.marker is None]
    return corrected_urdf(model.arm, arm, np.sum(offsets, axis=0) if offsets else None)


@command()
def correct(
    arm: MaybeArm = None,
    data: Data = None,
    encoder_noise_rad: EncoderNoise = None,
    urdf: Urdf = None,
    frame: FrameName = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Tip coordinates of readings by the calibrated arm with its effects, with their uncertainty, as CSV."""
    with Results(force, output) as results:
        model, path = model_and_data(arm, data, urdf, frame)
        table, readings = read_readings(path, model.arm.nq, CORRECTED)
        rows = _known_rows(model, readings, path)
        known = readings.take(rows)
        found = np.full((readings.n, len(CORRECTED)), np.nan)
        try:
            found[rows, :3] = model.correct(known.q, known.conditions) / MM
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
        found[rows, 3] = _u(model, known, encoder_noise_rad) / MM
        added = dict(zip(CORRECTED, found.T, strict=True))
        results.text(table.assign(**added).to_csv(index=False, lineterminator="\n"), output)
    effects = ", ".join(effect.label for effect in model.effects) or "no effects"
    note(f"{path}: {known.n} of {readings.n} readings corrected by {model.arm.name} with {effects}")


def _known_rows(model: ErrorModel, readings: Measurements, path: str) -> Index:
    """The readings that can be corrected; the others, outside the range of an error curve, are listed on stderr.

    Raises:
        AacmmError: none can be.
    """
    known = model.known_at(readings.q)
    for k, number in zip(*np.nonzero(~known), strict=True):
        effect = model.effects[number]
        known_range = ""
        if isinstance(effect, JointErrorCurve):
            low, high = effect.lower_rad, effect.upper_rad
            known_range = f", which is known from {low:g} to {high:g} rad ({low / DEG:g}° to {high / DEG:g}°)"
        note(f"{path}: row {readings.row[k]} is outside the range of {effect.label}{known_range}; left empty")
    rows = np.flatnonzero(known.all(axis=1))
    if readings.n and not rows.size:
        raise AacmmError(f"{path}: no reading is in the range in which the effects of {model.arm.name} are known")
    return rows


def _u(model: ErrorModel, readings: Measurements, encoder_noise: float | None) -> Array:
    """Standard uncertainty of each position (n,) [m]; nan where nobody states any."""
    noise = model.arm.encoder_noise if encoder_noise is None else np.array([encoder_noise])
    if not (np.diag(model.covariance()).any() or (noise is not None and noise.any())):
        note(f"note: {model.arm.name} states no uncertainty, so u_mm is left empty")
        return np.full(readings.n, np.nan)
    if noise is None:
        note("note: u_mm is of the parameters alone; --encoder-noise-rad adds the noise of the readings")
    return accuracy_volume(
        model, readings.q, conditions=readings.conditions, method="ellipsoid", encoder_noise=encoder_noise
    ).u
