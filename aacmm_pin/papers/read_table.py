"""The papers' printed tables, which stand as CSV beside the modules that use them; units are in the column names."""

from __future__ import annotations

import importlib.resources

import pandas as pd


def read_table(paper: str, name: str) -> pd.DataFrame:
    """The table ``name`` of a ``paper``, a package beside this module; lines that begin with # say where it comes from."""
    resource = importlib.resources.files(f"aacmm_pin.papers.{paper}") / f"{name}.csv"
    with resource.open(encoding="utf-8") as file:
        return pd.read_csv(file, comment="#")
