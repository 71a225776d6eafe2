"""Functions in NumPy with a twin in plain loops, which numba compiles where that is worth its time.

Loading numba and a compiled loop takes about a second, compiling it for the first time one to five more: far longer than
small work takes in NumPy. So twins are loaded when the NumPy functions have worked for ``WORTH_SECONDS`` in this process,
which costs at most twice what knowing beforehand would. Twins give the same numbers to the last bit, so that no result
depends on the moment; a :class:`Loop` without one is chosen by the size of its task.
Where numba is not installed, or does not work with the NumPy there is, NumPy does it all.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from types import FunctionType
from typing import Any

from aacmm_pin.errors import UnknownNameError

WORTH_SECONDS = 4.0
"""Time in NumPy after which the loops are loaded [s]: about what loading numba and compiling all twins takes."""
VARIABLE, ALWAYS, NEVER, WHEN_WORTH = "AACMM_PIN_COMPILED", "always", "never", "auto"

_spent = 0.0


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
        """The loop, where it is ``worth`` loading and can be; the environment variable overrules.

        Raises:
            UnknownNameError: the variable says something else than ``always``, ``never`` or ``auto``.
        """
        wanted = os.environ.get(VARIABLE, WHEN_WORTH)
        if wanted not in (ALWAYS, NEVER, WHEN_WORTH):
            raise UnknownNameError(f"environment variable {VARIABLE}", wanted, [ALWAYS, NEVER, WHEN_WORTH])
        return self.compiled if wanted == ALWAYS or (wanted == WHEN_WORTH and worth) else None

    @cached_property
    def compiled(self) -> Callable[..., Any] | None:
        """The loop, compiled and kept beside its source for the next process; None where numba cannot."""
        if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":  # the loops would run in Python
            return None
        try:
            import numba
        except ImportError:  # also where it is too old or too new for this NumPy
            return None
        loop = FunctionType(self.loop.__code__, _names(self.helpers)) if self.helpers else self.loop
        compile_ = partial(numba.njit, self.signature, nogil=True, error_model="numpy")
        try:
            return compile_(cache=True)(loop)
        except Exception:  # no folder to keep it in, a full disk, a file that cannot be read back: numba has no class for it
            return compile_()(loop)


@cache
def _names(helpers: tuple[Callable[..., Any], ...]) -> dict[str, Any]:
    """The names of the helpers' module, with the helpers as numba compiles them: once for all loops that call them."""
    import numba

    names = dict(helpers[0].__globals__)
    for helper in helpers:
        names[helper.__name__] = numba.njit(nogil=True, error_model="numpy")(FunctionType(helper.__code__, names))
    return names


@dataclass(frozen=True)
class Twins(Loop):
    """A loop and the same in NumPy.

    Attributes:
        plain: in NumPy, with the same arguments.
    """

    plain: Callable[..., None] = field(kw_only=True)

    def __call__(self, *arguments: Any) -> None:
        """Call the one that is faster here."""
        global _spent
        loop = self.wanted(_spent >= WORTH_SECONDS)
        if loop is not None:
            loop(*arguments)
            return
        start = time.perf_counter()
        self.plain(*arguments)
        _spent += time.perf_counter() - start


def twin_of(loop: Callable[..., None], signature: str) -> Callable[[Callable[..., None]], Twins]:
    """Decorator of a NumPy function: ``loop`` does the same."""
    return lambda plain: Twins(loop, signature, plain=plain)
