"""Libraries of few causes, for what a diagnosis says whatever else may act.

Without waves and curves of angles a search takes half of the time, among few sets a third.
"""

from unittest.mock import patch

from aacmm_pin.effects import CAUSES, EncoderEccentricity

WAVES = ("joint_periodic_error", "second_periodic_error", "joint_error_curve")
NO_WAVES = patch.dict(
    CAUSES, {name: cause for name, cause in CAUSES.items() if name not in WAVES}, clear=True
)
"""For a test as a decorator, for a part of one as a context."""
ECCENTRICITY_ALONE = patch.dict(
    CAUSES, {EncoderEccentricity.cause: EncoderEccentricity}, clear=True
)
