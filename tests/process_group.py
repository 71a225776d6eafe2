"""Processes that a test has started in a session of their own."""

from __future__ import annotations

import os
import signal
import time


def outlived(leader: int, seconds: float) -> bool:
    """Whether any of the group of ``leader`` is left after so long; they are killed then."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.killpg(leader, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.05)
    os.killpg(leader, signal.SIGKILL)
    return True
