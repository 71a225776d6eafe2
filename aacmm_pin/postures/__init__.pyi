from .articulation import articulations, places
from .configurations import TIP_JOINTS, WRIST, ConfigurationCircle, configuration_circle
from .curve_sampling import Flexibility, sector_centres
from .general_ik import ReachingPostures, reaching_postures
from .postures_at_point import PosturesAtPoint
from .sampling import brought_to, spread_out

__all__ = [
    "TIP_JOINTS",
    "WRIST",
    "ConfigurationCircle",
    "Flexibility",
    "PosturesAtPoint",
    "ReachingPostures",
    "articulations",
    "brought_to",
    "configuration_circle",
    "places",
    "reaching_postures",
    "sector_centres",
    "spread_out",
]
