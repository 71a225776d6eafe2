"""Bars: on a terminal's stderr and nowhere else, in a notebook as widgets; gone before an interrupt
is told.
"""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import textwrap
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from tqdm.auto import tqdm

from aacmm_pin import (
    calibrate,
    circle_accuracy,
    configuration_circle,
    diagnose,
)
from aacmm_pin import simulate_measurements as simulated
from aacmm_pin._support import progress
from aacmm_pin._support.progress import bar
from tests.few_causes import ECCENTRICITY_ALONE

WORK = """
import time
from aacmm_pin._support import progress
progress.DELAY = 0.0
with progress.watched(range(5), True, "counting", "step") as steps:
    for _ in steps:
        time.sleep(0.15)
print("done")
"""


def on_a_terminal(code: str) -> tuple[str, str, int]:
    """stdout, what stderr shows on a terminal of its own, and the exit status."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 100, 0, 0))  # rows, columns
    words = [sys.executable, "-c", textwrap.dedent(code)]
    child = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=theirs, text=True, start_new_session=True
    )
    os.close(theirs)
    shown = b""
    with suppress(OSError):  # the child has closed its end
        while part := os.read(ours, 4096):
            shown += part
    os.close(ours)
    out = child.communicate(timeout=60)[0]
    return out, shown.decode(), child.returncode


def test_a_terminal_shows_a_bar_on_stderr_that_is_gone_in_the_end():
    out, err, status = on_a_terminal(WORK)
    assert (out, status) == ("done\n", 0)
    assert re.search(r"counting: +\d+%", err)
    assert "5/5" in err or "4/5" in err
    assert err.rpartition("\r")[0].rpartition("\r")[2].strip() == ""  # wiped out
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("done\n", "")  # a pipe shows nothing
    out, err, _ = on_a_terminal(WORK.replace("DELAY = 0.0", "DELAY = 9.0"))
    assert (out, err) == ("done\n", "")  # nor does work that is shorter than the delay


class Recorder(tqdm):  # type: ignore[type-arg]
    """A bar that writes down what it was for."""

    seen: list[tuple[str, bool, int]]

    def close(self) -> None:
        if not getattr(self, "written", False):
            self.written = True
            Recorder.seen.append(
                (str(getattr(self, "title", "")), self.disable, getattr(self, "total", 0) or 0)
            )
        super().close()

    def __init__(self, *args: Any, **named: Any) -> None:
        self.title = named.get("desc")
        super().__init__(*args, **named)


@pytest.fixture
def bars(monkeypatch) -> Iterator[list[tuple[str, bool, int]]]:
    Recorder.seen = []
    monkeypatch.setattr(progress, "tqdm", Recorder)
    return Recorder.seen


def test_a_notebook_has_bars_though_its_stderr_is_no_terminal(bars, monkeypatch):
    for notebook, asked, disabled in (
        (True, True, False),
        (False, True, True),
        (True, False, True),
        (False, None, True),
    ):
        monkeypatch.setattr(progress, "IN_NOTEBOOK", notebook)
        with bar(asked, "x", "y", total=1):
            pass
        assert bars.pop()[1] is disabled


@ECCENTRICITY_ALONE
def test_long_work_has_bars(bars, sino6):
    data = simulated(sino6, "free", 60, rng=np.random.default_rng(1))
    lengths: list[int] = []

    def mine(steps: Iterable[int]) -> Iterable[int]:
        lengths.append(len(list(steps)))
        return steps

    calibrate(sino6, data, encoder_noise=8e-6, progress=mine)  # a caller's own function
    assert lengths == [10, 10]
    bars.clear()
    diagnose(sino6, data, encoder_noise=8e-6)
    names = [name for name, *_ in bars]
    assert names[0] == "search for causes"
    assert "held-out blocks" in names
    bars.clear()
    circle = configuration_circle(sino6, [0.03, -0.67, 0.18], count=5)
    circle_accuracy(circle, method="monte-carlo", rng=np.random.default_rng(1), draws=100)
    circle_accuracy(circle)
    assert [(name, total) for name, _, total in bars] == [("Monte Carlo", 5), ("accuracy", 5)]
