"""Whether records fit the arm; if not, which mistake in a file (sign, zero, column, unit, frame)
explains them.

No parameter may take up such a mistake. If the first fit, or the arm as described, leaves more than
any arm has, every mistake is undone in turn. The arm as described ranks them by the median distance
of tips and targets over the tips' travel, in which gross errors do not count, and by the mean error
of bars. A fit then has to leave no more than the noise. The simplest is named: the fewest mistakes
with the fewest free numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.candidate_mistakes import (
    LEAST_DIVISOR,
    SIMILAR_RATIO,
    Mistake,
    mistakes_in_bars,
    several_columns,
    single_mistakes,
)
from aacmm_pin.calibration.estimation import FIRST_SCATTER, fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.linearisation import Linearisation
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.parameters import ASSEMBLED, asked_again, problem_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.session_frames import another_frame
from aacmm_pin.calibration.setup import sessions_of
from aacmm_pin.calibration.solver import initial_point, solve
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import StylusOffset
from aacmm_pin.errors import AacmmError, MissingConditionError, MistakenFileError
from aacmm_pin.measurements import ANGLE, DISTANCE, OF_BAR, TILTS, Measurements, Observations

FAR = 2e-3
"""Scatter, or median distance after a fit, that no arm has [m]."""
UNLIKE_PART = 0.03
"""Scatter over the tips' travel beyond which records are not of this arm."""
MOST_MOTION = 5.0
"""Geometry that moves so many times :data:`ASSEMBLED`, and the tips as much as such a length, has
taken up a mistake; a zero that hardly moves the tip may be anything.
"""
EXPLAINED_PART = 0.2
"""Part of the median distance below which undoing a mistake explains it."""
MOST_FITTED = 8
"""Of the most likely mistakes; more than four alike are rare."""
FEWEST_FOR_MISTAKES = 10
"""With fewer records some mistake fits anything."""
RECORDS_TO_DISTINGUISH = 80
ORIENTATION_FAR = 0.05
"""Median angle between fitted and stated orientations that no arm has [rad]."""
ODD_RELATION = 4.0
"""A relation so many standard deviations off may have another value; chance: 1 of 16 000."""
REDUNDANCY = 1e-3
"""Least share of all else in a relation."""
IMPOSSIBLE = 30.0
"""A relation off by so many standard deviations, and by more than …"""
GROSS_DISTANCE = 3e-4
GROSS_SCALE = 2e-3
GROSS_ANGLE = 5e-3
"""… these [m; part of the distance; rad] is mistyped: no cause acts so unequally on one body."""


def first_fit(problem: Problem, *, robust: bool = True) -> Fit:
    """:func:`fit` that refuses records of another arm.

    Raises:
        MistakenFileError: undoing a mistake explains the records.
        AacmmError: the fit leaves a large part of what the tips travel, or a relation of planes is
            impossible; see :func:`fit`.
    """
    require_possible_relations(problem)
    if any(mistakes_in_bars(problem)):  # a fit to these takes long
        _require_no_mistake(problem, None)
    try:
        after = fit(problem, robust=robust)
    except MissingConditionError:  # which no mistake in the columns explains
        raise
    except AacmmError:
        _require_no_mistake_in_a_session(problem)
        _require_no_mistake(problem, None)
        raise
    distances = np.linalg.norm(after.system.deviation, axis=1)
    session = problem.measurements.conditions.labels("session")
    if any(_finite_median(distances[session == label]) >= FAR for label in {*session} - {""}):
        _require_no_mistake_in_a_session(problem)
    _require_no_mistake(problem, after)
    if _is_unlike(after):
        raise AacmmError(
            f"{problem.measurements.source}: {Note('unlike_arm')}. (With the best parameters, the "
            f"records scatter by {after.scatter / MM:.0f} mm in each coordinate. The tips of the "
            f"arm at these angles scatter by {_travel(problem) / MM:.0f} mm.)"
        )
    rows = after.used & after.observations.oriented
    median_angle = np.median(after.turns[rows]) if rows.any() else 0.0
    if median_angle >= ORIENTATION_FAR:
        raise AacmmError(
            f"{problem.measurements.source}: the orientations do not fit this arm (median error "
            f"{median_angle / DEG:.3g}°): {Note('orientation_unlike')}"
        )
    return after


