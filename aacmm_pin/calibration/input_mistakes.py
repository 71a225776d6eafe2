"""Whether records fit the arm; if not, which mistake in a file (sign, zero, column, unit, frame)
explains them.

No parameter may take up such a mistake. If the first fit, or the arm as described, leaves more than
any arm has, every mistake is undone in turn. The arm as described ranks them by the median distance
of tips and targets over the tips' travel, in which gross errors do not count. A fit then has to
leave no more than the noise. The simplest is named: the fewest mistakes with the fewest free
numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.candidate_mistakes import (
    OTHER_FRAME,
    Mistake,
    in_words,
    mistakes_by_records,
    several_columns,
    single_mistakes,
)
from aacmm_pin.calibration.estimation import FIRST_SCATTER, fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.odd_relations import require_possible_relations
from aacmm_pin.calibration.parameter_vector import DH_KIND_OF_EFFECT
from aacmm_pin.calibration.parameters import ASSEMBLED, asked_again, problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.session_frames import another_frame
from aacmm_pin.calibration.setup import sessions_of
from aacmm_pin.calibration.solver import FEWEST_PLACED, initial_point, solve
from aacmm_pin.calibration.wrong_columns import SIMILAR_RATIO
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import JointPlacement, JointZeroOffset, LinkTilt, StylusOffset
from aacmm_pin.errors import AacmmError, MissingConditionError, MistakenFileError
from aacmm_pin.measurements import OF_BAR, Measurements, Observations

FAR = 2e-3
"""Scatter, or median distance after a fit, that no arm has [m]."""
UNLIKE = 0.03
"""Scatter over the tips' travel beyond which records are not of this arm."""
MOVED = 5.0
"""Geometry that moves so many times :data:`ASSEMBLED`, and the tips as much as such a length, has
taken up a mistake; a zero that hardly moves the tip may be anything.
"""
EXPLAINS = 0.2
"""Part of the median distance below which undoing a mistake explains it."""
TRIED = 3
FITTED = 8
"""Of those alike; more than four are rare."""
MOST_GROSS = 0.15
FEWEST_FOR_MISTAKES = 10
"""With fewer records some mistake fits anything."""
RECORDS_TO_DISTINGUISH = 80
FEWEST_ROWS = 6
MOST_OF_ROWS = 0.8
"""Least part of the rows that are excluded, or that fit."""
SHIFTED_REMAINS = 0.1
"""Part of the distance that may remain with another row's coordinates."""
ORIENTATION_FAR = 0.05
"""Median angle between fitted and stated orientations that no arm has [rad]."""


GEOMETRIC_EFFECTS = {JointPlacement, *DH_KIND_OF_EFFECT}
_Touches = tuple[Problem, Observations]


def first_fit(problem: Problem, *, robust: bool = True) -> Fit:
    """:func:`fit` that refuses records of another arm.

    Raises:
        MistakenFileError: undoing a mistake explains the records.
        AacmmError: the fit leaves a large part of what the tips travel, or a relation of planes is
            impossible; see :func:`fit`.
    """
    require_possible_relations(problem)
    try:
        after = fit(problem, robust=robust)
    except MissingConditionError:  # which no mistake in the columns explains
        raise
    except AacmmError:
        _require_no_mistake_in_a_session(problem)
        _require_no_mistake(problem, np.inf, thorough=True, options=True)
        raise
    distances = pd.Series(np.linalg.norm(after.system.deviation, axis=1))
    session = problem.measurements.conditions.session
    if session is not None and (distances.groupby(session).median() >= FAR).any():
        _require_no_mistake_in_a_session(problem)
    travel = _travel(problem)
    unlike = after.scatter > max(FAR, UNLIKE * travel)
    fitted = _median(after.system.deviation)
    if fitted >= FAR:
        _require_rows_together(problem, fitted)
    if unlike or problem.measurements.bars() or max(fitted, _as_described(after)) >= FAR:
        absorbs = _absorbs(after)
        geometry = {type(effect) for effect in problem.vector.effects} & GEOMETRIC_EFFECTS
        zeros_alone = geometry <= {JointZeroOffset}  # which may have any value
        _require_no_mistake(
            problem,
            fitted,
            thorough=unlike or (absorbs and not zeros_alone),
            options=fitted >= FAR or absorbs,
            after=after,
        )
    if unlike:
        advice = _advice(problem)
        raise AacmmError(
            f"{problem.measurements.source}: {advice}. (With the best parameters, the records "
            f"scatter by {after.scatter / MM:.0f} mm in each coordinate. The tips of the arm at "
            f"these angles scatter by {travel / MM:.0f} mm.)"
        )
    _require_orientations(after)
    return after


