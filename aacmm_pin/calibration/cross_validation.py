"""Cross-validation by seats, sessions or blocks of joint space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.display import Shown
from aacmm_pin._support.plain_values import of_models
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin._support.units import MM
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.linearisation import Point
from aacmm_pin.calibration.noise_model import NoiseModel, observations_of
from aacmm_pin.calibration.solver import solve
from aacmm_pin.measurements import (
    FEWEST_CONTACTS,
    Measurements,
    centre_of_sphere,
    clusters_of,
    normal_of_plane,
)

FOLDS = 10
FEWEST_GROUPS = 3
FEWEST_POSTURES = 3
FEWEST_SEATS = 5
"""With fewer seats, a diagnosis leaves out blocks of joint space."""
ANGLE_DECIMALS = 9
"""For one order of angles in degrees and radians."""
MOST_RECORDS = 0.9
"""A diagnosis leaves out seats if more than this part of the records touch one."""


def rms(distance: Array) -> float:
    """Root mean square, without NaN [m]."""
    return float(np.sqrt(np.nanmean(np.square(distance))))


def rms_residual(fit: Fit, used: Mask) -> float:
    """RMS distance of tip and target over the ``used`` records (n,) [m]."""
    return rms(np.linalg.norm(fit.system.deviation[used], axis=1))


@dataclass(frozen=True, eq=False)
class HeldOut(Shown):
    """Residuals of records left out of the fit in turn.

    Attributes:
        kind: ``records`` (random postures, whose neighbours stay in, which flatters), ``seats``,
            ``sessions``, ``blocks`` (of joints).
        before, after: residuals by the arm before calibration (set-up fitted), and by the
            calibrated arm (n,) [m]; nan for none.
        turn_before, turn_after: rotations from the stated orientations (n,) [rad]; nan for none.
    """

    kind: str
    groups: int
    before: Array
    after: Array
    turn_before: Array
    turn_after: Array

    @property
    def turned(self) -> bool:
        """Whether there are orientations."""
        return bool(np.isfinite(self.turn_after).any())

    @property
    def rms_before(self) -> float:
        """Root mean square distance [m]."""
        return rms(self.before)

    @property
    def rms_after(self) -> float:
        """Root mean square distance [m]."""
        return rms(self.after)

    def summary(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        sizes = {"nominal": self.rms_before / MM, "calibrated": self.rms_after / MM}
        turns = None
        if self.turned:
            turned = {"nominal": rms(self.turn_before), "calibrated": rms(self.turn_after)}
            turns = of_models(turned)
        return {
            "kind": self.kind,
            "groups": self.groups,
            "rms_mm": of_models(sizes),
            "rms_rad": turns,
        }


# --- which records are left out together


def groups_of(fit: Fit, rng: np.random.Generator) -> tuple[str, Index]:
    """Kind and label (n,) of natural groups: seats, sessions, or blocks of joint space. Points
    beside seats are in blocks. Repeats of a posture are together.
    """
    records = fit.problem.measurements
    for kind in ("seat", "session"):
        # Other sessions do not determine the frame of a session.
        if kind == "session" and fit.problem.setup.frame_of_session:
            continue
        labels = records.conditions.labels(kind)
        numbers, has_label = pd.factorize(labels)[0], labels != ""
        groups = merged_by_posture(numbers, records.postures)
        if np.unique(groups[fit.used & has_label]).size < FEWEST_GROUPS:
            continue
        if kind == "seat":
            groups = _seats_and_blocks(numbers, has_label, records, rng)
        return f"{kind}s", groups
    return "blocks", _blocks(records, FOLDS, rng)


def fold_numbers(fit: Fit, rng: np.random.Generator) -> tuple[str, Index]:
    """Kind and fold (n,) for a diagnosis: seats (those of a bar together) or, if few, blocks of
    joint space. Repeats of a posture are together.
    """
    records = fit.problem.measurements
    seat = fit.observations.seat
    touched = seat >= 0
    bodies = np.full(records.n, -1)
    bodies[touched] = fit.observations.clusters[seat[touched]]
    groups = merged_by_posture(bodies, records.postures)
    if np.unique(groups[touched]).size >= FEWEST_SEATS and touched.sum() > MOST_RECORDS * records.n:
        return "seats", _folds(_seats_and_blocks(bodies, touched, records, rng), records, rng)
    blocks = _blocks(records, min(FOLDS, max(2, records.n // 5)), rng)
    return "blocks", np.unique(blocks, return_inverse=True)[1].astype(np.intp)


def _seats_and_blocks(
    numbers: Index, touched: Mask, records: Measurements, rng: np.random.Generator
) -> Index:
    """Numbers of seats (n,) where one is ``touched``, else blocks of joint space: seats alone may
    leave the frame open.
    """
    groups = numbers.copy()
    if not touched.all():
        groups[~touched] = numbers.max() + 1 + _blocks(records, FOLDS, rng)[~touched]
    return merged_by_posture(groups, records.postures)


def _blocks(records: Measurements, most: int, rng: np.random.Generator) -> Index:
    """Numbers (n,), by k-means over one record of every posture."""
    order = _in_order(records)
    _, first = np.unique(records.postures[order], return_index=True)
    chosen = order[np.sort(first)]
    on_circles = np.hstack([np.cos(records.q[chosen]), np.sin(records.q[chosen])])
    count = min(most, len(chosen))
    _, block = scipy.cluster.vq.kmeans2(on_circles, count, minit="++", rng=rng)
    block_of_posture = np.empty(len(chosen), dtype=np.intp)
    block_of_posture[records.postures[chosen]] = block
    return block_of_posture[records.postures]


def _folds(labels: Index, records: Measurements, rng: np.random.Generator) -> Index:
    """Fold, 0 to 9, of each record (n,); those of one label together."""
    first = np.unique(labels[_in_order(records)], return_index=True)[1]
    fold_of_rank = np.argsort(rng.permutation(first.size)) % FOLDS
    label = np.unique(labels, return_inverse=True)[1]
    rank_of_label = np.argsort(np.argsort(first))
    return np.asarray(fold_of_rank[rank_of_label[label]], dtype=np.intp)


def _in_order(records: Measurements) -> Index:
    """By angles, so that draws depend neither on the file's order nor on labels."""
    angles = np.round(records.q, ANGLE_DECIMALS)
    return np.lexsort(angles.T[::-1])


