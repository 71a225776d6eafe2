"""What repeated postures show: repeatability and drift."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import f_sf
from aacmm_pin._support.units import count
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.noise_model import reference_u

FEWEST_CYCLES = 10
"""A posture with fewer repeats has no RP: with 10, the mean RP is 7 % too small, with 5 15 %."""
RP_OF_NOISE = float(np.sqrt(8.0 / np.pi) + 3.0 * np.sqrt(3.0 - 8.0 / np.pi))
"""RP for normal noise with standard deviation 1 in each coordinate."""
NO_VARIANCE = 1e-9


@dataclass(frozen=True)
class Drift(Shown):
    """The part of the deviations of repeats that is linear in time, at all postures alike.

    Attributes:
        change: of tip minus target from the first repeat to the last (3,) [m].
        p_value: probability of such a drift if the repeats only scatter.
    """

    change: Array
    p_value: float


@dataclass(frozen=True, eq=False)
class Repeatability(Shown):
    """Used records with the same readings within
    :data:`~aacmm_pin.measurements.repeats.SAME_POSTURE`, session and target.

    Attributes:
        posture: number of the posture of each repeat (n,), from 0.
        deviations: tip minus target, minus the mean of its posture (n, 3) [m].
        clock: time of each repeat (n,) [s], or its line in the file.
        residuals: tip minus target of all used records after calibration (k, 3) [m].
        reference_u: stated standard uncertainty of a reference coordinate, RMS over the repeats
            [m]; nan if not stated, or of a seat.
    """

    posture: Index
    deviations: Array
    clock: Array
    is_timed: bool
    residuals: Array
    reference_u: float = np.nan

    @property
    def cycles(self) -> Index:
        """Number of the repeats of each posture ``(m,)``."""
        return np.bincount(self.posture)

    @property
    def sd(self) -> Array:
        """Pooled standard deviation of x, y and z over all postures ``(3,)`` [m]."""
        dof = len(self.posture) - self.cycles.size
        return np.asarray(np.sqrt(np.square(self.deviations).sum(axis=0) / dof))

    @property
    def rms(self) -> float:
        """RMS distance of a repeat from the true mean of its posture [m]."""
        return float(np.linalg.norm(self.sd))

    @property
    def rms_residual(self) -> float:
        """RMS residual of the used records after calibration [m]."""
        return rms(np.linalg.norm(self.residuals, axis=1))

    @cached_property
    def rp(self) -> Array:
        """Pose repeatability RP of ISO 9283 for each posture with :data:`FEWEST_CYCLES` repeats
        [m]: mean distance from the barycentre plus three standard deviations of the distances.
        """
        distances = pd.Series(np.linalg.norm(self.deviations, axis=1)).groupby(self.posture)
        of_posture = distances.mean() + 3.0 * distances.std()
        return of_posture.to_numpy()[self.cycles >= FEWEST_CYCLES]

    @property
    def rp_of_references(self) -> float:
        """RP by the stated noise of the references alone [m] (Maxwell distribution); nan if not
        stated.
        """
        return RP_OF_NOISE * self.reference_u

    @property
    def elapsed(self) -> Array:
        """The clock of each repeat, minus its mean for the posture ``(n,)``."""
        clock = pd.Series(self.clock)
        return np.asarray(clock - clock.groupby(self.posture).transform("mean"))

    @cached_property
    def drift(self) -> Drift | None:
        """The drift, by Hotelling's T² with independent repeats of one covariance; None if the
        repeats are too few, or all of one time.
        """
        elapsed = self.elapsed
        elapsed_square = float(elapsed @ elapsed)
        dof = len(self.posture) - self.cycles.size - 1
        if dof < 3 or not elapsed_square:
            return None
        slope = elapsed @ self.deviations / elapsed_square
        residuals = self.deviations - np.outer(elapsed, slope)
        precision = np.linalg.pinv(residuals.T @ residuals, rcond=NO_VARIANCE, hermitian=True)
        ratio = elapsed_square * float(slope @ precision @ slope)
        p_value = float(f_sf(ratio * (dof - 2) / 3, 3, dof - 2))
        return Drift(slope * np.ptp(self.clock), p_value)

    def __str__(self) -> str:
        return f"{len(self.posture)} repeats of {count(self.cycles.size, 'posture')}"


def repeatability_of(fit: Fit) -> Repeatability | None:
    """None without repeats. Contacts with spheres and planes, measured along the normal alone, do
    not count.
    """
    records, conditions = fit.problem.measurements, fit.problem.measurements.conditions
    labels = {
        "posture": records.postures,
        "placed": records.placed,
        "seat": np.where(records.placed, "", conditions.labels("seat")),
        "marker": conditions.labels("marker"),
        "session": conditions.labels("session"),
    }
    used = fit.used & ~fit.observations.on_surface
    table = pd.DataFrame(labels)[used]
    table = table[table.duplicated(keep=False)]
    if table.empty:
        return None
    rows = table.index.to_numpy()
    posture = np.asarray(table.groupby([*labels], sort=False).ngroup(), dtype=np.intp)
    target = np.where(records.placed[:, None], records.reference, 0.0)
    deviations = pd.DataFrame((fit.point.prediction.tips - target)[rows])
    # The coordinates of a seat are one reference for all of its records.
    own_reference = records.placed & (fit.observations.seat < 0)
    u = np.where(own_reference[:, None], reference_u(records, fit.problem.setup, np.nan), np.nan)
    clock = records.row if conditions.time is None else conditions.time
    return Repeatability(
        posture=posture,
        deviations=(deviations - deviations.groupby(posture).transform("mean")).to_numpy(),
        clock=np.asarray(clock[rows], dtype=np.float64),
        is_timed=conditions.time is not None,
        residuals=fit.system.deviation[used],
        reference_u=float(np.sqrt(np.square(u[rows]).mean())),
    )
