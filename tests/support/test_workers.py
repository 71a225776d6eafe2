"""Worker processes: none outlives its parent, and one that is killed is an error."""

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
FOR_EVER += (
    "with workers.results(time.sleep, [60, 60], 2) as r: print('begun', flush=True); list(r)"
)


def test_a_worker_that_is_killed_is_an_error():
    with (
        pytest.raises(AacmmError, match="worker process ended"),
        workers.results(_die, [os.getpid()] * 12, 2) as results,
    ):
        list(results)
    assert multiprocessing.active_children() == []


def _die(unless: int) -> None:
    if os.getpid() != unless:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.1)  # so that the others wait when a process is killed


def test_workers_end_with_their_parent():
    command = [sys.executable, "-c", FOR_EVER]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"begun\n"
        parent.kill()
    assert not outlived(parent.pid, 30.0), "a worker outlived its parent"
