"""Noise of readings, references and contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, vector

ENCODER = 8e-6
"""Default u of a reading [rad]: a good optical encoder, 1.6″."""
REFERENCE_NOISE = 1.2e-5
"""Default u of a reference coordinate [m]: a laser tracker at 2 m."""
PROBE = 0.0
"""Default u of a contact [m]."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard uncertainties of what is new in every record or reference.

    Attributes:
        encoder: of one reading (nq,) [rad; m for prismatic joints].
        reference: of each coordinate of a seat or free point [m].
        probe: of each coordinate of a contact [m].
    """

    encoder: Array
    reference: float = REFERENCE_NOISE
    probe: float = PROBE

    @staticmethod
    def of(
        nq: int,
        *,
        encoder: ArrayLike = ENCODER,
        reference: float = REFERENCE_NOISE,
        probe: float = PROBE,
    ) -> Noise:
        """Noise of ``nq`` joints; ``encoder`` is (nq,), or one number [rad].

        Raises:
            ShapeError: ``encoder`` has another number of entries.
            AacmmError: a number is negative, not finite, or implausible.
        """
        if np.ndim(encoder) == 0:
            encoder = np.full(nq, encoder, dtype=np.float64)
        of_joints = vector(encoder, nq, "encoder noise", "rad")
        plausible.ENCODER_NOISE.check(of_joints, "encoder noise")
        plausible.LENGTH_NOISE.check(reference, "reference noise")
        plausible.LENGTH_NOISE.check(probe, "probe noise")
        return Noise(of_joints, float(reference), float(probe))
