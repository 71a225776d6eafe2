"""The papers' printed tables, which stand as CSV in ``tables``; units are in the column names."""

from __future__ import annotations

import importlib.resources

import pandas as pd


def read_table(name: str) -> pd.DataFrame:
    """The table ``name``, without its comments: lines that begin with # say where it comes from."""
    with (importlib.resources.files("aacmm_pin.papers") / "tables" / f"{name}.csv").open(encoding="utf-8") as file:
        return pd.read_csv(file, comment="#")
