"""A meshcat scene without a server: whatever is sent to it is kept, and can be written down as one page or be shown live."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from meshcat import Visualizer

from aacmm_pin._support.output_files import whole_file
from aacmm_pin.report.scenes import page
from aacmm_pin.report.scenes.frames import Frames
from aacmm_pin.report.scenes.legend import Legend
from aacmm_pin.report.scenes.recorder import Recorder
from aacmm_pin.report.scenes.server import Server
from aacmm_pin.report.scenes.serving import kept
from aacmm_pin.report.scenes.view import View

NOTEBOOK_HEIGHT = 560
"""Height of a scene in a notebook [px]."""


class Scene:
    """Things to look at, with a title, a legend, a view and, where something moves, frames.

    ``scene["arm/body 3"]`` is meshcat's ``Visualizer`` at that path: ``set_object``, ``set_transform``, ``set_property``,
    ``delete``. In Jupyter a scene shows itself.

    Attributes:
        meshcat: meshcat's ``Visualizer`` of the whole scene.
        title: title of the page.
        caption: a sentence below it.
        legend: what colours, bars and sizes mean.
        frames: what moves, or None.
        view: from where it is looked at; None for meshcat's own view.
    """

    def __init__(
        self,
        title: str,
        caption: str = "",
        *,
        legend: Legend | None = None,
        frames: Frames | None = None,
        view: View | None = None,
    ) -> None:
        self._window = Recorder()
        self.meshcat = Visualizer(window=self._window)
        self.title, self.caption = title, caption
        self.legend = legend or Legend()
        self.frames, self.view = frames, view

    def __getitem__(self, path: str) -> Any:
        return self.meshcat[path]

    def __str__(self) -> str:
        return f"{self.title}: {len(self.commands)} commands, {0 if self.frames is None else len(self.frames)} frames"

    @property
    def commands(self) -> list[bytes]:
        """The meshcat commands that build the scene, packed by msgpack."""
        return kept(self._window.tree)

    def content(self) -> page.Content:
        """What a page needs of the scene."""
        return page.Content(self.title, self.caption, self.legend, self.frames, self.view, self.commands)

    def html(self) -> str:
        """The scene as one page that needs neither a network nor a server."""
        return page.whole_page(self.content())

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write that page.

        Raises:
            OutputError: the file exists and ``force`` is not given, or it cannot be written.
        """
        with whole_file(path, force) as temporary:
            temporary.write_text(self.html(), encoding="utf-8")

    def embedded(self, height: int = NOTEBOOK_HEIGHT) -> str:
        """The scene as a part of another page, which holds :func:`aacmm_pin.report.scenes.shared_script` once.

        Args:
            height: of the frame that it is shown in [px].
        """
        return page.embedded(self.content(), height)

    def _repr_html_(self) -> str:
        return page.in_frame(self.html(), self.title, NOTEBOOK_HEIGHT)

    def show(self, browser: bool = True) -> Server:
        """Serve the scene on this computer's loopback address; what is sent to it from then on is seen at once.

        Args:
            browser: open it in the browser.

        Returns:
            The server, running until it is closed or this process ends.

        Raises:
            AacmmError: the server does not start.
        """
        server = Server(page.live_page(self.content()), self.commands, self._window.listeners)
        if browser:
            server.open()
        return server
