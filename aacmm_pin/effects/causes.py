"""The causes that are known by name: the library's, and those that somebody registered."""

from __future__ import annotations

import inspect
import itertools
import re
import reprlib
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm, GivenArm, as_arm
from aacmm_pin.effects.compliance import BearingTilt, Counterbalance, JointCompliance, LinkBending, TorsionalWindup
from aacmm_pin.effects.conditions import COLUMNS, Conditions
from aacmm_pin.effects.drift_and_hysteresis import JointHysteresis, ZeroDrift
from aacmm_pin.effects.effect import Displacement, Effect, Records, Term
from aacmm_pin.effects.encoder import (
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    EncoderSlip,
    JointErrorCurve,
    JointPeriodicError,
)
from aacmm_pin.effects.geometry import JointDistance, JointPlacement, JointZeroOffset, LinkLength, LinkTilt, LinkTwist
from aacmm_pin.effects.mounting import BaseCompliance, ReferenceFrame, SeatError
from aacmm_pin.effects.probing import StylusBending, StylusOffset
from aacmm_pin.effects.state import State
from aacmm_pin.effects.thermal import ThermalExpansion
from aacmm_pin.errors import AacmmError, CauseError, UnknownNameError

CAUSES: dict[str, type[Effect]] = {
    effect.cause: effect
    for effect in (
        EncoderEccentricity,
        EncoderEllipticity,
        EncoderGain,
        JointPeriodicError,
        JointErrorCurve,
        EncoderSlip,
        ZeroDrift,
        JointHysteresis,
        JointCompliance,
        BearingTilt,
        BaseCompliance,
        LinkBending,
        TorsionalWindup,
        Counterbalance,
        ThermalExpansion,
        StylusBending,
        SeatError,
        JointZeroOffset,
        LinkLength,
        JointDistance,
        LinkTwist,
        LinkTilt,
        JointPlacement,
        StylusOffset,
        ReferenceFrame,
    )
}
"""Every cause by its name, in the order in which they are tried."""

LARGEST_COLUMN = 1e12
"""What a cause of one's own may move a place by per unit of a parameter [m/unit, rad/unit]; no physical one comes near."""

_Own = TypeVar("_Own", bound=type[Effect])
_Item = TypeVar("_Item")


def register(cause: _Own) -> _Own:
    """Make a cause of your own known by its name; a decorator of its class.

    From then on ``diagnose`` tries it wherever its ``candidates`` say, plans tell it from others, arm files and ``--effect``
    may name it, and pages and pictures show it. At the shell ``aacmm-pin --plugin MODULE …`` imports the module that
    registers it, as does an entry point in the group ``aacmm_pin.causes``. It lasts as long as the process: a program that
    reads an arm file with the cause registers it first. A class that is defined anew, as in a notebook, takes its own place.
    Whatever its ``displacements`` and ``exact`` give is checked, each time.

    Raises:
        AacmmError: it is no :class:`Effect`, the name is of no use in a file, or another class has it.
        CauseError: it has no ``displacements``, or its ``terms``, ``needs``, ``usual`` or ``inner`` are none.
    """
    if not (isinstance(cause, type) and issubclass(cause, Effect)):
        raise AacmmError(f"{cause!r} is registered as a cause, expected a class derived from aacmm_pin.effects.Effect")
    name = getattr(cause, "cause", None)
    if not (isinstance(name, str) and re.fullmatch("[a-z][a-z0-9_]*", name)):
        raise AacmmError(f"{cause.__name__}: cause is {name!r}, expected a name of small letters, digits and _")
    there = CAUSES.get(name, cause)
    if (there.__module__, there.__qualname__) != (cause.__module__, cause.__qualname__):
        raise AacmmError(f"{cause.__name__}: the cause {name} is there already, {there.__module__}.{there.__qualname__}")
    if cause.__abstractmethods__:
        raise CauseError(name, f"{cause.__name__} lacks {', '.join(sorted(cause.__abstractmethods__))}")
    terms = inspect.getattr_static(cause, "terms")
    if not isinstance(terms, property) and not (isinstance(terms, tuple) and terms and {*map(type, terms)} == {Term}):
        raise CauseError(name, f"terms is {terms!r}, expected a tuple of one Term or more, such as (Term(…),)")
    _check_attributes(cause, name)
    for method, check in (("displacements", _check), ("exact", _check_exact)):
        if not hasattr(getattr(cause, method), "__wrapped__") and getattr(cause, method) is not Effect.exact:
            setattr(cause, method, _checked(getattr(cause, method), check))
    CAUSES[name] = cause
    return cause


def _check_attributes(cause: type[Effect], name: str) -> None:
    """Refuse what a class states of itself, where that is no property."""
    needs = inspect.getattr_static(cause, "needs")
    if not isinstance(needs, property) and not (isinstance(needs, tuple) and {*needs} <= {*COLUMNS}):
        raise CauseError(name, f"needs is {needs!r}, expected a tuple of some of {', '.join(COLUMNS)}")
    if not (isinstance(cause.usual, int | float) and 0.0 < cause.usual < np.inf):
        raise CauseError(name, f"usual is {cause.usual!r}, expected a number above 0")
    if not (isinstance(cause.inner, tuple) and {*cause.inner} <= {*cause.structure()}):
        raise CauseError(name, f"inner is {cause.inner!r}, expected a tuple of some of {', '.join(cause.structure())}")


