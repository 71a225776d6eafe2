"""What this package raises when it cannot use what it was given."""

from __future__ import annotations

import copyreg

MOST_CHARACTERS = 1200
"""Of a line of a message; what is longer, such as a number of thousands of digits that it quotes,
is cut in the middle.
"""


class AacmmError(Exception):
    """Base of every error that this package raises on purpose; its text is meant for the user."""

    def __init__(self, message: str) -> None:
        half = MOST_CHARACTERS // 2
        lines = message.split("\n")
        super().__init__(
            "\n".join(
                x if len(x) <= MOST_CHARACTERS else f"{x[:half]} … {x[-half:]}" for x in lines
            )
        )

    def __reduce__(self) -> tuple[object, ...]:
        """As pickle takes it: an error of a worker process has to arrive as what it was, whatever
        its own arguments.
        """
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class ShapeError(AacmmError):
    """An array has the wrong shape or holds numbers that are not finite."""


class ArmFileError(AacmmError):
    """An arm file cannot be used.

    Attributes:
        path: the file, as the caller named it.
        key: the dotted key inside the file, or "" where the whole file is meant.
    """

    def __init__(self, path: str, key: str, message: str) -> None:
        self.path = path
        self.key = key
        super().__init__(f"{path}: {key}: {message}" if key else f"{path}: {message}")


class UnknownNameError(AacmmError):
    """A name (arm, frame, method, ...) is none of the known ones.

    Attributes:
        name: what came.
        known: what would have been understood.
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
    """The arm's geometry lacks what this computation needs."""


class CauseError(AacmmError):
    """A cause of one's own does not do what a cause has to.

    Attributes:
        label: the cause and where it sits.
    """

    def __init__(self, label: str, message: str) -> None:
        self.label = label
        super().__init__(f"{label}: {message}")


class OutputError(AacmmError):
    """A result cannot be written where it was asked to be."""


class MissingConditionError(AacmmError):
    """A cause of error depends on a condition that the records do not state.

    Attributes:
        column: the column of a measurement file that would tell.
    """

    def __init__(self, purpose: str, column: str) -> None:
        self.column = column
        super().__init__(f"{purpose}: the records lack the column {column}; add this column")


class MeasurementFileError(AacmmError):
    """A measurement file cannot be used.

    Attributes:
        path: the file, as the caller named it.
        row: line of the file, the header being line 1; None where no single line is meant.
        column: the column, or "" where no single one is meant.
    """

    def __init__(self, path: str, row: int | None, column: str, message: str) -> None:
        self.path = path
        self.row = row
        self.column = column
        place = [f"row {row}"] if row is not None else []
        place += [f"column {column}"] if column else []
        super().__init__(": ".join([path, *([", ".join(place)] if place else []), message]))


class MistakenFileError(AacmmError):
    """Records have nothing to do with the arm until a mistake in them is undone, such as a joint
    counted the other way.

    Attributes:
        source: the records, as the caller named them.
        mistake: what is wrong, in words.
        before: median distance of the records from their targets as they are [m].
        after: the same with the mistake undone and the parameters fitted [m].
        others: mistakes that explain the records as well, in words.
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
            "the arm or the options"
        )