def mistakes_of(after: Fit) -> Iterator[Note]:
    """Notes on mistakes with which records can still be fitted."""
    if wrong := wrong_value(after):
        yield Note(wrong.code, wrong.data)
    yield from another_frame(after)


def _is_unlike(after: Fit) -> bool:
    return after.scatter > max(FAR, UNLIKE_PART * _travel(after.problem))


def _problems_by_session(problem: Problem) -> list[Problem]:
    records = problem.measurements
    labels = records.conditions.session
    problems = []
    for session in () if labels is None else np.unique(labels):
        of_session = records.take(labels == session)
        if of_session.placed.any() or not problem.setup.frame_of_session:
            source = f"{records.source}: session {session}"
            problems.append(problem.of(replace(of_session, source=source)))
    return problems


def _fit_alone(problem: Problem) -> Fit | None:
    """None unless the records fit the arm."""
    try:
        after = fit(problem)
    except (AacmmError, np.linalg.LinAlgError):  # a hypothesis that is far off has no fit
        return None
    is_near = _distance_of(after) < min(FAR, UNLIKE_PART * _travel(after.problem))
    return after if is_near and after.scatter < FAR and not _absorbs(after) else None


def _require_no_mistake_in_a_session(problem: Problem) -> None:
    parts = _problems_by_session(problem)
    fits = [_fit_alone(part) for part in parts]
    for part, alone in zip(parts, fits, strict=True):
        if any(fits) and alone is None:
            _require_no_mistake(part, None, one_session=True)


def _require_no_mistake(problem: Problem, after: Fit | None, *, one_session: bool = False) -> None:
    """Refuse records that a mistake explains, of which ``after`` is the fit, if they have one.

    The frame of one session may be another without a mistake, as of a stand that was moved.
    """
    records = problem.measurements
    if problem.setup.frame_of_session:
        is_first = records.conditions.labels("session") == sessions_of(records)[0]
        external = replace(problem.setup, reference_frame="external")
        problem = asked_again(problem.of(records.take(is_first)), problem.model, external)
        records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES:
        return
    # With frame and targets unknown, and the geometry as described.
    offsets = [item for item in problem.asked if item == "tool" or isinstance(item, StylusOffset)]
    few_tips = replace(records.take(_thinned(records)), orientation=None)
    thinned = problem_of(problem.model, few_tips, offsets, problem.setup)
    described_distance, described_misfit = _misfit(thinned)
    fitted_distance = np.inf if after is None else _distance_of(after)
    described_fits = described_distance < FAR or described_misfit < UNLIKE_PART
    fits = after is not None and fitted_distance < FAR and not _is_unlike(after)
    if described_distance == np.inf or (described_fits and fits):
        return
    # Without a fit, or if geometry absorbed the mistake, the arm as described is the measure.
    by_description = fits or after is None
    as_is = described_distance if by_description else fitted_distance
    limit = (EXPLAINED_PART if by_description else 1.0) * described_misfit
    leaves_open = not one_session and (after is None or not fits or _absorbs(after))
    for tier in _tiers(thinned, after, open_numbers=leaves_open):
        explaining = {}
        for mistake in _likely(thinned, tier, limit):
            fitted = _fit_alone(mistake.undone(problem))
            if fitted is not None and _distance_of(fitted) < EXPLAINED_PART * as_is:
                explaining[mistake] = _distance_of(fitted)
        if explaining:
            fewest = min(mistake.size for mistake in explaining)
            first, *others = [mistake for mistake in explaining if mistake.size == fewest]
            also = tuple(map(str, others))
            raise MistakenFileError(records.source, str(first), as_is, explaining[first], also)


def _tiers(thinned: Problem, after: Fit | None, *, open_numbers: bool) -> Iterator[list[Mistake]]:
    """Single mistakes, then several columns, then those that leave numbers open.

    With a tip off by a length of the last row, which geometry takes up, these are no mistakes.
    """
    single = [*single_mistakes(thinned)]
    yield [mistake for mistake in single if not mistake.free_numbers]
    if open_numbers:
        yield [*several_columns(thinned)]
        wrong = None if after is None else wrong_value(after)
        single += [wrong] if wrong else []
        yield [mistake for mistake in single if mistake.free_numbers]
        left_out = [mistake for mistake in single if mistake.options]
        if len(left_out) == 2:
            frame, target = left_out
            also = (Note(target.code, target.data),)
            yield [replace(frame, also=also, size=2, options={**frame.options, **target.options})]


