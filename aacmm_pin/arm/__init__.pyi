from .arm import Arm, GivenArm, as_arm
from .chain import BASE, OF_A_POSE, Chain, axis, end, exp, screws, skew
from .dh import KINDS, DHTable, table
from .example_robots import EXAMPLE_ROBOTS
from .file import (
    COVERAGE_FACTOR,
    ArmFile,
    Covariance,
    DiscrepancyEntry,
    DiscrepancyPart,
    EffectEntry,
    UrdfArmFile,
    arm_text,
    bundled_arms,
    calibrated,
    load_arm_file,
    validated,
)
from .limits import AT_LIMIT, broken_limits, inside_part, into_limits, other_turns
from .parameter import Parameter, Scope
from .random_postures import MARGIN, MOST_DRAWS, Room, joint_bounds

__all__ = [
    "AT_LIMIT",
    "BASE",
    "COVERAGE_FACTOR",
    "EXAMPLE_ROBOTS",
    "KINDS",
    "MARGIN",
    "MOST_DRAWS",
    "OF_A_POSE",
    "Arm",
    "ArmFile",
    "Chain",
    "Covariance",
    "DHTable",
    "DiscrepancyEntry",
    "DiscrepancyPart",
    "EffectEntry",
    "GivenArm",
    "Parameter",
    "Room",
    "Scope",
    "UrdfArmFile",
    "arm_text",
    "as_arm",
    "axis",
    "broken_limits",
    "bundled_arms",
    "calibrated",
    "end",
    "exp",
    "inside_part",
    "into_limits",
    "joint_bounds",
    "load_arm_file",
    "other_turns",
    "screws",
    "skew",
    "table",
    "validated",
]
