"""Whether records fit the arm; if not, which mistake in a file (sign, zero, column, unit, frame)
explains them.

No parameter may take up such a mistake. If the first fit, or the arm as described, leaves more than
any arm has, every mistake is undone in turn. The arm as described ranks them by the median distance
of tips and targets over the tips' travel, in which gross errors do not count, and by the mean error
of bars. A fit then has to leave no more than the noise. The simplest is named: the fewest mistakes
with the fewest free numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.candidate_mistakes import (
    OTHER_FRAME,
    Mistake,
    in_words,
    mistake_in_value,
    several_columns,
    single_mistakes,
)
from aacmm_pin.calibration.estimation import FIRST_SCATTER, fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.odd_relations import odd_relation, require_possible_relations
from aacmm_pin.calibration.parameters import ASSEMBLED, asked_again, problem_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.session_frames import another_frame
from aacmm_pin.calibration.setup import sessions_of
from aacmm_pin.calibration.solver import initial_point, solve
from aacmm_pin.calibration.wrong_columns import LEAST_DIVISOR, SIMILAR_RATIO
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import StylusOffset
from aacmm_pin.errors import AacmmError, MissingConditionError, MistakenFileError
from aacmm_pin.measurements import OF_BAR, Measurements, Observations

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
OTHER_BARS = 2.0
"""Ratio of stated lengths of bars to those by the arm that no wrong arm has."""
WITHOUT_BARS = 0.7
"""Part of the scatter that a fit without wrong bars leaves at most."""
ORIENTATION_FAR = 0.05
"""Median angle between fitted and stated orientations that no arm has [rad]."""


def first_fit(problem: Problem, *, robust: bool = True) -> Fit:
    """:func:`fit` that refuses records of another arm.

    Raises:
        MistakenFileError: undoing a mistake explains the records.
        AacmmError: the fit leaves a large part of what the tips travel, or a relation of planes is
            impossible; see :func:`fit`.
    """
    require_possible_relations(problem)
    if _has_other_bars(problem):  # a fit to these takes long
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
            f"{problem.measurements.source}: {_advice(problem)}. (With the best parameters, the "
            f"records scatter by {after.scatter / MM:.0f} mm in each coordinate. The tips of the "
            f"arm at these angles scatter by {_travel(problem) / MM:.0f} mm.)"
        )
    _require_orientations(after)
    return after


def mistakes_of(after: Fit) -> Iterator[Note]:
    """Notes on mistakes with which records can still be fitted."""
    if wrong := wrong_value(after):
        yield wrong.note
    yield from another_frame(after)


def require_bars_that_agree(after: Fit) -> None:
    """Refuse records that fit, but for the lengths of a few bars.

    Raises:
        MistakenFileError: the other bars agree, and a fit without these scatters far less.
    """
    records = after.problem.measurements
    bars = records.bar
    note_of_bar: dict[str, Note] = {}
    without = after
    while note := odd_relation(without):
        if (
            bars is None
            or "bar" not in note.data
            or 2 * len(note_of_bar) >= len(records.bars()) - 1
        ):
            return
        note_of_bar[note.data["bar"]] = note
        others = np.where(np.isin(bars, [*note_of_bar]), "", bars)
        without = fit(after.problem.of(replace(records, bar=others)))
    if note_of_bar and without.scatter <= WITHOUT_BARS * after.scatter:
        reasons = "; ".join(map(str, note_of_bar.values()))
        distances = (_distance_of(after), _distance_of(without))
        raise MistakenFileError(records.source, reasons, *distances)


def _has_other_bars(problem: Problem) -> bool:
    records = problem.measurements
    if records.bar is None:
        return False
    tips = problem.model.arm.chain.positions(records.q)
    stated = np.array([bar.length for bar in records.bars()])
    by_arm = stated + records.bar_length_errors(tips)
    return bool((np.maximum(by_arm / stated, stated / by_arm) > OTHER_BARS).any())


def _is_unlike(after: Fit) -> bool:
    return after.scatter > max(FAR, UNLIKE_PART * _travel(after.problem))


def _advice(problem: Problem) -> Note:
    readings = problem.measurements.readings
    still = np.flatnonzero(np.ptp(readings, axis=0) == 0.0)
    if still.size:
        return Note("unlike_arm_one_reading", {"joints": (still + 1).tolist()})
    for j, k in combinations(range(readings.shape[1]), 2):
        if np.array_equal(readings[:, j], readings[:, k]):
            return Note("unlike_arm_copy", {"joints": [j + 1, k + 1]})
    sessions = _problems_by_session(problem)
    if len(sessions) > 1 and all(_fit_alone(OTHER_FRAME.undone(part)) for part in sessions):
        return Note("sessions_unlike")
    return Note("unlike_arm")


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


def _require_orientations(after: Fit) -> None:
    problem = after.problem
    point = after.point
    rows = after.used & after.observations.oriented
    stated = problem.measurements.orientation
    if stated is None or not rows.any():
        return
    median_angle = np.median(after.turns[rows])
    if median_angle < ORIENTATION_FAR:
        return
    reason = Note("orientation_unlike")
    for mistake, correct in (
        ("orientation_scalar_last", stated[:, [3, 0, 1, 2]]),
        ("orientation_inverse", stated * [1, -1, -1, -1]),
    ):
        corrected = problem.of(replace(problem.measurements, orientation=correct))
        poses = corrected.poses(point.x, corrected.with_targets(point.x, point.frame))
        if np.median(np.linalg.norm(poses[rows, 3:], axis=1)) < ORIENTATION_FAR:
            reason = Note(mistake)
    raise AacmmError(
        f"{problem.measurements.source}: the orientations do not fit this arm (median error "
        f"{median_angle / DEG:.3g}°): {reason}"
    )


def _require_no_mistake(problem: Problem, after: Fit | None, *, one_session: bool = False) -> None:
    """Refuse records that a mistake explains, of which ``after`` is the fit, if they have one.

    The frame of one session may be another without a mistake, as of a stand that was moved.
    """
    if problem.setup.frame_of_session:
        problem = _of_first_session(problem)
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES:
        return
    thinned = _as_described(problem.of(records.take(_thinned(records))))
    targets = observations_of(thinned.measurements, thinned.setup)
    described_distance, described_misfit = _misfit(thinned, targets)
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
        misfits = {}
        for mistakes in tier:
            undone = _undone(thinned, mistakes)
            of_undone = targets
            if any(mistake.changes_targets for mistake in mistakes):
                of_undone = observations_of(undone.measurements, undone.setup)
            misfits[mistakes] = _misfit(undone, of_undone)[1]
        explaining = {}
        for mistakes in _likely(misfits, limit):
            fitted = _fit_alone(_undone(problem, mistakes))
            if fitted is not None and _distance_of(fitted) < EXPLAINED_PART * as_is:
                explaining[mistakes] = _distance_of(fitted)
        if explaining:
            fewest = min(map(len, explaining))
            first, *others = [mistakes for mistakes in explaining if len(mistakes) == fewest]
            also = tuple(map(in_words, others))
            raise MistakenFileError(records.source, in_words(first), as_is, explaining[first], also)


def _tiers(
    thinned: Problem, after: Fit | None, *, open_numbers: bool
) -> Iterator[list[tuple[Mistake, ...]]]:
    """Sets of mistakes: single ones, then several columns, then those that leave numbers open.

    With a tip off by a length of the last row, which geometry takes up, these are no mistakes.
    """
    single = [*single_mistakes(thinned)]
    yield [(mistake,) for mistake in single if not mistake.free_numbers]
    if open_numbers:
        yield [*several_columns(thinned)]
        with_value = [] if after is None else [*mistake_in_value(after)]
        yield [(one,) for one in (*single, *with_value) if one.free_numbers]
        yield [tuple(one for one in single if one.options)]


def _likely(
    misfits: Mapping[tuple[Mistake, ...], float], limit: float
) -> list[tuple[Mistake, ...]]:
    """Some of the least misfits up to a ``limit``: those alike by their number of mistakes."""
    least = min(misfits.values(), default=np.inf)

    def rank(mistakes: tuple[Mistake, ...]) -> tuple[float, float]:
        misfit = misfits[mistakes]
        return (len(mistakes), 0.0) if misfit <= SIMILAR_RATIO * least else (np.inf, misfit)

    within = [mistakes for mistakes, misfit in misfits.items() if misfit <= limit]
    return sorted(within, key=rank)[:MOST_FITTED]


def _undone(problem: Problem, mistakes: Sequence[Mistake]) -> Problem:
    for mistake in mistakes:
        problem = mistake.undone(problem)
    return problem


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


def _as_described(problem: Problem) -> Problem:
    """With frame and targets unknown, and the geometry as described."""
    offsets = [item for item in problem.asked if item == "tool" or isinstance(item, StylusOffset)]
    records = replace(problem.measurements, orientation=None)
    return problem_of(problem.model, records, offsets, problem.setup)


def _misfit(problem: Problem, targets: Observations) -> tuple[float, float]:
    """Distance [m] of tips and targets, and its ratio to the tips' travel, with the frame and the
    targets fitted; infinite if there is none.
    """
    records = problem.measurements
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


def _of_first_session(problem: Problem) -> Problem:
    records = problem.measurements
    session = records.conditions.require("session", "reference frame")
    first = problem.of(records.take(session == sessions_of(records)[0]))
    setup = replace(problem.setup, reference_frame="external")
    return asked_again(first, problem.model, setup)


def _thinned(records: Measurements) -> Index:
    rows = np.arange(records.n)
    seats = records.seats()
    if not seats:
        return rows[:: max(1, records.n // RECORDS_TO_DISTINGUISH)]
    per_seat = max(3, RECORDS_TO_DISTINGUISH // len(seats))
    return np.unique(
        np.concatenate([members[:: max(1, len(members) // per_seat)] for members in seats.values()])
    )
