"""Whether records have anything to do with the arm, and the mistake of a first file behind those that have not.

A joint counted the other way, a zero a quarter turn off, exchanged columns, another unit or frame are no causes of error:
no parameter may take them up. Where the first fit leaves more than an arm has, or the arm as it is described is as far off,
every such mistake is undone in turn. The arm as it is described judges which of them brings tips and targets together best
(median distance over what the tips travel, so that gross errors do not count and no unit that shrinks the arm is rewarded);
a fit then has to confirm it. Nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.fit import FIRST_SCATTER, Fit, fit
from aacmm_pin.calibration.parameters import ASSEMBLED
from aacmm_pin.calibration.problem import OF_KIND, Problem
from aacmm_pin.calibration.solver import begin, deviations, noise_of_tips, solve
from aacmm_pin.calibration.stated_noise import StatedNoise, observations_of
from aacmm_pin.effects import JointPlacement, StylusOffset
from aacmm_pin.errors import AacmmError, MistakenFileError
from aacmm_pin.measurements.records import Measurements

FAR = 2e-3
"""Median distance that no arm has after a fit; some mistake is looked for [m]."""
UNLIKE = 0.03
"""Scatter about the best fit, as a part of what the tips travel, beyond which records have nothing to do with the arm."""
MOVED = 5.0
"""Geometry that moves so many times what assembly leaves (:data:`ASSEMBLED`) has taken up another mistake."""
EXPLAINS = 0.2
"""A mistake is named if without it the median distance falls to less than this part."""
ALIKE = 1.5
"""Mistakes that leave less than so many times the least are not told apart."""
TRIED = 3
"""So many of the best are fitted, the best first, until one explains the file."""
FEW = 10
"""With fewer records some mistake fits anything."""
ENOUGH = 80
"""So many records tell one mistake from another."""
UNITS = {"metres": 1e3, "inches": 25.4, "micrometres": 1e-3}
"""Units that a length in mm may have come in, and how many mm they have."""


@dataclass(frozen=True)
class _Mistake:
    """A mistake, which of angles, axes, lengths it is made in, and the problem without it."""

    name: str
    kind: str
    undone: Callable[[Problem], Problem]


def first_fit(problem: Problem, noise: StatedNoise, *, robust: bool = True) -> Fit:
    """:func:`fit`, refusing records that no fit of this arm means anything for.

    Raises:
        MistakenFileError: undoing one mistake, or two, explains the records.
        AacmmError: after the fit they are off by a large part of what the tips travel; see :func:`fit`.
    """
    try:
        after = fit(problem, noise, robust=robust)
    except AacmmError:
        _require_no_mistake(problem, noise, np.inf, thorough=True)
        raise
    travel = _travel(problem)
    unlike = after.unmodelled > max(UNLIKE * travel, FAR)
    fitted, at = _median(after.solution.system.deviation), after.solution.point
    before = _median(problem.tips(problem.start, at.frame) - after.observations.targets(at.seats))
    if max(fitted, before) >= FAR:
        _require_no_mistake(problem, noise, fitted, thorough=unlike)
    if unlike:
        raise AacmmError(
            f"{problem.measurements.source} does not fit this arm: are the columns of angles and coordinates, their units "
            "and signs, the arm and the reference frame right? (With the best parameters its records still scatter by "
            f"{after.unmodelled / MM:.0f} mm in each coordinate; the tips at these angles are spread over "
            f"{travel / MM:.0f} mm.)"
        )
    return after


def _require_no_mistake(problem: Problem, noise: StatedNoise, fitted: float, thorough: bool) -> None:
    """Refuse records that one mistake explains, or two where ``thorough``.

    Args:
        problem: what is unknown.
        noise: as stated.
        fitted: median distance after a fit of the records as they are, infinite where there is no such fit [m].
        thorough: look for several signs and pairs too.

    Raises:
        MistakenFileError: the mistake.
    """
    records = problem.measurements
    few = problem.of(records.take(_few(records)))
    before, as_given = _misfit(few, noise)
    if records.n < FEW or before == np.inf or (min(before / FAR, as_given / UNLIKE) < 1.0 and fitted < FAR):
        return
    taken_up = fitted < FAR or fitted == np.inf
    single = list(_mistakes(problem))
    for mistakes in (single, *((_several_signs(records.nq), _pairs(single)) if thorough else ())):
        misfits = np.array([_misfit(mistake.undone(few), noise)[1] for mistake in mistakes])
        alike = np.flatnonzero(misfits <= ALIKE * misfits.min())
        best = [*alike, *(k for k in np.argsort(misfits) if k not in alike)]
        for number in best[:TRIED]:
            if misfits[number] > (EXPLAINS if taken_up else 1.0) * as_given:
                continue
            try:
                without = fit(mistakes[number].undone(problem), noise)
            except AacmmError:
                continue
            least = min(EXPLAINS * (before if taken_up else fitted), UNLIKE * _travel(without.problem))
            left = _median(without.solution.system.deviation)
            if left < least and not _absorbs(without):
                others = [mistakes[k].name for k in alike if k != number and number in alike]
                raise MistakenFileError(
                    records.source, mistakes[number].name, before if taken_up else fitted, left, tuple(others)
                )


def _travel(problem: Problem) -> float:
    """How far the tips are spread in each coordinate [m]."""
    tips = problem.model.arm.positions(problem.measurements.q)
    return float(np.sqrt(tips.var(axis=0).mean()))


def _absorbs(after: Fit) -> bool:
    """Whether the fit moved a geometric value farther than any arm's is off."""
    problem, x, first = after.problem, after.solution.point.x, 0
    for effect in problem.estimated:
        own = slice(first, first + len(effect.terms))
        first = own.stop
        if isinstance(effect, (JointPlacement, *OF_KIND.values())):
            widths = np.array([ASSEMBLED[term.unit] for term in effect.terms])
            if (np.abs(x[own] - problem.start[own]) > MOVED * widths).any():
                return True
    return False


