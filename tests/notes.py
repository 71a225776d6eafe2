"""What notes state, by their code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from aacmm_pin._support.display import Note


def data_of(notes: Iterable[Note], code: str) -> list[Mapping[str, Any]]:
    """The data of the notes of this code."""
    return [note.data for note in notes if note.code == code]