def merged_by_posture(labels: Index, postures: Index) -> Index:
    """Labels (n,), from 0, with those that share a posture made one."""
    _, label_nodes = np.unique(labels, return_inverse=True)
    posture_nodes = label_nodes.max() + 1 + postures
    merged = clusters_of(
        np.column_stack([label_nodes, posture_nodes]), int(posture_nodes.max()) + 1
    )
    return merged[label_nodes]


def enough_postures(records: Measurements, used: Mask | slice = slice(None)) -> bool:
    """Whether records show anything that depends on posture."""
    return np.unique(records.postures[used]).size >= FEWEST_POSTURES


# --- leaving out


def distances(
    records: Measurements,
    poses: Array,
    seats: Mapping[str, Array] | None = None,
    lever: float = 0.0,
) -> Array:
    """Distance of predicted tips from the reference, else the known seat, else the mean of the tips
    at the seat (n,) [m].

    A spread about the mean of m records is widened by √(m/(m-1)), NaN for one; spheres and planes
    likewise. ``seats``: points by other records (3,), of planes point and anchor (2, 3) [m].
    ``poses`` are tips (n, 3) [m], perhaps with turns from the stated orientations (n, 6) [rad],
    which count over a ``lever`` [m].
    """
    tips = poses[:, :3]
    radius = np.nan_to_num(records.contact_radius)
    distance = np.abs(np.linalg.norm(tips - records.reference, axis=1) - radius)
    for label, members in records.seats().items():
        unplaced = members[~records.known[members]]
        if seats is not None and label in seats:
            distance[unplaced] = _distances_from(seats[label], tips[unplaced], radius[unplaced])
        elif records.on_surface[unplaced].any():
            distance[unplaced] = _distances_from_best(tips[unplaced], records.take(unplaced))
        elif unplaced.size > 1:
            spread = np.linalg.norm(tips[unplaced] - tips[unplaced].mean(axis=0), axis=1)
            distance[unplaced] = spread * np.sqrt(unplaced.size / (unplaced.size - 1))
    return np.asarray(np.hypot(distance, lever * np.linalg.norm(poses[:, 3:], axis=1)))


