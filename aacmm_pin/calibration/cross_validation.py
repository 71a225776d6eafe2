"""How well a calibration predicts records that it never saw: random ones, whole seats, sessions, blocks of joint space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin._support.shown import Shown
from aacmm_pin.calibration.duplicate_records import postures_of, tell_of_posture, together
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.solver import Point, noise_of_tips, solve
from aacmm_pin.calibration.stated_noise import StatedNoise, observations_of

FOLDS = 10


@dataclass(frozen=True, eq=False)
class HeldOut(Shown):
    """Residuals of records left out of the fit in turn.

    Attributes:
        kind: ``records`` (at random, repeats of a posture together; neighbours stay in, which flatters), ``seats``,
            ``sessions``, ``blocks`` (of joints).
        groups: how many parts were left out in turn.
        before: residual of each record by the arm as it was, only the set-up fitted (n,) [m]; nan where there is none.
        after: by the calibrated arm (n,) [m].
    """

    kind: str
    groups: int
    before: Array
    after: Array

    @property
    def rms_before(self) -> float:
        """Root mean square distance [m]."""
        return float(np.sqrt(np.nanmean(self.before**2)))

    @property
    def rms_after(self) -> float:
        """Root mean square distance [m]."""
        return float(np.sqrt(np.nanmean(self.after**2)))


def groups_of(fit: Fit, rng: np.random.Generator) -> tuple[str, Index]:
    """The natural groups of the records: seats, else sessions, else blocks of joint space: a label for each record.

    Repeats of a posture are in one group, whatever their seat or session.
    """
    records = fit.problem.measurements
    postures = postures_of(records.q)
    for kind, labels in (("seats", records.conditions.seat), ("sessions", records.conditions.session)):
        if labels is not None and len(set(labels[fit.used]) - {""}) >= 3:
            groups = together(np.unique(labels.astype(str), return_inverse=True)[1], postures)
            if len(np.unique(groups[fit.used & (labels != "")])) >= 3:
                return kind, groups
    return "blocks", blocks(records.q, postures, FOLDS, rng)


def blocks(q: Array, postures: Index, most: int, rng: np.random.Generator) -> Index:
    """Block of joint space of each record (n,), at most ``most`` of them: k-means over the first record of every posture.

    Args:
        q: readings (n, nq) [rad].
        postures: see :func:`postures_of` (n,).
        most: number of blocks where there are as many postures.
        rng: for the start.
    """
    first = q[np.unique(postures, return_index=True)[1]]
    turns = np.hstack([np.cos(first), np.sin(first)])
    clusters = scipy.cluster.vq.kmeans2(turns, min(most, len(first)), minit="++", rng=rng)[1]
    return np.asarray(clusters[postures], dtype=np.intp)


def folds(labels: Index, rng: np.random.Generator) -> Index:
    """Number of the part, 0 to at most 9, in which each record is left out; records of one label stay together."""
    names = rng.permutation(np.unique(labels))
    part = {name: i % FOLDS for i, name in enumerate(names)}
    return np.array([part[label] for label in labels], dtype=np.intp)


def held_out(
    before: Fit, after: Fit, noise: StatedNoise, rng: np.random.Generator, progress: Progress = None
) -> list[HeldOut]:
    """Leave out postures at random, then by natural groups of records; excluded records are neither used nor predicted.

    Where there are fewer than three postures nothing is left out: the others would say nothing of them.

    Args:
        before: fit of the set-up alone.
        after: fit of everything.
        noise: as stated.
        rng: for the choice of parts.
        progress: whether to show a bar, or a function that wraps the parts.
    """
    n = after.problem.measurements.n
    postures = postures_of(after.problem.measurements.q)
    if not tell_of_posture(after.problem.measurements.q[after.used]):
        return []
    kind, labels = groups_of(after, rng)
    found = []
    for name, part in (("records", folds(postures, rng)), (kind, folds(labels, rng))):
        parts = np.unique(part[after.used])
        if len(parts) < 2:
            continue
        residual = np.full((2, n), np.nan)
        with watched(parts, progress, f"held-out {name}", "part") as numbers:
            for number in numbers:
                out = (part == number) & after.used
                kept = (part != number) & after.used
                for which, fit in enumerate((before, after)):
                    residual[which, out] = _left_out(fit, noise, kept, out)
        found.append(HeldOut(name, len(parts), *residual))
    return found


def _left_out(fit: Fit, noise: StatedNoise, kept: Array, out: Array) -> Array:
    """Distances of the records ``out`` from where a fit of the records ``kept`` puts them."""
    problem = fit.problem.of(fit.problem.measurements.take(np.flatnonzero(kept)))
    observations = observations_of(problem.measurements, noise, fit.unmodelled)
    start = fit.solution.point
    tips = noise_of_tips(problem, start.frame, noise.encoder, fit.unmodelled)
    prediction = problem.predict(start.x, start.frame)
    point = Point(start.x, start.frame, observations.start(prediction.tips), prediction)
    solution = solve(problem, observations, tips, point, np.ones(problem.measurements.n))
    seats = dict(zip(observations.labels, solution.point.seats, strict=True))
    return _distances(fit.problem, solution.point, out, seats)


def _distances(problem: Problem, point: Point, out: Array, seats: dict[str, Array]) -> Array:
    """Distance from the reference, else from the seat as the kept records know it, else from the mean at that seat.

    The mean is of the held-out records themselves, so their spread about it is widened by √(m/(m-1)).
    """
    rows = np.flatnonzero(out)
    records = problem.measurements.take(rows)
    tips = problem.of(records).predict(point.x, point.frame).tips
    distance = np.linalg.norm(tips - records.reference, axis=1)
    for label, members in records.seats().items():
        unknown = members[~records.known[members]]
        if not unknown.size:
            continue
        if label in seats:
            distance[unknown] = np.linalg.norm(tips[unknown] - seats[label], axis=1)
        elif unknown.size > 1:
            spread = np.linalg.norm(tips[unknown] - tips[unknown].mean(axis=0), axis=1)
            distance[unknown] = spread * np.sqrt(unknown.size / (unknown.size - 1))
    return np.asarray(distance)
