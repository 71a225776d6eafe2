"""Colours, and the axes to draw on."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import Axes3D

from aacmm_pin.errors import AacmmError

BLUE, VERMILLION, GREEN, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
VOLUME_COLOURS = "viridis"
VOLUME_NAME, U_NAME = "accuracy volume", "standard uncertainty u"
VOLUME_LABEL = f"{VOLUME_NAME} [mm³]"


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """``ax``, or axes of a new pyplot figure of that size [inches]."""
    return ax if ax is not None else plt.figure(figsize=size, layout="constrained").add_subplot()


def axes_3d(ax: Axes3D | None) -> Axes3D:
    """The same in three dimensions."""
    if ax is None:
        return plt.figure(figsize=(7.2, 6.6), layout="constrained").add_subplot(projection="3d")
    if not isinstance(ax, Axes3D):
        raise AacmmError(f"ax is {type(ax).__name__}, expected three-dimensional axes: add_subplot(projection='3d')")
    return ax


def round_down(value: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(f for f in (1.0, 2.0, 2.5, 5.0) if f * power <= value))
