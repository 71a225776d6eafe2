"""Notes of results: codes with data. :mod:`aacmm_pin.report.messages` makes sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from aacmm_pin._support.display import sentence_of


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