def _likely(problem: Problem, mistakes: list[Mistake], limit: float) -> list[Mistake]:
    """Some with the least misfits up to a ``limit``: those alike by their number of mistakes."""
    misfits = {mistake: _misfit(mistake.undone(problem))[1] for mistake in mistakes}
    least = min(misfits.values(), default=np.inf)

    def rank(mistake: Mistake) -> tuple[float, float]:
        misfit = misfits[mistake]
        return (mistake.size, 0.0) if misfit <= SIMILAR_RATIO * least else (np.inf, misfit)

    within = [mistake for mistake in mistakes if misfits[mistake] <= limit]
    return sorted(within, key=rank)[:MOST_FITTED]


def _travel(problem: Problem) -> float:
    """Spread of the tips in each coordinate [m]."""
    tips = problem.model.arm.chain.positions(problem.measurements.q)
    return float(np.sqrt(tips.var(axis=0).mean()))


def _absorbs(after: Fit) -> bool:
    """Whether geometry, and the tips by it, moved farther than any arm is off."""
    vector = after.problem.vector
    changes = np.abs(after.point.x - after.problem.start)
    squares = np.square(after.point.prediction.jacobian[:, :3, : changes.size])
    tip_motions = changes * np.sqrt(squares.sum(axis=1).mean(axis=0))
    widths = np.array([ASSEMBLED.get(parameter.unit, np.inf) for parameter in vector.parameters])
    is_far = (changes > MOST_MOTION * widths) & (tip_motions > MOST_MOTION * ASSEMBLED["m"])
    return bool((is_far & vector.geometric).any())


def _misfit(problem: Problem) -> tuple[float, float]:
    """Distance [m] of tips and targets, and its ratio to the tips' travel, with the frame and the
    targets fitted; infinite if there is none.
    """
    records = problem.measurements
    targets = observations_of(records, problem.setup)
    try:
        point = initial_point(problem, targets)
        if problem.vector.effects and not records.known.all():
            scatters = Scatters(FAR, 0.0, FIRST_SCATTER)
            noise = NoiseModel.of(problem, point.x, point.frame, scatters, targets)
            point = solve(
                problem, noise, point, np.ones(records.n), robust=True, roughly=True
            ).point
    except AacmmError:
        return np.inf, np.inf
    tips = point.prediction.tips
    distance = _distance(targets.with_normals(tips, point.seats), tips, point.seats)
    travel = float(np.median(np.linalg.norm(tips - np.median(tips, axis=0), axis=1)))
    return distance, distance / max(travel, LEAST_DIVISOR)


def _distance_of(after: Fit) -> float:
    return _distance(after.observations, after.point.prediction.tips, after.point.seats)


def _distance(observations: Observations, tips: Array, seats: Array) -> float:
    """Median distance of tips (n, 3) and targets, and mean error of the bars [m]; infinite without
    any target.
    """
    distance = _finite_median(np.linalg.norm(observations.deviations(tips, seats), axis=1))
    bars = observations.relation == OF_BAR
    ends = seats[observations.ends[bars]]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    errors = np.abs(lengths - observations.value[bars])
    return distance + float(errors.sum() / max(errors.size, 1))


def _finite_median(distances: Array) -> float:
    finite = distances[np.isfinite(distances)]
    return float(np.median(finite)) if finite.size else np.inf