def _advice(problem: Problem) -> Note:
    readings = problem.measurements.readings
    still = np.flatnonzero(np.ptp(readings, axis=0) == 0.0)
    if still.size:
        return Note("unlike_arm_one_reading", {"joints": (still + 1).tolist()})
    for j, k in combinations(range(readings.shape[1]), 2):
        if np.array_equal(readings[:, j], readings[:, k]):
            return Note("unlike_arm_copy", {"joints": [j + 1, k + 1]})
    sessions = _by_session(problem)
    if _each_fits(sessions or _ends(problem)):
        return Note("sessions_unlike" if sessions else "ends_fit_alone")
    return Note("unlike_arm")


def mistakes_of(after: Fit) -> Iterator[Note]:
    """Notes on mistakes with which records can still be fitted."""
    if after.excluded.sum() >= FEWEST_ROWS:
        yield from _frozen_readings(after)
        yield from _shifted_rows(after)
    if wrong := wrong_value(after):
        yield wrong.note
    yield from another_frame(after)


def _frozen_readings(after: Fit) -> Iterator[Note]:
    """The longest run of one reading of a joint, if others move and most rows are excluded."""
    records = after.problem.measurements
    for joint, readings in enumerate(records.readings.T):
        run = np.cumsum(np.append(True, np.diff(readings) != 0.0))
        rows = np.flatnonzero(run == np.bincount(run).argmax())
        moves = np.ptp(records.readings[rows], axis=0).any()
        # The first of them may be right.
        frozen = after.excluded[rows[1:]]
        if rows.size > FEWEST_ROWS and moves and frozen.mean() > MOST_OF_ROWS:
            yield Note("reading_frozen", {"joint": joint + 1, "rows": records.row[rows].tolist()})


def _shifted_rows(after: Fit) -> Iterator[Note]:
    records = after.problem.measurements
    tips = after.point.prediction.tips
    out = np.flatnonzero(after.excluded & records.known)
    for where, step in (("before", 1), ("after", -1)):
        inside = out[(out + step >= 0) & (out + step < records.n)]
        if inside.size < FEWEST_ROWS:
            continue
        stated, shifted = (
            np.linalg.norm(tips[inside] - records.reference[rows], axis=1)
            for rows in (inside, inside + step)
        )
        if np.mean(shifted < SHIFTED_REMAINS * stated) > MOST_OF_ROWS:
            data = {"rows": records.row[inside].tolist(), "where": where}
            yield Note("some_rows_shifted", data)


def _by_session(problem: Problem) -> list[Problem]:
    records = problem.measurements
    labels = records.conditions.session
    alone = []
    for session in () if labels is None else np.unique(labels):
        of_session = records.take(labels == session)
        if of_session.placed.any() or not problem.setup.frame_of_session:
            source = f"{records.source}: session {session}"
            alone.append(problem.of(replace(of_session, source=source)))
    return alone


def _ends(problem: Problem) -> list[Problem]:
    """The first and last thirds; none of few records."""
    records = problem.measurements
    third = records.n // 3
    if third < FEWEST_FOR_MISTAKES:
        return []
    rows = np.arange(records.n)
    return [problem.of(records.take(end)) for end in (rows[:third], rows[-third:])]


