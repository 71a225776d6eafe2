"""Pieces of a map in a folder, so that a map that was interrupted goes on from what it had."""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.input_files import content_of, to_be_read
from aacmm_pin._support.output_files import HIDDEN, json_text, whole_file
from aacmm_pin.errors import AacmmError, OutputError

QUESTION = "question.json"
"""The file that says what map the pieces are of."""
MOST_BYTES = 32_000_000
"""Size of each file: a piece of 2500 sectors has a few megabytes."""


@dataclass(frozen=True)
class MapCheckpoint:
    """A folder with ``question.json``, what was asked, and a netCDF file (64-bit offsets) for each piece that is done.

    Attributes:
        folder: where they are.
        question: SHA-256 of what was asked, which each piece holds.
    """

    folder: Path
    question: str

    @staticmethod
    def of(folder: str | Path, question: dict[str, Any]) -> MapCheckpoint:
        """The folder, made where there is none.

        Args:
            folder: an earlier one of the same map, an empty one, or a new name.
            question: all that the numbers depend on, as JSON has it.

        Raises:
            OutputError: it is a file, holds something else, or cannot be written to.
            AacmmError: it holds pieces of another map.
        """
        folder = Path(folder)
        path, text = folder / QUESTION, json_text({"schema": "aacmm-pin/map-parts/1"} | question)
        try:
            folder.mkdir(exist_ok=True)
            if not path.exists() and any(not entry.name.startswith(HIDDEN) for entry in folder.iterdir()):
                raise OutputError(
                    f"{folder}: is not empty and has no {QUESTION}, expected the parts of a map, or a new folder"
                )
        except OSError as error:
            raise OutputError(f"{folder}: cannot be used for the parts of a map: {error.strerror}") from None
        try:
            if not path.exists():
                with whole_file(path) as temporary:
                    temporary.write_text(text, encoding="utf-8")
        except OutputError:
            if not path.exists():  # or another process, whose question is looked at next, was faster
                raise
        try:
            there = json.loads(_content(path))
        except (ValueError, RecursionError) as error:
            raise AacmmError(f"{path}: is no JSON ({error}); remove its folder, and the map is worked out again") from None
        asked = json.loads(text)
        other = [key for key in asked if not isinstance(there, dict) or there.get(key) != asked[key]]
        if other:
            raise AacmmError(f"{folder}: holds parts of another map, with another {', '.join(other)}; expected a new folder")
        return MapCheckpoint(folder, hashlib.sha256(text.encode()).hexdigest())

    def load(self, number: int, cells: int) -> dict[str, Array] | None:
        """What is there of a piece, by name (cells,) or (cells, any); None where it is not done.

        Raises:
            AacmmError: it is a file of another map, or none.
        """
        import xarray as xr

        path = self._path(number)
        if not path.exists():
            return None
        content = _content(path)
        try:
            with xr.open_dataset(io.BytesIO(content), engine="scipy") as data:
                question, found = data.attrs.get("question"), {str(n): v.to_numpy().copy() for n, v in data.items()}
        except Exception:  # whatever the reader makes of the bytes
            raise AacmmError(f"{path}: cannot be read as a part of a map; remove it, and it is worked out again") from None
        if str(question) != self.question or any(len(values) != cells for values in found.values()):
            raise AacmmError(f"{path}: is a part of another map; remove it, and it is worked out again")
        return found

    def save(self, number: int, found: dict[str, Array]) -> None:
        """Keep a piece, whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        import xarray as xr

        variables = {
            name: (("cell", *[f"{name}_{k}" for k in range(1, values.ndim)]), values) for name, values in found.items()
        }
        data = xr.Dataset(variables, attrs={"question": self.question})
        with whole_file(self._path(number), force=True) as temporary:
            data.to_netcdf(temporary, engine="scipy", format="NETCDF3_64BIT")
        to_be_read(self._path(number))  # by a later map; no result may take its place

    def _path(self, number: int) -> Path:
        return self.folder / f"part{number + 1:06d}.nc"


def _content(path: Path) -> bytes:
    """Of a file of the folder; of a pipe or a device, which may be without end, none is read."""
    if not path.is_file():
        raise AacmmError(f"{path}: is no regular file, expected the parts of a map, or a new folder")
    return content_of(path, MOST_BYTES, "a part of a map", lambda message: AacmmError(f"{path}: {message}"))


def digits(values: Array) -> Any:
    """Numbers as JSON has them, to nine digits: machines differ in the sixteenth."""
    return np.vectorize(lambda v: float(f"{v:.9g}"), otypes=[float])(values).tolist()
