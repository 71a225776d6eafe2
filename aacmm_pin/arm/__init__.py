"""An arm: its DH table or URDF, its kinematics, what its file states, and its poses by Pinocchio."""

from aacmm_pin.arm.arm import Arm, GivenArm, as_arm
from aacmm_pin.arm.chain import BASE, OF_A_POSE, Chain, axis, end, exp, screws, skew
from aacmm_pin.arm.dh import KINDS, DHTable, table
from aacmm_pin.arm.example_robots import EXAMPLE_ROBOTS
from aacmm_pin.arm.file import (
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
from aacmm_pin.arm.limits import AT_LIMIT, broken_limits, inside_part, into_limits, other_turns
from aacmm_pin.arm.parameter import Parameter, Scope
from aacmm_pin.arm.random_postures import MARGIN, MOST_DRAWS, Room, joint_bounds

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
