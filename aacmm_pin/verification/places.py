"""Probed points by common labels and lines in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.file_problems import rows_in_words

LABELS_OF_PLACES = ("length_id", "feature", "position", "repeat")


@dataclass(frozen=True)
class PointsInFile:
    """Common labels of probed points by column, and their lines in the file."""

    labels: Mapping[str, str]
    rows: tuple[int, ...]

    @classmethod
    def of(cls, points: pd.DataFrame) -> PointsInFile:
        """Those of a table."""
        shared = {}
        for name in LABELS_OF_PLACES:
            labels = points[name].tolist()
            if labels[0] and labels.count(labels[0]) == len(labels):
                shared[name] = labels[0]
        return cls(shared, tuple(points["row"].tolist()))

    def __str__(self) -> str:
        names = [named(self.labels)] if self.labels else []
        return ", ".join([*names, rows_in_words(self.rows)])


def named(labels: Mapping[str, str]) -> str:
    """Labels with their columns."""
    names = [f"{name.removesuffix('_id')} {label}" for name, label in labels.items()]
    return ", ".join(names)


def coordinates_of(points: pd.DataFrame) -> Array:
    """Coordinates (n, 3) [m]."""
    return np.column_stack([points[name].to_numpy() for name in "xyz"])
