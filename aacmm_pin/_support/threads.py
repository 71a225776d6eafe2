"""One thread of linear algebra: on small matrices several take up to forty times the work."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with one BLAS thread."""
    return cast("Callable[P, R]", threadpool_limits.wrap(limits=1, user_api="blas")(function))
