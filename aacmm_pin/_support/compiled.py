"""Loops that numba compiles, and functions in NumPy that have such a loop as a twin.

Loading numba and a compiled loop takes about half a second, compiling it for the first time one to
five more. So a twin is chosen where the task is large enough; it gives the same numbers to the last
bit.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from types import FunctionType
from typing import Any

import numpy as np

from aacmm_pin.errors import UnknownNameError

LARGE_TASK = 1_000_000
"""Numbers in the largest array of a task from which on a loop is loaded: NumPy takes 15 ms for
sensitivities of SINO6.
"""
VARIABLE, ALWAYS, NEVER, BY_SIZE = "AACMM_PIN_COMPILED", "always", "never", "auto"


@dataclass(frozen=True)
class Loop:
    """A function of arrays, in what numba compiles.

    Attributes:
        loop: the function.
        signature: types of its arguments, in numba's words.
        helpers: functions of the same module that it calls, each behind those that it calls itself.
    """

    loop: Callable[..., Any]
    signature: str
    helpers: tuple[Callable[..., Any], ...] = ()

    def wanted(self, worth: bool) -> Callable[..., Any] | None:
        """The compiled loop where it is ``worth`` loading; the environment variable overrules.

        Raises:
            UnknownNameError: the variable is none of ``always``, ``never`` and ``auto``.
        """
        wanted = os.environ.get(VARIABLE, BY_SIZE)
        if wanted not in (ALWAYS, NEVER, BY_SIZE):
            raise UnknownNameError(
                f"environment variable {VARIABLE}", wanted, [ALWAYS, NEVER, BY_SIZE]
            )
        if wanted == ALWAYS or (wanted == BY_SIZE and worth):
            return self.compiled
        return None

    @cached_property
    def compiled(self) -> Callable[..., Any]:
        """The compiled loop, kept beside its source for the next process where that can be
        written.
        """
        import numba

        loop = self.loop
        if self.helpers:
            loop = FunctionType(self.loop.__code__, _names(self.helpers))
        compile_ = partial(numba.njit, self.signature, nogil=True, error_model="numpy")
        try:
            return compile_(cache=True)(loop)
        except Exception:  # a full disk, a damaged file, no folder: numba has no class for it
            return compile_()(loop)


@cache
def _names(helpers: tuple[Callable[..., Any], ...]) -> dict[str, Any]:
    """The names of the helpers' module, with the compiled helpers: once for all loops that call
    them.
    """
    import numba

    names = dict(helpers[0].__globals__)
    for helper in helpers:
        function = FunctionType(helper.__code__, names)
        names[helper.__name__] = numba.njit(nogil=True, error_model="numpy")(function)
    return names


@dataclass(frozen=True)
class Twins(Loop):
    """A loop and the same in NumPy.

    Attributes:
        plain: in NumPy, with the same arguments.
        least: numbers in the largest array from which on the loop is chosen.
    """

    plain: Callable[..., None] = field(kw_only=True)
    least: int = field(default=LARGE_TASK, kw_only=True)

    def __call__(self, *arguments: Any) -> None:
        """Call the loop for a large task, the function in NumPy for a small one."""
        size = max(np.size(argument) for argument in arguments)
        function = self.wanted(size >= self.least) or self.plain
        function(*arguments)


def twin_of(
    loop: Callable[..., None], signature: str, least: int = LARGE_TASK
) -> Callable[[Callable[..., None]], Twins]:
    """Decorator of a NumPy function: ``loop`` does the same, and is chosen from ``least`` numbers
    on.
    """
    return lambda plain: Twins(loop, signature, plain=plain, least=least)
