"""A real headless Chromium for tests: pages are opened, asked, and pictured over the DevTools
protocol.

The protocol runs over two pipes (``--remote-debugging-pipe``), so that no port is opened and no
library is needed.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import io
import json
import os
import re
import select
import shutil
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest
from PIL import Image

REQUIRED = "AACMM_PIN_BROWSER"
"""Environment variable: with the value ``required``, tests fail where there is no browser instead
of being skipped.
"""
PATIENCE = 60.0
"""So long anything may take [s]; drawing by software on two busy cores is slow."""
FLAGS = (
    *(
        "--headless",
        "--no-sandbox",
        "--no-first-run",
        "--no-default-browser-check",
        "--disable-quic",
        "--disable-sync",
    ),
    *(
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-extensions",
        "--disable-dev-shm-usage",
    ),
    *(
        "--mute-audio",
        "--hide-scrollbars",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ),
    "--remote-debugging-pipe",
)
PIPES = 'exec "$@" 3<&{read} 4>&{write}'
"""The protocol wants its pipes as descriptors 3 and 4."""


def browser_path() -> str:
    """Where Chromium is; skips the test, or fails it, where there is none."""
    for name in ("chromium", "chromium-browser", "google-chrome", "chrome"):
        if found := shutil.which(name):
            return found
    if os.environ.get(REQUIRED) == "required":
        pytest.fail(
            f"{REQUIRED}=required, but there is no chromium on PATH (Debian: apt-get install "
            "chromium)"
        )
    pytest.skip("no chromium on PATH (Debian: apt-get install chromium)")


class Page:
    """One tab of a Chromium of its own.

    Attributes:
        errors: what the page complained of since it was opened: exceptions, errors and warnings on
            the console, requests that failed.
        requests: URLs that it asked the network for.
    """

    def __init__(self, *flags: str) -> None:
        browser = browser_path()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._number, self._buffer, self._answers, self._events = (
            0,
            b"",
            dict[int, dict[str, Any]](),
            set[str](),
        )
        self._folder = tempfile.TemporaryDirectory(prefix="browser-", ignore_cleanup_errors=True)
        theirs_in, self._out = _pipe()
        self._in, theirs_out = _pipe()
        command = [browser, *FLAGS, *flags, f"--user-data-dir={self._folder.name}", "about:blank"]
        self._process = subprocess.Popen(
            [
                "/bin/bash",
                "-c",
                PIPES.format(read=theirs_in, write=theirs_out),
                "browser",
                *command,
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(theirs_in, theirs_out),
            start_new_session=True,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        targets = self._ask("Target.getTargets", session=False)["targetInfos"]
        target = next(t["targetId"] for t in targets if t["type"] == "page")
        self._session = self._ask(
            "Target.attachToTarget", session=False, targetId=target, flatten=True
        )["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def open(
        self, where: str | Path, size: tuple[int, int] = (1200, 800), *, touch: bool = False
    ) -> None:
        """Load a file or a URL in a window of that size, and wait until it is loaded."""
        self._load("about:blank")  # so that another place of the same page is loaded anew too
        self.resize(size, touch=touch)
        self.errors.clear()
        self.requests.clear()
        self._load(where.resolve().as_uri() if isinstance(where, Path) else where)

    def _load(self, url: str) -> None:
        self._events.discard("Page.loadEventFired")
        said = self._ask("Page.navigate", url=url)
        if "errorText" in said:
            raise AssertionError(f"{url}: {said['errorText']}")
        if "loaderId" in said:  # else there is nothing to load: it is open
            self._until(lambda: "Page.loadEventFired" in self._events, f"{url} to load")

    def resize(self, size: tuple[int, int], *, touch: bool = False) -> None:
        """Give the window another size [px]; ``touch`` makes it that of a phone."""
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=size[0],
            height=size[1],
            deviceScaleFactor=1,
            mobile=touch,
        )
        self._ask("Emulation.setTouchEmulationEnabled", enabled=touch)

    def media(self, kind: str) -> None:
        """Show the page as on ``screen`` or in ``print``; "" for what the browser takes by
        itself.
        """
        self._ask("Emulation.setEmulatedMedia", media=kind)

    def evaluate(self, script: str) -> Any:
        """Value of a JavaScript expression (a promise is waited for) as JSON has it; what it
        throws, an AssertionError.
        """
        said = self._ask(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in said:
            details = said["exceptionDetails"]
            raise AssertionError(details.get("exception", {}).get("description") or details["text"])
        return said["result"].get("value")

    def wait_for(self, script: str) -> None:
        """Wait until a JavaScript expression is true."""
        self._until(lambda: bool(self.evaluate(script)), script)

    def key(self, key: str) -> None:
        """Press and release a key, such as ``ArrowRight``."""
        text = {"text": key} if len(key) == 1 else {}
        self._ask("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self._ask("Input.dispatchKeyEvent", type="keyUp", key=key)

    def screenshot(
        self, size: tuple[int, int] | None = None, path: Path | None = None
    ) -> np.ndarray:
        """What is seen, as an array (height, width, 3) of bytes; written to ``path`` too where one
        is given.
        """
        if size is not None:
            self.resize(size)
        self.evaluate(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => "
            "done(1))))"
        )
        png = base64.b64decode(self._ask("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(png)
        with Image.open(io.BytesIO(png)) as picture:
            return np.asarray(picture.convert("RGB"))

    def printed_pages(self) -> int:
        """Sheets of A4 that the page takes when it is printed with its own margins."""
        printed = self._ask(
            "Page.printToPDF", paperWidth=8.27, paperHeight=11.69, preferCSSPageSize=True
        )
        return len(re.findall(rb"/Type\s*/Page\b(?!s)", base64.b64decode(printed["data"])))

    def close(self) -> None:
        """End the browser."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._in)
        os.close(self._out)
        self._folder.cleanup()

    def _ask(self, method: str, *, session: bool = True, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        number, message = self._number, {"id": self._number, "method": method, "params": parameters}
        if session:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._out, data) :]
        self._until(lambda: number in self._answers, method, quick=True)
        answer = self._answers.pop(number)
        if "error" in answer:
            raise AssertionError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def _until(self, done: Any, what: str, quick: bool = False) -> None:
        end = time.monotonic() + PATIENCE
        while not done():
            if time.monotonic() > end:
                raise AssertionError(f"waited {PATIENCE:g} s for {what}; errors: {self.errors}")
            self._read(1.0 if quick else 0.05)

    def _read(self, seconds: float) -> None:
        if not select.select([self._in], [], [], seconds)[0]:
            return
        data = os.read(self._in, 1 << 20)
        if not data:
            raise AssertionError("the browser has ended")
        *messages, self._buffer = (self._buffer + data).split(b"\0")
        for message in messages:
            self._hear(json.loads(message))

    def _hear(self, message: dict[str, Any]) -> None:
        if "id" in message:
            self._answers[message["id"]] = message
            return
        method, said = message["method"], message.get("params", {})
        self._events.add(method)
        if method == "Runtime.exceptionThrown":
            details = said["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Runtime.consoleAPICalled" and said["type"] in (
            "error",
            "warning",
            "assert",
        ):
            self.errors.append(
                " ".join(str(a.get("value", a.get("description"))) for a in said["args"])
            )
        elif method == "Log.entryAdded" and said["entry"]["level"] in ("error", "warning"):
            self.errors.append(f"{said['entry']['text']} {said['entry'].get('url', '')}".strip())
        elif method == "Network.requestWillBeSent":
            self.requests.append(said["request"]["url"])
        elif method == "Network.loadingFailed" and not said.get("canceled"):
            self.errors.append(said["errorText"])


def _pipe() -> tuple[int, int]:
    """A pipe whose ends do not have the numbers 3 and 4."""
    ends = os.pipe()
    try:
        read, write = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends)
    finally:
        for end in ends:
            os.close(end)
    return read, write
