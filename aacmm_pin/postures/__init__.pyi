from .articulation import articulations, places
from .configurations import (
    TIP_JOINTS,
    WRIST,
    ConfigurationCircle,
    configuration_circle,
    directed_stylus,
    reach_of_points,
)
from .curve_sampling import Flexibility, sector_centres
from .general_ik import ReachingPostures, reaching_postures
from .postures_at_point import PosturesAtPoint
from .sampling import StateOf, agile, brought_to, different_postures, spread_out
from .wrist import WRIST_ROW, Wrist, box_of_wrist

__all__ = [
    "TIP_JOINTS",
    "WRIST",
    "WRIST_ROW",
    "ConfigurationCircle",
    "Flexibility",
    "PosturesAtPoint",
    "ReachingPostures",
    "StateOf",
    "Wrist",
    "agile",
    "articulations",
    "box_of_wrist",
    "brought_to",
    "configuration_circle",
    "different_postures",
    "directed_stylus",
    "places",
    "reach_of_points",
    "reaching_postures",
    "sector_centres",
    "spread_out",
]
