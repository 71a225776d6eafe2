"""Options that commands share: the arm, and how it is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from aacmm_pin._support import plausible
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import EXAMPLE_ROBOTS, Arm, bundled_arms, wide_half_width_notes
from aacmm_pin.cli.common import (
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
"""Frames of a URDF in a message."""
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
        ),
    ] = None
    frame: Annotated[
        str | None,
        typer.Option(
            "--frame",
            metavar="NAME",
            help="With --urdf: name of the frame at the tip.",
        ),
    ] = None

    @property
    def urdf_words(self) -> list[str]:
        """Options as typed; [] without ``--urdf``."""
        return [] if self.urdf is None else ["--urdf", self.urdf, "--frame", str(self.frame)]

    @property
    def half_widths(self) -> dict[str, float]:
        """For :meth:`Arm.from_urdf` [m, rad]."""
        return {}

    def of_urdf(self) -> ErrorModel | None:
        """The arm; None without ``--urdf``.

        Raises:
            AacmmError: it cannot be used.
        """
        if self.urdf is None:
            if self.frame is not None:
                raise typer.BadParameter("--frame requires --urdf or the name of an example robot")
            return None
        if self.frame is None and self.urdf in EXAMPLE_ROBOTS:
            _, frame = EXAMPLE_ROBOTS[self.urdf]
            note(
                f"the tip of {self.urdf} is the origin of its frame {frame}; to select another "
                "frame, use --frame NAME"
            )
        try:
            return ErrorModel(Arm.from_urdf(self.urdf, self.frame or "", **self.half_widths))
        except UnknownNameError as error:
            last_frames = ", ".join(error.known[: -NAMES_LISTED - 1 : -1])
            frames = f"expected a frame of {self.urdf} (from the last to the first): {last_frames}"
            if len(error.known) > NAMES_LISTED:
                frames += f" … and {len(error.known) - NAMES_LISTED} more"
            if self.frame is not None:
                raise AacmmError(f"unknown frame {self.frame!r}; {frames}") from None
            raise typer.BadParameter(f"--urdf requires --frame NAME; {frames}") from None


@dataclass(frozen=True)
class AnyArm(UrdfArm):
    """An arm by name or file, or by its URDF."""

    arm: Annotated[
        str | None,
        typer.Argument(
            metavar="ARM",
            help=f"Name of a bundled arm ({BUNDLED}) or of an example robot ({ROBOTS}), or path of "
            "an arm file. Omit ARM with --urdf.",
        ),
    ] = None

    def __post_init__(self) -> None:
        """The name of an example robot as ARM stands for ``--urdf`` with this name."""
        if self.urdf is None and self.arm in EXAMPLE_ROBOTS:
            object.__setattr__(self, "urdf", self.arm)
            object.__setattr__(self, "arm", None)

    def model(self) -> ErrorModel:
        """The arm with its effects.

        Raises:
            AacmmError: it cannot be used.
        """
        if (self.arm is None) == (self.urdf is None):
            raise typer.BadParameter("state ARM, or --urdf FILE and --frame NAME")
        if self.urdf is None and self.half_widths:
            raise typer.BadParameter(
                "--translation-half-width-mm and --rotation-half-width require --urdf; an arm file "
                "states half-widths in [joints.uncertainty]"
            )
        model = self.of_urdf() or ErrorModel.load(str(self.arm))
        # What a calibration left open has wide half-widths.
        if model.arm.covariance is None:
            for line in wide_half_width_notes(model.arm.parameters):
                warn(line)
        return model


@dataclass(frozen=True)
class UncertainArm(AnyArm):
    """An arm with uncertainty; options state that of a URDF."""

    translation_half_width: Annotated[
        float | None,
        length_option(
            "--translation-half-width-mm",
            "With --urdf: half-width of each translation of every joint placement. 0: the arm has "
            "no stated half-width.",
            plausible.SHIFT_HALF_WIDTH,
        ),
    ] = None
    rotation_half_width: Annotated[
        float | None,
        angle_option(
            "With --urdf: half-width of each rotation of every joint placement, in rad or as "
            "20arcsec. 0: the arm has no stated half-width.",
            plausible.TURN_HALF_WIDTH,
        ),
    ] = None

    @property
    def half_widths(self) -> dict[str, float]:
        """Those of the options."""
        widths = {
            "translation_half_width": self.translation_half_width,
            "rotation_half_width": self.rotation_half_width,
        }
        return {name: width for name, width in widths.items() if width is not None}


@dataclass(frozen=True)
class ArmAndData(UncertainArm):
    """An arm and a file; with ``--urdf`` the file is the only argument."""

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
    relations: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="Table of known distances and angles between planes of one body, such as a cube "
            "or a step gauge.",
        ),
    ] = None

    def model_and_data(self) -> tuple[ErrorModel, str]:
        """The arm, and the path of the file.

        Raises:
            AacmmError: it cannot be used.
        """
        if self.data is not None:
            return self.model(), self.data
        if self.urdf is None or self.arm is None:
            raise typer.BadParameter("state ARM and DATA, or --urdf FILE, --frame NAME and DATA")
        # With --urdf, the only argument is DATA, which typer takes for ARM.
        return replace(self, arm=None).model(), self.arm

    def records(self, model: ErrorModel, path: str) -> Measurements:
        """The records of the file.

        Raises:
            AacmmError: they cannot be used.
        """
        from aacmm_pin.measurements import Measurements  # which loads pandas

        records = Measurements.read(path, model.arm.nq, self.references)
        if self.relations is not None:
            records = records.with_relations(self.relations)
        return self.with_approach(records.with_joint_angles(model.arm))

    def with_approach(self, records: Measurements) -> Measurements:
        """The records, perhaps with directions from the order of the rows.

        Raises:
            AacmmError: they state directions.
        """
        return records.with_approach_from_order() if self.approach_from_order else records


@dataclass(frozen=True)
class EncoderNoise:
    """As stated with a command."""

    encoder_noise: Annotated[
        float | None,
        angle_option(
            "Standard uncertainty of one reading of each joint, in rad or with a unit, such as "
            "8urad.",
            plausible.ENCODER_NOISE,
        ),
    ] = None


@dataclass(frozen=True)
class ContactNoise(EncoderNoise):
    """Of contacts and references too."""

    probe_noise: Annotated[
        float | None,
        length_option(
            "--probe-noise-mm",
            "Standard uncertainty of a coordinate of one contact.",
            plausible.LENGTH_NOISE,
        ),
    ] = None
    reference_noise: Annotated[
        float | None,
        length_option(
            "--u-reference-mm",
            "Standard uncertainty of a reference coordinate.",
            plausible.LENGTH_NOISE,
        ),
    ] = None

    def simulated(self, arm: Arm) -> Noise:
        """Noise to simulate: as stated, else that of the arm, else typical, with a note."""
        encoder = arm.encoder_noise if self.encoder_noise is None else self.encoder_noise
        if encoder is None:
            note(str(Note("encoder_noise_assumed", {"noise": ENCODER})))
            encoder = ENCODER
        return Noise.of(
            arm.nq,
            encoder=encoder,
            reference=REFERENCE_NOISE if self.reference_noise is None else self.reference_noise,
            probe=PROBE if self.probe_noise is None else self.probe_noise,
        )


def restrict_to_known_range(model: ErrorModel) -> ErrorModel:
    """Limit joints to where effects are known, with notes."""
    within = model.restricted_to_known_range()
    for j in np.flatnonzero((within.arm.limits != model.arm.limits).any(axis=1)):
        unit, size = (" mm", MM) if model.arm.chain.prismatic[j] else ("°", DEG)
        low, high = within.arm.limits[j] / size
        note(
            f"the command uses joint {j + 1} only from {low:.4g}{unit} to {high:.4g}{unit}, "
            "because the arm states the error of this joint only there"
        )
    return within
