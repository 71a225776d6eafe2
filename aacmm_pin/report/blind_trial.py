"""A cause to be found: drawn without being shown, and laid beside what a diagnosis made of its records afterwards."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.arm.random_postures import Room
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.diagnosis.result import SETTLED
from aacmm_pin.effects import Effect, all_candidates
from aacmm_pin.effects.causes import SomeRecords
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.labels import FEW_VALUES, in_words, listed, probability
from aacmm_pin.effects.state import State
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.diagnosis import labels_in_words, motion_of
from aacmm_pin.report.numbers import lengths

TIMES_TYPICAL = (1.0, 2.5)
"""How large a drawn cause is, in usual magnitudes."""
SESSION = (1200.0, 4800.0)
"""When something happens: inside the first session of a virtual workshop [s]."""
SHOWS = 2e-6
"""A cause that moves the tip by less than this, at its usual magnitude, is not worth hiding [m]."""
POSTURES = 100


def hideable(arm: Arm) -> tuple[str, ...]:
    """Names of the causes that can be hidden in an arm: those that move its tip somewhere."""
    return tuple(sorted({effect.cause for effect in _everywhere(arm, np.random.default_rng(0))}))


def hidden_cause(arm: Arm, rng: np.random.Generator, choose: str | None = None) -> Effect:
    """A cause of usual size at a place where the arm can have it.

    Args:
        arm: the arm.
        rng: draws the cause, each kind being as likely, then its place, then its size in any direction.
        choose: name of the cause; None draws it too.

    Raises:
        UnknownNameError: the arm cannot have such a cause; lists those that it can.
    """
    names = hideable(arm)
    if choose is not None and choose not in names:
        raise UnknownNameError("cause", choose, list(names))
    drawn = str(rng.choice(names))  # drawn in any case, so that place and size are the seed's alone
    places = [effect for effect in _everywhere(arm, rng) if effect.cause == (choose or drawn)]
    effect = places[int(rng.integers(len(places)))]
    direction = rng.normal(size=len(effect.terms))
    size = rng.uniform(*TIMES_TYPICAL) / np.linalg.norm(direction)
    values = size * direction * np.array([term.typical for term in effect.terms])
    return effect.at(tuple(np.where([term.positive for term in effect.terms], np.abs(values), values)))


def _everywhere(arm: Arm, rng: np.random.Generator) -> list[Effect]:
    """Every cause that the arm can have, at every place where it shows, once; orders and times are drawn."""
    fixed = np.random.default_rng(0)
    conditions = Conditions(
        POSTURES,
        time=np.linspace(*SESSION, POSTURES),
        temperature=arm.reference_temperature + fixed.uniform(-1.0, 1.0, POSTURES),
        approach=fixed.choice([-1.0, 1.0], (POSTURES, arm.nq)),
    )
    visit = SomeRecords(Room(arm).postures(POSTURES, np.random.default_rng(0))[0], conditions, np.ones(POSTURES, dtype=bool))
    state = State(arm, visit.q, conditions, arm.chain.tip)
    drawn = [variants[int(rng.integers(len(variants)))] for variants in all_candidates(arm, visit)]
    return [effect for effect in drawn if len(effect.terms) <= FEW_VALUES and _motion(effect, state) > SHOWS]


def _motion(effect: Effect, state: State) -> float:
    """RMS by which a cause of usual magnitude moves the tip [m]."""
    moved = effect.sensitivity(state) * np.array([term.typical for term in effect.terms])
    return float(np.sqrt(np.square(moved).sum(axis=(1, 2)).mean()))


def finding_of(result: Diagnosis, hidden: Effect) -> Finding | None:
    """The finding that names the hidden cause at its place, if there is one."""
    return next((f for f in result.findings if f.label == hidden.label), None)


def uncovered(result: Diagnosis, hidden: Effect) -> pd.DataFrame:
    """What was hidden beside what was found, one row a value; found is empty where the cause was not named.

    Columns: value, hidden, found, U (k = 2), times_u (found minus hidden over u; a phase the shorter way round).
    """
    finding, true = finding_of(result, hidden), hidden.described()
    told = {} if finding is None else finding.parameters
    value, u = np.array([told.get(name, (np.nan, np.nan)) for name in true]).T
    off = value - np.array(list(true.values()))
    phase = np.array([name.startswith("phase") for name in true])
    off = np.where(phase, (off + np.pi) % (2 * np.pi) - np.pi, off)
    columns = {"value": list(true), "hidden": list(true.values()), "found": value}
    return pd.DataFrame(columns | {"U": COVERAGE_FACTOR * u, "times_u": off / u})


def uncovered_in_words(result: Diagnosis, hidden: Effect) -> str:
    """What was hidden, how far it moves the tip, and what became of it; the values stand in :func:`uncovered`."""
    moved, noise = lengths([motion_of(result, hidden), result.noise])
    was = f"Hidden was: {in_words(hidden)} ({moved} RMS at the tip, noise {noise})."
    finding = finding_of(result, hidden)
    others = listed([in_words(f.effect) for f in result.findings if f is not finding])
    also = f" Also named, though not hidden: {others}." if others else ""
    if finding is not None:
        sure = "settled" if finding.probability >= SETTLED else "not settled against its look-alikes"
        return f"{was} It is named, with probability {probability(finding.probability)}: {sure}.{also}"
    alike = [(f, a) for f in result.findings for a in f.aliases if a.label == hidden.label]
    for other, alias in alike[:1]:
        return (
            f"{was} Named is a look-alike, {in_words(other.effect)} (probability {probability(other.probability)}); what "
            f"was hidden has correlation {alias.correlation:.3f} and probability {probability(alias.probability)}."
        )
    group = next((group for group in result.cannot_tell_apart if hidden.label in group), ())
    same = f" In these records it looks like {labels_in_words(result, group)}." if group else ""
    return f"{was} It is not named.{also}{same}"
