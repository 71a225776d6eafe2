"""Errors that this package raises if it cannot use its input."""

from __future__ import annotations

import copyreg

MOST_CHARACTERS = 1200
"""Of a line in a message; longer ones are cut in the middle."""


class AacmmError(Exception):
    """Base class of all errors that this package raises on purpose.

    Its message is for users.
    """

    def __init__(self, message: str) -> None:
        half = MOST_CHARACTERS // 2
        lines = message.split("\n")
        super().__init__(
            "\n".join(
                x if len(x) <= MOST_CHARACTERS else f"{x[:half]} … {x[-half:]}" for x in lines
            )
        )

    def __reduce__(self) -> tuple[object, ...]:
        """An error of a worker process arrives as what it was, whatever its arguments."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class ShapeError(AacmmError):
    """An array has a wrong shape, or a number that is not finite."""


class ArmFileError(AacmmError):
    """An arm file cannot be used.

    Attributes:
        path: file name as stated.
        key: dotted key in the file; "" for the whole file.
    """

    def __init__(self, path: str, key: str, message: str) -> None:
        self.path = path
        self.key = key
        super().__init__(f"{path}: {key}: {message}" if key else f"{path}: {message}")


class UnknownNameError(AacmmError):
    """The name of an arm, frame, method or other object is unknown.

    Attributes:
        name: the unknown name.
        known: all known names.
    """

    def __init__(self, what: str, name: str, known: list[str], hint: str = "") -> None:
        self.name = name
        self.known = known
        noun, *of = what.partition(" of ")
        super().__init__(
            f"unknown {noun} {name!r}{''.join(of)}; expected one of {', '.join(known)}"
            + (f" ({hint})" if hint else "")
        )


class UnsupportedArmError(AacmmError):
    """The arm lacks a property that the computation needs."""


class CauseError(AacmmError):
    """A user-defined cause of error is invalid.

    Attributes:
        label: name and place of the cause.
    """

    def __init__(self, label: str, message: str) -> None:
        self.label = label
        super().__init__(f"{label}: {message}")


class OutputError(AacmmError):
    """A result cannot be written to the requested file."""


class MissingConditionError(AacmmError):
    """The records lack a condition on which a cause of error depends.

    Attributes:
        column: of the measurement file.
    """

    def __init__(self, purpose: str, column: str) -> None:
        self.column = column
        super().__init__(f"{purpose}: the records lack the column `{column}`; add this column")


class MeasurementFileError(AacmmError):
    """A measurement file cannot be used.

    Attributes:
        path: file name as stated.
        row: line, with the header as line 1; None if no single one is wrong.
        column: "" if no single one is wrong.
    """

    def __init__(self, path: str, row: int | None, column: str, message: str) -> None:
        self.path = path
        self.row = row
        self.column = column
        place = [f"row {row}"] if row is not None else []
        place += [f"column {column}"] if column else []
        super().__init__(": ".join([path, *([", ".join(place)] if place else []), message]))


class MistakenFileError(AacmmError):
    """The records do not fit the arm by a probable mistake in the file, such as a joint with the
    opposite sign.

    Attributes:
        source: file name as stated.
        mistake: in words.
        before: median distance from targets with the mistake [m].
        after: the same after a fit without the mistake [m].
        others: equally good mistakes, in words.
    """

    def __init__(
        self, source: str, mistake: str, before: float, after: float, others: tuple[str, ...] = ()
    ) -> None:
        self.source = source
        self.mistake = mistake
        self.before = before
        self.after = after
        self.others = others
        also = f" (or: {'; or: '.join(others)})" if others else ""
        super().__init__(
            f"{source} does not fit this arm: {mistake}{also}. Without this mistake, the median "
            f"residual falls from {before * 1e3:.4g} mm to {after * 1e3:.2g} mm. Correct the file, "
            "the arm file or the options"
        )
