"""Read the printed tables of the papers from the CSV files in ``tables``.

The names of the columns contain the units.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

TABLES = Path(__file__).parent / "tables"


def read_table(name: str) -> pd.DataFrame:
    """The table ``name``; lines that begin with # state its source."""
    return pd.read_csv(TABLES / f"{name}.csv", comment="#")
