"""Text on which no terminal acts, and with which no spreadsheet computes."""

from __future__ import annotations

import csv
import io
import re
import sys
import unicodedata
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, Literal, TextIO

if TYPE_CHECKING:
    import pandas as pd

_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""Start of a cell that a spreadsheet would compute, perhaps quoted."""
_SEPARATED, _SEPARATED_QUOTED = (re.compile(rf"([;\t]){quote}(?='*[=+\-@])") for quote in ("", "'"))
"""Within a cell."""

_NOTHING = ("nan", "None", "<NA>", "NaT")
"""Missing in NumPy and pandas."""


def printable(text: str) -> str:
    """Control and shapeless characters as escapes, but for line ends and tabulators."""
    if text.isprintable():
        return text
    escaped_text = ""
    for character in text:
        kind = unicodedata.category(character)
        acts = kind[0] == "C" or kind in ("Zl", "Zp")
        is_escaped = acts and character not in "\n\t"
        escaped_text += character.encode("unicode_escape").decode() if is_escaped else character
    return escaped_text


def encodable(text: str) -> str:
    """Surrogates, from names that are not UTF-8, as escapes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


_result_streams: list[TextIO] = []


def stdout() -> TextIO:
    """The stream of results."""
    return _result_streams[-1] if _result_streams else sys.stdout


@contextmanager
def results_alone_on_stdout() -> Iterator[None]:
    """Meanwhile send other output, such as of a user's cause, to stderr."""
    _result_streams.append(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _result_streams.pop()


def say(text: str) -> None:
    """Print a result."""
    print(printable(text), file=stdout(), flush=True)


def warn(text: object) -> None:
    """Print on stderr what may make the result wrong."""
    print_error(f"warning: {text}")


def note(text: object) -> None:
    """Print an assumption on stderr."""
    status(f"note: {text}")


def status(text: object) -> None:
    """Print a completed step on stderr."""
    if not _quiet:
        print_error(text)


def print_error(text: object) -> None:
    print(printable(str(text)), file=sys.stderr, flush=True)


_quiet: list[bool] = []


@contextmanager
def without_notes() -> Iterator[None]:
    """Meanwhile suppress notes and status."""
    _quiet.append(True)
    try:
        yield
    finally:
        _quiet.pop()


def csv_quoted(text: str) -> str:
    """Text for CSV with an apostrophe before what a spreadsheet would compute: at its start, and
    behind a semicolon or tab, where some programs begin a new cell.
    """
    text = _SEPARATED.sub(r"\1'", text)
    if not _FORMULA.match(text):
        return text
    try:
        float(text.replace(",", "."))
    except ValueError:
        return f"'{text}"
    return text  # a negative number is no formula


def csv_unquoted(cell: str) -> str:
    """The text that :func:`csv_quoted` wrote."""
    cell = _SEPARATED_QUOTED.sub(r"\1", cell)
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def csv_text(
    table: pd.DataFrame | Mapping[str, Any],
    quoting: Literal[0, 2] = csv.QUOTE_MINIMAL,
    separator: str = ",",
) -> str:
    """A table, or columns by name, as CSV; missing values are empty."""
    columns = [
        column.tolist() if hasattr(column, "tolist") else column for _, column in table.items()
    ]
    text = io.StringIO()
    writer = csv.writer(text, quoting=quoting, lineterminator="\n", delimiter=separator)
    writer.writerow([_quoted(str(name)) for name in table])
    writer.writerows(map(_quoted, row) for row in zip(*columns, strict=True))
    return encodable(text.getvalue())


def _quoted(value: object) -> object:
    if isinstance(value, str):
        return csv_quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    return "" if str(value) in _NOTHING else value
