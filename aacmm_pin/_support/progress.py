"""Bars for what takes longer than a moment: a widget in a notebook, a line on stderr at a terminal,
nothing elsewhere.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from tqdm import TqdmExperimentalWarning

with warnings.catch_warnings():
    # Of a notebook; tqdm.auto does the same, but loads asyncio.
    warnings.simplefilter("ignore", TqdmExperimentalWarning)
    from tqdm.autonotebook import tqdm

T = TypeVar("T")
Progress = bool | Callable[[Iterable[Any]], Iterable[Any]] | None
"""Whether to show bars; or a function such as ``tqdm`` that is given the steps of the longest part
and returns them.
"""

DELAY = 0.5
"""What is over before this shows no bar [s]."""
IN_NOTEBOOK = any(kind.__module__ == "tqdm.notebook" for kind in tqdm.__mro__)


def bar(progress: Progress, what: str, unit: str, **named: Any) -> Any:
    """A bar of tqdm, to be used as a context, so that it is gone before an error or an interrupt is
    told.
    """
    # A notebook's stderr is no terminal, and has a widget all the same.
    hidden = (False if IN_NOTEBOOK else None) if progress else True
    return tqdm(desc=what, unit=unit, leave=False, disable=hidden, delay=DELAY, **named)


@contextmanager
def watched(steps: Iterable[T], progress: Progress, what: str, unit: str) -> Iterator[Iterable[T]]:
    """The steps, with a bar that moves as they are taken.

    Args:
        steps: to be taken inside the context.
        progress: see :data:`Progress`.
        what: what is being done, in a word or two.
        unit: of the steps.
    """
    if callable(progress):
        yield progress(steps)
        return
    with bar(progress, what, unit, iterable=steps) as moving:
        yield moving
