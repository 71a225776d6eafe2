"""A scene: the commands of meshcat, for one page without a server, or for meshcat's own server."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import meshcat
import numpy as np
import umsgpack
from markupsafe import Markup, escape
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex
from meshcat import Visualizer

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.text_escaping import encodable
from aacmm_pin.report.templates import environment

Mark = Literal["ball", "line", "area"]
STOPS = 24
"""Colours of a bar on the page."""
TICKS = 4
"""Numbers beside a bar."""
FRAME_HEIGHT = 540
"""Height of a scene in a notebook or on a page [px]."""
MESHCAT_ID = re.compile(rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
"""meshcat's id of a geometry, material or object, with the time and the network address."""


@dataclass(frozen=True)
class Swatch:
    """One colour of the legend (CSS background), its meaning, and its shape."""

    colour: str
    text: str
    mark: Mark = "ball"


@dataclass(frozen=True, eq=False)
class ColourBar:
    """The colour scale of ``values`` (n,); ``label`` has the unit, ``name`` is a colour map of
    matplotlib.
    """

    label: str
    values: Array
    name: str

    @property
    def colours(self) -> Array:
        """Colours (n, 3) in [0, 1] of the values."""
        return np.asarray(colormaps[self.name](Normalize()(self.values)))[:, :3]

    @property
    def css(self) -> str:
        """The colour scale as a CSS gradient."""
        colours = colormaps[self.name](np.linspace(0, 1, STOPS))
        return f"linear-gradient(to right, {', '.join(map(to_hex, colours))})"

    @property
    def ticks(self) -> list[str]:
        """Numbers at equal distances along the scale."""
        ends = self.values.min(), self.values.max()
        return [f"{value:.3g}" for value in np.linspace(*ends, TICKS)]


@dataclass(frozen=True, eq=False)
class Frames:
    """The moving parts of a scene.

    Attributes:
        placements: by path, ``(n, 4, 4)`` [m]; rotations may contain a scale.
        texts: displayed numbers by name, ``(n,)`` each.
        colours: matplotlib colours along the slider ``(n,)``.
    """

    placements: Mapping[str, Array]
    texts: Mapping[str, Sequence[str]]
    colours: Sequence[str] | Array
    per_second: float = 20.0

    def __len__(self) -> int:
        return len(self.colours)

    @property
    def data(self) -> dict[str, Any]:
        """For the page; of placements the three upper rows in single precision."""
        rows = {path: moved[:, :3].astype("<f4") for path, moved in self.placements.items()}
        return {
            "count": len(self),
            "perSecond": self.per_second,
            "labels": [*self.texts],
            "readings": [*zip(*self.texts.values(), strict=True)],
            "colours": [to_hex(colour) for colour in self.colours],
            "moving": {path: _base64(numbers.tobytes()) for path, numbers in rows.items()},
        }


class Scene:
    """A three-dimensional scene with a title, a legend and a view; a moving scene also has frames.

    ``scene["arm/body 3"]`` is meshcat's ``Visualizer`` at that path, with ``set_object``,
    ``set_transform``, ``set_property`` and ``delete``. Jupyter displays a scene.

    Attributes:
        notes: sentences about sizes, magnifications and omitted parts.
        view: for the page: ``points`` (n, 3) that it shows with ``room`` around them [m], and the
            ``direction`` of the camera; None for the default of meshcat.
    """

    def __init__(self, title: str, caption: str = "") -> None:
        self._sent: list[Any] = []
        window = SimpleNamespace(web_url="", send=self._sent.append)
        self.meshcat = Visualizer(window=window)
        self.title, self.caption = title, caption
        self.swatches: list[Swatch] = []
        self.bar: ColourBar | None = None
        self.notes: list[str] = []
        self.frames: Frames | None = None
        self.view: dict[str, Any] | None = None

    def __getitem__(self, path: str) -> Any:
        return self.meshcat[path]

    def explain(self, colour: str, text: str, mark: Mark = "ball") -> None:
        """Put a colour and its meaning first in the legend."""
        self.swatches.insert(0, Swatch(colour, text, mark))

    @property
    def commands(self) -> list[bytes]:
        """The commands of meshcat, packed with msgpack, with numbers as ids."""
        numbers: dict[bytes, bytes] = {}

        def number(match: re.Match[bytes]) -> bytes:
            return numbers.setdefault(match[0], b"%036d" % len(numbers))

        packed = [umsgpack.packb(command.lower()) for command in self._sent]
        return [MESHCAT_ID.sub(number, command) for command in packed]

    def html(self) -> str:
        """The scene as one HTML page that needs neither network nor server."""
        data = {
            "commands": [_base64(command) for command in self.commands],
            "frames": self.frames and self.frames.data,
            "view": self.view,
        }
        template = environment().get_template("scene.html.j2")
        return template.render(scene=self, viewer=Markup(viewer_script()), data=plain(data))

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save :meth:`html` as a file.

        Raises:
            OutputError: the file exists and ``force`` is False, or the file cannot be written.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(encodable(self.html()), encoding="utf-8")

    def embedded(self) -> str:
        """The scene as HTML in a frame, for another page."""
        style = f"position: relative; width: 100%; height: {FRAME_HEIGHT}px; border: 0"
        frame = f'<iframe title="{escape(self.title)}" allowfullscreen style="{style}"'
        return f'{frame} srcdoc="{escape(self.html())}"></iframe>'

    _repr_html_ = embedded

    def show(self, browser: bool = True) -> Visualizer:
        """Show the scene live with meshcat's own server, in the first posture.

        The server listens on every network interface until the process ends. Only the page of
        :meth:`save` has legend, readings and slider.

        Returns:
            meshcat's ``Visualizer``, whose changes the browser shows immediately. In Jupyter, its
            ``jupyter_cell()`` displays the scene.
        """
        live = Visualizer()
        for command in self._sent:
            live.window.send(command)
        for path, placements in (self.frames.placements if self.frames else {}).items():
            live[path].set_transform(placements[0])
        return live.open() if browser else live


@cache
def viewer_script() -> str:
    """meshcat's viewer."""
    script = resources.files(meshcat) / "viewer" / "dist" / "main.min.js"
    return script.read_text(encoding="utf-8")


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
