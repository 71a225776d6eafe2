"""Independent pieces of work, here, in worker processes, or wherever an executor has them done.

Worker processes end at once when their work is no longer wanted, and with the process that started them.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from itertools import chain, islice
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from typing import TypeVar

from aacmm_pin._support.checks import whole
from aacmm_pin._support.stop_signals import signals_wait
from aacmm_pin.errors import AacmmError

J = TypeVar("J")
R = TypeVar("R")
Workers = int | Executor
"""How many processes, this one included, or a ``concurrent.futures.Executor``, which is used as it is and not shut down."""
OF_PARENT = (signal.SIGINT, signal.SIGHUP)
"""Signals that a terminal sends to all processes, and that are for the parent to answer."""
MOST_WAITING = 256
"""Jobs that are handed out at once: as many as there can be processes; more would only take memory."""
OF_EACH = 2
"""Jobs that each process has, the one that it does and the next; the others are left for this process to take from."""


@contextmanager
def results(work: Callable[[J], R], jobs: Iterable[J], workers: Workers) -> Iterator[Iterator[tuple[int, R]]]:
    """Numbers and results of all jobs as they come; when the context ends, nothing is worked out any more.

    Args:
        work: a function of a module, for it is sent by its name.
        jobs: taken from the iterable as they are handed out.
        workers: see :data:`Workers`; other processes take a while to start, and this one works when asked for results.

    Raises:
        AacmmError: a process was killed, or there are not so many.
    """
    if isinstance(workers, Executor):
        with _handed_out(workers, work, iter(jobs), MOST_WAITING) as found:
            yield found
        return
    count, jobs = whole(workers, 1, "processes"), iter(jobs)
    first = list(islice(jobs, count))
    jobs = chain(first, jobs)
    others = min(count - 1, len(first) - 1)
    if others < 1:
        yield enumerate(map(work, jobs))
        return
    context = get_context("spawn")
    with ExitStack() as ends:
        ending, alive = context.Pipe(duplex=False)
        ends.callback(ending.close)
        with _held_from_children():
            pool = ProcessPoolExecutor(others, context, _end_with_parent, (ending,))
            ends.callback(pool.shutdown, cancel_futures=True)
            ends.callback(alive.close)
            found = ends.enter_context(_handed_out(pool, work, jobs, OF_EACH * others, here=True))  # which starts them
        yield found
        pool.shutdown()


@contextmanager
def _handed_out(
    pool: Executor, work: Callable[[J], R], jobs: Iterator[J], most: int, *, here: bool = False
) -> Iterator[Iterator[tuple[int, R]]]:
    """The results of a pool, which has ``most`` jobs at once; with ``here``, this process does jobs too.

    No job is taken back from a process pool: what is cancelled there when a process is killed ends, in Python 3.11, the
    thread that would tell of the others.
    """
    numbered, waiting = enumerate(jobs), dict[Future[R], int]()

    def hand_out() -> None:
        for number, job in islice(numbered, most - len(waiting)):
            waiting[pool.submit(work, job)] = number

    def as_they_come() -> Iterator[tuple[int, R]]:
        while waiting:
            mine = next(numbered, None) if here else None
            if mine is not None:
                yield mine[0], work(mine[1])
            for future in wait(waiting, None if mine is None else 0, FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
            hand_out()

    try:
        hand_out()
        yield as_they_come()
    except BrokenExecutor:
        raise AacmmError(
            "a worker process ended, as happens when memory runs out (fewer take less), or when a script without "
            "`if __name__ == '__main__':` asks for processes"
        ) from None
    finally:
        for future in () if here else waiting:
            future.cancel()


def _end_with_parent(ending: Connection) -> None:
    """End this process, whatever it does, when nobody holds the other end of a pipe any more; its prints are no results."""
    sys.stdout = sys.stderr

    def wait() -> None:
        ending.poll(None)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _held_from_children() -> Iterator[None]:
    """Keep signals until the end, and those of the terminal from processes that are started meanwhile for ever.

    Another thread may receive what this one blocks, and Python raises here even so; a process that has been started, and
    not been told yet what to do, would end in a traceback.
    """
    with signals_wait():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, OF_PARENT)
        try:
            resource_tracker.ensure_running()  # which lets interrupts through when it starts
            signal.pthread_sigmask(signal.SIG_BLOCK, OF_PARENT)
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
