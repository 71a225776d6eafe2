"""Worker processes: none outlives its parent, and one that is killed is an error."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

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


def _process_of(_: int) -> int:
    return os.getpid()


@pytest.mark.parametrize(("processes", "elsewhere"), [(2, True), (1, False)])
def test_one_process_is_this_one(processes, elsewhere):
    with workers.results(_process_of, [7], processes) as found:
        ((_, number),) = found
    assert (number != os.getpid()) == elsewhere


@contextmanager
def begun_for_ever() -> Iterator[subprocess.Popen[bytes]]:
    """A process whose workers have begun work without end."""
    command = [sys.executable, "-c", FOR_EVER]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    ) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"begun\n"
        yield parent


def test_workers_end_with_their_parent():
    with begun_for_ever() as parent:
        parent.kill()
    assert not outlived(parent.pid, 30.0), "a worker outlived its parent"


def test_an_interrupt_does_not_wait_for_work_that_has_begun():
    """As Ctrl-C to a command whose workers are in the middle of minutes of work."""
    with begun_for_ever() as parent:
        time.sleep(2.0)  # the workers have started
        parent.send_signal(signal.SIGINT)
        parent.wait(20.0)
    assert not outlived(parent.pid, 10.0)


BLOCKED_BY_TRACKER = """
from multiprocessing import resource_tracker
from pathlib import Path
from aacmm_pin._support import workers

with workers.results(abs, [1, 2], 2) as results:
    list(results)
    status = Path(f"/proc/{resource_tracker._resource_tracker._pid}/status").read_text()
print(int(status.split("SigBlk:")[1].split()[0], 16))
"""


def test_no_helper_process_dies_when_the_terminal_closes():
    """Python's tracker of resources ignores what a terminal sends, but for SIGHUP."""
    command = [sys.executable, "-c", BLOCKED_BY_TRACKER]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stdout) & 1 << (signal.SIGHUP - 1)
