"""How a result shows and draws itself, although words and pictures stand on floors above it.

``found.plot()`` and the card that Jupyter shows of ``found`` belong to the result, which is where people look for them. What
they do takes :mod:`aacmm_pin.report`, which no room above it imports. So this module finds the function there by its name,
when it is called for the first time, as pandas finds its plotting backend: ``import aacmm_pin`` loads neither matplotlib nor
the cards. A test holds that only this module finds others by name, and that every name it is asked for is there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CARDS, PICTURES = "aacmm_pin.report.cards", "aacmm_pin.report.plots"


LETTERS = 1000
"""A line in a console is at most this long; a dataclass would print all its arrays."""


class Shown:
    """A value that shows itself: as a card in Jupyter, as a line in IPython."""

    def __init_subclass__(cls, **named: Any) -> None:
        super().__init_subclass__(**named)
        # IPython asks the classes of a value in turn for this or for __repr__, which every dataclass has of its own.
        cls._repr_pretty_ = _line  # type: ignore[attr-defined]

    def _repr_html_(self) -> str:
        return str(import_module(CARDS).html_of(self))


def _line(value: Shown, printer: Any, cycle: bool) -> None:
    text = str(value)
    printer.text(text if len(text) <= LETTERS else f"{text[:LETTERS]} …")


def drawn(function: str, *what: Any, **how: Any) -> Axes:
    """What ``function`` of :mod:`aacmm_pin.report.plots` draws of ``what``; it returns the axes."""
    return cast("Axes", getattr(import_module(PICTURES), function)(*what, **how))
