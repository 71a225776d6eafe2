"""What the page beside a scene explains of its colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex
from matplotlib.ticker import MaxNLocator

from aacmm_pin._support.checks import Array

Mark = Literal["ball", "line", "area"]
STOPS = 24
"""Colours that a bar is made of on the page."""


@dataclass(frozen=True)
class Swatch:
    """One colour and what it stands for.

    Attributes:
        colour: a CSS background.
        text: what has it.
        mark: the shape in which it is shown.
    """

    colour: str
    text: str
    mark: Mark = "ball"


@dataclass(frozen=True, eq=False)
class ColourBar:
    """Numbers by colours.

    Attributes:
        label: what the numbers are, with their unit.
        low, high: the numbers at both ends.
        name: of a matplotlib colour map.
    """

    label: str
    low: float
    high: float
    name: str

    @staticmethod
    def of(label: str, values: Array, name: str) -> ColourBar:
        """The bar over the finite ones of ``values``; of equal ones it shows a little on both sides."""
        finite = values[np.isfinite(values)]
        low, high = float(finite.min()), float(finite.max())
        room = 0.0 if high > low else max(abs(low), 1e-12) * 0.01
        return ColourBar(label, low - room, high + room, name)

    def colours(self, values: Array) -> Array:
        """Colours of ``values`` (n,): (n, 3) in [0, 1]."""
        return np.asarray(colormaps[self.name](Normalize(self.low, self.high)(values)))[:, :3]

    @property
    def css(self) -> str:
        """The bar as a CSS gradient."""
        colours = colormaps[self.name](np.linspace(0, 1, STOPS))
        return f"linear-gradient(to right, {', '.join(map(to_hex, colours))})"

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Where along the bar [%] a number stands, and the number."""
        places = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(self.low, self.high)
        inside = [float(p) for p in places if self.low <= p <= self.high]
        return [(100 * (p - self.low) / (self.high - self.low), f"{p:.4g}") for p in inside]
