"""Signals that end a command raise an exception in it, so that half-written files are removed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
RECEIVED: list[int] = []
"""Signals of this command: compiled code that is being loaded makes other errors of the exception.
"""


class Stopped(KeyboardInterrupt):
    """A signal came that ends the command, from the keyboard, ``timeout`` or a batch system."""

    def __init__(self, number: int) -> None:
        self.number = number


def _stop(number: int, frame: FrameType | None) -> None:
    RECEIVED.append(number)
    raise Stopped(number)


@contextmanager
def stopping_signals() -> Iterator[None]:
    """Raise :class:`Stopped` for each signal of :data:`STOPPING` that is not ignored, until the
    end.
    """
    if threading.current_thread() is not threading.main_thread():  # only that one receives any
        yield
        return
    RECEIVED.clear()
    before = {number: signal.getsignal(number) for number in STOPPING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
