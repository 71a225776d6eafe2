"""Notes of results: a code with data. :mod:`aacmm_pin.report.messages` makes the sentence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from aacmm_pin._support.display import sentence_of


@dataclass(frozen=True, repr=False)
class Note:
    """An assumption or a finding beside the result; ``str(note)`` is its sentence.

    Attributes:
        code: kind of note, which JSON lists in ``note_codes``.
        data: contents of the sentence by name: SI units, names, rows of the file; ``place`` is put
            in front of the sentence.
    """

    code: str
    data: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def with_place(self, place: str) -> Note:
        """The same note of a file, an arm or a position."""
        outer = self.data.get("place")
        return replace(self, data={**self.data, "place": f"{place}: {outer}" if outer else place})

    def __str__(self) -> str:
        return sentence_of(self)

    def __repr__(self) -> str:
        return repr(str(self))


def notes_in_json(notes: Iterable[Note]) -> dict[str, list[str]]:
    """Notes in JSON: their sentences and codes."""
    listed = [*notes]
    return {"notes": [str(note) for note in listed], "note_codes": [note.code for note in listed]}
