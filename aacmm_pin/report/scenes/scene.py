"""A scene, without a server or with one: whatever is sent to meshcat is kept, written as one page,
or shown live.

meshcat's viewer is one script of 0.85 MB. A whole page has it inside. A page with several scenes
has it once, as text that does nothing (:func:`shared_script`); each scene is an inner frame that
receives the text when it is scrolled into sight, or soon after the page has been read.

A live scene is served by a thread on the loopback address alone. meshcat's own file server listens
on every network interface, so that anyone on the net could look.
"""

from __future__ import annotations

import asyncio
import base64
import json
import re
import socket
import threading
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, Self
from uuid import UUID

import jinja2
import meshcat
import numpy as np
import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack
from markupsafe import Markup, escape
from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex
from matplotlib.ticker import MaxNLocator
from meshcat import Visualizer
from meshcat.commands import SetProperty
from meshcat.path import Path as ScenePath

from aacmm_pin._support.checks import Array
from aacmm_pin._support.output_files import whole_file
from aacmm_pin._support.text_escaping import encodable
from aacmm_pin._support.units import DEG
from aacmm_pin.errors import AacmmError, ShapeError

Mark = Literal["ball", "line", "area"]
STOPS = 24
"""Colours that a bar is made of on the page."""
NOTEBOOK_HEIGHT = 560
"""Height of a scene in a notebook [px]."""
AN_ID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
"""How meshcat writes the id of a geometry, a material or an object."""
OUTERMOST = 60
"""Directions in which the points that have to be seen are looked for."""
POSTER = (
    '<p style="position: absolute; inset: 2rem 1rem auto; text-align: center">Scroll '
    "here to see the 3D scene.</p>"
)
"""Seen until the scene is drawn over it."""
LOOPBACK = "127.0.0.1"
OWN_NAMES = r"(127\.0\.0\.1|localhost)"
"""Requests for other names are refused: a foreign page may have its own name resolved to this
computer.
"""
MOST_SENT = 65_536
"""A browser that only looks has no more than this to say at once [bytes]; requests with more are
refused unread.
"""
WHOLE = umsgpack.packb(SetProperty("whole", True, ScenePath(("aacmm",))).lower())
"""Tells the page that the scene is there."""


@dataclass(frozen=True)
class Swatch:
    """One colour of the legend and its meaning.

    Attributes:
        colour: CSS background.
        text: meaning of the colour.
        mark: shape of the swatch.
    """

    colour: str
    text: str
    mark: Mark = "ball"


@dataclass(frozen=True, eq=False)
class ColourBar:
    """The colour scale of a scene.

    Attributes:
        label: quantity with its unit.
        low, high: values at the two ends.
        name: name of the matplotlib colour map.
    """

    label: str
    low: float
    high: float
    name: str

    @staticmethod
    def of(label: str, values: Array, name: str) -> ColourBar:
        """Make the colour scale of the finite ``values``; if all values are equal, the scale
        extends slightly beyond them.
        """
        finite = values[np.isfinite(values)]
        low, high = float(finite.min()), float(finite.max())
        room = 0.0 if high > low else max(abs(low), 1e-12) * 0.01
        return ColourBar(label, low - room, high + room, name)

    def colours(self, values: Array) -> Array:
        """Return the colours ``(n, 3)`` in [0, 1] of ``values`` ``(n,)``."""
        shade = Normalize(self.low, self.high)(values)
        rgba = np.asarray(colormaps[self.name](shade))
        return rgba[:, :3]

    @property
    def css(self) -> str:
        """The colour scale as a CSS gradient."""
        colours = colormaps[self.name](np.linspace(0, 1, STOPS))
        return f"linear-gradient(to right, {', '.join(map(to_hex, colours))})"

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Return the positions along the scale [%] and the numbers of the ticks."""
        locator = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10])
        values = np.asarray(locator.tick_values(self.low, self.high))
        inside = values[(self.low <= values) & (values <= self.high)].tolist()
        percent = 100 / (self.high - self.low)
        return [(percent * (value - self.low), f"{value:.4g}") for value in inside]


@dataclass(frozen=True, eq=False)
class Frames:
    """The moving parts of a scene.

    Attributes:
        placements: placements of each moving path ``(n, 4, 4)`` [m]; rotations may contain a scale.
        texts: texts of each displayed number by its name, ``(n,)`` each.
        colours: CSS colour of each frame along the slider ``(n,)``.
        start: index of the first frame shown.
        per_second: number of frames per second.
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
                    raise ShapeError(
                        f"{what} of {name}: {len(of)} frames; expected {n}, as many as colours"
                    )
        if not 0 <= self.start < n:
            raise ShapeError(f"start is {self.start}; expected a frame from 0 to {n - 1}")

    def __len__(self) -> int:
        return len(self.colours)

    @property
    def labels(self) -> list[str]:
        """The names of the displayed numbers."""
        return list(self.texts)

    @property
    def readings(self) -> list[list[str]]:
        """The texts of the displayed numbers for each frame, in the order of :attr:`labels`."""
        return [list(row) for row in zip(*self.texts.values(), strict=True)]


