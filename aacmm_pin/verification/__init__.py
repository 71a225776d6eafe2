"""Acceptance tests by public descriptions of two standards."""

from aacmm_pin.verification.acceptance import (
    GUARD_BAND_FACTOR,
    LONGEST_PART,
    AcceptanceResult,
    accept,
    shown_verdict,
)
from aacmm_pin.verification.acceptance_file import AS_GIVEN, brief
from aacmm_pin.verification.characteristics import ASME, EDITIONS, RULE_OF, StandardName
from aacmm_pin.verification.history import (
    LEAST_CHECKS,
    PER_MOVING_RANGE,
    ControlChart,
    History,
    in_utc,
)
from aacmm_pin.verification.procedure import (
    PROBE_DIAMETER_MM,
    SPHERE_DIAMETER_MM,
    Procedure,
    acceptance_procedure,
)

__all__ = [
    "ASME",
    "AS_GIVEN",
    "EDITIONS",
    "GUARD_BAND_FACTOR",
    "LEAST_CHECKS",
    "LONGEST_PART",
    "PER_MOVING_RANGE",
    "PROBE_DIAMETER_MM",
    "RULE_OF",
    "SPHERE_DIAMETER_MM",
    "AcceptanceResult",
    "ControlChart",
    "History",
    "Procedure",
    "StandardName",
    "accept",
    "acceptance_procedure",
    "brief",
    "in_utc",
    "shown_verdict",
]
