"""The process behind :class:`aacmm_pin.report.scenes.server.Server`, which runs this file by itself, without the package.

It reads msgpack from its input: the page, the commands of the scene, ``None``; then further commands until the input ends.
It prints where it serves. Requests that were not meant for this computer's own names are refused (a foreign page that
resolves its own name to 127.0.0.1 would send its name along), and so are WebSockets of other origins (by tornado).
"""

from __future__ import annotations

import signal
import sys
import threading
from pathlib import Path
from typing import Any

import meshcat
import tornado.httpserver
import tornado.ioloop
import tornado.netutil
import tornado.web
import tornado.websocket
import umsgpack
from meshcat.commands import SetProperty
from meshcat.path import Path as MeshcatPath
from meshcat.servers.tree import SceneTree, find_node, walk

LOOPBACK = "127.0.0.1"
OWN_NAMES = r"(127\.0\.0\.1|localhost)"
VIEWER_FOLDER = Path(meshcat.__file__).parent / "viewer" / "dist"
WHOLE = umsgpack.packb(SetProperty("whole", True, MeshcatPath(("aacmm",))).lower())
"""Tells the page that the scene is there."""


def keep(tree: Any, command: dict[str, Any], data: bytes) -> None:
    """Put a command and its packed form into a scene tree."""
    entries = [entry for entry in command["path"].split("/") if entry]
    kind = command["type"]
    if kind == "delete":
        parent = find_node(tree, entries[:-1]) if entries else tree
        parent.pop(entries[-1], None) if entries else parent.clear()
        return
    node = find_node(tree, entries)
    if kind == "set_object":
        node.object, node.properties = data, []
    elif kind == "set_property":
        node.properties.append(data)
    elif kind == "set_transform":
        node.transform = data
    elif kind == "set_animation":
        node.animation = data


def kept(tree: Any) -> list[bytes]:
    """The commands that build a tree, in the order in which a viewer can take them."""
    return [
        data
        for node in walk(tree)
        for data in (node.object, *node.properties, node.transform, node.animation)
        if data is not None
    ]


class Bridge:
    """The scene, and the browsers that look at it."""

    def __init__(self) -> None:
        self.tree = SceneTree()
        self.sockets: set[Socket] = set()

    def take(self, data: bytes) -> None:
        """Keep a command and hand it on."""
        keep(self.tree, umsgpack.unpackb(data), data)
        for socket in self.sockets:
            socket.write_message(data, binary=True)


class Socket(tornado.websocket.WebSocketHandler):
    """One browser. A plain request for the address of the socket is led to the page."""

    def initialize(self, bridge: Bridge) -> None:
        """Called by tornado with what :func:`application` states."""
        self._bridge = bridge

    async def get(self, *args: Any, **kwargs: Any) -> None:
        """Become a WebSocket, or lead to the page."""
        if self.request.headers.get("Upgrade", "").lower() != "websocket":
            self.redirect("/static/")
            return
        await super().get(*args, **kwargs)

    def open(self, *args: str, **kwargs: str) -> None:
        """Send the whole scene."""
        for command in kept(self._bridge.tree):
            self.write_message(command, binary=True)
        self.write_message(WHOLE, binary=True)
        self._bridge.sockets.add(self)

    def on_message(self, message: str | bytes) -> None:
        """Browsers have nothing to say."""

    def on_close(self) -> None:
        """Forget the browser."""
        self._bridge.sockets.discard(self)


class Page(tornado.web.RequestHandler):
    """The page of the scene."""

    def initialize(self, html: str) -> None:
        """Called by tornado with what :func:`application` states."""
        self._html = html

    def get(self) -> None:
        """Send it."""
        self.set_header("Cache-Control", "no-store")
        self.write(self._html)


def application(bridge: Bridge, html: str) -> tornado.web.Application:
    """The viewer, the page and the socket, for requests that name this computer."""
    serving = tornado.web.Application()
    serving.add_handlers(
        OWN_NAMES,
        [
            (r"/", Socket, {"bridge": bridge}),
            (r"/static/", Page, {"html": html}),
            (r"/static/(.+)", tornado.web.StaticFileHandler, {"path": str(VIEWER_FOLDER)}),
        ],
    )
    return serving


def main() -> None:
    """Serve until the input ends."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    source = sys.stdin.buffer
    html, bridge = umsgpack.unpack(source), Bridge()
    while (data := umsgpack.unpack(source)) is not None:
        bridge.take(data)
    loop = tornado.ioloop.IOLoop()
    loop.make_current()

    def listen_on() -> None:
        try:
            while True:
                loop.add_callback(bridge.take, umsgpack.unpack(source))
        except umsgpack.InsufficientDataException:
            loop.add_callback(loop.stop)

    server = tornado.httpserver.HTTPServer(application(bridge, html))
    (socket,) = tornado.netutil.bind_sockets(0, LOOPBACK)
    server.add_sockets([socket])
    threading.Thread(target=listen_on, daemon=True).start()
    print(f"http://{LOOPBACK}:{socket.getsockname()[1]}/static/", flush=True)
    loop.start()


if __name__ == "__main__":
    main()
