"""Arm files made of SINO6's, and arms of tables of their own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain

import numpy as np

from aacmm_pin.arm import Arm, ArmFile, load_arm_file

RIGID: dict[str, object] = {"fixed": True, "limits_rad": None, "encoder_noise_rad": None}

AACMM = (
    (0.0, 280.0, 90.0, 0.0),
    (30.0, 0.0, -90.0, 0.0),
    (-35.0, 920.0, 90.0, 0.0),
    (25.0, 0.0, -90.0, 0.0),
    (0.0, 640.0, 90.0, 0.0),
    (120.0, 60.0, -90.0, 0.0),
)
"""A measuring arm as it may be drawn: a, d [mm], alpha, theta offset [°] of its rows."""

PRISMATIC: dict[str, object] = {
    "kind": "prismatic",
    "limits_rad": None,
    "limits_mm": (-100.0, 400.0),
    "encoder_noise_rad": None,
}


def changed(
    file: ArmFile | str, rows: Mapping[int, Mapping[str, object]] | None = None, **fields: object
) -> Arm:
    """The arm of a file, or of a bundled one, with other values in rows (from 1; 0: in each that
    has a joint) and in fields. Not validated.
    """
    file, rows = load_arm_file(file) if isinstance(file, str) else file, rows or {}
    assert fields.keys() <= ArmFile.model_fields.keys()
    assert {*chain(*rows.values())} <= type(file.joints[0]).model_fields.keys()
    file = file.model_copy(update=fields)
    joints = [
        row.model_copy(update={**({} if row.fixed else rows.get(0, {})), **rows.get(number, {})})
        for number, row in enumerate(file.joints, start=1)
    ]
    return Arm.from_file(file.model_copy(update={"joints": joints}))


def nominal() -> ArmFile:
    """SINO6 as drawn: axes exactly at right angles, no small lengths, no zero offsets; its
    half-widths and limits stay.
    """
    file, rows = load_arm_file("sino6"), []
    for row, right, small in zip(
        file.joints, (-1, 1, -1, 1, 1, 0), ("ad", "d", "", "ad", "a", ""), strict=True
    ):
        change = {"alpha_rad": right * np.pi / 2, "theta_offset_rad": 0.0} | {
            f"{letter}_mm": 0.0 for letter in small
        }
        rows.append(row.model_copy(update=change))
    return file.model_copy(update={"name": "nominal", "joints": rows})


def craig() -> ArmFile:
    """SINO6 written in modified DH: a and alpha move one row down, so the last row's stay
    behind.
    """
    sino6 = load_arm_file("sino6")
    before = [(0.0, 0.0), *[(row.a_mm, row.alpha_rad) for row in sino6.joints[:-1]]]
    rows = [
        row.model_copy(update={"a_mm": a, "alpha_rad": t})
        for row, (a, t) in zip(sino6.joints, before, strict=True)
    ]
    return sino6.model_copy(update={"convention": "modified-dh", "joints": rows})


def by_table(
    name: str,
    rows: Iterable[Sequence[float]],
    limit: float,
    convention: str = "standard-dh",
    **each: object,
) -> Arm:
    """An arm of DH rows a, d [mm], alpha, theta offset [°], its joints within ±limit [°];
    ``each``: of all rows.
    """
    keys = ("a_mm", "d_mm", "alpha_deg", "theta_offset_deg")
    joints = [
        dict(zip(keys, row, strict=True)) | {"limits_deg": [-limit, limit]} | each for row in rows
    ]
    file = {
        "schema": "aacmm-pin/arm/1",
        "name": name,
        "source": "",
        "convention": convention,
        "joints": joints,
    }
    return Arm.from_file(ArmFile.model_validate(file))


def serial_urdf(
    joints: Iterable[tuple[str, str, str, float, float]], tip: str, body: str = ""
) -> str:
    """A URDF of links l0, l1, … in a row, each joint with its type, axis, origin and limits, and of
    a link ``tip`` at an origin behind the last; ``body`` is inside each link that moves.
    """
    text, last = '<robot name="serial"><link name="l0"/>', 0
    for last, (kind, axis, origin, low, high) in enumerate(joints, start=1):
        text += (
            f'<link name="l{last}">{body}</link><joint name="j{last}" type="{kind}">'
            f'<parent link="l{last - 1}"/><child link="l{last}"/><origin xyz="{origin}"/>'
            f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'
            "</joint>"
        )
    return text + (
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="l{last}"/>'
        f'<child link="tip"/><origin xyz="{tip}"/></joint></robot>'
    )
