"""Worker processes: none outlives what it works for, and one that dies is told."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import pytest

from aacmm_pin._support import workers
from aacmm_pin.errors import AacmmError
from tests.process_group import outlived

FOR_EVER = "import time; from aacmm_pin._support import workers\n"
FOR_EVER += "with workers.results(time.sleep, [60, 60], 2) as r: print('begun', flush=True); list(r)"


def test_a_worker_that_is_killed_is_an_error() -> None:
    with pytest.raises(AacmmError, match="worker process was killed"), workers.results(_die, [1, 2], 2) as results:
        list(results)
    assert multiprocessing.active_children() == []


def _die(_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_workers_end_at_once_when_nobody_waits_for_them() -> None:
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), workers.results(time.sleep, [60, 60], 2):
        raise KeyboardInterrupt
    assert multiprocessing.active_children() == []
    assert time.monotonic() - began < 30


def test_workers_end_with_their_parent() -> None:
    command = [sys.executable, "-c", FOR_EVER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"begun\n"
        parent.kill()
    assert not outlived(parent.pid, 30.0), "a worker outlived its parent"