def _median(deviation: Array) -> float:
    """Median distance of the records that have a target [m]; infinite where none has."""
    distance = np.linalg.norm(deviation, axis=1)
    distance = distance[np.isfinite(distance)]
    return float(np.median(distance)) if distance.size else np.inf


def _misfit(problem: Problem, noise: StatedNoise) -> tuple[float, float]:
    """Median distance by the arm as it is described, frame, seats and target fitted [m]; the same over the tips' travel."""
    mine = np.array([isinstance(e, StylusOffset) for e in problem.estimated for _ in e.terms], dtype=bool)
    targets = tuple(e for e in problem.estimated if isinstance(e, StylusOffset))
    setup = replace(
        problem,
        estimated=targets,
        widths=problem.widths[mine],
        stated=problem.stated[mine],
        arm_u=problem.arm_u[mine],
        correlation=problem.correlation[np.ix_(mine, mine)],
    )
    records = setup.measurements
    observations = observations_of(records, noise, FIRST_SCATTER)
    try:
        point = begin(setup, observations)
        if targets:
            tips = noise_of_tips(setup, point.frame, None, FAR)
            point = solve(setup, observations, tips, point, np.ones(records.n), robust=True, roughly=True).point
    except AacmmError:
        return np.inf, np.inf
    off = deviations(observations, point)
    seats = records.seats()
    for bar in records.bars():
        # Seats lie where their records put them: what a bar is off by is half each end's.
        a, b = (seats[label] for label in (bar.seat_a, bar.seat_b))
        tips = point.prediction.tips
        apart = np.linalg.norm(np.median(tips[a], axis=0) - np.median(tips[b], axis=0))
        both = np.concatenate([a, b])
        off[both] += 0.5 * (apart - bar.length) / np.sqrt(3.0) * np.where(off[both] < 0, -1.0, 1.0)
    median = _median(off)
    travel = float(np.median(np.linalg.norm(point.prediction.tips - np.median(point.prediction.tips, axis=0), axis=1)))
    return median, median / max(travel, 1e-9)


