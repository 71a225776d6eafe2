"""Options of commands with measurements."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any

import typer

from aacmm_pin._support.plausible import LENGTH_NOISE
from aacmm_pin.calibration import ReferenceFrame, Target
from aacmm_pin.cli.arm_options import ContactNoise
from aacmm_pin.cli.common import length_option

FrameOfReferences = Annotated[
    ReferenceFrame,
    typer.Option(
        help="Frame of the reference data. base: base of the arm. external: an unknown frame, "
        "which the fit estimates. session: an unknown frame for each label in the column "
        "'session'."
    ),
]
TargetOfReferences = Annotated[
    Target,
    typer.Option(
        help="Point that the reference data describe. tip: the tip of the arm. unknown: a point "
        "at an unknown place of the last body. The calibrated arm has its tip at this point. "
        "frame: the tip, with orientations of the axes of the tip."
    ),
]

NoCrossValidation = Annotated[
    bool,
    typer.Option(
        "--no-cross-validation", help="Do not compute residuals of held-out records (faster)."
    ),
]


@dataclass(frozen=True)
class MeasuredHow(ContactNoise):
    """How records are measured, and what is known of the arm."""

    length_noise: Annotated[
        float | None,
        length_option("--u-bar-mm", "Standard uncertainty of the length of a bar.", LENGTH_NOISE),
    ] = None
    reference_frame: FrameOfReferences = "base"
    target: TargetOfReferences = "tip"
    no_prior: Annotated[
        bool, typer.Option("--no-prior", help="Ignore the uncertainties in the arm file.")
    ] = False

    def keywords(self) -> dict[str, Any]:
        """Keyword arguments of ``calibrate``, ``diagnose`` and ``plan_measurements``."""
        keywords = asdict(self)
        keywords["prior"] = not keywords.pop("no_prior")
        return keywords
