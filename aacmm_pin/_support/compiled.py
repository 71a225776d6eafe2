"""Loops that numba compiles, and the choice between them and NumPy.

Loading numba and a loop takes half a second, the first compilation one to five more. So only large
tasks choose the loop, with the same numbers to the last bit.
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
"""Signature of a helper with one caller, compiled with it in half the time."""
Helpers = tuple[tuple[Callable[..., Any], str], ...]


@dataclass(frozen=True)
class Loop:
    """A function of arrays for numba.

    Attributes:
        signature: numba's types.
        helpers: called functions of the module with signatures (without, numba compiles one for
            each constant argument), each after those that it calls.
        least: least size of a task.
    """

    loop: Callable[..., Any]
    signature: str
    helpers: Helpers = ()
    least: int = 0

    def chosen(self, size: int) -> Callable[..., Any] | None:
        """The compiled loop for a large task, else None; the environment variable overrules.

        Raises:
            UnknownNameError: expected ``always``, ``never`` or ``auto``.
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
        """The loop, cached beside its source if that is writable."""
        if not self.helpers:
            return _compiled(self.loop, self.signature)
        calls_compiled = FunctionType(self.loop.__code__, _globals_of(self.helpers))
        return _compiled(calls_compiled, self.signature)


def _compiled(function: Callable[..., Any], signature: str, **options: bool) -> Any:
    import numba

    compile_ = partial(numba.njit, signature, nogil=True, error_model="numpy", **options)
    try:
        return compile_(cache=True)(function)
    except Exception:  # a full disk, a damaged file, no folder: numba has no class for it
        return compile_()(function)


@cache
def _globals_of(helpers: Helpers) -> dict[str, Any]:
    """Globals of the helpers' module with compiled helpers, which all loops share."""
    import numba

    names = dict(helpers[0][0].__globals__)
    without_wrappers: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for helper, signature in helpers:
        function = FunctionType(helper.__code__, names)
        if signature == INLINED:
            compile_ = numba.njit(error_model="numpy", inline="always", **without_wrappers)
            names[helper.__name__] = compile_(function)
        else:
            names[helper.__name__] = _compiled(function, signature, **without_wrappers)
    return names
