"""Conditions to change besides postures: side of approach, temperature, load, mount."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, ArmFile, axis, end
from aacmm_pin.effects import Effect, ErrorModel, TimeConstant

ROOM_WARMING = 4.0
"""A room can be warmed by this much [K]."""
LOAD = 1.0
"""Mass that is hung on an arm [kg]."""
WARM_UP_CONSTANTS = 3.0
"""A warm-up is watched for so many of its time constants."""


@dataclass(frozen=True, eq=False)
class MeasurementConditions:
    """Set-up and use of the arm during the planned measurements.

    Attributes:
        words: changes to make; () if the arm stays as it is.
        model: the arm so set up.
        sides: joints (from 1) that approach their postures from either side.
        warmer: temperature rise of part of the records [K].
        warm_up: duration of the warm-up of the arm during the records [s].
        changes_arm: the set-up needs another arm file; diagnose old and new records separately.
    """

    words: tuple[str, ...]
    model: ErrorModel
    sides: tuple[int, ...] = ()
    warmer: float = 0.0
    warm_up: float = 0.0
    changes_arm: bool = False

    def __str__(self) -> str:
        return set_up_in_words(self.words)


def set_up_in_words(changes: tuple[str, ...]) -> str:
    """A set-up by its changes."""
    return "; ".join(changes) or "no change"


def possible_conditions(
    model: ErrorModel, causes: tuple[Effect, ...], reference_temperature: float
) -> Iterator[MeasurementConditions]:
    """Set-ups that may distinguish the causes, from the least effort to the most."""
    changes = list(_changes(model.arm, causes, reference_temperature))
    for count in range(len(changes) + 1):
        for some in combinations(changes, count):
            fields = {name: value for _, change in some for name, value in change.items()}
            last = MeasurementConditions(tuple(words for words, _ in some), model, **fields)
            yield last
    file = model.arm.file
    if isinstance(file, ArmFile) and any(effect.elastic for effect in causes):
        for words, changed in _loads_and_mounts(model.arm, file):
            arm = Arm.from_file(file.model_copy(update=changed))
            yield replace(
                last,
                words=(*last.words, words),
                model=ErrorModel(arm, model.effects),
                changes_arm=True,
            )


Change = tuple[str, dict[str, Any]]
"""What has to be done, in words, and the fields that it changes."""


def _changes(
    arm: Arm, causes: tuple[Effect, ...], reference_temperature: float
) -> Iterator[Change]:
    """Each condition that a cause depends on and that a person can choose."""
    rows = arm.chain.moving_rows()
    joints = sorted(
        {rows.index(e.row) + 1 for e in causes if "approach" in e.needs and e.row in rows}
    )
    if joints:
        which = f"joint{'s' * (len(joints) > 1)} {', '.join(map(str, joints))}"
        yield str(Note("approach_both_sides", {"joints": which})), {"sides": tuple(joints)}
    if any("temperature" in effect.needs for effect in causes):
        warm = reference_temperature + ROOM_WARMING
        data = {"cool": reference_temperature, "warm": warm}
        yield str(Note("warm_room", data)), {"warmer": ROOM_WARMING}
    constants = [e.nonlinear.value(e) for e in causes if isinstance(e.nonlinear, TimeConstant)]
    if constants:
        watched = WARM_UP_CONSTANTS * max(constants)
        yield str(Note("measure_warm_up", {"minutes": watched / 60})), {"warm_up": watched}


def _loads_and_mounts(arm: Arm, file: ArmFile) -> Iterator[Change]:
    if arm.masses is not None:
        rows = arm.chain.moving_rows()
        row = rows[-2] if len(rows) > 1 else rows[-1]
        yield str(Note("hang_load", {"load": LOAD, "link": row})), _loaded(arm, file, row)
    if not arm.gravity.any():
        return
    about = int(np.argmin(np.abs(arm.gravity)))
    for degrees in (90, 180):
        turn = Rotation.from_euler("xyz"[about], -degrees, degrees=True)
        gravity = np.round(turn.apply(arm.gravity), 6) + 0.0
        numbers = ", ".join(f"{g:g}" for g in gravity)
        words = str(
            Note("turn_mount", {"degrees": degrees, "axis": "xyz"[about], "gravity": numbers})
        )
        yield words, {"gravity_m_s2": tuple(gravity.tolist())}


def _loaded(arm: Arm, file: ArmFile, row: int) -> dict[str, Any]:
    """The change of the arm file for a mass at the end of body ``row``."""
    rotation, origin = arm.chain.walk(np.zeros((1, arm.nq)))
    frame = end(row) if file.convention == "standard-dh" else axis(row)
    place = rotation[frame][0].T @ (origin[end(row)] - origin[frame])[0] / MM
    rows = list(file.joints)
    body = rows[row - 1]
    before = body.mass_kg or 0.0
    centre = (before * np.array(body.com_mm or (0.0, 0.0, 0.0)) + LOAD * place) / (before + LOAD)
    rows[row - 1] = body.model_copy(
        update={"mass_kg": before + LOAD, "com_mm": tuple(centre.tolist())}
    )
    return {"joints": rows}
