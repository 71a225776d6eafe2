"""Which arm a command is given, how it is measured, and how noisy: the arguments that commands on measurements share."""

from __future__ import annotations

from typing import Annotated

import typer

from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import bundled_arms
from aacmm_pin.cli.common import note
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.noise import ENCODER, PROBE, REFERENCE, Noise

BAR_LENGTH_MM = 500.0
"""Length of a ball bar where nothing is stated."""

MaybeArm = Annotated[
    str | None,
    typer.Argument(
        metavar="ARM", help=f"Bundled arm ({', '.join(bundled_arms())}) or path of an arm file; none with --urdf."
    ),
]
Data = Annotated[str | None, typer.Argument(metavar="DATA", help="Measurement file (CSV).", show_default=False)]
Urdf = Annotated[str | None, typer.Option("--urdf", metavar="FILE", help="Any serial arm by its URDF, in place of ARM.")]
FrameName = Annotated[
    str | None, typer.Option("--frame", metavar="NAME", help="With --urdf: the frame whose origin is the tip.")
]
TranslationHalfWidth = Annotated[
    float | None,
    typer.Option("--translation-half-width-mm", help="With --urdf: bound of the shifts of every joint placement, in mm."),
]
RotationHalfWidth = Annotated[
    float | None,
    typer.Option("--rotation-half-width-rad", help="With --urdf: bound of the turns of every joint placement, in rad."),
]
ReferenceNoise = Annotated[
    float | None, typer.Option("--reference-noise-mm", help="Standard uncertainty of a reference coordinate, in mm.")
]
ProbeNoise = Annotated[
    float | None, typer.Option("--probe-noise-mm", help="Standard uncertainty of a coordinate of one contact, in mm.")
]
LengthNoise = Annotated[
    float | None, typer.Option("--length-noise-mm", help="Standard uncertainty of a bar's length, in mm.")
]
FrameOfReferences = Annotated[str, typer.Option("--reference-frame", help="base, or external: an unknown frame.")]
TargetName = Annotated[str, typer.Option("--target", help="tip, or unknown: some point on the last body.")]
NoPrior = Annotated[bool, typer.Option("--no-prior", help="Do not use the arm's stated uncertainties.")]


def model_of(
    arm: str | None,
    urdf: str | None,
    frame: str | None,
    translation_mm: float | None = None,
    rotation_rad: float | None = None,
) -> ErrorModel:
    """The arm with its effects, from whichever of the arguments names it; half-widths are those of a URDF's placements.

    Raises:
        AacmmError: the arm cannot be used.
    """
    if (arm is None) == (urdf is None):
        raise typer.BadParameter("expected ARM, or --urdf FILE --frame NAME in its place")
    if (urdf is None) != (frame is None):
        raise typer.BadParameter("--urdf and --frame go together")
    if urdf is not None and frame is not None:
        half_widths = {"translation_half_width": (translation_mm or 0.0) * MM, "rotation_half_width": rotation_rad or 0.0}
        return ErrorModel(Arm.from_urdf(urdf, frame, **half_widths))
    if translation_mm is not None or rotation_rad is not None:
        raise typer.BadParameter(
            "--translation-half-width-mm and --rotation-half-width-rad go with --urdf; an arm file has its own"
        )
    return ErrorModel.load(str(arm))


def model_and_data(
    arm: str | None,
    data: str | None,
    urdf: str | None,
    frame: str | None,
    translation_mm: float | None = None,
    rotation_rad: float | None = None,
) -> tuple[ErrorModel, str]:
    """The same with a file of measurements behind; with ``--urdf`` that is the only argument.

    Raises:
        AacmmError: the arm cannot be used.
    """
    if urdf is not None and data is None:
        arm, data = None, arm
    if data is None:
        raise typer.BadParameter("expected ARM DATA, or --urdf FILE --frame NAME DATA")
    return model_of(arm, urdf, frame, translation_mm, rotation_rad), data


def in_metres(noise_mm: float | None) -> float | None:
    """The same in metres."""
    return None if noise_mm is None else noise_mm * MM


def noise_of(arm: Arm, encoder_rad: float | None, reference_mm: float | None, probe_mm: float | None) -> Noise:
    """Noise of virtual measurements; what is not given is what the arm states, or usual, which is then said.

    Raises:
        AacmmError: a number is negative or not finite.
    """
    encoder = encoder_rad if encoder_rad is not None else arm.encoder_noise
    if encoder is None:
        note(f"note: nobody states the noise of the encoders; {ENCODER:g} rad are assumed")
        encoder = ENCODER
    reference, probe = in_metres(reference_mm), in_metres(probe_mm)
    return Noise.of(
        arm.nq,
        encoder=encoder,
        reference=REFERENCE if reference is None else reference,
        probe=PROBE if probe is None else probe,
    )


def noise_in_words(noise: Noise) -> str:
    """What the noise is."""
    encoder = ", ".join(f"{u:g}" for u in dict.fromkeys(noise.encoder))
    return f"noise: readings {encoder} rad, references {noise.reference / MM:g} mm, contacts {noise.probe / MM:g} mm"


def bar_length(plan: str, stated_mm: float | None) -> float | None:
    """Length of the bars of a plan [m]; the usual one where a plan needs one and none is given."""
    if stated_mm is None and plan == "ball-bar":
        note(f"note: bars of {BAR_LENGTH_MM:g} mm are assumed; --bar-length-mm states another length")
        stated_mm = BAR_LENGTH_MM
    return in_metres(stated_mm)
