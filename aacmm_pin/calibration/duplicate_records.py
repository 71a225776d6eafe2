"""Records that say the same twice: copies count once, and repeats of a posture stay together when records are left out."""

from __future__ import annotations

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.measurements.records import Measurements

REPEATED = 1e-3
"""Postures whose readings differ by no more than this in any joint are one, repeated [rad; m where a joint slides].

A UR10 sent to one pose 255 times reads within 3e-4 rad, and its other poses are more than 0.03 rad apart; a Fanuc's repeats
state the very same angles. A tip moves by about a millimetre over such a step, and what depends on posture hardly changes.
"""
FEW = 3
"""Fewer postures than this tell nothing of what depends on posture."""


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
    if not tell_of_posture(kept.q):
        count = int(postures_of(kept.q).max(initial=-1)) + 1
        notes.append(
            f"only {count} posture{'s' * (count != 1)} in {kept.n} record{'s' * (kept.n != 1)}: nothing can be said of what "
            "depends on posture, and no held-out validation is possible"
        )
    return kept, notes


def tell_of_posture(q: Array) -> bool:
    """Whether readings (n, nq) [rad] are of enough postures to tell anything of what depends on posture."""
    others = q
    for _ in range(FEW - 1):
        others = others[np.abs(others - others[:1]).max(axis=1) > REPEATED]
    return len(others) > 0


def postures_of(q: Array) -> Index:
    """Number of the posture of each record (n,), from 0 in the order of their first records.

    Args:
        q: readings (n, nq) [rad]; one within :data:`REPEATED` of a posture's first record repeats it.
    """
    tree = scipy.spatial.KDTree(q)
    found = np.full(len(q), -1, dtype=np.intp)
    number = 0
    for k in range(len(q)):
        if found[k] < 0:
            near = np.asarray(tree.query_ball_point(q[k], REPEATED, p=np.inf))
            found[near[found[near] < 0]] = number
            number += 1
    return found


def together(labels: Index, postures: Index) -> Index:
    """Labels (n,), 0 and on, with those made one that share a posture."""
    joined = np.unique(labels, return_inverse=True)[1]
    count = int(joined.max()) + 1
    nodes = count + int(postures.max()) + 1
    graph = scipy.sparse.coo_array((np.ones(len(joined)), (joined, count + postures)), shape=(nodes, nodes))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1][joined], dtype=np.intp)