def _few(records: Measurements) -> Index:
    """Enough of the records, some of every seat."""
    rows = np.arange(records.n)
    seats = records.seats()
    if not seats:
        return rows[:: max(1, records.n // ENOUGH)]
    each = max(3, ENOUGH // len(seats))
    return np.unique(np.concatenate([members[:: max(1, len(members) // each)] for members in seats.values()]))


# --- mistakes


def _mistakes(problem: Problem) -> Iterator[_Mistake]:
    """Every single mistake."""
    records = problem.measurements
    for j in range(records.nq):
        yield _Mistake(f"joint {j + 1} is counted the other way", "sign", _counted((j,)))
    for j, degrees in product(range(records.nq), (90, -90, 180)):
        name = f"the zero of joint {j + 1} is turned: {degrees}° have to be added to its angles"
        yield _Mistake(name, f"zero {j}", _turned(j, degrees * DEG))
    for j, k in combinations(range(records.nq), 2):
        yield _Mistake(f"the columns of joints {j + 1} and {k + 1} are exchanged", "columns", _exchanged(j, k))
    for name, factor in (("degrees, taken as radians", DEG), ("radians, taken as degrees", 1 / DEG)):
        yield _Mistake(f"the angles are in {name}", "angles", _multiplied(factor))
    if records.known.any():
        yield from _of_frame(problem.external)
        for name, factor in UNITS.items():
            yield _Mistake(f"the coordinates are in {name}, in columns of mm", "unit", _scaled(factor))
        yield _Mistake("the coordinates are in mm, taken as metres", "unit", _scaled(MM))
    if records.bars():
        for name, factor in UNITS.items():
            yield _Mistake(f"the lengths of the bars are in {name}, in a column of mm", "bars", _other_bars(factor))
        yield _Mistake("the lengths of the bars are in mm, taken as metres", "bars", _other_bars(MM))


def _of_frame(external: bool) -> Iterator[_Mistake]:
    """Coordinates along other axes; in an unknown frame all mirror images are alike."""
    if external:
        name = "the coordinates are a mirror image: two columns are exchanged, or one has the other sign"
        yield _Mistake(name, "axes", _axes((0, 1, 2), (1, 1, -1)))
        return
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        if (order, signs) != ((0, 1, 2), (1, 1, 1)):
            came = ", ".join(f"{'-' * (s < 0)}{'xyz'[k]}" for k, s in zip(order, signs, strict=True))
            yield _Mistake(f"the coordinates are along other axes: x, y, z should be {came}", "axes", _axes(order, signs))
    name = "the coordinates are in another frame than the base's: is the reference frame external?"
    yield _Mistake(name, "axes", lambda p: replace(p, external=True))


def _several_signs(nq: int) -> list[_Mistake]:
    """Two joints or more counted the other way."""
    found = []
    for joints in (j for count in range(2, nq + 1) for j in combinations(range(nq), count)):
        listed = f"{', '.join(str(j + 1) for j in joints[:-1])} and {joints[-1] + 1}"
        found.append(_Mistake(f"joints {listed} are counted the other way", "sign", _counted(joints)))
    return found


def _pairs(single: list[_Mistake]) -> list[_Mistake]:
    """Every two mistakes of different kinds; zeros of two joints are two kinds."""
    return [
        _Mistake(f"{one.name}, and {other.name}", "two", _both(one, other))
        for one, other in combinations(single, 2)
        if one.kind != other.kind
    ]


def _both(one: _Mistake, other: _Mistake) -> Callable[[Problem], Problem]:
    return lambda problem: other.undone(one.undone(problem))


def _angles(change: Callable[[Array], Array]) -> Callable[[Problem], Problem]:
    return lambda problem: problem.of(replace(problem.measurements, q=change(problem.measurements.q)))


def _counted(joints: tuple[int, ...]) -> Callable[[Problem], Problem]:
    def change(q: Array) -> Array:
        signs = np.ones(q.shape[1])
        signs[list(joints)] = -1.0
        return q * signs

    return _angles(change)


def _multiplied(factor: float) -> Callable[[Problem], Problem]:
    return _angles(lambda q: factor * q)


def _turned(joint: int, angle: float) -> Callable[[Problem], Problem]:
    return _angles(lambda q: q + angle * np.eye(q.shape[1])[joint])


def _exchanged(one: int, other: int) -> Callable[[Problem], Problem]:
    def change(q: Array) -> Array:
        order = np.arange(q.shape[1])
        order[[one, other]] = other, one
        return q[:, order]

    return _angles(change)


def _axes(order: tuple[int, ...], signs: tuple[int, ...]) -> Callable[[Problem], Problem]:
    def undone(problem: Problem) -> Problem:
        records = problem.measurements
        reference = records.reference[:, order] * np.array(signs)
        return problem.of(replace(records, reference=reference, reference_u=records.reference_u[:, order]))

    return undone


def _scaled(factor: float) -> Callable[[Problem], Problem]:
    """Coordinates in another unit; their uncertainties stay, which may be right."""

    def undone(problem: Problem) -> Problem:
        records = problem.measurements
        return problem.of(replace(records, reference=factor * records.reference))

    return undone


def _other_bars(factor: float) -> Callable[[Problem], Problem]:
    def undone(problem: Problem) -> Problem:
        records = problem.measurements
        length = None if records.bar_length is None else factor * records.bar_length
        return problem.of(replace(records, bar_length=length))

    return undone
