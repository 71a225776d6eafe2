"""The display and plots of results, although :mod:`aacmm_pin.report` is a later room.

The package itself, which may import every room, states at import how to find the report; it is
loaded when first needed, so that ``import aacmm_pin`` loads no matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

CONSOLE_LETTERS = 1000
"""Longest line in a console; a dataclass would print all its arrays."""
_load: dict[str, Callable[[], Any]] = {}


def reported_by(results: Callable[[], Any], sentence: Callable[[], Any]) -> None:
    """State how to find parts of the report.

    Args:
        results: returns the module with ``plots`` and ``html_of``.
        sentence: returns the function for the sentence of a note, without drawing modules.
    """
    _load.update(results=results, sentence=sentence)


def report() -> Any:
    """The module :mod:`aacmm_pin.report.results`."""
    return _load["results"]()


def sentence_of(note: object) -> str:
    """The sentence of a :class:`aacmm_pin._support.notes.Note`."""
    return str(_load["sentence"]()(note))


class Shown:
    """A value that Jupyter shows as HTML and IPython as one line."""

    def __init_subclass__(cls, **named: Any) -> None:
        super().__init_subclass__(**named)
        # IPython asks the classes of a value in turn for this or for __repr__, which every
        # dataclass has of its own.
        cls._repr_pretty_ = _line  # type: ignore[attr-defined]

    def _repr_html_(self) -> str:
        return str(report().html_of(self))


def _line(value: Shown, printer: Any, cycle: bool) -> None:
    text = str(value)
    printer.text(text if len(text) <= CONSOLE_LETTERS else f"{text[:CONSOLE_LETTERS]} …")


def two_digits(value: float) -> str:
    """A number with two significant digits without exponent: ``1.6``, ``37``, ``110``."""
    return f"{float(f'{value:.2g}'):.15g}"
