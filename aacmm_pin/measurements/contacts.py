"""Coordinates of the points that a probe touched, brought to the centre of its ball."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from aacmm_pin._support.notes import Note

if TYPE_CHECKING:
    from aacmm_pin.measurements.records import Measurements


def at_centres(records: Measurements) -> Measurements:
    """The records with references of the tip, which is the centre of the probe's ball.

    A record that states a probe's diameter and a direction, and neither feature nor seat, states
    the coordinates of its contact: the centre is half the diameter before that, ``c = p - r d``. It
    then has no diameter, and a note in ``read_as`` lists these records.
    """
    diameter = records.probe_diameter
    direction = records.conditions.probe_direction
    if diameter is None or direction is None:
        return records
    touches = np.isfinite(diameter) & direction.any(axis=1) & records.known
    if records.conditions.seat is not None:
        touches &= records.conditions.seat == ""
    if not touches.any():
        return records
    half = np.where(touches, diameter / 2, 0.0)
    before = records.reference - half[:, None] * direction
    left = np.where(touches, np.nan, diameter)
    note = Note("contacts_at_centres", {"rows": records.row[touches].tolist()})
    return replace(
        records,
        reference=before,
        probe_diameter=left if np.isfinite(left).any() else None,
        read_as=(*records.read_as, note),
    )