@dataclass(frozen=True, eq=False)
class View:
    """The points that a page shows and the direction of the camera; the page calculates the
    distance.

    Attributes:
        points: points that are all within the picture ``(n, 3)`` [m].
        azimuth: azimuth of the camera, from +x towards +y [rad].
        elevation: elevation of the camera above the horizontal [rad].
        room: margin around the points, for thick bodies [m].
    """

    points: Array
    azimuth: float
    elevation: float = 18 * DEG
    room: float = 0.0

    @property
    def direction(self) -> Array:
        """The unit vector from the points towards the camera, ``(3,)``."""
        level = np.cos(self.elevation)
        x = level * np.cos(self.azimuth)
        y = level * np.sin(self.azimuth)
        return np.array([x, y, np.sin(self.elevation)])

    @property
    def outermost(self) -> Array:
        """The outermost points, which represent all points, ``(m, 3)`` [m]."""
        # Evenly over the sphere (Fibonacci).
        turn = np.arange(OUTERMOST) * np.pi * (3.0 - np.sqrt(5.0))
        height = 1.0 - (2 * np.arange(OUTERMOST) + 1) / OUTERMOST
        level = np.sqrt(1.0 - height**2)
        directions = np.column_stack([level * np.cos(turn), level * np.sin(turn), height])
        farthest = (directions @ self.points.T).argmax(axis=1)
        return np.asarray(self.points[np.unique(farthest)])


class _Window:
    """A window for meshcat's ``Visualizer``: it keeps the last command of each kind for each path,
    and hands it on.
    """

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
        path, kind = lowered["path"].rstrip("/"), lowered["type"]
        packed = umsgpack.packb(lowered)
        if kind == "delete":
            below = [key for key in self.kept if f"{key[0]}/".startswith(f"{path}/")]
            for key in below:
                del self.kept[key]
        else:
            self.kept[path, kind, lowered.get("property", "")] = packed
        for listener in self.listeners:
            listener(packed)

    def _numbered(self, part: Any) -> Any:
        """The same with numbers for meshcat's ids, which hold the time and the network address of
        the computer.
        """
        if isinstance(part, str) and AN_ID.fullmatch(part):
            return self.ids.setdefault(part, str(UUID(int=len(self.ids) + 1)))
        if isinstance(part, dict):
            return {key: self._numbered(value) for key, value in part.items()}
        return [self._numbered(value) for value in part] if isinstance(part, list) else part


