"""Options that commands share: which arm, how it is measured, and how noisy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from aacmm_pin._support import plausible
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import EXAMPLE_ROBOTS, Arm, bundled_arms, wide_half_width_notes
from aacmm_pin.cli.common import (
    ARM,
    NOISE,
    angle_option,
    length_option,
    note,
    warn,
)
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import ENCODER, PROBE, Noise
from aacmm_pin.measurements.noise import REFERENCE_NOISE

if TYPE_CHECKING:
    from aacmm_pin.measurements import Measurements

NAMES_LISTED = 20
"""So many frames of a URDF are listed."""
BUNDLED = ", ".join(bundled_arms())
ROBOTS = ", ".join(EXAMPLE_ROBOTS)

ApproachFromOrder = Annotated[
    bool,
    typer.Option(
        "--approach-from-order",
        help="Derive the direction of approach of each joint (approach1 …) from the order of the "
        "rows. The rows must be in the order of measurement.",
    ),
]


@dataclass(frozen=True)
class UrdfArm:
    """An arm by its URDF."""

    urdf: Annotated[
        str | None,
        typer.Option(
            "--urdf",
            metavar="FILE.urdf",
            help="URDF of a serial arm, instead of ARM.",
            rich_help_panel=ARM,
        ),
    ] = None
    frame: Annotated[
        str | None,
        typer.Option(
            "--frame",
            metavar="NAME",
            help="With --urdf: name of the frame at the tip.",
            rich_help_panel=ARM,
        ),
    ] = None

    @property
    def urdf_words(self) -> list[str]:
        """The options as they are typed; none where the arm is not given so."""
        return [] if self.urdf is None else ["--urdf", self.urdf, "--frame", str(self.frame)]

    def of_urdf(self, **half_widths: float) -> ErrorModel | None:
        """The arm, if it is given so; half-widths are those of its joint placements [m, rad].

        Raises:
            AacmmError: the arm cannot be used.
        """
        if self.urdf is None:
            if self.frame is not None:
                raise typer.BadParameter("--frame requires --urdf or the name of an example robot")
            return None
        if self.frame is None and self.urdf in EXAMPLE_ROBOTS:
            robot = EXAMPLE_ROBOTS[self.urdf]
            note(
                f"the tip of {self.urdf} is the origin of its frame {robot[1]}; to select another "
                "frame, use --frame NAME"
            )
        try:
            return ErrorModel(Arm.from_urdf(self.urdf, self.frame or "", **half_widths))
        except UnknownNameError as error:
            more = (
                f" … and {len(error.known) - NAMES_LISTED} more"
                if len(error.known) > NAMES_LISTED
                else ""
            )
            frames = (
                f"expected a frame of {self.urdf} (from the last to the first): "
                f"{', '.join(error.known[: -NAMES_LISTED - 1 : -1])}{more}"
            )
            if self.frame is not None:
                raise AacmmError(f"unknown frame {self.frame!r}; {frames}") from None
            raise typer.BadParameter(f"--urdf requires --frame NAME; {frames}") from None


@dataclass(frozen=True)
class AnyArm(UrdfArm):
    """An arm by its name or file, or by its URDF."""

    arm: Annotated[
        str | None,
        typer.Argument(
            metavar="ARM",
            help=f"Name of a bundled arm ({BUNDLED}) or of an example robot ({ROBOTS}), or path of "
            "an arm file. Omit ARM with --urdf.",
        ),
    ] = None

    def __post_init__(self) -> None:
        """Take an example robot as the URDF that it is."""
        if self.urdf is None and self.arm in EXAMPLE_ROBOTS:
            object.__setattr__(self, "urdf", self.arm)
            object.__setattr__(self, "arm", None)

    def model(self, **half_widths: float) -> ErrorModel:
        """The arm with its effects; see :meth:`UrdfArm.of_urdf`.

        Raises:
            AacmmError: the arm cannot be used.
        """
        if (self.arm is None) == (self.urdf is None):
            raise typer.BadParameter("state ARM, or --urdf FILE and --frame NAME")
        model = self.of_urdf(**half_widths) or ErrorModel.load(str(self.arm))
        # What a calibration left open has wide half-widths.
        own = [] if model.arm.covariance is not None else model.arm.parameters
        for line in wide_half_width_notes(own):
            warn(line)
        return model


@dataclass(frozen=True)
class UncertainArm(AnyArm):
    """An arm whose uncertainty matters; that of a URDF is given by options."""

    translation_half_width_mm: Annotated[
        float | None,
        length_option(
            "With --urdf: half-width of each translation of every joint placement. 0: the arm has "
            "no stated half-width.",
            plausible.SHIFT_HALF_WIDTH,
            ARM,
        ),
    ] = None
    rotation_half_width: Annotated[
        float | None,
        angle_option(
            "With --urdf: half-width of each rotation of every joint placement, in rad or as "
            "20arcsec. 0: the arm has no stated half-width.",
            plausible.TURN_HALF_WIDTH,
            ARM,
        ),
    ] = None

    def model(self, **half_widths: float) -> ErrorModel:
        """See :meth:`AnyArm.model`; the half-widths are those of the options."""
        shift, turn = self.translation_half_width_mm, self.rotation_half_width
        if self.urdf is None and (shift is not None or turn is not None):
            raise typer.BadParameter(
                "--translation-half-width-mm and --rotation-half-width require --urdf; an arm file "
                "states half-widths in [joints.uncertainty]"
            )
        return super().model(
            translation_half_width=(shift or 0.0) * MM, rotation_half_width=turn or 0.0
        )


@dataclass(frozen=True)
class ArmAndData(UncertainArm):
    """An arm and a file of measurements; with ``--urdf`` the file is the only argument."""

    data: Annotated[
        str | None,
        typer.Argument(metavar="DATA", help="Measurement file (CSV)."),
    ] = None
    approach_from_order: ApproachFromOrder = False
    references: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Second file, with the reference data. The command joins rows of both files with "
            "the same label in the column 'record'. Without this column, both files must have the "
            "same rows in the same order.",
        ),
    ] = None

    def model_and_data(self) -> tuple[ErrorModel, str]:
        """The arm with its effects, and the path of the file.

        Raises:
            AacmmError: the arm cannot be used.
        """
        given = (
            replace(self, arm=None, data=self.arm)
            if self.urdf is not None and self.data is None
            else self
        )
        if given.data is None:
            raise typer.BadParameter("state ARM and DATA, or --urdf FILE, --frame NAME and DATA")
        return given.model(), given.data

    def records(self, model: ErrorModel, path: str) -> Measurements:
        """The records of the file.

        Raises:
            AacmmError: they cannot be used.
        """
        from aacmm_pin.measurements import Measurements  # which loads pandas

        records = Measurements.read(path, model.arm.nq, self.references)
        return self.with_approach(records.with_joint_angles(model.arm))

    def with_approach(self, records: Measurements) -> Measurements:
        """The records with directions of approach, if these come from the order of the rows.

        Raises:
            AacmmError: they state such directions.
        """
        return records.with_approach_from_order() if self.approach_from_order else records


@dataclass(frozen=True)
class EncoderNoise:
    """Standard uncertainties as stated with a command."""

    encoder_noise: Annotated[
        float | None,
        angle_option(
            "Standard uncertainty of one reading of each joint, in rad or with a unit, such as "
            "8urad.",
            plausible.ENCODER_NOISE,
            NOISE,
        ),
    ] = None


@dataclass(frozen=True)
class MeasuringNoise(EncoderNoise):
    """The same of contacts too."""

    probe_noise_mm: Annotated[
        float | None,
        length_option(
            "Standard uncertainty of a coordinate of one contact.", plausible.LENGTH_NOISE, NOISE
        ),
    ] = None


@dataclass(frozen=True)
class ContactNoise(MeasuringNoise):
    """The same of references too."""

    u_reference_mm: Annotated[
        float | None,
        length_option(
            "Standard uncertainty of a reference coordinate.", plausible.LENGTH_NOISE, NOISE
        ),
    ] = None

    def simulated(self, arm: Arm) -> Noise:
        """Noise of virtual measurements; if it is not given, that of the arm, else a typical one
        with a note.
        """
        encoder = arm.encoder_noise if self.encoder_noise is None else self.encoder_noise
        if encoder is None:
            note(str(Note("encoder_noise_assumed", {"noise": ENCODER})))
            encoder = ENCODER
        reference, probe = in_metres(self.u_reference_mm), in_metres(self.probe_noise_mm)
        return Noise.of(
            arm.nq,
            encoder=encoder,
            reference=REFERENCE_NOISE if reference is None else reference,
            probe=PROBE if probe is None else probe,
        )


def in_metres(length_mm: float | None) -> float | None:
    """The same in metres."""
    return None if length_mm is None else length_mm * MM


def restrict_to_known_range(model: ErrorModel) -> ErrorModel:
    """The model whose joints stay where its effects are known; says which do, where that is not
    their whole range.
    """
    within = model.restricted_to_known_range()
    for j in np.flatnonzero((within.arm.limits != model.arm.limits).any(axis=1)):
        low, high = within.arm.limits[j] / (MM if model.arm.chain.prismatic[j] else DEG)
        unit = " mm" if model.arm.chain.prismatic[j] else "°"
        note(
            f"the command uses joint {j + 1} only from {low:.4g}{unit} to {high:.4g}{unit}, "
            "because the arm states the error of this joint only there"
        )
    return within
