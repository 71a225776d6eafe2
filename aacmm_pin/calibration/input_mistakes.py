"""Whether records fit the arm at all; if not, which mistake in the file (sign, zero, column, unit,
frame) explains them.

A joint angle of reversed sign, a zero a quarter turn off, exchanged columns, another unit or frame
are no causes of error: no parameter may take them up. Where the first fit leaves more than an arm
has, or the arm as it is described is as far off, every such mistake is undone in turn. The arm as
it is described judges which of them brings tips and targets together best (median distance over
what the tips travel, so that gross errors do not count and no unit that shrinks the arm is
rewarded); a fit then has to leave no more than the noise. Of several the simplest is named: the
fewest, with the fewest free numbers. Nothing is repaired.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, ArmFile
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.estimation import FIRST_SCATTER, fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.parameter_vector import DH_KIND_OF_EFFECT
from aacmm_pin.calibration.parameters import ASSEMBLED, asked_again
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.session_frames import another_frame
from aacmm_pin.calibration.setup import Setup, sessions_of
from aacmm_pin.calibration.solver import FEWEST_PLACED, initial_point, solve
from aacmm_pin.calibration.wrong_columns import (
    QUARTERS,
    SIMILAR_RATIO,
    likely_columns,
    likely_orders,
    likely_ratios,
    likely_scales,
)
from aacmm_pin.calibration.wrong_rows import mistaken_rows
from aacmm_pin.calibration.wrong_values import wrong_value
from aacmm_pin.effects import (
    JointPlacement,
    JointZeroOffset,
    LinkTilt,
    StylusOffset,
)
from aacmm_pin.errors import AacmmError, MissingConditionError, MistakenFileError
from aacmm_pin.measurements import Measurements, Observations

FAR = 2e-3
"""Scatter, or median distance after a fit, that no arm has; some mistake is looked for [m]."""
UNLIKE = 0.03
"""Scatter about the best fit, as a part of what the tips travel, beyond which records have nothing
to do with the arm.
"""
MOVED = 5.0
"""Geometry that moves so many times what assembly leaves (:data:`ASSEMBLED`), and the tips by as
much as such a length, has taken up another mistake; the zero of a joint that hardly moves the tip
may be anything.
"""
EXPLAINS = 0.2
"""A mistake is named if without it the median distance falls to less than this part."""
TRIED = 3
"""So many of the best are fitted, the best first, until one explains the file."""
FITTED = 8
"""Of those that are alike, so many at most are fitted, the simplest first; seldom there are more
than four.
"""
TURN = 2 * np.pi
"""An angle beyond this was hardly in radians [rad]."""
SLIPS_OF_LENGTHS = (-1.0, 10.0, 0.1)
"""Factors by which a length is mistyped: another sign, a decimal place."""
EXCHANGED = {
    ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"): "rows_exchanged",
    ("a_mm",): "values_exchanged",
    ("d_mm",): "values_exchanged",
}
"""Values of two rows of an arm file that may be exchanged, and the codes of the notes."""
NOT_REVOLUTE = {"limits_rad": None, "encoder_noise_rad": None}
"""Keys that a prismatic joint lacks."""
SLIDE_UNITS = {"mm": 1e-3, "centimetres": 1e-2, "inches": 0.0254}
"""Units that the readings of a prismatic joint may have come in, in metres."""
LEAST_SINE = 0.01
"""A twist with a smaller sine has no sign."""
MOST_GROSS = 0.15
"""Gross errors are not a larger part of the records."""
MOST_IN_RADIANS = 0.06
"""Twists that are all below this were hardly in degrees: a right angle in radians under such a key
[rad]."""
SMALL = 0.25
"""The lengths of an arm hardly add up to less [m]."""
FEWEST_FOR_MISTAKES = 10
"""With fewer records some mistake fits anything."""
RECORDS_TO_DISTINGUISH = 80
"""So many records tell one mistake from another."""
GON = 0.9
"""One gon [°]."""
LENGTH_UNITS = {
    ("metres", "mm"): 1e3,
    ("centimetres", "mm"): 10.0,
    ("inches", "mm"): 25.4,
    ("micrometres", "mm"): 1e-3,
    ("mm", "metres"): MM,
}
"""Units that lengths may have come in and what they were taken as, and the factor that undoes it.
"""
ANGLE_UNITS = {
    ("degrees", "radians"): DEG,
    ("radians", "degrees"): 1 / DEG,
    ("gon", "degrees"): GON,
    ("minutes of arc", "degrees"): 1 / 60,
    ("milliradians", "radians"): 1e-3,
    ("turns", "degrees"): 360.0,
    ("turns", "radians"): 360.0 * DEG,
}
"""Units that angles may have come in and what they were taken as, and the factor that undoes it."""
AXIS_NUMBERS = np.arange(3)
ORIENTATION_FAR = 0.05
"""Median angle between fitted and stated orientations that no arm has [rad]."""


@dataclass(frozen=True, eq=False)
class _Mistake:
    """A mistake in a file, and what undoes it.

    Attributes:
        name: what the mistake is; None where it is never reported.
        kind: of two mistakes of one kind only one is tried at a time.
        angle_matrix: the angles are these combinations of the angles in the file (nq, nq).
        angle_offset: added to the angles (nq,) [rad].
        axes: which coordinate of the file is x, y, z, and its sign.
        scale: factor of the coordinates, or of each of the three columns; their uncertainties
            stay, which may be right.
        bar_factor: factor of the bars' lengths.
        external_frame: the coordinates are in another frame than the base's.
        target_off_tip: the coordinates are of another point of the last body than the tip.
        arm: the arm that the records are of; None for the arm as it is described.
        chosen: it is one of many that the records choose among: a value, a ratio.
    """

    name: Note | None
    kind: str
    angle_matrix: Array | None = None
    angle_offset: Array | None = None
    axes: tuple[tuple[int, ...], tuple[int, ...]] = ((0, 1, 2), (1, 1, 1))
    scale: float | Array = 1.0
    bar_factor: float = 1.0
    external_frame: bool = False
    target_off_tip: bool = False
    arm: Arm | None = None
    chosen: bool = False

    @property
    def changes_tips(self) -> bool:
        """Whether undoing it changes the computed tips, not the coordinates or lengths touched."""
        changes = (self.angle_matrix, self.angle_offset, self.arm)
        return self.target_off_tip or any(change is not None for change in changes)

    @property
    def free(self) -> int:
        """How many numbers it leaves open, which may take up other mistakes; more than an option if
        it is chosen among many.
        """
        return 6 * self.external_frame + 3 * self.target_off_tip + 10 * self.chosen

    def undone(self, problem: Problem) -> Problem:
        """The problem without the mistake."""
        records = problem.measurements
        setup = problem.setup
        order, signs = self.axes
        readings = records.readings
        length = records.bar_length
        if self.angle_matrix is not None:
            readings = readings @ self.angle_matrix
        if self.angle_offset is not None:
            readings = readings + self.angle_offset
        scaled = (self.scale * records.reference)[:, order]
        changed = replace(
            records,
            q=readings,
            of_encoders=None,
            reference=scaled * np.array(signs),
            reference_u=records.reference_u[:, order],
            bar_length=None if length is None else self.bar_factor * length,
            orientation=None,  # tips alone show what is wrong with them
        ).with_joint_angles(problem.model.arm)
        if self.external_frame:
            setup = replace(setup, reference_frame="external")
        if self.target_off_tip:
            setup = replace(setup, target="unknown")
        if self.target_off_tip or self.arm:
            model = problem.model if self.arm is None else replace(problem.model, arm=self.arm)
            problem = asked_again(problem, model, setup)
        return replace(problem, measurements=changed, setup=setup, targets=())


def first_fit(problem: Problem, *, robust: bool = True) -> Fit:
    """:func:`fit`, refusing records that no fit of this arm means anything for.

    Raises:
        MistakenFileError: undoing one mistake, or two, explains the records.
        AacmmError: after the fit they are off by a large part of what the tips travel; see
            :func:`fit`.
    """
    try:
        after = fit(problem, robust=robust)
    except MissingConditionError:  # which no mistake in the columns explains
        raise
    except AacmmError:
        _require_no_mistake_in_a_session(problem)
        _require_no_mistake(problem, np.inf, thorough=True, options=True)
        raise
    if _far_in_a_session(after):
        _require_no_mistake_in_a_session(problem)
    travel = _travel(problem) if after.unmodelled > FAR else np.inf
    unlike = after.unmodelled > UNLIKE * travel
    fitted = _median(after.system.deviation)
    if unlike or problem.measurements.bars() or max(fitted, _as_described(after)) >= FAR:
        absorbs = _absorbs(after)
        if fitted >= FAR:
            _require_rows_together(problem, fitted)
        _require_no_mistake(
            problem,
            fitted,
            thorough=unlike or (absorbs and not _zeros_alone(problem)),
            options=fitted >= FAR or absorbs,
            after=after,
        )
    if unlike:
        advice = _advice(problem)
        raise AacmmError(
            f"{problem.measurements.source}: {advice}. (With the best parameters, the records "
            f"scatter by {after.unmodelled / MM:.0f} mm in each coordinate. The tips of the arm at "
            f"these angles scatter by {travel / MM:.0f} mm.)"
        )
    _require_orientations(after)
    return after


def _zeros_alone(problem: Problem) -> bool:
    """Whether zeros of joints are the only geometric values that are estimated: then they may be
    off by any angle.
    """
    return all(
        isinstance(effect, JointZeroOffset)
        for effect in problem.vector.effects
        if isinstance(effect, (JointPlacement, *DH_KIND_OF_EFFECT))
    )


def _advice(problem: Problem) -> Note:
    """What to look at where no mistake explains records that do not fit."""
    readings = problem.measurements.readings
    still = np.flatnonzero(np.ptp(readings, axis=0) == 0.0)
    if still.size:
        return Note("unlike_arm_one_reading", {"joints": (still + 1).tolist()})
    for j, k in combinations(range(readings.shape[1]), 2):
        if np.array_equal(readings[:, j], readings[:, k]):
            return Note("unlike_arm_copy", {"joints": [j + 1, k + 1]})
    if _each_fits(_ends(problem)):
        return Note("ends_fit_alone")
    return Note("sessions_unlike" if _each_fits(_by_session(problem)) else "unlike_arm")


def mistakes_of(after: Fit) -> list[Note]:
    """Notes on mistakes in the files that do not keep the records from being fitted: a wrong value
    of the arm, rows in another frame, readings that stand still, rows that are shifted.
    """
    notes = mistaken_rows(after)
    wrong = wrong_value(after)
    if wrong is not None:
        notes.append(wrong.note)
    in_another_frame = another_frame(after)
    if in_another_frame is not None:
        notes.append(in_another_frame)
    return notes


def _far_in_a_session(after: Fit) -> bool:
    """Whether the median distance of a session is farther than those of any arm."""
    distances = pd.Series(np.linalg.norm(after.system.deviation, axis=1))
    session = after.problem.measurements.conditions.session
    return session is not None and bool((distances.groupby(session).median() >= FAR).any())


def _by_session(problem: Problem) -> list[Problem]:
    """The same unknowns with the records of each session alone."""
    records = problem.measurements
    if records.conditions.session is None:
        return []
    rows_of = pd.Series(np.arange(records.n)).groupby(records.conditions.session).indices
    alone = []
    for session, rows in rows_of.items():
        own = records.take(np.asarray(rows))
        if own.placed.any() or not problem.setup.frame_of_session:
            source = f"{records.source}: session {session}"
            alone.append(problem.of(replace(own, source=source)))
    return alone


def _ends(problem: Problem) -> list[Problem]:
    """The same unknowns with the first and with the last third of the records; none if they are
    few, or have sessions.
    """
    records = problem.measurements
    third = records.n // 3
    if third < FEWEST_FOR_MISTAKES or records.conditions.session is not None:
        return []
    rows_of_ends = np.arange(third), np.arange(records.n - third, records.n)
    return [problem.of(records.take(rows)) for rows in rows_of_ends]


def _each_fits(parts: Sequence[Problem]) -> bool:
    """Whether there are several parts, and the records of each fit the arm in some frame."""
    own_frame = _Mistake(None, "", external_frame=True)
    try:
        fits = [fit(own_frame.undone(part)) for part in parts]
    except AacmmError:
        return False
    return len(fits) > 1 and all(after.unmodelled < FAR for after in fits)


def _require_no_mistake_in_a_session(problem: Problem) -> None:
    """Refuse records of which some sessions fit the arm, if a mistake explains another session: one
    in its columns, as the arm or the references may have been moved between sessions.

    Raises:
        MistakenFileError: the mistake.
    """
    distances = {alone: _distance_alone(alone) for alone in _by_session(problem)}
    if min(distances.values(), default=np.inf) < FAR:
        for alone, distance in distances.items():
            if distance >= FAR:
                _require_no_mistake(alone, distance, thorough=False, options=False)


def _distance_alone(problem: Problem) -> float:
    """Median distance after a fit, or by the arm as it is described if that is larger [m]; infinite
    where there is no fit.
    """
    try:
        after = fit(problem)
    except AacmmError:
        return np.inf
    return max(_median(after.system.deviation), _as_described(after))


def _require_orientations(after: Fit) -> None:
    """Refuse orientations that are not of a body that moves with the last body of the arm, and
    state what explains them.

    Raises:
        AacmmError: the orientations do not fit the arm.
    """
    problem = after.problem
    point = after.point
    rows = after.used & after.observations.oriented
    stated = problem.measurements.orientation
    if stated is None or not rows.any():
        return
    median_angle = np.median(after.turns[rows])
    if median_angle < ORIENTATION_FAR:
        return
    why = "orientation_unlike"
    for mistake, other in (
        ("orientation_scalar_last", stated[:, [3, 0, 1, 2]]),
        ("orientation_inverse", stated * [1, -1, -1, -1]),
    ):
        changed = replace(problem, measurements=replace(problem.measurements, orientation=other))
        poses = changed.poses(point.x, changed.with_targets(point.x, point.frame))
        angles = np.linalg.norm(poses[rows, 3:], axis=1)
        if np.median(angles) < ORIENTATION_FAR:
            why = mistake
    source = problem.measurements.source
    reason = Note(why)
    raise AacmmError(
        f"{source}: the orientations do not fit this arm (median error "
        f"{median_angle / DEG:.3g}°): {reason}"
    )


def _require_no_mistake(
    problem: Problem, fitted: float, *, thorough: bool, options: bool, after: Fit | None = None
) -> None:
    """Refuse records that one mistake explains.

    Args:
        problem: the records as they are.
        fitted: median distance after a fit of these, infinite where there is no such fit [m].
        thorough: look for two mistakes, and several signs and zeros, too.
        options: look for options that were left out. They leave numbers open that geometry may as
            well take up: a tip that is off by a length of the last row is no mistake.
        after: a fit of these, by which one wrong value of the arm is looked for before options.

    Raises:
        MistakenFileError: the mistake.
    """
    if problem.setup.frame_of_session:
        problem = _of_first_session(problem)
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES:
        return
    thinned = problem.of(records.take(_thinned(records)))

    @cache
    def cached_tips(*mistakes: _Mistake) -> _Described:
        return _tips_as_described(_undone(thinned, mistakes))

    @cache
    def cached_touches(*mistakes: _Mistake) -> _Touches:
        return _touches_of(_undone(thinned, mistakes))

    def misfit(several: tuple[_Mistake, ...]) -> float:
        of_tips = tuple(mistake for mistake in several if mistake.changes_tips)
        of_touches = (mistake for mistake in several if not mistake.changes_tips)
        # Two together are computed only once, and would fill the cache.
        tips_of = cached_tips if len(of_tips) < 2 else cached_tips.__wrapped__
        try:
            return _misfit(tips_of(*of_tips), cached_touches(*of_touches))[1]
        except AacmmError:  # an arm so changed has no tips, as where it finds no equilibrium
            return np.inf

    described_distance, described_misfit = _misfit(cached_tips(), cached_touches())
    if described_distance == np.inf:
        return
    described_fits = described_distance < FAR or described_misfit < UNLIKE
    if described_fits and fitted < FAR:
        return
    taken_up = fitted < FAR or fitted == np.inf
    as_is = described_distance if taken_up else fitted
    single = [(mistake,) for mistake in _mistakes(problem) if options or not mistake.free]
    free = [mistakes for mistakes in single if mistakes[0].free]
    tiers: list[list[tuple[_Mistake, ...]]] = [
        [mistakes for mistakes in single if not mistakes[0].free],
        _several_columns(thinned) if thorough else [],
        [*free, *_of_numbers(thinned, after)] if options else [],
        [(*free[0], *free[1])] if len(free) == 2 else [],
        _pairs(single) if thorough else [],
    ]
    for mistakes in tiers:
        misfits = np.array([misfit(several) for several in mistakes])
        limit = (EXPLAINS if taken_up else 1.0) * described_misfit
        nearest = [k for k in np.argsort(misfits, kind="stable") if misfits[k] <= limit]
        alike = [k for k in nearest if misfits[k] <= SIMILAR_RATIO * misfits[nearest[0]]]
        alike.sort(key=lambda k: (len(mistakes[k]), sum(one.free for one in mistakes[k]), k))
        for together in (alike[:FITTED], *([k] for k in nearest[len(alike) : TRIED])):
            distances = {
                mistakes[k]: _distance_without(_undone(problem, mistakes[k]), as_is)
                for k in together
            }
            least = min(distances.values(), default=np.inf)
            if least == np.inf:
                continue
            named = [
                several
                for several, distance in distances.items()
                if distance <= SIMILAR_RATIO * least
            ]
            named = [
                larger
                for larger in named
                if not any(set(smaller) < set(larger) for smaller in named)
            ]
            words = [_in_words(several) for several in named]
            raise MistakenFileError(
                records.source, words[0], as_is, distances[named[0]], tuple(words[1:])
            )


def _require_rows_together(problem: Problem, as_is: float) -> None:
    """Refuse records whose coordinates are those of the row before or behind.

    Raises:
        MistakenFileError: they are.
    """
    records = problem.measurements
    if records.n < FEWEST_FOR_MISTAKES or not records.placed.all():
        return
    for where, step in (("before", 1), ("after", -1)):
        kept = slice(max(-step, 0), records.n - max(step, 0))
        touched = slice(max(step, 0), records.n - max(-step, 0))
        reference, u = records.reference[touched], records.reference_u[touched]
        shifted = replace(records.take(np.arange(records.n)[kept]), reference=reference)
        shifted = replace(shifted, reference_u=u)
        after = _fit_without(problem.of(shifted), as_is)
        if after is not None:
            name = Note("rows_shifted", {"where": where})
            apart = after.excluded
            if apart.mean() > MOST_GROSS:
                rows = shifted.row[~apart].tolist()
                name = Note("some_rows_shifted", {"rows": rows, "where": where})
            distance = _median(after.system.deviation)
            raise MistakenFileError(records.source, str(name), as_is, distance)


def _distance_without(without: Problem, as_is: float) -> float:
    """Median distance after a fit ``without`` a mistake [m]; infinite where :func:`_fit_without`
    has none.
    """
    after = _fit_without(without, as_is)
    return np.inf if after is None else _median(after.system.deviation)


def _fit_without(without: Problem, as_is: float) -> Fit | None:
    """A fit ``without`` a mistake; None unless its median distance is far below ``as_is`` [m], and
    no more than noise.
    """
    try:
        after = fit(without)
    except (AacmmError, np.linalg.LinAlgError):  # a hypothesis that is far off has no fit
        return None
    limit = min(EXPLAINS * as_is, UNLIKE * _travel(after.problem))
    explained = after.unmodelled < FAR and _median(after.system.deviation) < limit
    return after if explained and not _absorbs(after) else None


def _undone(problem: Problem, mistakes: tuple[_Mistake, ...]) -> Problem:
    for mistake in mistakes:
        problem = mistake.undone(problem)
    return problem


def _travel(problem: Problem) -> float:
    """How far the tips are spread in each coordinate [m]."""
    tips = problem.model.arm.chain.positions(problem.measurements.q)
    return float(np.sqrt(tips.var(axis=0).mean()))


def _absorbs(after: Fit) -> bool:
    """Whether the fit moved a geometric value, and thereby the tips, farther than the geometry of
    any arm is off: by more than so many times what assembly leaves (:data:`ASSEMBLED`).
    """
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
    """Median distance by the arm as it is described, with frame and seats where the fit has them,
    to first order [m].
    """
    x = after.point.x - after.problem.start
    jacobian = after.point.prediction.jacobian[:, :3, : x.size]
    return _median(after.system.deviation - jacobian @ x)


def _median(deviation: Array) -> float:
    """Median distance of the records that have a target [m]; infinite where none has."""
    distance = np.linalg.norm(deviation, axis=1)
    distance = distance[np.isfinite(distance)]
    return float(np.median(distance)) if distance.size else np.inf


class _Described(NamedTuple):
    """The arm as it is described: tips in its base (n, 3) [m], in a problem with nothing unknown
    but targets.
    """

    problem: Problem
    tips: Array


class _Touches(NamedTuple):
    """What was touched: records, their observations, and the set-up with the frame of their
    coordinates.
    """

    records: Measurements
    observations: Observations
    setup: Setup


def _tips_as_described(problem: Problem) -> _Described:
    bare = _of_targets(problem)
    return _Described(bare, bare.poses(bare.start, Frame.identity()))


def _touches_of(problem: Problem) -> _Touches:
    records = replace(problem.measurements, orientation=None)
    return _Touches(records, observations_of(records, problem.setup), problem.setup)


def _misfit(arm: _Described, touches: _Touches) -> tuple[float, float]:
    """Median distance by the arm as it is described, frame, seats and target fitted [m]; this
    distance over the tips' travel.
    """
    records, observations, setup = touches
    if setup.external and records.known.sum() < FEWEST_PLACED:
        return np.inf, np.inf
    try:
        tips, points = (
            _fitted_tips(arm, touches)
            if arm.problem.vector.effects
            else _registered_tips(arm.tips, touches)
        )
    except AacmmError:
        return np.inf, np.inf
    deviations = observations.with_normals(tips, points).deviations(tips, points)
    seats = records.seats()
    for bar in records.bars():
        # Seats lie where their records put them: what a bar is off by is half each end's.
        a, b = (seats[label] for label in (bar.seat_a, bar.seat_b))
        distance = np.linalg.norm(np.median(tips[a], axis=0) - np.median(tips[b], axis=0))
        ends = np.concatenate([a, b])
        outwards = np.where(deviations[ends] < 0, -1.0, 1.0)
        deviations[ends] += 0.5 * (distance - bar.length) / np.sqrt(3.0) * outwards
    median = _median(deviations)
    travel = float(np.median(np.linalg.norm(tips - np.median(tips, axis=0), axis=1)))
    return median, median / max(travel, 1e-9)


def _registered_tips(tips: Array, touches: _Touches) -> tuple[Array, Array]:
    """Tips (n, 3) and seats (s, 3) in the frame of the references [m]."""
    records, observations, setup = touches
    if setup.external:
        tips = registered(tips[records.known], records.reference[records.known]).apply(tips)
    return tips, observations.start(tips)


def _fitted_tips(arm: _Described, touches: _Touches) -> tuple[Array, Array]:
    """Tips (n, 3) and seats (s, 3) in the frame of the references, unknown targets fitted [m].

    Raises:
        AacmmError: see :func:`initial_point`.
    """
    records, observations, setup = touches
    changed = replace(records, q=arm.problem.measurements.q)
    problem = replace(arm.problem, measurements=changed, setup=setup)
    point = initial_point(problem, observations)
    if not records.known.all():
        noise = NoiseModel.of(
            problem, point.x, point.frame, Scatters(FAR, 0.0, FIRST_SCATTER), observations
        )
        point = solve(problem, noise, point, np.ones(records.n), robust=True, roughly=True).point
    return point.prediction.tips, point.seats


def _of_first_session(problem: Problem) -> Problem:
    """The same unknowns with the records of the first session, whose frame is one."""
    records = problem.measurements
    session = records.conditions.require("session", "reference frame")
    alone = problem.of(records.take(session == sessions_of(records)[0]))
    setup = replace(problem.setup, reference_frame="external")
    return asked_again(alone, problem.model, setup)


def _of_targets(problem: Problem) -> Problem:
    """The problem with nothing unknown but where targets sit, and the frame."""
    kept = np.zeros(problem.widths.size, dtype=bool)
    effects = []
    for effect, entries in problem.vector:
        if isinstance(effect, StylusOffset):
            effects.append(effect)
            kept[entries] = True
    vector = replace(problem.vector, effects=tuple(effects))
    return replace(
        problem,
        measurements=replace(problem.measurements, orientation=None),
        targets=(),
        vector=vector,
        widths=problem.widths[kept],
        stated=problem.stated[kept],
        correlation=problem.correlation[np.ix_(kept, kept)],
    )


def _thinned(records: Measurements) -> Index:
    """Enough of the records, some of every seat."""
    rows = np.arange(records.n)
    seats = records.seats()
    if not seats:
        return rows[:: max(1, records.n // RECORDS_TO_DISTINGUISH)]
    per_seat = max(3, RECORDS_TO_DISTINGUISH // len(seats))
    return np.unique(
        np.concatenate([members[:: max(1, len(members) // per_seat)] for members in seats.values()])
    )


# --- mistakes


def _of_table(arm: Arm) -> Iterator[_Mistake]:
    """Values of a DH table that are mistyped, exchanged, or in other units."""
    if not isinstance(arm.file, ArmFile):
        return
    yield from _of_rows(arm.file)
    yield from _of_exchanges(arm.file)
    if 0.0 < max(abs(row.alpha_rad) for row in arm.file.joints) < MOST_IN_RADIANS:
        changed = _scaled(arm.file, ("alpha_rad", "theta_offset_rad"), 1.0 / DEG)
        yield _Mistake(Note("table_in_radians"), "table", arm=changed)
    if _is_small(arm):
        larger = {unit: factor for (unit, _), factor in LENGTH_UNITS.items() if factor > 1.0}
        for unit, factor in larger.items():
            changed = _scaled(arm.file, ("a_mm", "d_mm"), factor)
            yield _Mistake(Note("table_unit", {"unit": unit}), "table", arm=changed)


def _of_rows(file: ArmFile) -> Iterator[_Mistake]:
    """A value of one row that is mistyped: another sign, decimal place or quarter turn; a joint of
    another kind.
    """
    for number, row in enumerate(file.joints):
        if abs(np.sin(row.alpha_rad)) > LEAST_SINE:
            name = Note("twist_reversed", {"row": number + 1, "alpha": row.alpha_rad})
            changed = _with_values(file, {number: {"alpha_rad": -row.alpha_rad}})
            yield _Mistake(name, f"alpha {number}", arm=changed)
        for key in ("a_mm", "d_mm"):
            stated = getattr(row, key)
            for factor in SLIPS_OF_LENGTHS if abs(stated) * MM > FAR else ():
                data = {"parameter": f"{key[0]}{number + 1}", "stated": stated * MM}
                name = Note("length_mistyped", data | {"likely": factor * stated * MM})
                changed = _with_values(file, {number: {key: factor * stated}})
                yield _Mistake(name, f"{key} {number}", arm=changed)
        for turn in QUARTERS[1:]:
            alpha = float(np.remainder(row.alpha_rad + turn * DEG + np.pi, TURN) - np.pi)
            if abs(alpha + row.alpha_rad) < LEAST_SINE:
                continue  # the opposite sign
            data = {"row": number + 1, "alpha": row.alpha_rad, "likely": alpha}
            changed = _with_values(file, {number: {"alpha_rad": alpha}})
            yield _Mistake(Note("twist_mistyped", data), f"alpha {number}", arm=changed)
        if not row.fixed and not row.slides:
            prismatic = {"kind": "prismatic", "limits_mm": (-1e4, 1e4), **NOT_REVOLUTE}
            changed = _with_values(file, {number: prismatic})
            name = Note("kind_of_joint", {"row": number + 1})
            yield _Mistake(name, f"kind {number}", arm=changed)


def _of_exchanges(file: ArmFile) -> Iterator[_Mistake]:
    """The lengths of a row, or values of two rows, exchanged."""
    rows = file.joints
    for number, row in enumerate(rows):
        name = Note("row_exchanged", {"row": number + 1})
        changed = _with_values(file, {number: {"a_mm": row.d_mm, "d_mm": row.a_mm}})
        yield _Mistake(name, "table", arm=changed)
    for j, k in combinations(range(len(rows)), 2):
        for keys, code in EXCHANGED.items():
            exchanged = {row: rows[j + k - row].model_dump(include={*keys}) for row in (j, k)}
            name = Note(code, {"rows": (j + 1, k + 1), "value": keys[0][0]})
            yield _Mistake(name, "table", arm=_with_values(file, exchanged))


def _of_placements(arm: Arm) -> Iterator[_Mistake]:
    """A placement in a URDF that is turned by quarter turns, or the axis of a joint that is another
    one.
    """
    if arm.dh is not None:
        return
    names = [parameter.name for parameter in arm.parameters]
    for joint in range(arm.nq if not arm.mimics else 0):
        of_joint = names[6 * joint + 3 : 6 * joint + 6]
        for name, degrees in product(of_joint, QUARTERS[1:]):
            data = {"joint": joint + 1, "axis": name[1], "degrees": degrees}
            changed = moved_arm(arm, {name: degrees * DEG}, None)
            yield _Mistake(Note("placement_turned", data), f"placement {joint}", arm=changed)
    for joint in range(arm.nq - 1 if not arm.mimics else 0):
        for axis, letter in zip(np.eye(3), "xyz", strict=True):
            if abs(axis @ arm.joint_axes[joint]) < LEAST_SINE:
                changed = arm.with_joint_axis(joint + 1, axis)
                name = Note("axis_mistyped", {"joint": joint + 1, "axis": letter})
                yield _Mistake(name, f"axis {joint}", arm=changed)


def _scaled(file: ArmFile, keys: Sequence[str], factor: float) -> Arm:
    """The arm with some values of every row times a factor."""
    rows = enumerate(file.joints)
    return _with_values(
        file, {k: {key: factor * getattr(row, key) for key in keys} for k, row in rows}
    )


def _with_values(file: ArmFile, values: Mapping[int, Mapping[str, object]]) -> Arm:
    """The arm with other values in some rows (from 0)."""
    rows = [row.model_copy(update=values.get(k, {})) for k, row in enumerate(file.joints)]
    return Arm.from_file(file.model_copy(update={"joints": rows}))


def _is_small(arm: Arm) -> bool:
    """Whether the lengths of a DH table are hardly in the unit that their keys state."""
    if not isinstance(arm.file, ArmFile):
        return False
    size = sum(abs(row.a_mm) + abs(row.d_mm) for row in arm.file.joints)
    return size * MM < SMALL


def _mistakes(problem: Problem) -> Iterator[_Mistake]:
    """Every single mistake."""
    records = problem.measurements
    identity = np.eye(problem.measurements.nq)
    for j, largest in enumerate(np.abs(records.readings).max(axis=0)):
        yield _reversed(j, records.nq)
        if problem.model.arm.chain.prismatic[j]:
            for unit, factor in SLIDE_UNITS.items():
                name = Note("slide_unit", {"joint": j + 1, "unit": unit})
                factors = np.where(identity[j] > 0, factor, 1.0)
                yield _Mistake(name, f"unit {j}", angle_matrix=np.diag(factors))
            continue
        units = [(GON, "gon", "deg")]
        if largest > TURN or largest <= TURN * DEG:
            units.append((DEG, "degrees", "rad") if largest > TURN else (1 / DEG, "radians", "deg"))
        for factor, unit, column in units:
            name = Note("joint_angles_unit", {"joint": j + 1, "unit": unit, "column": column})
            factors = np.where(identity[j] > 0, factor, 1.0)
            yield _Mistake(name, f"unit {j}", angle_matrix=np.diag(factors))
    for j, degrees in product(range(records.nq), QUARTERS[1:]):
        yield _turned(j, degrees, records.nq)
    for j, k in combinations(range(records.nq), 2):
        order = np.arange(records.nq)
        order[[j, k]] = k, j
        name = Note("joints_exchanged", {"joints": (j + 1, k + 1)})
        yield _Mistake(name, "columns", angle_matrix=identity[order])
    arm = problem.model.arm
    rows = arm.chain.moving_rows()
    yield from _of_couplings(arm)
    neighbours = [*zip(range(1, arm.nq), range(arm.nq - 1), strict=True)]
    neighbours += [(other, joint) for joint, other in neighbours]
    for (j, of), sign in product(neighbours, (1.0, -1.0)):
        if arm.coupling_matrix[j, of]:
            continue
        code = "joint_shows_sum" if sign < 0 else "joint_shows_difference"
        angle_matrix = identity + sign * np.outer(identity[of], identity[j])
        ratio = (arm.coupling_matrix @ angle_matrix.T)[j, of]
        coupling = {"row": rows[j], "of": rows[of], "ratio": float(ratio)}
        name = Note(code, {"joint": j + 1, "other": of + 1, **coupling})
        yield _Mistake(name, "sum", angle_matrix=angle_matrix)
    for (unit, taken), factor in ANGLE_UNITS.items():
        name = Note("angles_unit", {"unit": unit, "taken": taken})
        yield _Mistake(name, "angles", angle_matrix=factor * identity)
    yield from _of_convention(problem.model.arm)
    yield from _of_table(arm)
    yield from _of_placements(arm)
    if records.known.any():
        yield from _of_frame(problem.external)
        if problem.setup.target != "unknown" and not any(
            isinstance(effect, StylusOffset) for effect in problem.vector.effects
        ):
            yield _Mistake(Note("target_off_tip"), "target", target_off_tip=True)
        for (unit, taken), factor in () if _is_small(arm) else LENGTH_UNITS.items():
            yield _Mistake(
                Note("coordinates_unit", {"unit": unit, "taken": taken}), "unit", scale=factor
            )
        for k, axis in enumerate("xyz"):
            scale = np.where(k == AXIS_NUMBERS, 1e3, 1.0)
            yield _Mistake(Note("coordinate_in_metres", {"axis": axis}), "unit", scale=scale)
    if records.bars():
        for (unit, taken), factor in LENGTH_UNITS.items():
            name = Note("bars_unit", {"unit": unit, "taken": taken})
            yield _Mistake(name, "bars", bar_factor=factor)


def _of_frame(external: bool) -> Iterator[_Mistake]:
    """Coordinates along other axes; in an unknown frame all mirror images are alike."""
    if external:
        yield _Mistake(Note("coordinates_mirrored"), "axes", axes=((0, 1, 2), (1, 1, -1)))
        return
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        if (order, signs) != ((0, 1, 2), (1, 1, 1)):
            came = ", ".join(
                f"{'-' * (s < 0)}{'xyz'[k]}" for k, s in zip(order, signs, strict=True)
            )
            yield _Mistake(Note("other_axes", {"axes": came}), "axes", axes=(order, signs))
    yield _Mistake(Note("other_frame"), "axes", external_frame=True)


def _of_couplings(arm: Arm) -> Iterator[_Mistake]:
    """The ratio of a stated coupling with the opposite sign, inverted or left out."""
    stated = arm.coupling_matrix
    without = np.eye(arm.nq)
    rows = arm.chain.moving_rows()
    for j, k in np.argwhere(stated != without):
        ratio = float(stated[j, k])
        inverse = 1.0 / ratio if j == k else 0.0
        for expected in {-ratio, inverse, float(without[j, k])} - {ratio}:
            changed = stated.copy()
            changed[j, k] = expected
            name = Note(
                "coupling_ratio",
                {"joint": rows[j], "of": rows[k], "ratio": ratio, "expected": expected},
            )
            angle_matrix = np.asarray(np.linalg.solve(stated, changed).T)
            yield _Mistake(name, "sum", angle_matrix=angle_matrix)


def _of_convention(arm: Arm) -> Iterator[_Mistake]:
    """The numbers of a DH table, read by the other convention."""
    if not isinstance(arm.file, ArmFile):
        return
    now, other = ("standard-dh", "modified-dh")[
        :: 1 if arm.file.convention == "standard-dh" else -1
    ]
    changed = Arm.from_file(arm.file.model_copy(update={"convention": other}))
    yield _Mistake(
        Note("other_convention", {"other": other, "convention": now}), "convention", arm=changed
    )


def _of_numbers(problem: Problem, after: Fit | None) -> Iterator[tuple[_Mistake, ...]]:
    """A wrong value of the arm file, the ratio of a joint, the scale of the coordinates."""
    arm = problem.model.arm
    wrong = None if after is None else wrong_value(after)
    if wrong is not None:
        changed = moved_arm(arm, wrong.errors, arm.covariance)
        yield (_Mistake(wrong.note, "value", arm=changed, chosen=True),)
    rows = arm.chain.moving_rows()
    records = problem.measurements
    for joint, ratio in enumerate(likely_ratios(arm, records, problem.external)):
        ratio_of_joint = float(arm.coupling_matrix[joint, joint]) * ratio
        data = {"joint": joint + 1, "row": rows[joint], "ratio": ratio_of_joint}
        factors = np.ones(arm.nq)
        factors[joint] = ratio
        name = Note("joint_ratio", data)
        yield (_Mistake(name, "ratio", angle_matrix=np.diag(factors), chosen=True),)
    scales = likely_scales(arm, records)
    if scales is not None:
        for axes, several in (("xyz", [0, 1, 2]), ("x", [0]), ("y", [1]), ("z", [2])):
            factors = np.ones(3)
            factors[several] = np.mean(scales[several])
            name = Note("coordinates_scaled", {"axes": [*axes], "factor": 1 / factors[several[0]]})
            yield (_Mistake(name, "unit", scale=factors, chosen=True),)


@cache
def _reversed(joint: int, nq: int) -> _Mistake:
    """Angles of a joint (from 0) with the opposite sign."""
    signs = np.ones(nq)
    signs[joint] = -1.0
    name = Note("joint_reversed", {"joint": joint + 1})
    return _Mistake(name, f"sign {joint}", angle_matrix=np.diag(signs))


@cache
def _turned(joint: int, degrees: int, nq: int) -> _Mistake:
    """Angles of a joint (from 0) that are off by quarter turns."""
    name = Note("zero_turned", {"joint": joint + 1, "degrees": degrees})
    offset = degrees * DEG * np.eye(nq)[joint]
    return _Mistake(name, f"zero {joint}", angle_offset=offset)


def _several_columns(problem: Problem) -> list[tuple[_Mistake, ...]]:
    """Columns in another order; signs and quarter turns of two joints or more, the signs first."""
    records = problem.measurements
    several_columns: list[tuple[_Mistake, ...]] = []
    for order in likely_orders(problem.model.arm, records, problem.external):
        name = Note("columns_in_order", {"joints": [joint + 1 for joint in order]})
        of_joints = np.eye(records.nq)[:, np.argsort(order)]
        several_columns.append((_Mistake(name, "columns", angle_matrix=of_joints),))
    for several in likely_columns(problem.model.arm, records, problem.external):
        signs = [_reversed(one.joint, records.nq) for one in several if one.sign < 0]
        turns = [_turned(one.joint, one.degrees, records.nq) for one in several if one.degrees]
        several_columns.append((*signs, *turns))
    return several_columns


def _in_words(several: tuple[_Mistake, ...]) -> str:
    """Several mistakes in one sentence, joints with the opposite sign together."""
    notes = [one.name for one in several if one.name is not None]
    signs = [note for note in notes if note.code == "joint_reversed"]
    if len(signs) > 1:
        joints = [note.data["joint"] for note in signs]
        others = [note for note in notes if note not in signs]
        notes = [Note("joints_reversed", {"joints": joints}), *others]
    return ", and ".join(map(str, notes))


def _pairs(single: list[tuple[_Mistake]]) -> list[tuple[_Mistake, ...]]:
    """Every two mistakes of different kinds, but those of :func:`_several_columns`, and of a table
    and a column.
    """
    mistakes = [one for (one,) in single]
    tried = {*combinations([m for m in mistakes if m.kind.startswith(("sign", "zero"))], 2)}
    pairs: list[tuple[_Mistake, ...]] = []
    for pair in combinations(mistakes, 2):
        one, other = pair
        of_table = one.changes_tips and other.changes_tips and (one.arm or other.arm)
        if one.kind != other.kind and not of_table and pair not in tried:
            pairs.append(pair)
    return pairs
