"""The papers' printed tables, which stand as CSV in ``tables``; units are in the column names."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

TABLES = Path(__file__).parent / "tables"


def read_table(name: str) -> pd.DataFrame:
    """The table ``name``, without its comments: lines that begin with # say where it comes from."""
    return pd.read_csv(TABLES / f"{name}.csv", comment="#")
