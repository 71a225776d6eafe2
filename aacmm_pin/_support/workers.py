"""Worker processes that end at once when their work is no longer wanted, and with the process that started them."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from typing import TypeVar

from aacmm_pin.errors import AacmmError

J = TypeVar("J")
R = TypeVar("R")
OF_PARENT = (signal.SIGINT, signal.SIGHUP)
"""Signals that a terminal sends to all processes, and that are for the parent to answer."""


@contextmanager
def results(work: Callable[[J], R], jobs: Sequence[J], processes: int) -> Iterator[Iterator[tuple[int, R]]]:
    """Numbers and results of all jobs as they come, from so many processes; when the context ends, so do they.

    Raises:
        AacmmError: a process was killed.
    """
    if min(processes, len(jobs)) == 1:
        yield enumerate(map(work, jobs))
        return
    context = get_context("spawn")
    ending, alive = context.Pipe(duplex=False)
    with _held_from_children():
        pool = ProcessPoolExecutor(min(processes, len(jobs)), context, _end_with_parent, (ending,))
    try:
        with _held_from_children():
            futures = {pool.submit(work, job): number for number, job in enumerate(jobs)}
        yield _as_they_come(futures)
        pool.shutdown()
    except BrokenProcessPool:
        raise AacmmError("a worker process was killed, as happens when memory runs out; fewer take less") from None
    finally:
        alive.close()
        pool.shutdown(cancel_futures=True)
        ending.close()


def _as_they_come(futures: dict[Future[R], int]) -> Iterator[tuple[int, R]]:
    for future in as_completed(futures):
        yield futures[future], future.result()


def _end_with_parent(ending: Connection) -> None:
    """End this process, whatever it does, when nobody holds the other end of a pipe any more."""

    def wait() -> None:
        ending.poll(None)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _held_from_children() -> Iterator[None]:
    """Keep signals until the end, and from processes that are started meanwhile for ever."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, OF_PARENT)
    try:
        resource_tracker.ensure_running()  # which lets interrupts through when it starts
        signal.pthread_sigmask(signal.SIG_BLOCK, OF_PARENT)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
