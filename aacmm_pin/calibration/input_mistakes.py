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
UNLIKE_PART = 0.03
"""Scatter over the tips' travel beyond which records are not of this arm."""
MOST_MOTION = 5.0
"""Geometry that moves so many times :data:`ASSEMBLED`, and the tips as much as such a length, has
taken up a mistake; a zero that hardly moves the tip may be anything.
"""
EXPLAINED_PART = 0.2
"""Part of the median distance below which undoing a mistake explains it."""
MOST_TRIED = 3
MOST_FITTED = 8
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
_Targets = tuple[Problem, Observations]
"""Records without mistakes in their targets, and their observations."""


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
    unlike = after.scatter > max(FAR, UNLIKE_PART * travel)
    fitted_distance = _median_distance(after.system.deviation)
    if fitted_distance >= FAR:
        _require_unshifted_rows(problem, fitted_distance)
    described_distance = _distance_as_described(after)
    if unlike or problem.measurements.bars() or max(fitted_distance, described_distance) >= FAR:
        absorbs = _absorbs(after)
        geometry = {type(effect) for effect in problem.vector.effects} & GEOMETRIC_EFFECTS
        zeros_alone = geometry <= {JointZeroOffset}  # which may have any value
        _require_no_mistake(
            problem,
            fitted_distance,
            thorough=unlike or (absorbs and not zeros_alone),
            options=fitted_distance >= FAR or absorbs,
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
    sessions = _problems_by_session(problem)
    if _each_fits_alone(sessions or _first_and_last_third(problem)):
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
        run_of_row = np.cumsum(np.append(True, np.diff(readings) != 0.0))
        rows = np.flatnonzero(run_of_row == np.bincount(run_of_row).argmax())
        others_move = np.ptp(records.readings[rows], axis=0).any()
        # The first of them may be right.
        is_excluded = after.excluded[rows[1:]]
        if rows.size > FEWEST_ROWS and others_move and is_excluded.mean() > MOST_OF_ROWS:
            yield Note("reading_frozen", {"joint": joint + 1, "rows": records.row[rows].tolist()})


def _shifted_rows(after: Fit) -> Iterator[Note]:
    records = after.problem.measurements
    tips = after.point.prediction.tips
    excluded = np.flatnonzero(after.excluded & records.known)
    for where, step in (("before", 1), ("after", -1)):
        rows = excluded[(excluded + step >= 0) & (excluded + step < records.n)]
        if rows.size < FEWEST_ROWS:
            continue
        as_stated = np.linalg.norm(tips[rows] - records.reference[rows], axis=1)
        as_shifted = np.linalg.norm(tips[rows] - records.reference[rows + step], axis=1)
        if np.mean(as_shifted < SHIFTED_REMAINS * as_stated) > MOST_OF_ROWS:
            data = {"rows": records.row[rows].tolist(), "where": where}
            yield Note("some_rows_shifted", data)


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


def _first_and_last_third(problem: Problem) -> list[Problem]:
    records = problem.measurements
    third = records.n // 3
    if third < FEWEST_FOR_MISTAKES:
        return []
    rows = np.arange(records.n)
    return [problem.of(records.take(part)) for part in (rows[:third], rows[-third:])]


def _each_fits_alone(parts: Sequence[Problem]) -> bool:
    try:
        fits = [fit(OTHER_FRAME.undone(part)) for part in parts]
    except AacmmError:
        return False
    return len(fits) > 1 and all(after.scatter < FAR for after in fits)


def _require_no_mistake_in_a_session(problem: Problem) -> None:
    distances = {}
    for of_session in _problems_by_session(problem):
        try:
            after = fit(of_session)
        except AacmmError:
            distances[of_session] = np.inf
        else:
            distance = _median_distance(after.system.deviation)
            distances[of_session] = max(distance, _distance_as_described(after))
    if min(distances.values(), default=np.inf) < FAR:
        for of_session, distance in distances.items():
            if distance >= FAR:
                _require_no_mistake(of_session, distance, thorough=False, options=False)


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


def _require_no_mistake(
    problem: Problem,
    fitted_distance: float,
    *,
    thorough: bool,
    options: bool,
    after: Fit | None = None,
) -> None:
    """Refuse records that one mistake explains.

    Args:
        fitted_distance: median distance after a fit, infinite without one [m].
        thorough: try several signs and zeros together.
        options: try options that were left out. Geometry may absorb what they leave open: a tip off
            by a length of the last row is no mistake.
        after: a fit, for one wrong value of the arm.
    """
    if problem.setup.frame_of_session:
        problem = _of_first_session(problem)
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES:
        return
    thinned = problem.of(records.take(_thinned(records)))
    misfit = _misfit_function(thinned)
    described_distance, described_misfit = misfit()
    described_fits = described_distance < FAR or described_misfit < UNLIKE_PART
    if described_distance == np.inf or (described_fits and fitted_distance < FAR):
        return
    # Without a fit, or if geometry absorbed the mistake, the arm as described is the measure.
    by_description = fitted_distance < FAR or fitted_distance == np.inf
    as_is = described_distance if by_description else fitted_distance
    limit = (EXPLAINED_PART if by_description else 1.0) * described_misfit
    single = [*single_mistakes(problem)]
    of_options = [mistake for mistake in single if options and mistake.free_numbers]
    with_value = [*mistakes_by_records(thinned, after)] if options else []
    tiers: list[list[tuple[Mistake, ...]]] = [
        [(mistake,) for mistake in single if not mistake.free_numbers],
        several_columns(thinned) if thorough else [],
        [(mistake,) for mistake in (*of_options, *with_value)],
        [tuple(of_options)] if len(of_options) == 2 else [],
    ]
    for tier in tiers:
        misfits = {mistakes: misfit(*mistakes)[1] for mistakes in tier}
        for group in _likely_groups(misfits, limit):
            distances = {}
            for mistakes in group:
                explaining = _explaining_fit(_undone(problem, mistakes), as_is)
                if explaining is not None:
                    distances[mistakes] = _median_distance(explaining.system.deviation)
            if distances:
                raise _mistaken_file_error(records.source, distances, as_is)


def _likely_groups(
    misfits: Mapping[tuple[Mistake, ...], float], limit: float
) -> Iterator[list[tuple[Mistake, ...]]]:
    """The least misfits up to a ``limit``: those alike, simplest first, then a few one by one."""
    within = [mistakes for mistakes, misfit in misfits.items() if misfit <= limit]
    nearest = sorted(within, key=misfits.__getitem__)
    if not nearest:
        return
    most = SIMILAR_RATIO * misfits[nearest[0]]
    alike = [mistakes for mistakes in within if misfits[mistakes] <= most]
    alike.sort(
        key=lambda mistakes: (len(mistakes), sum(mistake.free_numbers for mistake in mistakes))
    )
    yield alike[:MOST_FITTED]
    for mistakes in nearest[len(alike) : MOST_TRIED]:
        yield [mistakes]


def _mistaken_file_error(
    source: str, distances: Mapping[tuple[Mistake, ...], float], as_is: float
) -> MistakenFileError:
    most = SIMILAR_RATIO * min(distances.values())
    alike = [mistakes for mistakes, distance in distances.items() if distance <= most]
    fewest = [
        mistakes for mistakes in alike if not any(set(fewer) < set(mistakes) for fewer in alike)
    ]
    first, *others = map(in_words, fewest)
    return MistakenFileError(source, first, as_is, distances[fewest[0]], tuple(others))


def _require_unshifted_rows(problem: Problem, as_is: float) -> None:
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES or not records.placed.all():
        return
    for where, step in (("before", 1), ("after", -1)):
        rows = np.arange(max(-step, 0), records.n - max(step, 0))
        neighbours = records.take(rows + step)
        shifted = replace(
            records.take(rows),
            reference=neighbours.reference,
            reference_u=neighbours.reference_u,
        )
        after = _explaining_fit(problem.of(shifted), as_is)
        if after is None:
            continue
        name = Note("rows_shifted", {"where": where})
        if after.excluded.mean() > MOST_GROSS:
            fitting = shifted.row[~after.excluded].tolist()
            name = Note("some_rows_shifted", {"rows": fitting, "where": where})
        distance = _median_distance(after.system.deviation)
        raise MistakenFileError(records.source, str(name), as_is, distance)


def _explaining_fit(corrected: Problem, as_is: float) -> Fit | None:
    """None unless its median distance is far below ``as_is`` [m], and no more than noise."""
    try:
        after = fit(corrected)
    except (AacmmError, np.linalg.LinAlgError):  # a hypothesis that is far off has no fit
        return None
    limit = min(EXPLAINED_PART * as_is, UNLIKE_PART * _travel(after.problem))
    explained = after.scatter < FAR and _median_distance(after.system.deviation) < limit
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
    """Whether geometry, and the tips by it, moved farther than any arm is off."""
    point = after.point
    changes = np.abs(point.x - after.problem.start)
    squares = np.square(point.prediction.jacobian[:, :3, : changes.size])
    tip_motions = changes * np.sqrt(squares.sum(axis=1).mean(axis=0))
    moves_tips = tip_motions > MOST_MOTION * ASSEMBLED["m"]
    for effect, entries in after.problem.vector:
        if isinstance(effect, (JointPlacement, LinkTilt, *DH_KIND_OF_EFFECT)):
            most = MOST_MOTION * np.array([ASSEMBLED[term.unit] for term in effect.terms])
            if ((changes[entries] > most) & moves_tips[entries]).any():
                return True
    return False


def _distance_as_described(after: Fit) -> float:
    """By the arm as described, but the fitted frame and seats, to first order [m]."""
    x = after.point.x - after.problem.start
    jacobian = after.point.prediction.jacobian[:, :3, : x.size]
    return _median_distance(after.system.deviation - jacobian @ x)


def _median_distance(deviations: Array) -> float:
    """By deviations (n, 3) [m]; infinite without any target."""
    return _finite_median(np.linalg.norm(deviations, axis=1))


def _finite_median(distances: Array) -> float:
    finite = distances[np.isfinite(distances)]
    return float(np.median(finite)) if finite.size else np.inf


def _misfit_function(problem: Problem) -> Callable[..., tuple[float, float]]:
    """A function of mistakes: the median distance [m] of tips and targets without them, and its
    ratio to the tips' travel; infinite if there is none. By the arm as described, with frame and
    targets unknown.
    """
    offsets = [item for item in problem.asked if item == "tool" or isinstance(item, StylusOffset)]
    records = replace(problem.measurements, orientation=None)
    as_described = problem_of(problem.model, records, offsets, problem.setup)

    @cache
    def tips_of(*mistakes: Mistake) -> tuple[Problem, Array]:
        undone = _undone(as_described, mistakes)
        return undone, undone.poses(undone.start, Frame.identity())

    @cache
    def targets_of(*mistakes: Mistake) -> _Targets:
        undone = _undone(as_described, mistakes)
        return undone, observations_of(undone.measurements, undone.setup)

    def misfit(*mistakes: Mistake) -> tuple[float, float]:
        in_tips = [mistake for mistake in mistakes if mistake.changes_tips]
        in_targets = [mistake for mistake in mistakes if not mistake.changes_tips]
        try:
            targets = targets_of(*in_targets)
            tips, seats = _fitted_tips(*tips_of(*in_tips), targets)
        except AacmmError:
            return np.inf, np.inf
        median = _finite_median(_distances(tips, seats, targets[1]))
        travel = float(np.median(np.linalg.norm(tips - np.median(tips, axis=0), axis=1)))
        return median, median / max(travel, 1e-9)

    return misfit


def _distances(tips: Array, seats: Array, observations: Observations) -> Array:
    """Of tips (n, 3) and targets (n,) [m], with half of a bar's error at each of its seats."""
    deviations = observations.with_normals(tips, seats).deviations(tips, seats)
    bars = observations.relation == OF_BAR
    ends = observations.ends[bars]
    lengths = np.linalg.norm(seats[ends[:, 0]] - seats[ends[:, 1]], axis=1)
    bar_errors = np.zeros(len(seats) + 1)  # the last for records without seat
    np.add.at(bar_errors, ends.T, np.abs(lengths - observations.value[bars]) / 2)
    return np.asarray(np.linalg.norm(deviations, axis=1) + bar_errors[observations.seat])


def _fitted_tips(arm_problem: Problem, tips: Array, targets: _Targets) -> tuple[Array, Array]:
    """Tips (n, 3) and seats (s, 3) in the frame of the references, with that and unknown targets
    fitted [m].
    """
    target_problem, observations = targets
    records, setup = target_problem.measurements, target_problem.setup
    placed = records.known
    if setup.external and placed.sum() < FEWEST_PLACED:
        raise AacmmError(f"{records.source}: too few coordinates for a frame")
    if not arm_problem.vector.effects:
        if setup.external:
            tips = registered(tips[placed], records.reference[placed]).apply(tips)
        return tips, observations.first_seats(tips)
    combined = replace(records, q=arm_problem.measurements.q)
    problem = replace(arm_problem, measurements=combined, setup=setup)
    point = initial_point(problem, observations)
    if not placed.all():
        scatters = Scatters(FAR, 0.0, FIRST_SCATTER)
        noise = NoiseModel.of(problem, point.x, point.frame, scatters, observations)
        point = solve(problem, noise, point, np.ones(records.n), robust=True, roughly=True).point
    return point.prediction.tips, point.seats


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
