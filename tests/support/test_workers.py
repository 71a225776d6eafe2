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
STOPPED = """
import os, signal, sys, threading, time
from multiprocessing import util
from aacmm_pin._support import workers

start = util.spawnv_passfds

def start_and_stop(*words):
    pid = start(*words)
    os.kill(os.getpid(), signal.SIGHUP)
    return pid

util.spawnv_passfds = start_and_stop
signal.signal(signal.SIGHUP, lambda *_: sys.exit(3))
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()  # may receive what the main thread blocks
with workers.results(abs, [1, 2], 2) as results:
    list(results)
"""


def test_a_worker_that_is_killed_is_an_error() -> None:
    with pytest.raises(AacmmError, match="worker process ended"), workers.results(_die, [os.getpid()] * 12, 2) as results:
        list(results)
    assert multiprocessing.active_children() == []


def _die(unless: int) -> None:
    if os.getpid() != unless:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.1)  # so that the others wait when a process is killed


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


def test_a_signal_while_processes_start_comes_when_they_know_their_work() -> None:
    run = subprocess.run([sys.executable, "-c", STOPPED], capture_output=True, text=True, timeout=60, check=False)
    assert (run.returncode, run.stderr) == (3, "")
