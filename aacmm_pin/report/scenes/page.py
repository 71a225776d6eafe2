"""A scene as HTML: a whole page, or a part of another page.

meshcat's viewer is one script of 0.85 MB. A whole page has it inside. A page with several scenes has it once, as text that
does nothing (:func:`shared_script`); each scene is an inner frame that receives the text when it is scrolled into sight, or
soon after the page has been read.
"""

from __future__ import annotations

import base64
import json
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
import meshcat
from markupsafe import Markup, escape

from aacmm_pin.errors import AacmmError

if TYPE_CHECKING:
    from aacmm_pin.report.scenes.scene import Frames, Scene


POSTER = '<p style="position: absolute; inset: 2rem 1rem auto; text-align: center">3D scene: scroll here to see it.</p>'
"""Seen until the scene is drawn over it."""


def whole(scene: Scene, live: bool = False) -> str:
    """One page that needs no network; a ``live`` one gets its commands from the server that sends it."""
    return _rendered(scene, Markup(f"<script>{viewer_script()}</script>"), live=live, plays=True)


def embedded(scene: Scene, height: int) -> str:
    """A part of another page that has :func:`shared_script`: an inner frame, and behind it what it will show as JSON."""
    inner = _json(_rendered(scene, Markup("<!-- viewer -->"), live=False, plays=False))
    frame = _frame(scene, height, "class=aacmm-scene", "; position: relative")
    return f'<div style="position: relative">{POSTER}{frame}\n<script type="application/json">{inner}</script></div>'


def shared_script() -> str:
    """What a page with embedded scenes needs once, anywhere: the viewer, and what fills the inner frames."""
    filling = _template("embed.js")
    return f'<script type="text/plain" id="aacmm-viewer">{viewer_script()}</script>\n<script>{filling}</script>'


def in_frame(scene: Scene, height: int) -> str:
    """A whole page as an inner frame, for a notebook."""
    return _frame(scene, height, f'srcdoc="{escape(whole(scene))}"')


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
        raise AacmmError(f"{place}: meshcat's viewer cannot be read: {error.strerror or error}") from None
    if "</script" in script or "<!--" in script:
        raise AacmmError(f"{place}: meshcat's viewer cannot stand inside a page: it holds </script or <!--")
    return script


def _rendered(scene: Scene, viewer: Markup, *, live: bool, plays: bool) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aacmm_pin.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    view = scene.view
    data = {
        "live": live,
        "plays": plays,
        "commands": [] if live else [base64.b64encode(command).decode("ascii") for command in scene.commands],
        "frames": scene.frames and _frames(scene.frames),
        "view": view and {"points": view.outermost.tolist(), "direction": view.direction.tolist(), "room": float(view.room)},
    }
    drawing = Markup(_template("scene.js"))
    template = environment.get_template("scene.html.j2")
    return template.render(scene=scene, viewer=viewer, drawing=drawing, data=Markup(_json(data)))


def _frames(frames: Frames) -> dict[str, Any]:
    """Placements as the three upper rows of their matrices in single precision, base64; NaN hides a body."""
    return {
        "count": len(frames),
        "start": frames.start,
        "perSecond": frames.per_second,
        "labels": frames.labels,
        "readings": frames.readings,
        "colours": list(frames.colours),
        "moving": {
            path: base64.b64encode(of[:, :3].astype("<f4").tobytes()).decode("ascii")
            for path, of in frames.placements.items()
        },
    }


def _json(value: Any) -> str:
    """JSON that can stand inside a script element."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False).replace("<", "\\u003c")


@cache
def _template(name: str) -> str:
    return (resources.files("aacmm_pin.report") / "templates" / name).read_text(encoding="utf-8")
