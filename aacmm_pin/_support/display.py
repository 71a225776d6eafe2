"""How a result shows and draws itself, although words and pictures stand in a later room,
:mod:`aacmm_pin.report`.

``found.plot()`` and the HTML that Jupyter shows of ``found`` belong to the result, which is where
people look for them. The package itself, which may import every room, says at import how the report
is found; it is loaded when it is first needed, so that ``import aacmm_pin`` loads no matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

CONSOLE_LETTERS = 1000
"""A line in a console is at most this long; a dataclass would print all its arrays."""
_load: dict[str, Callable[[], Any]] = {}


def reported_by(results: Callable[[], Any], sentence: Callable[[], Any]) -> None:
    """State how parts of the report are found.

    Args:
        results: gives the module that has ``plots`` and ``html_of``.
        sentence: gives the function that makes the sentence of a note, without what draws.
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
    """A number with two significant digits and without an exponent: ``1.6``, ``37``, ``110``."""
    return f"{float(f'{value:.2g}'):.15g}"