def _distances_from(seat: Array, tips: Array, radius: Array) -> Array:
    """From a point, a sphere of ``radius`` (m,), or the plane of point and anchor [m]."""
    if seat.ndim == 1:
        return np.asarray(np.abs(np.linalg.norm(tips - seat, axis=1) - radius))
    point, anchor = seat
    normal = (point - anchor) / np.linalg.norm(point - anchor)
    return np.asarray(np.abs((tips - point) @ normal))


def _distances_from_best(tips: Array, records: Measurements) -> Array:
    """From the best sphere or plane, widened by √(m/(m-3)); NaN for three or fewer [m]."""
    if len(tips) < FEWEST_CONTACTS:
        return np.full(len(tips), np.nan)
    radius = np.nan_to_num(records.contact_radius)
    if records.on_plane.any():
        middle = tips.mean(axis=0)
        best = np.stack([middle, middle - normal_of_plane(tips)])
    else:
        best = centre_of_sphere(tips, float(radius[0]))
    widened = np.sqrt(len(tips) / (len(tips) - 3))
    return np.asarray(widened * _distances_from(best, tips, radius))


def held_out(
    before: Fit, after: Fit, rng: np.random.Generator, progress: Progress
) -> list[HeldOut]:
    """Leave out postures at random, then natural groups, and predict them by both fits. Excluded
    records do not count; fewer than three postures leave nothing to hold out.
    """
    records = after.problem.measurements
    used = after.used
    if not enough_postures(records, used):
        return []
    kind, labels = groups_of(after, rng)
    results = []
    for name, folds in (
        ("records", _folds(records.postures, records, rng)),
        (kind, _folds(labels, records, rng)),
    ):
        numbers = np.unique(folds[used]).tolist()
        if len(numbers) < 2:
            continue
        residuals = np.full((4, records.n), np.nan)
        with watched(numbers, progress, f"held-out {name}", "part") as numbers_shown:
            for number in numbers_shown:
                out = used & (folds == number)
                residuals[:, out] = _held_out_residuals((before, after), used & ~out, out)
        results.append(HeldOut(name, len(numbers), *residuals))
    return results


def _held_out_residuals(fits: Sequence[Fit], kept: Mask, out: Mask) -> list[Array]:
    """By each fit, refitted to the records ``kept`` with its scatter: distances of the records
    ``out`` [m], then turns from the stated orientation [rad], nan without.
    """
    records = fits[0].problem.measurements
    predicted = records.take(out)
    others = records.take(kept)
    observations = observations_of(others, fits[0].problem.setup)
    residuals = []
    turns = []
    for fit in fits:
        problem = fit.problem.of(others)
        x, frame = fit.point.x, fit.point.frame
        noise = NoiseModel.of(problem, x, frame, fit.noise.scatters, observations)
        observed = noise.observations
        prediction = problem.predict(x, frame)
        point = Point(x, frame, observed.first_seats(prediction.tips), prediction)
        end = solve(problem, noise, point, np.ones(others.n)).point
        seats = dict(zip(observed.labels, end.seats, strict=True))
        for k in np.flatnonzero(observed.planes):
            seats[observed.labels[k]] = np.stack([end.seats[k], observed.anchor[k]])
        poses = problem.of(predicted).poses(end.x, end.frame)
        residuals.append(distances(predicted, poses, seats))
        turn = np.linalg.norm(poses[:, 3:], axis=1)
        turns.append(np.where(predicted.oriented, turn, np.nan))
    return [*residuals, *turns]
