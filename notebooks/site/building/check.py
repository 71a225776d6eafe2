"""The pages as built: no file from the network, and no link inside that leads nowhere."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


class Links(HTMLParser):
    """What a page has and what it asks for."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Sort the addresses."""
        named = dict(attrs)
        self.anchors |= {name for key in ("id", "name") if (name := named.get(key))}
        if tag == "a":
            self.links += filter(None, [named.get("href")])
        elif tag == "link" and named.get("rel") not in (
            "next",
            "prev",
            "index",
            "search",
            "genindex",
        ):
            self.loaded += filter(None, [named.get("href")])
        else:
            self.loaded += filter(
                None, [named.get(key) for key in ("src", "srcset", "data", "poster")]
            )


def _read(path: Path) -> Links:
    links = Links()
    links.feed(path.read_text(encoding="utf-8"))
    return links


def _check(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir)
    pages = {path: _read(path) for path in folder.rglob("*.html")}
    for path, page in pages.items():
        for address in page.loaded:
            parts = urlsplit(address)
            if parts.netloc or parts.scheme not in ("", "data"):
                LOGGER.warning("%s loads %s from the network", path.name, address)
            elif not parts.scheme and not (path.parent / unquote(parts.path)).exists():
                LOGGER.warning("%s loads %s, which is not there", path.name, address)
        for address in page.links:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            if not target.exists():
                LOGGER.warning("%s links to %s, which is not there", path.name, address)
            elif (
                parts.fragment
                and target in pages
                and unquote(parts.fragment) not in pages[target].anchors
            ):
                LOGGER.warning("%s links to %s, which has no such place", path.name, address)
    for sheet in (*folder.rglob("*.css"), *folder.rglob("*.js")):
        text = sheet.read_text(encoding="utf-8")
        for start in (
            "url(http",
            "url('http",
            'url("http',
            "@import url(//",
            'importScripts("http',
        ):
            if start in text:
                LOGGER.warning("%s loads something from the network: %s", sheet.name, start)


def setup(app: Sphinx) -> dict[str, Any]:
    """When all is written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True}
