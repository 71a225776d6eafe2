"""What moves in a scene: for every frame the places of its bodies, shapes that change, and what is read out."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.errors import ShapeError


@dataclass(frozen=True, eq=False)
class ChangingMesh:
    """A mesh that is another one in every frame.

    Attributes:
        path: its path in the scene, where it has an object already; that object's material stays.
        meshes: vertices (v, 3) [m] and triangles (f, 3) of each frame; None where there is none.
    """

    path: str
    meshes: Sequence[tuple[Array, Index] | None]


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of an animation.

    Attributes:
        placements: of each moving path (n, 4, 4) [m], rotations with or without scale; nan where the body is not shown.
        labels: names of the numbers that are read out.
        readings: their texts, for each frame one for each label.
        colours: a CSS colour for each frame, shown along the slider.
        start: number of the frame shown first.
        meshes: shapes that change.
        per_second: frames shown in a second of play.
    """

    placements: Mapping[str, Array]
    labels: Sequence[str]
    readings: Sequence[Sequence[str]]
    colours: Sequence[str]
    start: int = 0
    meshes: Sequence[ChangingMesh] = field(default=())
    per_second: float = 20.0

    def __post_init__(self) -> None:
        n = len(self)
        for what, found in (
            ("colours", len(self.colours)),
            *((f"placements of {path}", len(of)) for path, of in self.placements.items()),
            *((f"meshes of {mesh.path}", len(mesh.meshes)) for mesh in self.meshes),
        ):
            if found != n:
                raise ShapeError(f"{what}: {found} frames, expected {n} as there are readings")
        if not 0 <= self.start < n:
            raise ShapeError(f"start is {self.start}, expected a frame from 0 to {n - 1}")

    def __len__(self) -> int:
        return len(self.readings)

    def encoded(self) -> dict[str, Any]:
        """For the page: placements as position, quaternion (x, y, z, w) and scale in single precision, base64."""
        return {
            "count": len(self),
            "start": self.start,
            "perSecond": self.per_second,
            "labels": list(self.labels),
            "readings": [list(row) for row in self.readings],
            "colours": list(self.colours),
            "moving": {path: _base64(_parts(placements)) for path, placements in self.placements.items()},
            "meshes": [{"path": m.path, "frames": [_mesh(mesh) for mesh in m.meshes]} for m in self.meshes],
        }


def _parts(placements: Array) -> Array:
    """Position, quaternion and, where any is not 1, scale: (n, 7) or (n, 10)."""
    shown = np.asarray(np.isfinite(placements).all(axis=(1, 2)))
    axes = np.where(shown[:, None, None], placements[:, :3, :3], np.eye(3))
    scale = np.linalg.norm(axes, axis=1)
    turn = Rotation.from_matrix(axes / scale[:, None, :]).as_quat()
    parts = np.column_stack([placements[:, :3, 3], turn] + ([] if np.allclose(scale, 1.0, atol=1e-9) else [scale]))
    parts[~shown] = np.nan
    return parts


def _mesh(mesh: tuple[Array, Index] | None) -> list[str] | None:
    if mesh is None:
        return None
    vertices, faces = mesh
    if len(vertices) > 0xFFFF:
        raise ShapeError(f"a mesh has {len(vertices)} vertices, expected at most {0xFFFF}")
    return [_base64(vertices), base64.b64encode(faces.astype("<u2").tobytes()).decode("ascii")]


def _base64(values: Array) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")