def _checked(method: Callable[[Any, State], list[_Item]], check: Callable[..., None]) -> Callable[[Any, State], list[_Item]]:
    """The same, with a :class:`CauseError` for whatever is wrong with it but what an :class:`AacmmError` says."""
    file, name = method.__code__.co_filename, method.__name__

    @wraps(method)
    def checked(self: Effect, state: State) -> list[_Item]:
        try:
            found = list(method(self, state))
            for item in found:
                check(self, item, state)
        except AacmmError:
            raise
        except (Exception, SystemExit) as error:
            raise CauseError(self.label, f"{name}: {raised(error, file)}") from error
        return found

    return checked


def _check(effect: Effect, displacement: Displacement, state: State) -> None:
    columns = np.asarray(displacement.columns)
    expected = f"expected ({state.n}, 6, {len(effect.terms)}) or (1, 6, {len(effect.terms)}): records, twist, parameters"
    if columns.shape[1:] != (6, len(effect.terms)) or len(columns) not in (1, state.n):
        raise CauseError(effect.label, f"displacements: columns have shape {columns.shape}, {expected}")
    numbers = columns.reshape(len(columns), -1)
    _check_numbers(effect, "displacements: columns", displacement.place, numbers, state)


def _check_exact(effect: Effect, moved: tuple[int, Array], state: State) -> None:
    twists = np.asarray(moved[1])
    if twists.shape not in ((state.n, 6), (1, 6)):
        raise CauseError(effect.label, f"exact: twists have shape {twists.shape}, expected ({state.n}, 6) or (1, 6)")
    _check_numbers(effect, "exact: twists", moved[0], twists, state)


def _check_numbers(effect: Effect, what: str, place: int, numbers: Array, state: State) -> None:
    last, wrong = state.arm.chain.tip, np.flatnonzero(~(np.abs(numbers) <= LARGEST_COLUMN).all(axis=1))
    if place not in range(last + 1):
        raise CauseError(effect.label, f"{what.split(':')[0]}: place is {place!r}, expected a whole number from 0 to {last}")
    if wrong.size:
        came = f"numbers that are not finite, or beyond {LARGEST_COLUMN:g}, in {wrong.size} of {len(numbers)} records"
        raise CauseError(effect.label, f"{what} have {came}, the first at number {wrong[0] + 1}")


def raised(error: BaseException, file: str) -> str:
    """An exception in one line, with the last line of ``file`` on its way, if it came by there."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    where = f" ({Path(file).name}, line {lines[-1]})" if lines else ""
    text = str(traceback.TracebackException.from_exception(error))  # whatever its own __str__ does
    return f"{type(error).__name__}: {' '.join(text.split())}{where}"


def cause_named(name: str) -> type[Effect]:
    """The class of a cause.

    Raises:
        UnknownNameError: no cause of this name is known.
    """
    if name not in CAUSES:
        hint = "a cause of your own needs --plugin MODULE before the command, in Python the import of that module"
        raise UnknownNameError("cause", name, list(CAUSES), hint)
    return CAUSES[name]


def all_candidates(arm: GivenArm, records: Records | None = None) -> Iterator[tuple[Effect, ...]]:
    """Every cause at every place where it could sit, with the variants to try, but for what a calibration refits anyway.

    In the order of :data:`CAUSES`; neighbours there that sit in places of one kind come place by place.

    Args:
        arm: the arm.
        records: as far as they show the causes; None for whatever could be recorded.
    """
    arm = as_arm(arm)
    for _, kinds in itertools.groupby(CAUSES.values(), key=lambda cause: cause.site()):
        found = [variants for cause in kinds if not cause.refitted for variants in _candidates(cause, arm, records)]
        yield from sorted(found, key=lambda variants: variants[0].row or 0)


def _candidates(cause: type[Effect], arm: Arm, records: Records | None) -> list[tuple[Effect, ...]]:
    """What :meth:`Effect.candidates` of a class gives.

    Raises:
        CauseError: it gives something else.
    """
    found = cause.candidates(arm, records)
    given = list(found) if isinstance(found, Iterable) else [found]
    for variants in given:
        if not (isinstance(variants, tuple) and variants and all(isinstance(one, cause) for one in variants)):
            came = reprlib.repr(variants)
            raise CauseError(cause.cause, f"candidates gives {came}, expected tuples of one {cause.__name__} or more")
    return given


@dataclass(frozen=True, eq=False)
class SomeRecords:
    """Records as far as :class:`Records` asks of them, which nobody took."""

    q: Array
    conditions: Conditions
    known: NDArray[np.bool_]


@cache
def example(cause: type[Effect]) -> Effect | None:
    """One of its kind in SINO6, for what cannot be asked of a class; None where :meth:`Effect.candidates` has none there."""
    from aacmm_pin.arm.random_postures import joint_bounds

    arm, n = Arm.load("sino6"), 360
    low, high = joint_bounds(arm).T
    part = np.linspace(0.0, 1.0, n)
    conditions = Conditions(
        n,
        time=3600.0 * part,
        temperature=20.0 + part,
        approach=np.sign(np.sin(np.arange(1, n + 1)[:, None] * np.arange(1, arm.nq + 1))),
        seat=np.array(list("ABC") * (n // 3), dtype=object),
        marker=np.full(n, "1", dtype=object),
    )
    records = SomeRecords(low + part[:, None] * (high - low), conditions, np.ones(n, dtype=bool))
    return next((variants[0] for variants in _candidates(cause, arm, records)), None)
