"""Libraries of few causes, for what a diagnosis says whatever else may act.

Without waves and curves of angles a search takes half of the time, among few sets a third. Half of
the columns of covariates are products of two joints: without these, it takes 30 % less.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import ContextDecorator, ExitStack
from unittest.mock import patch

from aacmm_pin.arm import Arm
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.diagnosis.covariates import Covariate, covariates
from aacmm_pin.effects import CAUSES, EncoderEccentricity
from aacmm_pin.measurements import Measurements

WAVES = ("joint_periodic_error", "second_periodic_error", "joint_error_curve")
WITHOUT_WAVES = CAUSES.keys() - {*WAVES}


def without_pairs(arm: Arm, records: Measurements) -> list[Covariate]:
    """Covariates but for the products of two joints."""
    return [each for each in covariates(arm, records) if str(each.depends_on).count("joint") < 2]


class Few(ContextDecorator):
    """For a test as a decorator, for a part of one as a context: some causes alone, and whether
    residuals may depend on two joints together.
    """

    def __init__(self, causes: Iterable[str], pairs: bool = False) -> None:
        self.causes, self.pairs = causes, pairs
        self.entered = list[ExitStack]()

    def __enter__(self) -> None:
        stack = ExitStack()
        known = {name: cause for name, cause in CAUSES.items() if name in self.causes}
        stack.enter_context(patch.dict(CAUSES, known, clear=True))
        if not self.pairs:
            module = sys.modules[diagnose.__module__]
            stack.enter_context(patch.object(module, "covariates", without_pairs))
        self.entered.append(stack)

    def __exit__(self, *_: object) -> None:
        self.entered.pop().close()


NO_WAVES = Few(WITHOUT_WAVES, pairs=True)
FEW = Few(WITHOUT_WAVES)
ECCENTRICITY_ALONE = Few([EncoderEccentricity.cause])
