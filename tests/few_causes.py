"""A library of one cause, for what a diagnosis says whatever else may act: a search among few sets
takes a third of the time.
"""

from unittest.mock import patch

from aacmm_pin.effects import CAUSES, EncoderEccentricity

ECCENTRICITY_ALONE = patch.dict(
    CAUSES, {EncoderEccentricity.cause: EncoderEccentricity}, clear=True
)
"""For a test as a decorator, for a part of one as a context."""
