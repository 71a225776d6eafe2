"""Notes, display and plots of results, although :mod:`aacmm_pin.report` is a later room.

A note is a code with data; :mod:`aacmm_pin.report.messages` makes its sentence.

The package itself, which may import every room, names the modules of the report; they load when
first needed, so that ``import aacmm_pin`` loads no matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any

CONSOLE_LETTERS = 1000
"""Of a line; a dataclass would print all its arrays."""
_modules: dict[str, str] = {}


def reported_by(results: str, messages: str) -> None:
    """Name the modules of ``plots`` and ``html_of``, and of ``sentence``, which loads nothing that
    draws.
    """
    _modules.update(results=results, messages=messages)


def report() -> Any:
    """The module :mod:`aacmm_pin.report.results`."""
    return import_module(_modules["results"])


def sentence_of(note: object) -> str:
    """The sentence of a note."""
    return str(import_module(_modules["messages"]).sentence(note))


class Shown:
    """Jupyter shows it as HTML, IPython as one line."""

    def __init_subclass__(cls, **named: Any) -> None:
        super().__init_subclass__(**named)
        # IPython asks the classes of a value in turn for this or for __repr__, which every
        # dataclass has of its own.
        cls._repr_pretty_ = Shown._repr_pretty_  # type: ignore[method-assign]

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        text = str(self)
        printer.text(text if len(text) <= CONSOLE_LETTERS else f"{text[:CONSOLE_LETTERS]} …")

    def _repr_html_(self) -> str:
        return str(report().html_of(self))


def two_digits(value: float) -> str:
    """Two significant digits without exponent: ``1.6``, ``37``, ``110``."""
    return f"{float(f'{value:.2g}'):.15g}"


@dataclass(frozen=True, repr=False)
class Note:
    """An assumption or finding beside the result; ``str(note)`` is its sentence.

    Attributes:
        code: kind, in JSON ``note_codes``.
        data: of the sentence, by name, in SI; ``place`` is put in front of it.
    """

    code: str
    data: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def with_place(self, place: str) -> Note:
        """The note on a file, arm or position."""
        outer = self.data.get("place")
        return replace(self, data={**self.data, "place": f"{place}: {outer}" if outer else place})

    def __str__(self) -> str:
        return sentence_of(self)

    def __repr__(self) -> str:
        return repr(str(self))


def notes_in_json(notes: Iterable[Note]) -> dict[str, list[str]]:
    """In JSON: sentences and codes."""
    listed = [*notes]
    return {"notes": [str(note) for note in listed], "note_codes": [note.code for note in listed]}
