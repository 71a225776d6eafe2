"""Copies of records, readings of one contact, records of one posture."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.units import DEG
from aacmm_pin.measurements.csv_columns import APPROACH, ORIENTATION, REFERENCE, THETA, named

if TYPE_CHECKING:
    from aacmm_pin.measurements.records import Measurements

SAME_POSTURE = 1e-3
"""Largest difference of readings of one posture in any joint [rad; m for prismatic joints].

A UR10 sent to one pose 255 times reads within 3e-4 rad, a Fanuc equal angles; other poses of the
UR10 differ by more than 0.03 rad. The tip moves by about a millimetre.
"""
FINGERPRINT_STEP = 1e-9
"""Smaller differences are none [rad, m]."""
FINGERPRINT_DIGITS = 12
"""Hexadecimal: among 100 000 records two agree by chance in one of 50 000 files."""
UNKNOWN_IN_FINGERPRINT = -(2.0**62)
ANGLE_DECIMALS = 9
"""Of degrees after removal of whole turns."""
MOST_VALUES = 12
"""An unknown column with more describes single records, such as their numbers."""
SHARED_BY_COPIES = (*REFERENCE, *ORIENTATION, "seat", "marker", "bar", "bar_end")
"""Columns in which copies agree, besides angles and approach."""


def originals(records: Measurements) -> Index:
    """Number of the record of which each is a copy (n,); its own if none.

    Copies agree in readings (but for whole turns), reference, labels and approach. They come from
    files appended to another export.
    """
    table = records.to_frame().reindex(columns=[*SHARED_BY_COPIES, *named(APPROACH, records.nq)])
    table.loc[records.known, list(ORIENTATION)] = np.nan
    degrees = np.mod(records.readings / DEG, 360.0)
    # Rounding may give 360.
    table[named(THETA["deg"], records.nq)] = np.round(degrees, ANGLE_DECIMALS) % 360.0
    rows = pd.Series(np.arange(records.n))
    return rows.groupby(_group_numbers(table)).transform("first").to_numpy(dtype=np.intp)


def _group_numbers(table: pd.DataFrame) -> Index:
    groups = table.groupby(list(table.columns), sort=False, dropna=False)
    return np.asarray(groups.ngroup(), dtype=np.intp)


def posture_numbers(q: Array, within: float = SAME_POSTURE) -> Index:
    """Number of the posture of each record (n,), from 0 by appearance; q is (n, nq) [rad].

    A record repeats it if no reading differs by more than ``within`` from its first.
    """
    tree = scipy.spatial.KDTree(q)
    nearest, _ = tree.query(q, 2, p=np.inf, distance_upper_bound=2.0 * within)
    is_alone = nearest[:, 1] > within
    posture = np.full(len(q), -1, dtype=np.intp)
    number = 0
    for k in range(len(q)):
        if posture[k] >= 0:
            continue
        neighbours = np.array([k])
        if not is_alone[k]:
            neighbours = np.asarray(tree.query_ball_point(q[k], within, p=np.inf))
        posture[neighbours[posture[neighbours] < 0]] = number
        number += 1
    return posture


def means_of_contacts(records: Measurements) -> tuple[Measurements, Index]:
    """One record of each contact, with mean readings; and which had several readings.

    Successive records in one posture, equal in reference, labels, approach and other few-valued
    columns, are one contact.
    """
    few_valued = [name for name in records.extra if records.extra[name].nunique() <= MOST_VALUES]
    columns = [*SHARED_BY_COPIES, "session", "operator", *named(APPROACH, records.nq), *few_valued]
    table = records.to_frame().reindex(columns=columns).assign(posture=records.postures)
    is_new = np.diff(_group_numbers(table), prepend=-1) != 0
    contact = np.cumsum(is_new) - 1
    readings_of_contact = np.bincount(contact)
    if is_new.all():
        return records, np.zeros(0, dtype=np.intp)
    means: dict[str, Any] = {
        name: pd.DataFrame(getattr(records, name)).groupby(contact).mean().to_numpy()
        for name in ("q", "of_encoders")
        if getattr(records, name) is not None
    }
    return replace(records.take(is_new), **means), np.flatnonzero(readings_of_contact[contact] > 1)


def fingerprints(records: Measurements) -> tuple[str, ...]:
    """A text that identifies each record in any file: readings to 1e-9 rad, reference to 1 nm."""
    return _hashes(np.column_stack([records.readings, records.reference]))


def fingerprints_of_standards(records: Measurements) -> tuple[str, ...]:
    """Fingerprints of each seat's coordinates, and of each bar's length and u."""
    at_seat = records.conditions.labels("seat") != ""
    coordinates = np.unique(records.reference[records.known & at_seat], axis=0)
    lengths = np.unique(records.lengths(), axis=0).reshape(-1, 2)
    of_seats = [f"seat-{text}" for text in _hashes(coordinates)]
    return (*of_seats, *(f"bar-{text}" for text in _hashes(lengths)))


def _hashes(rows: Array) -> tuple[str, ...]:
    steps = np.rint(rows / FINGERPRINT_STEP)
    numbers = np.nan_to_num(steps, nan=UNKNOWN_IN_FINGERPRINT).astype("<i8")
    return tuple(hashlib.sha256(row.tobytes()).hexdigest()[:FINGERPRINT_DIGITS] for row in numbers)
