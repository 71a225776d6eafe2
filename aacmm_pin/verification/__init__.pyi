from .acceptance import (
    GUARD_BAND_FACTOR,
    LONGEST_PART,
    AcceptanceResult,
    accept,
    shown_verdict,
)
from .acceptance_file import AS_GIVEN, brief
from .characteristics import ASME, EDITIONS, RULE_OF, StandardName
from .history import (
    LEAST_CHECKS,
    PER_MOVING_RANGE,
    ControlChart,
    History,
    in_utc,
)
from .procedure import (
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