def _thinned(records: Measurements) -> Index:
    rows = np.arange(records.n)
    seats = records.seats()
    if not seats:
        return rows[:: max(1, records.n // RECORDS_TO_DISTINGUISH)]
    per_seat = max(3, RECORDS_TO_DISTINGUISH // len(seats))
    return np.unique(
        np.concatenate([members[:: max(1, len(members) // per_seat)] for members in seats.values()])
    )


def deviations_of_relations(system: Linearisation) -> Array:
    """Deviation of each relation from all else, in standard deviations (b,): deletion residuals
    (Belsley, Kuh, Welsch 1980, eq. 2.27), one Gauss–Newton step away. Divided by ``(1 + H Hᵀ)^½``
    again, rows of relations that share seats are deviations.
    """
    inverse = np.linalg.inv(system.elimination.relation_factor)
    rows = slice(-len(inverse), None)
    steps = system.jacobian[rows] @ system.independent_steps
    residual = inverse.T @ (system.residual[rows] - steps @ system.solution.along)
    variance = np.diag(inverse.T @ (np.eye(len(inverse)) - steps @ steps.T) @ inverse)
    least = REDUNDANCY * np.square(inverse).sum(axis=0)
    return np.asarray(np.abs(residual) / np.sqrt(np.maximum(variance, least)))


def odd_relation(after: Fit) -> Note | None:
    """A note on the relation that all else contradicts most."""
    observations = after.observations
    if len(observations.ends) < 2:
        return None
    deviations = deviations_of_relations(after.system)
    worst = int(deviations.argmax())
    data = {"deviations": float(deviations[worst])}
    if deviations[worst] < ODD_RELATION:
        return None
    kind = observations.relation[worst]
    ends = [observations.labels[end] for end in observations.ends[worst]]
    if kind == OF_BAR:
        bars = after.problem.measurements.bars()
        bar = next(bar.bar for bar in bars if [bar.seat_a, bar.seat_b] == ends)
        return Note("bar_length_off", data | {"bar": bar})
    word = DISTANCE if kind == DISTANCE else ANGLE
    return Note("relation_off", data | {"kind": word, "planes": ends})


def require_possible_relations(problem: Problem) -> None:
    """Compare the relations of planes with a fit without them.

    Raises:
        AacmmError: one is off by far more than an arm can be.
    """
    records = problem.measurements
    stated = observations_of(records, problem.setup)
    of_planes = stated.relation != OF_BAR
    if not of_planes.any():
        return
    free = fit(problem.of(replace(records, relations=())))
    names = ("ends", "relation", "value", "value_u")
    related = replace(free.observations, **{name: getattr(stated, name) for name in names})
    noise = replace(free.noise, observations=related)
    system = Fit.at(problem, noise, free.point, free.weights).system
    # All relations may be wrong alike, by a wrong diameter of the probe.
    deviations = np.maximum(
        deviations_of_relations(system), _deviations_from_free(system, free.system)
    )
    is_tilt = np.isin(related.relation, TILTS)
    as_angles = replace(related, relation=np.where(is_tilt, ANGLE, related.relation))
    excess = as_angles.relation_residuals(free.point.seats)[0] * related.value_u
    is_distance = related.relation == DISTANCE
    gross = np.where(is_distance, GROSS_DISTANCE + GROSS_SCALE * related.value, GROSS_ANGLE)
    impossible = of_planes & (deviations >= IMPOSSIBLE) & (np.abs(excess) >= gross)
    if not impossible.any():
        return
    worst = int(np.where(impossible, deviations, 0.0).argmax())
    excess_in_words = f"angle by {excess[worst] / DEG:+.3g}°"
    if is_distance[worst]:
        excess_in_words = f"distance by {excess[worst] / MM:+.3g} mm"
    one, other = (related.labels[end] for end in related.ends[worst])
    raise AacmmError(
        f"{records.source}: the contacts of planes {one!r} and {other!r} contradict the stated "
        f"{excess_in_words} ({deviations[worst]:.0f} standard deviations); expected a value that "
        "agrees with the contacts; check the distance, the angle (0: same side, 180: opposite "
        "sides), probe_diameter_mm and the labels of the contacts"
    )


def _deviations_from_free(system: Linearisation, free: Linearisation) -> Array:
    """Innovation of each relation after a fit without any, in standard deviations (b,)."""
    factor = system.elimination.relation_factor
    rows = system.jacobian[-len(factor) :] @ free.independent_steps
    spread = np.hstack([factor, factor @ rows])
    residual = factor @ system.residual[-len(factor) :]
    return np.asarray(np.abs(residual) / np.linalg.norm(spread, axis=1))
