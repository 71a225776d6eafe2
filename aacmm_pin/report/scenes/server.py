"""A scene shown live: a thread that serves its page and meshcat's commands on the loopback address alone.

meshcat's own file server listens on every network interface, so that anyone on the net could look.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack
from meshcat.commands import SetProperty
from meshcat.path import Path

from aacmm_pin.errors import AacmmError
from aacmm_pin.report.scenes import page

if TYPE_CHECKING:
    from aacmm_pin.report.scenes.scene import Scene

LOOPBACK = "127.0.0.1"
OWN_NAMES = r"(127\.0\.0\.1|localhost)"
"""Requests for other names are refused: a foreign page may have its own name resolved to this computer."""
MOST_SENT = 65_536
"""A browser that only looks has no more than this to say at once [bytes]; requests with more are refused unread."""
WHOLE = umsgpack.packb(SetProperty("whole", True, Path(("aacmm",))).lower())
"""Tells the page that the scene is there."""


class Server:
    """A running server; a context, at whose end it stops. It ends with this process too.

    Attributes:
        url: where the scene is seen, on this computer.
    """

    def __init__(self, scene: Scene, listeners: list[Callable[[bytes], None]]) -> None:
        """Start it; further commands are heard of through ``listeners``.

        Raises:
            AacmmError: it does not start.
        """
        try:
            (bound,) = tornado.netutil.bind_sockets(0, LOOPBACK)
        except OSError as error:
            raise AacmmError(f"the server of the scene did not start: {error.strerror}") from None
        self.url = f"http://{LOOPBACK}:{bound.getsockname()[1]}/"
        self._listeners, self._browsers, started = listeners, set[_Browser](), threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(scene, bound, started)), daemon=True)
        self._thread.start()
        started.wait()
        listeners.append(self._send)

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def close(self) -> None:
        """Stop; a second time is harmless."""
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
        application = tornado.web.Application(log_function=lambda handler: None, websocket_max_message_size=MOST_SENT)
        application.add_handlers(OWN_NAMES, [("/", _Browser, {"scene": scene, "browsers": self._browsers})])
        server = tornado.httpserver.HTTPServer(application, max_body_size=MOST_SENT, max_buffer_size=16 * MOST_SENT)
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
    """Its plain request gets the page, its WebSocket (tornado refuses those of other origins) the commands."""

    def initialize(self, scene: Scene, browsers: set[_Browser]) -> None:
        self._scene, self._browsers = scene, browsers

    async def get(self, *args: Any, **kwargs: Any) -> None:
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await super().get(*args, **kwargs)
        else:
            self.set_header("Cache-Control", "no-store")
            self.finish(page.whole(self._scene, live=True))

    def open(self, *args: str, **kwargs: str) -> None:
        for command in (*self._scene.commands, WHOLE):
            self.write_message(command, binary=True)
        self._browsers.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Browsers have nothing to say."""

    def on_close(self) -> None:
        self._browsers.discard(self)
