"""Options for a point, and a direction or orientation of the tip there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from aacmm_pin._support.arrays import Array, vector
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.cli.common import length_option, note
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import (
    TIP_JOINTS,
    WRIST,
    PosturesAtPoint,
    configuration_circle,
    reaching_postures,
)

Triple = tuple[float, float, float]
Point = Annotated[
    Triple, length_option("--point", "Point in the base frame, in mm.", COORDINATE, metavar="X Y Z")
]

IN_METRES = 20.0 * MM
"""Larger coordinates cannot be metres [m]."""
METRES = "the point would be in reach if its numbers were in metres; expected mm"


@dataclass(frozen=True)
class Orientation:
    """Orientation of the tip, and number of postures."""

    tip: Annotated[
        bool,
        typer.Option(
            "--tip",
            help="Place the tip at the point. Default: place the wrist there. --axis and --rpy-deg "
            "imply --tip.",
        ),
    ] = False
    axis: Annotated[
        Triple | None,
        typer.Option(
            metavar="X Y Z",
            help="Direction of the stylus in the base frame (with --urdf: direction of the tool). "
            "Default: any direction.",
        ),
    ] = None
    tool_axis: Annotated[
        Triple | None,
        typer.Option(
            metavar="X Y Z",
            help="With --urdf and --axis: axis of the tip frame that points along --axis. "
            "Default: z.",
        ),
    ] = None
    rpy_deg: Annotated[
        Triple | None,
        typer.Option(
            metavar="R P Y",
            help="Roll, pitch and yaw of the tip, as in URDF, in degrees.",
        ),
    ] = None
    count: Annotated[
        int,
        typer.Option(
            "--samples", metavar="N", min=3, help="Number of postures on each closed curve."
        ),
    ] = 360

    @property
    def oriented(self) -> bool:
        """A direction or an orientation is given."""
        return self.axis is not None or self.rpy_deg is not None

    def postures(self, arm: Arm, point: Triple) -> PosturesAtPoint:
        """All postures at ``point`` [m], with notes on stderr.

        Raises:
            AacmmError: none, or not supported by the arm.
        """
        has_table = arm.dh is not None
        if self.tool_axis is not None and (self.axis is None or has_table):
            raise typer.BadParameter(
                "--tool-axis requires --urdf and --axis; an arm file states this axis in [stylus]"
            )
        if self.axis is not None and self.rpy_deg is not None:
            raise typer.BadParameter("--axis cannot be combined with --rpy-deg")
        if has_table and self.tip and not self.oriented:
            raise typer.BadParameter("--tip requires --axis or --rpy-deg")
        result, notes = self._postures(arm, np.array(point)), []
        if not result.within_limits.any() and np.linalg.norm(point) < IN_METRES:
            in_metres = self._postures(arm, np.array(point) / MM)
            if in_metres.within_limits.any():
                notes.append(METRES)
        if result.reason:
            raise AacmmError("; ".join([str(result), *notes]))
        for line in (*result.notes, *notes):
            note(line)
        return result

    def _postures(self, arm: Arm, point: Array) -> PosturesAtPoint:
        """All postures at a point (3,) [m]; an empty result states the reason."""
        has_table, tip = arm.dh is not None, self.oriented or arm.dh is None
        if has_table and self.rpy_deg is None and (arm.nq == TIP_JOINTS or not tip):
            return configuration_circle(arm, point, axis=self.axis, count=self.count)
        rotation = None
        if self.rpy_deg is not None:
            from aacmm_pin.arm import from_roll_pitch_yaw

            rotation = from_roll_pitch_yaw(
                vector(np.array(self.rpy_deg) * DEG, 3, "rpy_deg", "rad")
            )
        return reaching_postures(
            arm, point, axis=self.axis, tool=self.tool_axis, rotation=rotation, count=self.count
        )


def note_wrist(postures: PosturesAtPoint) -> None:
    if postures.at == WRIST:
        note(
            "the wrist (frame5) is at the point; to place the tip at the point, state the "
            "direction of the stylus with --axis X Y Z"
        )
