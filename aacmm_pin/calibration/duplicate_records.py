"""Records that say the same twice: copies count once, and repeats of a posture are no other postures."""

from __future__ import annotations

import numpy as np

from aacmm_pin.calibration.cross_validation import enough_postures
from aacmm_pin.measurements.records import Measurements


def counted_once(measurements: Measurements) -> tuple[Measurements, list[str]]:
    """The records without copies of others, and words for which these were and for postures that are too few.

    See :meth:`Measurements.copies`; ``row`` still has the line of each record in the file.
    """
    of = measurements.copies()
    copies = np.flatnonzero(of != np.arange(measurements.n))
    kept = measurements.take(np.unique(of))
    notes = []
    if copies.size:
        row = measurements.row[copies]
        runs = np.split(row, np.flatnonzero(np.diff(row) != 1) + 1)
        listed = ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)
        notes.append(f"{copies.size} records are copies of others and count once: rows {listed}")
    if not enough_postures(kept):
        count = np.unique(kept.postures).size
        notes.append(
            f"only {count} posture{'s' * (count != 1)} in {kept.n} record{'s' * (kept.n != 1)}: nothing can be said of what "
            "depends on posture, and no held-out validation is possible"
        )
    return kept, notes
