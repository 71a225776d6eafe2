"""Functions in NumPy with a twin in plain loops, which numba compiles where that is worth its time.

Loading numba and a compiled loop takes about half a second, compiling it for the first time one or two more: far longer
than small work takes in NumPy. So the loops are loaded when the NumPy functions have worked for ``WORTH_SECONDS`` in this
process, which costs at most twice what knowing beforehand would. Both give the same numbers to the last bit, so that no
result depends on the moment. Where numba is not installed, or does not work with the NumPy there is, NumPy does it all.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from aacmm_pin.errors import UnknownNameError

WORTH_SECONDS = 4.0
"""CPU time in NumPy after which the loops are loaded [s]: about what compiling them all for the first time takes."""
VARIABLE, ALWAYS, NEVER, WHEN_WORTH = "AACMM_PIN_COMPILED", "always", "never", "auto"

_spent = 0.0


@dataclass(frozen=True)
class Twins:
    """A function that fills arrays, written twice.

    Attributes:
        plain: in NumPy.
        loop: in what numba compiles, with the same arguments.
        signature: types of the arguments, in numba's words.
    """

    plain: Callable[..., None]
    loop: Callable[..., None]
    signature: str

    def __call__(self, *arguments: Any) -> None:
        """Call the one that is faster here.

        Raises:
            UnknownNameError: the variable that chooses says something else than ``always``, ``never`` or ``auto``.
        """
        global _spent
        wanted = os.environ.get(VARIABLE, WHEN_WORTH)
        if wanted not in (ALWAYS, NEVER, WHEN_WORTH):
            raise UnknownNameError(f"environment variable {VARIABLE}", wanted, [ALWAYS, NEVER, WHEN_WORTH])
        if wanted == ALWAYS or (wanted == WHEN_WORTH and _spent >= WORTH_SECONDS):
            (self.compiled or self.plain)(*arguments)
            return
        start = time.thread_time()
        self.plain(*arguments)
        _spent += time.thread_time() - start

    @cached_property
    def compiled(self) -> Callable[..., None] | None:
        """The loop, compiled and kept beside its source for the next process; None where numba cannot."""
        if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":  # the loops would run in Python
            return None
        try:
            import numba
        except ImportError:  # also where it is too old or too new for this NumPy
            return None
        compile_ = partial(numba.njit, self.signature, nogil=True)
        try:
            return compile_(cache=True)(self.loop)
        except Exception:  # no folder to keep it in, a full disk, a file that cannot be read back: numba has no class for it
            return compile_()(self.loop)


def twin_of(loop: Callable[..., None], signature: str) -> Callable[[Callable[..., None]], Twins]:
    """Decorator of a NumPy function: ``loop`` does the same."""
    return lambda plain: Twins(plain, loop, signature)