class Scene:
    """A three-dimensional scene with a title, a legend and a view; a moving scene also has frames.

    ``scene["arm/body 3"]`` is meshcat's ``Visualizer`` at that path, with ``set_object``,
    ``set_transform``, ``set_property`` and ``delete``. Jupyter displays a scene as the value of a
    cell.

    Attributes:
        meshcat: meshcat's ``Visualizer`` of the whole scene.
        title: title of the page.
        caption: sentence below the scene.
        swatches: colours of the legend and their meaning.
        bar: colour scale, or None.
        notes: sentences about sizes, magnifications and omitted parts.
        frames: moving parts, or None.
        view: view of the camera; None for the default of meshcat.
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
        frames = len(self.frames) if self.frames else 0
        return f"{self.title}: {len(self.commands)} commands, {frames} frames"

    @property
    def commands(self) -> list[bytes]:
        """Return the meshcat commands that build the scene, packed with msgpack."""
        return [*self._window.kept.values()]

    def html(self) -> str:
        """Return the scene as one HTML page that needs neither a network nor a server."""
        return whole_page(self)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save the scene as one HTML page that needs neither a network nor a server.

        Raises:
            OutputError: the file exists and ``force`` is False, or the file cannot be written.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(encodable(self.html()), encoding="utf-8")

    def embedded(self, height: int = NOTEBOOK_HEIGHT) -> str:
        """Return the scene as HTML for another page; that page must contain
        :func:`aacmm_pin.report.scenes.shared_script` once.

        Args:
            height: height of the frame around the scene [px].
        """
        return embedded_page(self, height)

    def _repr_html_(self) -> str:
        return framed_page(self, NOTEBOOK_HEIGHT)

    def show(self, browser: bool = True) -> Server:
        """Serve the scene on the loopback address of this computer; the browser shows later changes
        immediately.

        Args:
            browser: open the scene in the browser.

        Returns:
            The server, which runs until :meth:`Server.close` or the end of the process.

        Raises:
            AacmmError: the server does not start.
        """
        server = Server(self, self._window.listeners)
        if browser:
            webbrowser.open(server.url, new=2)
        return server


# --- the page


def whole_page(scene: Scene, live: bool = False) -> str:
    """One page that needs no network; a ``live`` one gets its commands from the server that sends
    it.
    """
    return _rendered(scene, Markup(f"<script>{viewer_script()}</script>"), live=live, plays=True)


def embedded_page(scene: Scene, height: int) -> str:
    """A part of another page that has :func:`shared_script`: an inner frame, and behind it what it
    will show as JSON.
    """
    inner = _json(_rendered(scene, Markup("<!-- viewer -->"), live=False, plays=False))
    frame = _frame(scene, height, "class=aacmm-scene", "; position: relative")
    return (
        f'<div style="position: relative">{POSTER}{frame}\n<script '
        f'type="application/json">{inner}</script></div>'
    )


def shared_script() -> str:
    """Return the HTML that a page with embedded scenes needs once: the viewer and a script that
    fills the frames.
    """
    filling = _template("embed.js")
    return (
        '<script type="text/plain" '
        f'id="aacmm-viewer">{viewer_script()}</script>\n<script>{filling}</script>'
    )


def framed_page(scene: Scene, height: int) -> str:
    """A whole page as an inner frame, for a notebook."""
    return _frame(scene, height, f'srcdoc="{escape(whole_page(scene))}"')


def _frame(scene: Scene, height: int, more: str, style: str = "") -> str:
    style = f"width: 100%; height: {height}px; border: 0{style}"
    return f'<iframe title="{escape(scene.title)}" {more} allowfullscreen style="{style}"></iframe>'


@cache
def viewer_script() -> str:
    """meshcat's viewer, the script that draws.

    Raises:
        AacmmError: it is not where meshcat 0.3 keeps it, or cannot stand inside a page.
    """
    place = resources.files(meshcat) / "viewer" / "dist" / "main.min.js"
    try:
        script = place.read_text(encoding="utf-8")
    except OSError as error:
        raise AacmmError(
            f"{place}: meshcat's viewer cannot be read: {error.strerror or error}"
        ) from None
    if "</script" in script or "<!--" in script:
        raise AacmmError(
            f"{place}: meshcat's viewer has </script or <!--; expected a viewer without these; "
            "install another version of meshcat"
        )
    return script


def _rendered(scene: Scene, viewer: Markup, *, live: bool, plays: bool) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aacmm_pin.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    data = {
        "live": live,
        "plays": plays,
        "commands": [] if live else [_base64(command) for command in scene.commands],
        "frames": scene.frames and _frames(scene.frames),
        "view": scene.view and _view(scene.view),
    }
    drawing = Markup(_template("scene.js"))
    template = environment.get_template("scene.html.j2")
    return template.render(scene=scene, viewer=viewer, drawing=drawing, data=Markup(_json(data)))


def _frames(frames: Frames) -> dict[str, Any]:
    """Placements as the three upper rows of their matrices in single precision."""
    moving = {}
    for path, placements in frames.placements.items():
        rows = placements[:, :3].astype("<f4")
        moving[path] = _base64(rows.tobytes())
    return {
        "count": len(frames),
        "start": frames.start,
        "perSecond": frames.per_second,
        "labels": frames.labels,
        "readings": frames.readings,
        "colours": list(frames.colours),
        "moving": moving,
    }


def _view(view: View) -> dict[str, Any]:
    return {
        "points": view.outermost.tolist(),
        "direction": view.direction.tolist(),
        "room": float(view.room),
    }


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _json(value: Any) -> str:
    """JSON that can stand inside a script element."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")


