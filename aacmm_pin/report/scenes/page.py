"""A scene as HTML: a whole page, a page that a server completes, or a part of another page.

meshcat's viewer is one script of 0.85 MB. A whole page has it inside. A page with several scenes has it once, as text that
does nothing (:func:`shared_script`); each scene is an inner frame that receives the text when it is scrolled into sight.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal

import jinja2
import meshcat
from markupsafe import Markup, escape

from aacmm_pin.errors import AacmmError
from aacmm_pin.report.scenes.frames import Frames
from aacmm_pin.report.scenes.legend import Legend
from aacmm_pin.report.scenes.view import View

VIEWER_NAME = "main.min.js"
PLACE_OF_VIEWER = "<!-- viewer -->"
"""Where a page without the viewer gets it."""


@dataclass(frozen=True, eq=False)
class Content:
    """All that a page shows.

    Attributes:
        title, caption: of the page.
        legend: explanations.
        frames: what moves, or None.
        view: from where it is looked at, or None.
        commands: what meshcat draws.
    """

    title: str
    caption: str
    legend: Legend
    frames: Frames | None
    view: View | None
    commands: Sequence[bytes]


def whole_page(content: Content) -> str:
    """One page that needs neither a network nor a server."""
    return _rendered(content, Markup(f"<script>{viewer_script()}</script>"), "whole")


def live_page(content: Content) -> str:
    """The page that a server sends; viewer and commands come from there."""
    return _rendered(content, Markup(f'<script src="{VIEWER_NAME}"></script>'), "live")


def embedded(content: Content, height: int) -> str:
    """A part of another page that has :func:`shared_script`: an inner frame, and behind it what it will show as JSON."""
    inner = _json(_rendered(content, Markup(PLACE_OF_VIEWER), "embedded"))
    return (
        f'<iframe class="aacmm-scene" title="{escape(content.title)}" allowfullscreen '
        f'style="width: 100%; height: {height}px; border: 0"></iframe>\n'
        f'<script type="application/json">{inner}</script>'
    )


def shared_script() -> str:
    """What a page with :func:`embedded` scenes needs once, anywhere: the viewer, and what fills the inner frames."""
    filling = _template("embed.js")
    return f'<script type="text/plain" id="aacmm-viewer">{viewer_script()}</script>\n<script>{filling}</script>'


def in_frame(html: str, title: str, height: int) -> str:
    """A whole page as an inner frame, for a notebook."""
    return (
        f'<iframe title="{escape(title)}" srcdoc="{escape(html)}" allowfullscreen '
        f'style="width: 100%; height: {height}px; border: 0"></iframe>'
    )


@cache
def viewer_script() -> str:
    """meshcat's viewer, the script that draws.

    Raises:
        AacmmError: it is not where meshcat 0.3 keeps it, or cannot stand inside a page.
    """
    place = resources.files(meshcat) / "viewer" / "dist" / VIEWER_NAME
    try:
        script = place.read_text(encoding="utf-8")
    except OSError as error:
        raise AacmmError(f"{place}: meshcat's viewer cannot be read: {error.strerror or error}") from None
    if "</script" in script or "<!--" in script:
        raise AacmmError(f"{place}: meshcat's viewer cannot stand inside a page: it holds </script or <!--")
    return script


def _rendered(content: Content, viewer: Markup, mode: Literal["whole", "live", "embedded"]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aacmm_pin.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("scene.html.j2").render(
        title=content.title,
        caption=content.caption,
        legend=content.legend,
        reads=content.frames is not None,
        moves=content.frames is not None and len(content.frames) > 1,
        viewer=viewer,
        drawing=Markup(_template("scene.js")),
        data=Markup(_json(_data(content, mode))),
    )


def _data(content: Content, mode: str) -> dict[str, Any]:
    view = content.view
    look = (
        None
        if view is None
        else {"points": view.outermost.tolist(), "direction": view.direction.tolist(), "room": view.room}
    )
    return {
        "mode": mode,
        "commands": [] if mode == "live" else [base64.b64encode(command).decode("ascii") for command in content.commands],
        "frames": None if content.frames is None else content.frames.encoded(),
        "view": look,
    }


def _json(value: Any) -> str:
    """JSON that can stand inside a script element."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")


@cache
def _template(name: str) -> str:
    return (resources.files("aacmm_pin.report") / "templates" / name).read_text(encoding="utf-8")
