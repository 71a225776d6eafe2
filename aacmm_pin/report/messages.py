"""The sentence of every note, by its code, from ``messages.toml``.

A field names a value of the note's data; after its colon follows a format; a format and a unit for
a value in SI (``.3g mm``; ``2 mm`` for two digits); ``#`` and a noun, to count (``#record``);
``and``, to list; ``rows``, to list rows; ``p``, of a p-value.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from string import Formatter
from typing import Any

from aacmm_pin._support.display import Note, two_digits
from aacmm_pin._support.file_problems import rows_in_words
from aacmm_pin._support.units import DEG, MM, UM, count
from aacmm_pin.effects import listed
from aacmm_pin.report.numbers import p_equals

FORMAT_UNITS = {"mm": (MM, " mm"), "µm": (UM, " µm"), "µrad": (UM, " µrad"), "°": (DEG, "°")}
"""Size of the units of formats, and their text."""


def sentence(note: Note) -> str:
    """The sentence of a note, without capital and full stop.

    Raises:
        KeyError: the code is unknown, or a value is missing.
    """
    text = _Values().vformat(SENTENCES[note.code], (), note.data)
    place = note.data.get("place")
    return f"{place}: {text}" if place else text


class _Values(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        form, _, unit = format_spec.rpartition(" ")
        if unit in FORMAT_UNITS:
            size, unit_text = FORMAT_UNITS[unit]
            number = two_digits(value / size) if form == "2" else format(value / size, form)
            return f"{number}{unit_text}"
        if format_spec.startswith("#"):
            return count(value, format_spec[1:])
        if format_spec == "and":
            return listed([*map(str, value)])
        if format_spec == "p":
            return p_equals(value)
        if format_spec == "rows":
            return rows_in_words(value)
        return format(value, format_spec)


_TEXT = (Path(__file__).parent / "messages.toml").read_text(encoding="utf-8")
SENTENCES: Mapping[str, str] = tomllib.loads(_TEXT)
"""The sentences of ``messages.toml``, by code."""
