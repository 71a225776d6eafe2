from .arm import Arm, GivenArm, as_arm
from .chain import BASE, OF_A_POSE, Chain, axis, end, exp, rigid_motions, screws, skew
from .corrected_urdf import from_roll_pitch_yaw
from .dh import KINDS, DHTable, table
from .dh_to_urdf import urdf_text
from .example_robots import EXAMPLE_ROBOTS
from .file import (
    COVERAGE_FACTOR,
    MOST_BYTES,
    UR_FILES,
    ArmFile,
    Covariance,
    DiscrepancyEntry,
    DiscrepancyPart,
    EffectEntry,
    UrdfArmFile,
    arm_text,
    bundled_arms,
    load_arm_file,
    toml_of,
    validated,
)
from .limits import AT_LIMIT, inside_part, into_limits, outside_limits, whole_turn_notes
from .parameter import Parameter, wide_half_width_notes
from .poses import Poses
from .random_postures import MARGIN, MOST_DRAWS, Room, joint_bounds, spread_postures
from .ur_kinematics import UR_ROBOTS, UrKinematics
from .urdf_to_dh import dh_file

__all__ = [
    "AT_LIMIT",
    "BASE",
    "COVERAGE_FACTOR",
    "EXAMPLE_ROBOTS",
    "KINDS",
    "MARGIN",
    "MOST_BYTES",
    "MOST_DRAWS",
    "OF_A_POSE",
    "UR_FILES",
    "UR_ROBOTS",
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
    "Poses",
    "Room",
    "UrKinematics",
    "UrdfArmFile",
    "arm_text",
    "as_arm",
    "axis",
    "bundled_arms",
    "dh_file",
    "end",
    "exp",
    "from_roll_pitch_yaw",
    "inside_part",
    "into_limits",
    "joint_bounds",
    "load_arm_file",
    "outside_limits",
    "rigid_motions",
    "screws",
    "skew",
    "spread_postures",
    "table",
    "toml_of",
    "urdf_text",
    "validated",
    "whole_turn_notes",
    "wide_half_width_notes",
]
