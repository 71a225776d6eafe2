"""Postures and places in words."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm

STRAIGHT_ELBOW = 0.05
"""An elbow closer to the line shoulder → tip than this part of its length is on no side."""
SECOND_WORD_RATIO = 0.6
"""A second component with this part of the first has a word too."""
SIDES = ("up", "right", "down", "left")
OPPOSITES = (("up", "down"), ("out", "in"), ("left", "right"))


def articulations(arm: Arm, q: Array) -> list[str]:
    """Postures ``q`` (n, nq) in words, such as ``elbow left, stylus down``.

    The elbow is the joint axis farthest from the line shoulder (joint 2) → tip. Left and right are
    seen from behind the stand along this line; ``out`` is away from the stand.
    """
    rotation, origin = arm.chain.walk(q)
    axes = arm.chain.moving_axes()
    tips = origin[arm.chain.tip]
    words: list[list[str]] = []
    if len(axes) > 3:
        words.append(_elbow_words(arm, origin[axes[1]], origin[axes[2:]], tips))
    if arm.stylus_axis is not None:
        styluses = _direction_words(arm, tips, rotation[arm.chain.tip] @ arm.stylus_axis)
        words.append([f"stylus {word}" for word in styluses])
    return [*map(", ".join, zip(*words, strict=True))] or [""] * len(q)


def places(arm: Arm, points: Array) -> pd.DataFrame:
    """Table of ``points`` (n, 3) [m]: distance from the vertical through the base origin, bearing
    from the first horizontal axis of the base (counter-clockwise from above), height.
    """
    level = np.eye(3)[np.argmin(np.abs(arm.up))]
    level = level - arm.up * (level @ arm.up)
    level /= np.linalg.norm(level)
    x = points @ level
    y = points @ np.cross(arm.up, level)
    bearing = np.round(np.arctan2(y, x) / DEG) + 0.0
    columns = {"distance_mm": np.hypot(x, y) / MM, "bearing_deg": bearing}
    columns["height_mm"] = points @ arm.up / MM
    return pd.DataFrame(columns).round(0)


def _elbow_words(arm: Arm, shoulder: Array, joints: Array, tips: Array) -> list[str]:
    """Side of the elbow at tips (n, 3) [m]: that of ``joints`` (k, n, 3) [m] farthest aside."""
    line = tips - shoulder
    length = np.linalg.norm(line, axis=1)[:, None]
    line = line / np.maximum(length, 1e-12)
    aside = joints - shoulder
    aside = aside - line * np.sum(aside * line, axis=2, keepdims=True)
    farthest = np.linalg.norm(aside, axis=2).argmax(axis=0)
    elbow = aside[farthest, np.arange(len(tips))]
    above = arm.up - line * (line @ arm.up)[:, None]
    sine = np.sum(np.cross(above, elbow) * line, axis=1)
    cosine = np.sum(above * elbow, axis=1)
    angle = np.arctan2(sine, cosine)
    side = np.round(angle / (np.pi / 2)).astype(int) % 4
    straight = np.linalg.norm(elbow, axis=1) < STRAIGHT_ELBOW * length[:, 0]
    words = np.char.add("elbow ", SIDES)[side]
    return [*np.where(straight, "arm straight", words).tolist()]


def _direction_words(arm: Arm, tips: Array, direction: Array) -> list[str]:
    """Each direction (n, 3) at its tip, such as ``down and out``: one or two largest components."""
    out = tips - arm.up * (tips @ arm.up)[:, None]
    out = out / np.maximum(np.linalg.norm(out, axis=1), 1e-12)[:, None]
    left = np.cross(arm.up, out)
    outwards = np.sum(direction * out, axis=1)
    leftwards = np.sum(direction * left, axis=1)
    words = []
    for components in np.stack([direction @ arm.up, outwards, leftwards], axis=1):
        size = np.abs(components)
        _, second, first = size.argsort()
        word = OPPOSITES[first][int(components[first] < 0)]
        if size[second] > SECOND_WORD_RATIO * size[first]:
            word += f" and {OPPOSITES[second][int(components[second] < 0)]}"
        words.append(word)
    return words