def _each_fits(parts: Sequence[Problem]) -> bool:
    try:
        fits = [fit(OTHER_FRAME.undone(part)) for part in parts]
    except AacmmError:
        return False
    return len(fits) > 1 and all(after.scatter < FAR for after in fits)


def _require_no_mistake_in_a_session(problem: Problem) -> None:
    """Refuse a session whose columns have a mistake, if others fit the arm."""
    distances = {}
    for alone in _by_session(problem):
        try:
            after = fit(alone)
        except AacmmError:
            distances[alone] = np.inf
        else:
            distances[alone] = max(_median(after.system.deviation), _as_described(after))
    if min(distances.values(), default=np.inf) < FAR:
        for alone, distance in distances.items():
            if distance >= FAR:
                _require_no_mistake(alone, distance, thorough=False, options=False)


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
    for mistake, other in (
        ("orientation_scalar_last", stated[:, [3, 0, 1, 2]]),
        ("orientation_inverse", stated * [1, -1, -1, -1]),
    ):
        changed = problem.of(replace(problem.measurements, orientation=other))
        poses = changed.poses(point.x, changed.with_targets(point.x, point.frame))
        if np.median(np.linalg.norm(poses[rows, 3:], axis=1)) < ORIENTATION_FAR:
            reason = Note(mistake)
    raise AacmmError(
        f"{problem.measurements.source}: the orientations do not fit this arm (median error "
        f"{median_angle / DEG:.3g}°): {reason}"
    )


def _require_no_mistake(
    problem: Problem, fitted: float, *, thorough: bool, options: bool, after: Fit | None = None
) -> None:
    """Refuse records that one mistake explains.

    Args:
        fitted: median distance after a fit, infinite without one [m].
        thorough: try several signs and zeros.
        options: try options that were left out. Geometry may take up what they leave open: a tip
            off by a length of the last row is no mistake.
        after: a fit, for one wrong value of the arm.
    """
    if problem.setup.frame_of_session:
        problem = _of_first_session(problem)
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES:
        return
    thinned = problem.of(records.take(_thinned(records)))
    misfit = _misfits(thinned)
    described_distance, described_misfit = misfit()
    described_fits = described_distance < FAR or described_misfit < UNLIKE
    if described_distance == np.inf or (described_fits and fitted < FAR):
        return
    taken_up = fitted < FAR or fitted == np.inf
    as_is = described_distance if taken_up else fitted
    limit = (EXPLAINS if taken_up else 1.0) * described_misfit
    single = [mistake for mistake in single_mistakes(problem) if options or not mistake.free]
    left_out = [mistake for mistake in single if mistake.free]
    chosen = [*mistakes_by_records(thinned, after)] if options else []
    tiers: list[list[tuple[Mistake, ...]]] = [
        [(mistake,) for mistake in single if not mistake.free],
        several_columns(thinned) if thorough else [],
        [(mistake,) for mistake in (*left_out, *chosen)],
        [tuple(left_out)] if len(left_out) == 2 else [],
    ]
    for tier in tiers:
        misfits = {mistakes: misfit(*mistakes)[1] for mistakes in tier}
        for together in _likely(misfits, limit):
            distances = {}
            for mistakes in together:
                without = _fit_without(_undone(problem, mistakes), as_is)
                if without is not None:
                    distances[mistakes] = _median(without.system.deviation)
            if distances:
                raise _named(records.source, distances, as_is)


def _likely(
    misfits: Mapping[tuple[Mistake, ...], float], limit: float
) -> Iterator[list[tuple[Mistake, ...]]]:
    """The least misfits up to a ``limit``: those alike together, simplest first, then a few."""
    nearest = sorted((one for one in misfits if misfits[one] <= limit), key=misfits.__getitem__)
    if not nearest:
        return
    most = SIMILAR_RATIO * misfits[nearest[0]]
    alike = [one for one in misfits if misfits[one] <= min(most, limit)]
    alike.sort(key=lambda mistakes: (len(mistakes), sum(one.free for one in mistakes)))
    yield alike[:FITTED]
    for mistakes in nearest[len(alike) : TRIED]:
        yield [mistakes]