@cache
def _template(name: str) -> str:
    return (resources.files("aacmm_pin.report") / "templates" / name).read_text(encoding="utf-8")


# --- the server


class Server:
    """A running server of a scene, and a context manager that stops the server.

    The server also ends with the process.

    Attributes:
        url: address of the scene on this computer.
    """

    def __init__(self, scene: Scene, listeners: list[Callable[[bytes], None]]) -> None:
        """Start the server; ``listeners`` passes later commands of the scene to the server.

        Raises:
            AacmmError: the server does not start.
        """
        try:
            (bound,) = tornado.netutil.bind_sockets(0, LOOPBACK)
        except OSError as error:
            raise AacmmError(f"the server of the scene did not start: {error.strerror}") from None
        self.url = f"http://{LOOPBACK}:{bound.getsockname()[1]}/"
        self._listeners, self._browsers, started = listeners, set[_Browser](), threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(scene, bound, started)), daemon=True
        )
        self._thread.start()
        started.wait()
        listeners.append(self._send)

    @property
    def running(self) -> bool:
        """True while the server runs."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Stop the server; a second call has no effect."""
        if self._send in self._listeners:
            self._listeners.remove(self._send)
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def _serve(self, scene: Scene, bound: socket.socket, started: threading.Event) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        application = tornado.web.Application(
            log_function=lambda handler: None, websocket_max_message_size=MOST_SENT
        )
        application.add_handlers(
            OWN_NAMES, [("/", _Browser, {"scene": scene, "browsers": self._browsers})]
        )
        server = tornado.httpserver.HTTPServer(
            application, max_body_size=MOST_SENT, max_buffer_size=16 * MOST_SENT
        )
        server.add_sockets([bound])
        started.set()
        await self._stop.wait()
        server.stop()
        for browser in tuple(self._browsers):
            browser.close()
        await server.close_all_connections()

    def _send(self, command: bytes) -> None:
        self._loop.call_soon_threadsafe(self._hand_on, command)

    def _hand_on(self, command: bytes) -> None:
        for browser in self._browsers:
            browser.write_message(command, binary=True)


class _Browser(tornado.websocket.WebSocketHandler):
    """Its plain request gets the page, its WebSocket (tornado refuses those of other origins) the
    commands.
    """

    def initialize(self, scene: Scene, browsers: set[_Browser]) -> None:
        self._scene, self._browsers = scene, browsers

    async def get(self, *args: Any, **kwargs: Any) -> None:
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await super().get(*args, **kwargs)
        else:
            self.set_header("Cache-Control", "no-store")
            self.finish(whole_page(self._scene, live=True))

    def open(self, *args: str, **kwargs: str) -> None:
        for command in (*self._scene.commands, WHOLE):
            self.write_message(command, binary=True)
        self._browsers.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Browsers have nothing to say."""

    def on_close(self) -> None:
        self._browsers.discard(self)
