"""How records were taken, and what is known before they are looked at."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, vector
from aacmm_pin._support.display import Note
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel, GivenModel, known_range_in_words
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import Measurements, as_measurements

ReferenceFrame = Literal["base", "external", "session"]
Target = Literal["tip", "unknown", "frame"]


@dataclass(frozen=True, eq=False)
class Setup:
    """Reference frame, target, prior and noise of records, as the keywords of :func:`calibrate`; a
    noise that is not stated is None.

    Attributes:
        encoder_noise: of each joint (nq,) [rad].
        moved_frames: rotation (3, 3) and shift (3,) [m] with which the references of each session
            are in the frame of the first.

    Raises:
        UnknownNameError: no such frame or target.
        AacmmError: a noise is negative, not finite, or larger than any arm's: in another unit.
    """

    reference_frame: ReferenceFrame = "base"
    target: Target = "tip"
    prior: bool = True
    encoder_noise: Array | None = None
    reference_noise: float | None = None
    probe_noise: float | None = None
    length_noise: float | None = None
    moved_frames: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, choice in (("reference_frame", ReferenceFrame), ("target", Target)):
            if getattr(self, name) not in get_args(choice):
                raise UnknownNameError(
                    name.replace("_", " "), getattr(self, name), list(get_args(choice))
                )
        for name in ("encoder", "reference", "probe", "length"):
            noise = getattr(self, f"{name}_noise")
            if noise is not None:
                range_ = plausible.ENCODER_NOISE if name == "encoder" else plausible.LENGTH_NOISE
                range_.check(noise, f"{name}_noise")

    @staticmethod
    def of(
        arm: Arm,
        reference_frame: ReferenceFrame = "base",
        target: Target = "tip",
        prior: bool = True,
        encoder_noise: ArrayLike | None = None,
        reference_noise: float | None = None,
        probe_noise: float | None = None,
        length_noise: float | None = None,
    ) -> Setup:
        """From the keywords of public functions; the default encoder noise is the arm's."""
        encoder = arm.encoder_noise
        if encoder_noise is not None:
            stated = np.asarray(encoder_noise, dtype=np.float64)
            stated = np.full(arm.nq, stated) if stated.ndim == 0 else stated
            encoder = vector(stated, arm.nq, "encoder_noise", "rad")
        return Setup(
            reference_frame, target, prior, encoder, reference_noise, probe_noise, length_noise
        )

    @property
    def external(self) -> bool:
        """Whether the frame of the references is unknown."""
        return self.reference_frame != "base"

    @property
    def frame_of_session(self) -> bool:
        """Whether each session has a frame of its own."""
        return self.reference_frame == "session"

    def unstated(self, measurements: Measurements) -> list[str]:
        """Noise that is not stated although χ² needs it."""
        unstated = []
        reference_u = measurements.reference_u[measurements.placed]
        if self.reference_noise is None and not np.isfinite(reference_u).all():
            unstated.append("reference coordinates")
        turn_u = measurements.orientation_u
        if turn_u is None:
            turn_u = np.full(measurements.n, np.nan)
        if not np.isfinite(turn_u[measurements.oriented]).all():
            unstated.append("orientations")
        # Without any of these, repeated contacts of a seat would have to give one and the same tip.
        seats = measurements.seats().values()
        all_placed = all(measurements.placed[records].any() for records in seats)
        if seats and self.probe_noise is None and (self.encoder_noise is None or not all_placed):
            unstated.append("contacts in seats")
        return unstated


def sessions_of(measurements: Measurements) -> list[str]:
    """Labels of the sessions with references, in the order of their records.

    Raises:
        AacmmError: a record with a reference has none.
    """
    stated = measurements.conditions.require("session", "--reference-frame session")
    labels = stated[measurements.placed]
    if (labels == "").any():
        row = int(measurements.row[measurements.placed][labels == ""][0])
        raise AacmmError(
            f"{measurements.source}: row {row}, column session: empty cell; expected a label in "
            "each row with a reference, because each session has its own reference frame"
        )
    return [str(label) for label in dict.fromkeys(labels)]


def checked_input(
    model: GivenModel, measurements: object, asked: Collection[str] = ()
) -> tuple[ErrorModel, Measurements]:
    """Model and measurements, given or by name or path.

    Records outside the range of a known effect that is not ``asked`` for are left out, as
    ``read_as`` then states, unless all are.

    Raises:
        AacmmError: no records, or another number of joints.
    """
    model = ErrorModel.of(model)
    measurements = as_measurements(measurements, model.arm)
    if not measurements.n:
        raise AacmmError(f"{measurements.source} has no records; expected one or more")
    if measurements.nq != model.arm.nq:
        raise AacmmError(
            f"{measurements.source} has angles of {measurements.nq} joints; expected "
            f"{model.arm.nq}, as many as {model.arm.name} has"
        )
    inside_range = model.known_at(measurements.q) | np.array(
        [effect.label in asked for effect in model.effects], dtype=bool
    )
    used = inside_range.all(axis=1)
    if used.all() or not used.any():
        return model, measurements
    notes = [*measurements.read_as]
    for effect, inside in zip(model.effects, inside_range.T, strict=True):
        if not inside.all():
            cause = f"{effect.label}{known_range_in_words(effect)}"
            rows = measurements.row[~inside].tolist()
            data = {"records": len(rows), "of": measurements.n, "cause": cause, "rows": rows}
            notes.append(Note("outside_known_range", data))
    return model, replace(measurements.take(used), read_as=tuple(notes))
