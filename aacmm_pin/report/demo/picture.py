"""A picture for the page and for the folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin.report.html import Picture


def picture(axes: Axes, out: Path, name: str, alt: str, caption: str) -> Picture:
    """The figure of ``axes`` for the page, written to ``out`` as ``name``.png as well."""
    figure = axes.figure
    if not isinstance(figure, Figure):
        raise TypeError(f"{name}: expected axes of a whole figure, not of a part of one")
    picture = Picture.of(figure, alt, caption)
    (out / f"{name}.png").write_bytes(picture.png)
    return picture


def new_axes(width: float, height: float, projection: Literal["3d"] | None = None) -> Any:
    """Axes of a new figure [inches] that pyplot knows nothing of, so that nothing has to be closed."""
    return Figure(figsize=(width, height), layout="constrained").add_subplot(projection=projection)