def _named(
    source: str, distances: Mapping[tuple[Mistake, ...], float], as_is: float
) -> MistakenFileError:
    most = SIMILAR_RATIO * min(distances.values())
    named = [mistakes for mistakes, distance in distances.items() if distance <= most]
    fewest = [
        mistakes for mistakes in named if not any(set(fewer) < set(mistakes) for fewer in named)
    ]
    first, *others = map(in_words, fewest)
    return MistakenFileError(source, first, as_is, distances[fewest[0]], tuple(others))


def _require_rows_together(problem: Problem, as_is: float) -> None:
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES or not records.placed.all():
        return
    for where, step in (("before", 1), ("after", -1)):
        rows = np.arange(max(-step, 0), records.n - max(step, 0))
        touched = records.take(rows + step)
        shifted = records.take(rows)
        shifted = replace(shifted, reference=touched.reference, reference_u=touched.reference_u)
        after = _fit_without(problem.of(shifted), as_is)
        if after is None:
            continue
        name = Note("rows_shifted", {"where": where})
        if after.excluded.mean() > MOST_GROSS:
            fitting = shifted.row[~after.excluded].tolist()
            name = Note("some_rows_shifted", {"rows": fitting, "where": where})
        distance = _median(after.system.deviation)
        raise MistakenFileError(records.source, str(name), as_is, distance)


def _fit_without(without: Problem, as_is: float) -> Fit | None:
    """None unless its median distance is far below ``as_is`` [m], and no more than noise."""
    try:
        after = fit(without)
    except (AacmmError, np.linalg.LinAlgError):  # a hypothesis that is far off has no fit
        return None
    limit = min(EXPLAINS * as_is, UNLIKE * _travel(after.problem))
    explained = after.scatter < FAR and _median(after.system.deviation) < limit
    return after if explained and not _absorbs(after) else None


def _undone(problem: Problem, mistakes: Sequence[Mistake]) -> Problem:
    for mistake in mistakes:
        problem = mistake.undone(problem)
    return problem


def _travel(problem: Problem) -> float:
    """Spread of the tips in each coordinate [m]."""
    tips = problem.model.arm.chain.positions(problem.measurements.q)
    return float(np.sqrt(tips.var(axis=0).mean()))


def _absorbs(after: Fit) -> bool:
    """Whether the fit moved geometry, and the tips, farther than any arm is off."""
    point = after.point
    changes = np.abs(point.x - after.problem.start)
    squares = np.square(point.prediction.jacobian[:, :3, : changes.size])
    tips = changes * np.sqrt(squares.sum(axis=1).mean(axis=0))
    for effect, entries in after.problem.vector:
        if isinstance(effect, (JointPlacement, LinkTilt, *DH_KIND_OF_EFFECT)):
            most = MOVED * np.array([ASSEMBLED[term.unit] for term in effect.terms])
            if ((changes[entries] > most) & (tips[entries] > MOVED * ASSEMBLED["m"])).any():
                return True
    return False


def _as_described(after: Fit) -> float:
    """By the arm as described, with the fitted frame and seats, to first order [m]."""
    x = after.point.x - after.problem.start
    jacobian = after.point.prediction.jacobian[:, :3, : x.size]
    return _median(after.system.deviation - jacobian @ x)


def _median(deviation: Array) -> float:
    """Of the records with a target [m]; infinite without any."""
    return _median_distance(np.linalg.norm(deviation, axis=1))


def _median_distance(distance: Array) -> float:
    distance = distance[np.isfinite(distance)]
    return float(np.median(distance)) if distance.size else np.inf


