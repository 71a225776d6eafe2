"""Tables of readings, as measurement files have them."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

THETAS = [f"theta{j}_deg" for j in range(1, 7)]
PLACES = ["x_mm", "y_mm", "z_mm"]


def readings(q: ArrayLike, unit: str = "deg") -> pd.DataFrame:
    """Angles (n, 6) [rad] in columns of this unit."""
    names = [name.replace("deg", unit) for name in THETAS]
    return pd.DataFrame(np.degrees(q) if unit == "deg" else np.asarray(q), columns=names)
