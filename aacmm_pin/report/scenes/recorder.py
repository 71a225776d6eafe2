"""meshcat's window without a server: it keeps the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import umsgpack
from meshcat.servers.tree import SceneTree

from aacmm_pin.report.scenes.serving import keep


class Recorder:
    """What meshcat's ``Visualizer`` takes for a window: commands are kept in a scene tree and handed on to listeners.

    Attributes:
        tree: meshcat's tree of the last object, transform, properties and animation of every path.
        listeners: called with every further command.
    """

    web_url = ""

    def __init__(self) -> None:
        self.tree = SceneTree()
        self.listeners: list[Callable[[bytes], None]] = []

    def send(self, command: Any) -> None:
        """Keep a command, as meshcat's own server does."""
        lowered = command.lower()
        data = umsgpack.packb(lowered)
        keep(self.tree, lowered, data)
        for listener in self.listeners:
            listener(data)