def _misfits(problem: Problem) -> Callable[..., tuple[float, float]]:
    """A function of some mistakes: the median distance [m] of tips and targets without them, and
    over the tips' travel; infinite if there is none. By the arm as described, with frame and
    targets unknown.
    """
    of_targets = [
        item for item in problem.asked if item == "tool" or isinstance(item, StylusOffset)
    ]
    records = replace(problem.measurements, orientation=None)
    bare = problem_of(problem.model, records, of_targets, problem.setup)

    @cache
    def tips_of(*mistakes: Mistake) -> tuple[Problem, Array]:
        undone = _undone(bare, mistakes)
        return undone, undone.poses(undone.start, Frame.identity())

    @cache
    def touches_of(*mistakes: Mistake) -> _Touches:
        undone = _undone(bare, mistakes)
        return undone, observations_of(undone.measurements, undone.setup)

    def without(*mistakes: Mistake) -> tuple[float, float]:
        of_tips = [mistake for mistake in mistakes if mistake.changes_tips]
        of_touches = [mistake for mistake in mistakes if not mistake.changes_tips]
        try:
            touches = touches_of(*of_touches)
            tips, points = _fitted_tips(*tips_of(*of_tips), touches)
        except AacmmError:
            return np.inf, np.inf
        median = _median_distance(_distances(tips, points, touches[1]))
        travel = float(np.median(np.linalg.norm(tips - np.median(tips, axis=0), axis=1)))
        return median, median / max(travel, 1e-9)

    return without


def _distances(tips: Array, points: Array, observations: Observations) -> Array:
    """Of tips and targets (n,) [m], with half of a bar's error at each of its ends."""
    deviations = observations.with_normals(tips, points).deviations(tips, points)
    bars = observations.relation == OF_BAR
    ends = observations.ends[bars]
    lengths = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    of_seats = np.zeros(len(points) + 1)  # the last is of no seat
    np.add.at(of_seats, ends.T, np.abs(lengths - observations.value[bars]) / 2)
    return np.asarray(np.linalg.norm(deviations, axis=1) + of_seats[observations.seat])


def _fitted_tips(bare: Problem, tips: Array, touches: _Touches) -> tuple[Array, Array]:
    """Tips (n, 3) and seats (s, 3) in the frame of the references, with that and unknown targets
    fitted [m].
    """
    touched, observations = touches
    records, setup = touched.measurements, touched.setup
    stating = records.known
    if setup.external and stating.sum() < FEWEST_PLACED:
        raise AacmmError(f"{records.source}: too few coordinates for a frame")
    if not bare.vector.effects:
        if setup.external:
            tips = registered(tips[stating], records.reference[stating]).apply(tips)
        return tips, observations.start(tips)
    changed = replace(records, q=bare.measurements.q)
    problem = replace(bare, measurements=changed, setup=setup)
    point = initial_point(problem, observations)
    if not stating.all():
        scatters = Scatters(FAR, 0.0, FIRST_SCATTER)
        noise = NoiseModel.of(problem, point.x, point.frame, scatters, observations)
        point = solve(problem, noise, point, np.ones(records.n), robust=True, roughly=True).point
    return point.prediction.tips, point.seats


def _of_first_session(problem: Problem) -> Problem:
    records = problem.measurements
    session = records.conditions.require("session", "reference frame")
    alone = problem.of(records.take(session == sessions_of(records)[0]))
    setup = replace(problem.setup, reference_frame="external")
    return asked_again(alone, problem.model, setup)


def _thinned(records: Measurements) -> Index:
    """Some of every seat."""
    rows = np.arange(records.n)
    seats = records.seats()
    if not seats:
        return rows[:: max(1, records.n // RECORDS_TO_DISTINGUISH)]
    per_seat = max(3, RECORDS_TO_DISTINGUISH // len(seats))
    return np.unique(
        np.concatenate([members[:: max(1, len(members) // per_seat)] for members in seats.values()])
    )
