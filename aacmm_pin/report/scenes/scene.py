"""A meshcat scene without a server: whatever is sent to it is kept, and can be written down as one page or be shown live."""

from __future__ import annotations

import re
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import umsgpack
from meshcat import Visualizer

from aacmm_pin._support.checks import Array
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.text_escaping import encodable
from aacmm_pin._support.units import DEG
from aacmm_pin.errors import ShapeError
from aacmm_pin.report.scenes import page
from aacmm_pin.report.scenes.legend import ColourBar, Swatch
from aacmm_pin.report.scenes.server import Server

NOTEBOOK_HEIGHT = 560
"""Height of a scene in a notebook [px]."""
AN_ID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
"""How meshcat writes the id of a geometry, a material or an object."""
OUTERMOST = 60
"""Directions in which the points that have to be seen are looked for."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What moves in a scene.

    Attributes:
        placements: of each moving path (n, 4, 4) [m], rotations with or without scale; nan where the body is not shown.
        texts: of each number that is read out, by its name, (n,) each.
        colours: a CSS colour for each frame (n,), shown along the slider.
        start: number of the frame shown first.
        per_second: frames shown in a second of play.
    """

    placements: Mapping[str, Array]
    texts: Mapping[str, Sequence[str]]
    colours: Sequence[str]
    start: int = 0
    per_second: float = 20.0

    def __post_init__(self) -> None:
        n = len(self)
        for what, per_frame in (("placements", self.placements), ("texts", self.texts)):
            for name, of in per_frame.items():
                if len(of) != n:
                    raise ShapeError(f"{what} of {name}: {len(of)} frames, expected {n} as there are colours")
        if not 0 <= self.start < n:
            raise ShapeError(f"start is {self.start}, expected a frame from 0 to {n - 1}")

    def __len__(self) -> int:
        return len(self.colours)

    @property
    def labels(self) -> list[str]:
        """Names of the numbers that are read out."""
        return list(self.texts)

    @property
    def readings(self) -> list[list[str]]:
        """Their texts, for each frame one for each label."""
        return [list(row) for row in zip(*self.texts.values(), strict=True)]


@dataclass(frozen=True, eq=False)
class View:
    """What has to be seen, and from which side; the page finds the distance that its own shape needs.

    Attributes:
        points: (n, 3) [m], all of them inside the picture.
        azimuth: of the camera, from +x towards +y [rad].
        elevation: of the camera above the horizontal [rad].
        room: so much is seen beyond the points, for what is thick [m].
    """

    points: Array
    azimuth: float
    elevation: float = 18 * DEG
    room: float = 0.0

    @property
    def direction(self) -> Array:
        """From what is seen towards the camera, unit (3,)."""
        level = np.cos(self.elevation)
        return np.array([level * np.cos(self.azimuth), level * np.sin(self.azimuth), np.sin(self.elevation)])

    @property
    def outermost(self) -> Array:
        """Those of the points that are farthest out, which stand for all (m, 3) [m]."""
        turn = np.arange(OUTERMOST) * np.pi * (3.0 - np.sqrt(5.0))  # evenly over the sphere (Fibonacci)
        height = 1.0 - (2 * np.arange(OUTERMOST) + 1) / OUTERMOST
        level = np.sqrt(1.0 - height**2)
        directions = np.column_stack([level * np.cos(turn), level * np.sin(turn), height])
        return np.asarray(self.points[np.unique((directions @ self.points.T).argmax(axis=1))])


class _Window:
    """A window for meshcat's ``Visualizer``: it keeps the last command of each kind for each path, and hands it on."""

    web_url = ""

    def __init__(self) -> None:
        self.kept: dict[tuple[str, ...], bytes] = {}
        self.listeners: list[Callable[[bytes], None]] = []
        self.ids: dict[str, str] = {}

    def send(self, command: Any) -> None:
        """Called by meshcat."""
        lowered = command.lower()
        if "object" in lowered:
            lowered["object"] = self._numbered(lowered["object"])
        path, kind, packed = lowered["path"].rstrip("/"), lowered["type"], umsgpack.packb(lowered)
        if kind == "delete":
            self.kept = {key: data for key, data in self.kept.items() if not f"{key[0]}/".startswith(f"{path}/")}
        else:
            self.kept[path, kind, lowered.get("property", "")] = packed
        for listener in self.listeners:
            listener(packed)

    def _numbered(self, part: Any) -> Any:
        """The same with numbers for meshcat's ids, which hold the time and the network address of the computer."""
        if isinstance(part, str) and AN_ID.fullmatch(part):
            return self.ids.setdefault(part, str(UUID(int=len(self.ids) + 1)))
        if isinstance(part, dict):
            return {key: self._numbered(value) for key, value in part.items()}
        return [self._numbered(value) for value in part] if isinstance(part, list) else part


class Scene:
    """Things to look at, with a title, a legend, a view and, where something moves, frames.

    ``scene["arm/body 3"]`` is meshcat's ``Visualizer`` at that path: ``set_object``, ``set_transform``, ``set_property``,
    ``delete``. In Jupyter a scene shows itself.

    Attributes:
        meshcat: meshcat's ``Visualizer`` of the whole scene.
        title: title of the page.
        caption: a sentence below it.
        swatches: what colours mean.
        bar: numbers by colours, or None.
        notes: sentences: sizes, magnifications, what is not shown and why.
        frames: what moves, or None.
        view: from where it is looked at; None for meshcat's own view.
    """

    def __init__(self, title: str, caption: str = "") -> None:
        self._window = _Window()
        self.meshcat = Visualizer(window=self._window)
        self.title, self.caption = title, caption
        self.swatches: list[Swatch] = []
        self.bar: ColourBar | None = None
        self.notes: list[str] = []
        self.frames: Frames | None = None
        self.view: View | None = None

    def __getitem__(self, path: str) -> Any:
        return self.meshcat[path]

    def __str__(self) -> str:
        return f"{self.title}: {len(self.commands)} commands, {0 if self.frames is None else len(self.frames)} frames"

    @property
    def commands(self) -> list[bytes]:
        """The meshcat commands that build the scene, packed by msgpack."""
        return [*self._window.kept.values()]

    def html(self) -> str:
        """The scene as one page that needs neither a network nor a server."""
        return page.whole(self)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write that page.

        Raises:
            OutputError: the file exists and ``force`` is not given, or it cannot be written.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(encodable(self.html()), encoding="utf-8")

    def embedded(self, height: int = NOTEBOOK_HEIGHT) -> str:
        """The scene as a part of another page, which holds :func:`aacmm_pin.report.scenes.shared_script` once.

        Args:
            height: of the frame that it is shown in [px].
        """
        return page.embedded(self, height)

    def _repr_html_(self) -> str:
        return page.in_frame(self, NOTEBOOK_HEIGHT)

    def show(self, browser: bool = True) -> Server:
        """Serve the scene on this computer's loopback address; what is sent to it from then on is seen at once.

        Args:
            browser: open it in the browser.

        Returns:
            The server, running until it is closed or this process ends.

        Raises:
            AacmmError: the server does not start.
        """
        server = Server(self, self._window.listeners)
        if browser:
            webbrowser.open(server.url, new=2)
        return server
