from .length import LengthUncertainty, length_uncertainty_between
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
    "length_uncertainty_between",
    "map_caveats",
    "map_workspace",
    "paired",
]
