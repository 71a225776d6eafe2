"""A scene: the commands of meshcat, for one page without a server, or for meshcat's own server.

meshcat's viewer is one script of 0.85 MB. A page with several scenes has it once, as inert text
(:func:`shared_script`); each scene is an inner frame that receives it when scrolled into sight, or
soon after the page has been read.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import meshcat
import numpy as np
import umsgpack
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup, escape
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex
from meshcat import Visualizer

from aacmm_pin._support.checks import Array
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
POSTER = (
    '<p style="position: absolute; inset: 2rem 1rem auto; text-align: center">Scroll '
    "here to see the 3D scene.</p>"
)
"""Shown until the scene is drawn over it."""


@dataclass(frozen=True)
class Swatch:
    """One colour of the legend (CSS background), its meaning, and its shape."""

    colour: str
    text: str
    mark: Mark = "ball"


@dataclass(frozen=True, eq=False)
class ColourBar:
    """The colour scale of a scene; ``label`` has the unit, ``name`` is a colour map of
    matplotlib.
    """

    label: str
    low: float
    high: float
    name: str

    @staticmethod
    def of(label: str, values: Array, name: str) -> ColourBar:
        """The colour scale of the finite ``values``, slightly wider if all are equal."""
        finite = values[np.isfinite(values)]
        low, high = float(finite.min()), float(finite.max())
        room = 0.0 if high > low else max(abs(low), 1e-12) * 0.01
        return ColourBar(label, low - room, high + room, name)

    def colours(self, values: Array) -> Array:
        """Colours (n, 3) in [0, 1] of ``values`` (n,)."""
        shade = Normalize(self.low, self.high)(values)
        return np.asarray(colormaps[self.name](shade))[:, :3]

    @property
    def css(self) -> str:
        """The colour scale as a CSS gradient."""
        colours = colormaps[self.name](np.linspace(0, 1, STOPS))
        return f"linear-gradient(to right, {', '.join(map(to_hex, colours))})"

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Positions along the scale [%] and texts of the ticks."""
        values = np.linspace(self.low, self.high, TICKS)
        percent = np.linspace(0.0, 100.0, TICKS)
        return [(place, f"{value:.3g}") for place, value in zip(percent, values, strict=True)]


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


class _Window:
    web_url = ""

    def __init__(self) -> None:
        self.commands: list[Any] = []

    def send(self, command: Any) -> None:
        self.commands.append(command)


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
        self._window = _Window()
        self.meshcat = Visualizer(window=self._window)
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

        packed = [umsgpack.packb(command.lower()) for command in self._window.commands]
        return [MESHCAT_ID.sub(number, command) for command in packed]

    def html(self) -> str:
        """The scene as one HTML page that needs neither network nor server."""
        return self._page(f"<script>{viewer_script()}</script>", plays=True)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save :meth:`html` as a file.

        Raises:
            OutputError: the file exists and ``force`` is False, or the file cannot be written.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(encodable(self.html()), encoding="utf-8")

    def embedded(self) -> str:
        """The scene as HTML in a frame, for a page with one
        :func:`aacmm_pin.report.scenes.shared_script`.
        """
        page = htmlsafe_json_dumps(self._page("<!-- viewer -->", plays=False))
        frame = self._frame("class=aacmm-scene")
        return (
            f'<div style="position: relative">{POSTER}{frame}\n'
            f'<script type="application/json">{page}</script></div>'
        )

    def _repr_html_(self) -> str:
        return self._frame(f'srcdoc="{escape(self.html())}"')

    def show(self, browser: bool = True) -> Visualizer:
        """Show the scene live with meshcat's own server, in the first posture.

        The server listens on every network interface until the process ends. Only the page of
        :meth:`save` has legend, readings and slider.

        Returns:
            meshcat's ``Visualizer``, whose changes the browser shows immediately. In Jupyter, its
            ``jupyter_cell()`` displays the scene.
        """
        live = Visualizer()
        for command in self._window.commands:
            live.window.send(command)
        for path, placements in (self.frames.placements if self.frames else {}).items():
            live[path].set_transform(placements[0])
        return live.open() if browser else live

    def _page(self, viewer: str, *, plays: bool) -> str:
        data = {
            "plays": plays,
            "commands": [_base64(command) for command in self.commands],
            "frames": self.frames and self.frames.data,
            "view": self.view,
        }
        template = environment().get_template("scene.html.j2")
        return template.render(scene=self, viewer=Markup(viewer), data=plain(data))

    def _frame(self, attribute: str) -> str:
        style = f"position: relative; width: 100%; height: {FRAME_HEIGHT}px; border: 0"
        title = escape(self.title)
        return f'<iframe title="{title}" {attribute} allowfullscreen style="{style}"></iframe>'


def shared_script() -> str:
    """HTML that a page with embedded scenes needs once: the viewer, and a script that fills the
    frames.
    """
    return (
        f'<script type="text/plain" id="aacmm-viewer">{viewer_script()}</script>\n'
        f"<script>{environment().get_template('embed.js').render()}</script>"
    )


@cache
def viewer_script() -> str:
    """meshcat's viewer."""
    script = resources.files(meshcat) / "viewer" / "dist" / "main.min.js"
    return script.read_text(encoding="utf-8")


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
