"""A scene shown live: a process of its own that listens on the loopback address alone.

meshcat's own file server listens on every network interface, so that anyone on the net could look. This one serves
meshcat's viewer and speaks its protocol, to this computer only. It takes commands from a pipe, and ends when the pipe does:
when the server is closed, or when the process that started it is gone, however that came about.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import threading
import weakref
import webbrowser
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import IO, Any, Self

import umsgpack

from aacmm_pin.errors import AacmmError
from aacmm_pin.report.scenes import serving

PATIENCE = 10.0
"""So long the process may take to end by itself [s]."""


class Server:
    """A running server; a context, at whose end it stops.

    Attributes:
        url: where the scene is seen, on this computer.
    """

    def __init__(self, html: str, commands: Sequence[bytes], listeners: list[Callable[[bytes], None]]) -> None:
        """Start it.

        Args:
            html: the page, see :func:`aacmm_pin.report.scenes.page.live_page`.
            commands: the scene.
            listeners: where to hear of further commands.

        Raises:
            AacmmError: it does not start.
        """
        errors = tempfile.TemporaryFile()  # noqa: SIM115  (closed by _stop)
        # A session of its own: Ctrl-C in a notebook's cell or at a prompt is for the caller, who closes it.
        self._process = subprocess.Popen(
            [sys.executable, "-P", serving.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
        )
        self._lock = threading.Lock()
        self._listeners = listeners
        self._close = weakref.finalize(self, _stop, self._process, errors)
        with contextlib.suppress(BrokenPipeError):
            self._write(umsgpack.packb(html))
            for command in commands:
                self._write(umsgpack.packb(command))
            self._write(umsgpack.packb(None))
        self.url = self._pipe(self._process.stdout).readline().decode().strip()
        if not self.url:
            errors.seek(0)
            said = errors.read().decode(errors="replace").strip().splitlines()
            self._close()
            raise AacmmError(f"the server of the scene did not start: {said[-1] if said else 'it said nothing'}")
        listeners.append(self._send)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def open(self) -> None:
        """Open the scene in the browser."""
        webbrowser.open(self.url, new=2)

    def close(self) -> None:
        """End the process; a second time is harmless."""
        if self._send in self._listeners:
            self._listeners.remove(self._send)
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __str__(self) -> str:
        return f"{self.url}, {'running' if self.running else 'stopped'}"

    def _send(self, command: bytes) -> None:
        try:
            self._write(umsgpack.packb(command))
        except BrokenPipeError:
            self.close()

    def _write(self, data: bytes) -> None:
        pipe = self._pipe(self._process.stdin)
        with self._lock:
            pipe.write(data)
            pipe.flush()

    @staticmethod
    def _pipe(pipe: IO[Any] | None) -> IO[Any]:
        if pipe is None:
            raise AacmmError("the server of the scene has no pipe")
        return pipe


def _stop(process: subprocess.Popen[bytes], errors: IO[bytes]) -> None:
    """Close the pipe, at whose end the process ends; be firmer where it does not."""
    for pipe in (process.stdin, process.stdout, errors):
        if pipe is not None:
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
