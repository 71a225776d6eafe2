"""A scene shown live: a thread that serves its page and meshcat's commands on the loopback address alone.

meshcat's own file server listens on every network interface, so that anyone on the net could look.
"""

from __future__ import annotations

import asyncio
import threading
import webbrowser
from collections.abc import Callable
from types import TracebackType
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
WHOLE = umsgpack.packb(SetProperty("whole", True, Path(("aacmm",))).lower())
"""Tells the page that the scene is there."""


class Server:
    """A running server; a context, at whose end it stops. It ends with this process too.

    Attributes:
        url: where the scene is seen, on this computer.
    """

    def __init__(self, scene: Scene, listeners: list[Callable[[bytes], None]]) -> None:
        """Start it.

        Args:
            scene: what is served.
            listeners: where to hear of further commands.

        Raises:
            AacmmError: it does not start.
        """
        try:
            (self._socket,) = tornado.netutil.bind_sockets(0, LOOPBACK)
        except OSError as error:
            raise AacmmError(f"the server of the scene did not start: {error.strerror}") from None
        self.url = f"http://{LOOPBACK}:{self._socket.getsockname()[1]}/"
        self._scene, self._listeners, self._sockets = scene, listeners, set[_Socket]()
        self._loop, started = asyncio.new_event_loop(), threading.Event()
        self._thread = threading.Thread(target=self._run, args=[started], daemon=True)
        self._thread.start()
        started.wait()
        listeners.append(self._send)

    @property
    def running(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def open(self) -> None:
        """Open the scene in the browser."""
        webbrowser.open(self.url, new=2)

    def close(self) -> None:
        """Stop; a second time is harmless."""
        if self._send in self._listeners:
            self._listeners.remove(self._send)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __str__(self) -> str:
        return f"{self.url}, {'running' if self.running else 'stopped'}"

    def _run(self, started: threading.Event) -> None:
        """What the thread does until the loop is stopped."""
        asyncio.set_event_loop(self._loop)
        application = tornado.web.Application(log_function=lambda handler: None)
        application.add_handlers(OWN_NAMES, [("/", _Socket, {"scene": self._scene, "sockets": self._sockets})])
        server = tornado.httpserver.HTTPServer(application)
        server.add_sockets([self._socket])
        self._loop.call_soon(started.set)
        self._loop.run_forever()
        server.stop()
        for browser in tuple(self._sockets):
            browser.close()
        self._loop.run_until_complete(server.close_all_connections())
        self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        self._loop.close()

    def _send(self, command: bytes) -> None:
        self._loop.call_soon_threadsafe(self._hand_on, command)

    def _hand_on(self, command: bytes) -> None:
        for browser in self._sockets:
            browser.write_message(command, binary=True)


class _Socket(tornado.websocket.WebSocketHandler):
    """A browser: its plain request gets the page, its WebSocket (tornado refuses those of other origins) the commands."""

    def initialize(self, scene: Scene, sockets: set[_Socket]) -> None:
        self._scene, self._sockets = scene, sockets

    async def get(self, *args: Any, **kwargs: Any) -> None:
        if self.request.headers.get("Upgrade", "").lower() == "websocket":
            await super().get(*args, **kwargs)
        else:
            self.set_header("Cache-Control", "no-store")
            self.finish(page.whole(self._scene, live=True))

    def open(self, *args: str, **kwargs: str) -> None:
        for command in (*self._scene.commands, WHOLE):
            self.write_message(command, binary=True)
        self._sockets.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Browsers have nothing to say."""

    def on_close(self) -> None:
        self._sockets.discard(self)
