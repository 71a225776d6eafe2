"""One thread of linear algebra: on small matrices threads that wait for one another cost up to
forty times the work.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function, with the BLAS held to one thread while it runs."""
    return cast("Callable[P, R]", threadpool_limits.wrap(limits=1, user_api="blas")(function))
