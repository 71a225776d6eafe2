"""Loops that numba compiles, and the choice between such a loop and the same in NumPy.

Loading numba and a compiled loop takes about half a second, compiling it for the first time one to
five more. So a loop is chosen where the task is large enough; it gives the same numbers to the last
bit.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from types import FunctionType
from typing import Any

from aacmm_pin.errors import UnknownNameError

VARIABLE, ALWAYS, NEVER, BY_SIZE = "AACMM_PIN_COMPILED", "always", "never", "auto"
INLINED = ""
"""Instead of the signature of a helper that has one caller: numba compiles it as part of that,
which takes half the time."""
Helpers = tuple[tuple[Callable[..., Any], str], ...]


@dataclass(frozen=True)
class Loop:
    """A function of arrays, in what numba compiles.

    Attributes:
        loop: the function.
        signature: types of its result and of its arguments, in numba's words.
        helpers: functions of the same module that it calls, each behind those that it calls itself,
            with their signatures: without these numba compiles a helper for each constant that it
            is called with.
        least: size of the task from which on the loop is chosen.
    """

    loop: Callable[..., Any]
    signature: str
    helpers: Helpers = ()
    least: int = 0

    def chosen(self, size: int) -> Callable[..., Any] | None:
        """The compiled loop for a task of at least the size ``least``, None for a smaller one; the
        environment variable overrules.

        Raises:
            UnknownNameError: the variable is none of ``always``, ``never`` and ``auto``.
        """
        wanted = os.environ.get(VARIABLE, BY_SIZE)
        if wanted not in (ALWAYS, NEVER, BY_SIZE):
            raise UnknownNameError(
                f"environment variable {VARIABLE}", wanted, [ALWAYS, NEVER, BY_SIZE]
            )
        is_large = wanted == BY_SIZE and size >= self.least
        return self.compiled if wanted == ALWAYS or is_large else None

    @cached_property
    def compiled(self) -> Any:
        """The compiled loop, kept beside its source for the next process where that can be
        written.
        """
        if not self.helpers:
            return _compiled(self.loop, self.signature)
        return _compiled(FunctionType(self.loop.__code__, _names(self.helpers)), self.signature)


def _compiled(function: Callable[..., Any], signature: str, **options: bool) -> Any:
    """``function`` compiled, kept beside its source where that can be written."""
    import numba

    compile_ = partial(numba.njit, signature, nogil=True, error_model="numpy", **options)
    try:
        return compile_(cache=True)(function)
    except Exception:  # a full disk, a damaged file, no folder: numba has no class for it
        return compile_()(function)


@cache
def _names(helpers: Helpers) -> dict[str, Any]:
    """The names of the helpers' module, with the compiled helpers: once for all loops that call
    them.
    """
    import numba

    names = dict(helpers[0][0].__globals__)
    inner: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for helper, signature in helpers:
        function = FunctionType(helper.__code__, names)
        if signature == INLINED:
            compile_ = numba.njit(error_model="numpy", inline="always", **inner)
            names[helper.__name__] = compile_(function)
        else:
            names[helper.__name__] = _compiled(function, signature, **inner)
    return names
