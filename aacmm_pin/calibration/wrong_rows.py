"""Which mistake excluded records share: a reading that stands still, or coordinates of the next
row.
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin.calibration.fit import Fit

FEWEST_ROWS = 6
"""Fewer rows than this are a few gross errors."""
MOST_OF_THEM = 0.8
"""So large a part of the rows has to be excluded, or to fit."""
REMAINS = 0.1
"""The part of the distance that may remain if the coordinates are of another row."""


def mistaken_rows(after: Fit) -> list[Note]:
    """Notes on excluded records whose readings stand still, or whose coordinates are of the row
    before or after.
    """
    if after.excluded.sum() < FEWEST_ROWS:
        return []
    return [*_frozen_readings(after), *_shifted_rows(after)]


def _frozen_readings(after: Fit) -> list[Note]:
    """For each joint the longest run of rows with one and the same reading, if other joints move
    and the fit excludes most of the rows.
    """
    records = after.problem.measurements
    notes = []
    for joint, readings in enumerate(records.readings.T):
        starts = np.flatnonzero(np.append(True, np.diff(readings) != 0.0))
        lengths = np.diff(np.append(starts, records.n))
        longest = int(np.argmax(lengths))
        rows = starts[longest] + np.arange(lengths[longest])
        moves = np.ptp(records.readings[rows], axis=0).any()
        # The first of them may be right.
        frozen = after.excluded[rows[1:]]
        if rows.size > FEWEST_ROWS and moves and frozen.mean() > MOST_OF_THEM:
            data = {"joint": joint + 1, "rows": records.row[rows].tolist()}
            notes.append(Note("reading_frozen", data))
    return notes


def _shifted_rows(after: Fit) -> list[Note]:
    """A note if the coordinates of most excluded records are those of the row before or after."""
    records = after.problem.measurements
    tips = after.point.prediction.tips
    out = np.flatnonzero(after.excluded & records.known)
    notes = []
    for where, step in (("before", 1), ("after", -1)):
        inside = out[(out + step >= 0) & (out + step < records.n)]
        if inside.size < FEWEST_ROWS:
            continue
        stated = _distances(tips[inside], records.reference[inside])
        shifted = _distances(tips[inside], records.reference[inside + step])
        if np.mean(shifted < REMAINS * stated) > MOST_OF_THEM:
            data = {"rows": records.row[inside].tolist(), "where": where}
            notes.append(Note("some_rows_shifted", data))
    return notes


def _distances(tips: Array, reference: Array) -> Array:
    return np.asarray(np.linalg.norm(tips - reference, axis=1))
