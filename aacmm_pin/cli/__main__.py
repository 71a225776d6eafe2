"""``aacmm-pin`` and ``python -m aacmm_pin.cli``: signals are answered from the first moment, before the rest is imported."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from types import FrameType


def _end(number: int, frame: FrameType | None) -> None:
    """Before anything was begun, and after everything has ended."""
    with suppress(OSError):  # nobody may be there to read it
        os.write(2, b"aacmm-pin: interrupted\n")
    os._exit(128 + number)


def _open_what_is_closed() -> None:
    """Standard streams that the caller closed, lest files that are opened later take their numbers."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)


def main() -> None:
    """The command."""
    _open_what_is_closed()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as nohup wants it, and shells for jobs in the background
            signal.signal(number, _end)
    from aacmm_pin.cli.root_command import app

    app()


if __name__ == "__main__":
    main()
