"""Copies of records, readings of one contact, records of one posture."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, UM
from aacmm_pin.measurements.csv_columns import APPROACH, ORIENTATION, REFERENCE, THETA, named

if TYPE_CHECKING:
    from aacmm_pin.measurements.records import Measurements

SAME_POSTURE = 1e-3
"""Largest difference of readings of one posture in any joint [rad; m for prismatic joints].

A UR10 sent to one pose 255 times reads within 3e-4 rad, a Fanuc equal angles; other poses of the
UR10 differ by more than 0.03 rad. The tip moves by about a millimetre.
"""
WHOLE_TOLERANCE = 1e-6
"""For whole and half numbers of steps: a double at 100 m has 1e-8 µm."""
FINGERPRINT_STEP = 1e-9
"""Smaller differences are none [rad, m]."""
FINGERPRINT_DIGITS = 12
"""Hexadecimal: among 100 000 records two agree by chance in one of 50 000 files."""
UNKNOWN_IN_FINGERPRINT = -(2.0**62)
ANGLE_STEPS = (1e-3, 1e-4, 1e-5, 1e-6)
"""Rounding of angles in another export [degree] …"""
REFERENCE_STEPS = (10 * UM, UM, UM / 10, UM / 100)
"""… and of references [m]."""
ANGLE_DECIMALS = 9
"""Of degrees after removal of whole turns."""
MOST_VALUES = 12
"""An unknown column with more describes single records, such as their numbers."""
SHARED_BY_COPIES = (*REFERENCE, *ORIENTATION, "seat", "marker", "bar", "bar_end")
"""Columns in which copies agree, besides angles and approach."""


def originals(records: Measurements) -> Index:
    """Number of the record of which each is a copy (n,); its own if none.

    Copies agree in readings (but for whole turns), reference, labels and approach. One may be
    rounded: references to 1e-2 to 1e-5 mm, angles to 1e-3 to 1e-6 degrees. They come from files
    appended to another export.
    """
    single = _nearest_difference(records.readings, 2.0 * SAME_POSTURE) > DEG * ANGLE_STEPS[0]
    if single.all():
        return np.arange(records.n)
    degrees = np.asarray(
        np.round(np.mod(records.readings / DEG, 360.0), ANGLE_DECIMALS) % 360.0, np.float64
    )
    angles = named(THETA["deg"], records.nq)
    table = records.to_frame().reindex(columns=[*SHARED_BY_COPIES, *named(APPROACH, records.nq)])
    table.loc[records.known, list(ORIENTATION)] = np.nan
    table["single"] = np.where(single, np.arange(records.n), -1)
    table[angles] = degrees
    group = _group_numbers(table)
    angle_steps = [degrees / step for step in ANGLE_STEPS]
    reference_steps: list[Array] = []
    if records.known.any():
        reference_steps = [records.reference / step for step in REFERENCE_STEPS]
    others = _group_numbers(table.drop(columns=angles))
    for values in angle_steps:
        group = _joined(group, others, values)
    of_angles = _group_numbers(table.drop(columns=[*REFERENCE]))
    labels = _group_numbers(table.drop(columns=[*angles, *REFERENCE]))
    for reference in reference_steps:
        group = _joined(group, of_angles, reference)
        for values in angle_steps:
            group = _joined(group, labels, np.hstack([values, reference]))
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return np.asarray(first[number], dtype=np.intp)


def _group_numbers(table: pd.DataFrame) -> Index:
    by = table.groupby(list(table.columns), sort=False, dropna=False)
    return np.asarray(by.ngroup(), dtype=np.intp)


def _joined(group: Index, equal_otherwise: Index, values: Array) -> Index:
    """Groups (n,) after rows of ``values`` (n, k) join those of their rounded numbers, if
    ``equal_otherwise`` (n,). Programs round a half up, to even, or down.
    """
    finite = np.isfinite(values).all(axis=1)
    is_whole = finite & (np.abs(values - np.rint(values)) < WHOLE_TOLERANCE).all(axis=1)
    between = np.flatnonzero(finite & ~is_whole)
    if not is_whole.any() or not between.size:
        return group
    apart = np.column_stack([values, 2.0 * equal_otherwise])
    tree = scipy.spatial.KDTree(apart[is_whole])
    half = 0.5 + 2 * WHOLE_TOLERANCE
    distance, nearest = tree.query(apart[between], p=np.inf, distance_upper_bound=half)
    has_near = np.isfinite(distance)
    joined = np.arange(group.max() + 1)
    joined[group[between[has_near]]] = group[is_whole][nearest[has_near]]
    return np.asarray(joined[group], dtype=np.intp)


def _nearest_difference(q: Array, most: float) -> Array:
    """Distance of each record to the nearest other one (n,): the largest difference of any joint,
    whole turns aside; infinite above ``most``.
    """
    turn = 2 * np.pi
    # Of a tiny negative angle the first gives 2π, which the tree refuses.
    within = np.mod(np.mod(q, turn), turn)
    tree = scipy.spatial.KDTree(within, boxsize=turn)
    distances, _ = tree.query(within, 2, p=np.inf, distance_upper_bound=most)
    return np.asarray(distances[:, 1])


def posture_numbers(q: Array, within: float = SAME_POSTURE) -> Index:
    """Number of the posture of each record (n,), from 0 by appearance; q is (n, nq) [rad].

    A record repeats it if no reading differs by more than ``within`` from its first.
    """
    tree = scipy.spatial.KDTree(q)
    single = _nearest_difference(q, 2.0 * within) > within
    posture = np.full(len(q), -1, dtype=np.intp)
    number = 0
    for k in range(len(q)):
        if posture[k] >= 0:
            continue
        near = np.array([k])
        if not single[k]:
            near = np.asarray(tree.query_ball_point(q[k], within, p=np.inf))
        posture[near[posture[near] < 0]] = number
        number += 1
    return posture


def means_of_contacts(records: Measurements) -> tuple[Measurements, Index]:
    """One record of each contact, with mean readings; and which had several readings.

    Successive records in one posture, equal in reference, labels, approach and other few-valued
    columns, are one contact.
    """
    few = [name for name in records.extra if records.extra[name].nunique() <= MOST_VALUES]
    columns = [*SHARED_BY_COPIES, "session", "operator", *named(APPROACH, records.nq), *few]
    table = records.to_frame().reindex(columns=columns).assign(posture=records.postures)
    contact = np.cumsum(np.diff(_group_numbers(table), prepend=-1) != 0) - 1
    unique = np.unique(contact, return_index=True, return_inverse=True, return_counts=True)
    _, first, number, count = unique
    if count.max(initial=1) == 1:
        return records, np.zeros(0, dtype=np.intp)
    means: dict[str, Any] = {
        name: pd.DataFrame(getattr(records, name)).groupby(number).mean().to_numpy()
        for name in ("q", "of_encoders")
        if getattr(records, name) is not None
    }
    return replace(records.take(first), **means), np.flatnonzero(count[number] > 1)


def fingerprints(records: Measurements) -> tuple[str, ...]:
    """A text that identifies each record in any file: readings to 1e-9 rad, reference to 1 nm."""
    return _hashes(np.column_stack([records.readings, records.reference]))


def fingerprints_of_standards(records: Measurements) -> tuple[str, ...]:
    """Fingerprints of each seat's coordinates, and of each bar's length and u."""
    at_seat = records.conditions.labels("seat") != ""
    places = np.unique(records.reference[records.known & at_seat], axis=0)
    lengths = np.unique(records.lengths(), axis=0).reshape(-1, 2)
    of_seats = [f"seat-{text}" for text in _hashes(places)]
    return (*of_seats, *(f"bar-{text}" for text in _hashes(lengths)))


def _hashes(rows: Array) -> tuple[str, ...]:
    steps = np.rint(rows / FINGERPRINT_STEP)
    numbers = np.nan_to_num(steps, nan=UNKNOWN_IN_FINGERPRINT).astype("<i8")
    return tuple(hashlib.sha256(row.tobytes()).hexdigest()[:FINGERPRINT_DIGITS] for row in numbers)
