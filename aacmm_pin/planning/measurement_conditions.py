"""Conditions beside postures: side of approach, temperature, load, mount."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from aacmm_pin._support.display import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, ArmFile, axis, end
from aacmm_pin.effects import Effect, ErrorModel, TimeConstant

ROOM_WARMING = 4.0
"""By heating a room [K]."""
LOAD = 1.0
"""Hung on an arm [kg]."""
WARM_UP_CONSTANTS = 3.0
"""Time constants over which a warm-up is watched."""


@dataclass(frozen=True, eq=False)
class MeasurementConditions:
    """Set-up and use of the arm during planned measurements.

    Attributes:
        words: changes to make.
        sides: joints (from 1) that approach from either side.
        warmer: rise in part of the records [K].
        warm_up: duration during the records [s].
        changes_arm: needs another arm file; old and new records are diagnosed separately.
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
    """Set-ups that may distinguish the causes, by effort."""
    changes = list(_changes(model.arm, causes, reference_temperature))
    for count in range(len(changes) + 1):
        for combination in combinations(changes, count):
            words = tuple(text for text, _ in combination)
            fields = ChainMap(*(change for _, change in combination))
            last = MeasurementConditions(words, model, **fields)
            yield last
    file = model.arm.file
    if isinstance(file, ArmFile) and any(effect.elastic for effect in causes):
        for text, changed in _loads_and_mounts(model.arm, file):
            arm = Arm.from_file(file.model_copy(update=changed))
            changed_model = ErrorModel(arm, model.effects)
            words = (*last.words, text)
            yield replace(last, words=words, model=changed_model, changes_arm=True)


Change = tuple[str, dict[str, Any]]
"""Text, and the changed fields."""


def _changes(
    arm: Arm, causes: tuple[Effect, ...], reference_temperature: float
) -> Iterator[Change]:
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
        seconds = WARM_UP_CONSTANTS * max(constants)
        yield str(Note("measure_warm_up", {"minutes": seconds / 60})), {"warm_up": seconds}


def _loads_and_mounts(arm: Arm, file: ArmFile) -> Iterator[Change]:
    """A load after the last joint but one, or a rotated mount."""
    if arm.masses is not None:
        rows = arm.chain.moving_rows()
        row = rows[-2] if len(rows) > 1 else rows[-1]
        rotation, origin = arm.chain.at_zero
        frame = end(row) if file.convention == "standard-dh" else axis(row)
        place_of_load = rotation[frame].T @ (origin[end(row)] - origin[frame]) / MM
        joints = list(file.joints)
        body = joints[row - 1]
        mass_before = body.mass_kg or 0.0
        centre_before = np.array(body.com_mm or (0.0, 0.0, 0.0))
        mass = mass_before + LOAD
        centre = (mass_before * centre_before + LOAD * place_of_load) / mass
        update = {"mass_kg": mass, "com_mm": tuple(centre.tolist())}
        joints[row - 1] = body.model_copy(update=update)
        yield str(Note("hang_load", {"load": LOAD, "link": row})), {"joints": joints}
    if not arm.gravity.any():
        return
    about = int(np.argmin(np.abs(arm.gravity)))
    for degrees in (90, 180):
        rotation_of_gravity = Rotation.from_euler("xyz"[about], -degrees, degrees=True)
        gravity = np.round(rotation_of_gravity.apply(arm.gravity), 6) + 0.0
        numbers = ", ".join(f"{g:g}" for g in gravity)
        data = {"degrees": degrees, "axis": "xyz"[about], "gravity": numbers}
        yield str(Note("turn_mount", data)), {"gravity_m_s2": tuple(gravity.tolist())}
