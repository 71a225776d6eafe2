"""Independent jobs here, in worker processes, or by an executor of the user."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.synchronize import Event
from typing import TypeVar

from aacmm_pin._support.arrays import whole
from aacmm_pin.errors import AacmmError

J = TypeVar("J")
R = TypeVar("R")
Workers = int | Executor
"""Processes, or a ``concurrent.futures.Executor``, which is not shut down."""
TERMINAL_SIGNALS = (signal.SIGINT, signal.SIGHUP)
"""To all processes of a terminal; the parent answers."""


@contextmanager
def results(
    work: Callable[[J], R], jobs: Iterable[J], workers: Workers
) -> Iterator[Iterator[tuple[int, R]]]:
    """Numbers and results of jobs, as they are done. The end of the context cancels waiting jobs;
    an error or interrupt ends worker processes at once.

    Args:
        work: a function of a module, which is sent by name.
        jobs: all are submitted at once.
        workers: 1 is this process.

    Raises:
        AacmmError: a worker was killed, or their number is out of range.
    """
    futures: dict[Future[R], int] = {}
    pool: ProcessPoolExecutor | None = None
    stop: Event | None = None
    try:
        if isinstance(workers, Executor):
            yield _submitted(workers, work, jobs, futures)
        elif (count := whole(workers, 1, "workers")) == 1:
            yield enumerate(map(work, jobs))
        else:
            with _blocked_signals():
                context = get_context("spawn")
                stop = context.Event()
                pool = ProcessPoolExecutor(count, context, _begin, (stop,))
                numbered_results = _submitted(pool, work, jobs, futures)
            yield numbered_results
    except BrokenExecutor:
        raise AacmmError(
            "a worker process ended early. If memory ran out, use fewer workers. In a Python "
            "script, start workers below `if __name__ == '__main__':`"
        ) from None
    except BaseException:
        if stop is not None:
            stop.set()
        raise
    finally:
        for future in futures:
            future.cancel()
        if pool is not None:
            pool.shutdown()


def _submitted(
    executor: Executor,
    work: Callable[[J], R],
    jobs: Iterable[J],
    futures: dict[Future[R], int],
) -> Iterator[tuple[int, R]]:
    """Submit all jobs; numbers and results as they are done.

    ``futures`` keeps those not returned yet, for the caller to cancel.
    """
    for number, job in enumerate(jobs):
        futures[executor.submit(work, job)] = number
    return ((futures.pop(future), future.result()) for future in as_completed([*futures]))


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Block signals of the terminal inside the context, also for processes that start there."""
    former_mask = signal.pthread_sigmask(signal.SIG_BLOCK, TERMINAL_SIGNALS)
    try:
        # Started here, the tracker inherits the block of SIGHUP; its start unblocks the others.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, TERMINAL_SIGNALS)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former_mask)


def _begin(stop: Event) -> None:
    """Begin a worker process; it ends with its parent, or at ``stop``."""

    def exit_after(wait_for_end: Callable[[], object]) -> None:
        wait_for_end()
        os._exit(1)

    from tqdm import tqdm  # whoever imports this module needs no bars

    sys.stdout = sys.stderr  # its output is no result
    # The own lock of tqdm is a semaphore of the system, which os._exit would leave behind.
    tqdm.set_lock(threading.RLock())
    waits: list[Callable[[], object]] = [stop.wait]
    if (parent := parent_process()) is not None:
        waits.append(parent.join)
    for wait_for_end in waits:
        threading.Thread(target=exit_after, args=[wait_for_end], daemon=True).start()
