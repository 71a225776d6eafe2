"""Progress bars: a widget in a notebook, a line on stderr of a terminal, else none."""

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
"""Show bars or not; or a function such as ``tqdm`` around the longest part."""

DELAY = 0.5
"""Shorter work shows no bar [s]."""
IN_NOTEBOOK = any(kind.__module__ == "tqdm.notebook" for kind in tqdm.__mro__)


def bar(progress: Progress, what: str, unit: str, **named: Any) -> Any:
    """A context with tqdm's bar, which disappears before an error is printed."""
    # A notebook's stderr is no terminal, and has a widget all the same.
    hidden = (False if IN_NOTEBOOK else None) if progress else True
    return tqdm(desc=what, unit=unit, leave=False, disable=hidden, delay=DELAY, **named)


@contextmanager
def watched(steps: Iterable[T], progress: Progress, what: str, unit: str) -> Iterator[Iterable[T]]:
    """A context with the steps, whose bar moves with them; ``what`` is the task in a word or two,
    ``unit`` a step.
    """
    if callable(progress):
        yield progress(steps)
        return
    with bar(progress, what, unit, iterable=steps) as moving:
        yield moving
