"""Tables as people read them: every cell as text, the same for a card in a notebook and for the shell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

NOTHING = "–"
"""Stands where there is no number."""


def cells(frame: pd.DataFrame, formats: Mapping[str, str] | None = None) -> pd.DataFrame:
    """The frame with text in every cell.

    Args:
        frame: the data.
        formats: format of the numbers of a column, such as ``{"u_mm": ".4f"}``; others as they print.
    """
    formats = formats or {}
    columns = {name: [_cell(value, formats.get(str(name), "")) for value in frame[name]] for name in frame.columns}
    return pd.DataFrame(columns, dtype=object)


def spread(values: Any, form: str) -> dict[str, str]:
    """Least, middle and largest of some numbers as text, those that are not finite left out."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    found = (finite.min(), np.median(finite), finite.max()) if finite.size else (None, None, None)
    return {name: _cell(value, form) for name, value in zip(("least", "median", "largest"), found, strict=True)}


def _cell(value: object, form: str) -> str:
    if value is None or value is pd.NA or (isinstance(value, float) and np.isnan(value)):
        return NOTHING
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, tuple | list):
        return ", ".join(map(str, value))
    return format(value, form) if form else f"{value:.6g}" if isinstance(value, float) else str(value)
