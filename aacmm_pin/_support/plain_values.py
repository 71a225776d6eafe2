"""Values for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd


def plain(value: Any) -> Any:
    """Dictionaries and lists of numbers and words, tables row by row; None for infinite numbers and
    NaN.
    """
    match value:
        case Mapping():
            return {str(name): plain(inner) for name, inner in value.items()}
        case pd.DataFrame():
            return plain(value.to_dict("records"))
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case list() | tuple():
            return [plain(inner) for inner in value]
        case float():
            return value if math.isfinite(value) else None
    return None if value is pd.NA else value


def of_models(sizes: Mapping[str, float]) -> dict[str, float]:
    """Sizes by model; the nominal arm also by its name before version 0.3, ``simulation``."""
    return {**sizes, "simulation": sizes["nominal"]}
