from .length import LengthUncertainty, length_uncertainty
from .tip_sensitivity import ErrorSources
from .volume import (
    COVERED,
    ELLIPSOID_COVERAGE_FACTOR,
    METHODS,
    AccuracyVolume,
    Method,
    accuracy_volume,
    circle_accuracy,
    expanded,
    paired,
    usable_postures,
)
from .workspace import QUANTITIES, Quantity, WorkspaceMap, map_caveats, map_workspace

__all__ = [
    "COVERED",
    "ELLIPSOID_COVERAGE_FACTOR",
    "METHODS",
    "QUANTITIES",
    "AccuracyVolume",
    "ErrorSources",
    "LengthUncertainty",
    "Method",
    "Quantity",
    "WorkspaceMap",
    "accuracy_volume",
    "circle_accuracy",
    "expanded",
    "length_uncertainty",
    "map_caveats",
    "map_workspace",
    "paired",
    "usable_postures",
]
