"""Records that determine the geometry best."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import report
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin._support.units import MM, UM
from aacmm_pin.calibration import (
    NO_SCATTER,
    Observability,
    ReferenceFrame,
    Setup,
    Target,
    remaining_triangle,
)
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import GivenRecords, as_measurements, seed_of
from aacmm_pin.planning.candidate_design import Situation
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.measurement_plan import PlanOfRecords
from aacmm_pin.planning.measurement_sheet import planned_records
from aacmm_pin.planning.optimal_design import chosen_records, d_optimality
from aacmm_pin.planning.plan import POOL_SIZE, PlannedScheme, prepared

CALIBRATION_PLAN_SCHEMA = "aacmm-pin/calibration-plan/1"
RANDOM = 20
"""Plans with random records, for comparison."""
EXCHANGE_ROUNDS = 10
"""Three or four suffice."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationPlan(PlanOfRecords):
    """Planned records for a calibration, with observability index and u.

    Attributes:
        o1: observability index O1 (Borm, Menq 1991) with the existing records.
        o1_random: the same of random records, ``(RANDOM,)``.
        u: standard uncertainty of the tip after calibration, RMS over all available postures [m].
        u_random: the same of random records ``(RANDOM,)`` [m].
        records, expected, measurements, existing, seed: see :class:`MeasurementPlan`.
    """

    o1: float
    o1_random: Array
    u: float
    u_random: Array

    @property
    def ratio(self) -> float:
        """O1 of the plan over the median of random plans."""
        return self.o1 / float(np.median(self.o1_random))

    def __str__(self) -> str:
        return str(report().plan_page.calibration_plan_line(self))

    def summary(self) -> dict[str, Any]:
        """Return the JSON content of schema ``aacmm-pin/calibration-plan/1``."""
        return {
            "schema": CALIBRATION_PLAN_SCHEMA,
            "o1": self.o1,
            "o1_random": self.o1_random.tolist(),
            "o1_ratio": self.ratio,
            "u_mm": self.u / MM,
            "u_random_mm": (self.u_random / MM).tolist(),
            **self.summary_of_records(),
        }


def plan_calibration(
    model: GivenModel,
    records: int = 40,
    *,
    existing: GivenRecords | None = None,
    scheme: PlannedScheme = "free",
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
    above: float | None = None,
    postures: int = POOL_SIZE,
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> CalibrationPlan:
    """Plan the records that determine the geometry best.

    The plan maximises the log determinant of the information of the arm's stated uncertainties, the
    existing and the planned records, whitened by their noise (Bayesian D-optimality: Chaloner,
    Verdinelli 1995, Statistical Science 10). It adds records one by one, then exchanges them until
    nothing improves (Fedorov 1972).

    Args:
        model: arm, perhaps with causes of error, which keep their values.
        records: number to plan.
        existing: records that also count.
        scheme, reference_frame, target, prior: see :func:`plan_measurements`, as for all others.

    Raises:
        UnknownNameError: unknown scheme or frame.
        MissingConditionError: existing records lack a condition that a cause needs.
        AacmmError: too few records or postures, records of another arm, an exact arm, or no noise.
    """
    model = ErrorModel.of(model).restricted_to_known_range()
    rng = rng or np.random.default_rng(1)
    existing = None if existing is None else as_measurements(existing, model.arm)
    seed = seed_of(rng)
    setup = Setup.of(
        model.arm,
        reference_frame,
        target,
        prior,
        encoder_noise,
        reference_noise,
        probe_noise,
        length_noise,
    )
    task, candidates, notes = prepared(
        model, (), existing, setup, scheme, records, postures, above, rng
    )
    setup = task.setup
    noise = np.r_[
        setup.encoder_noise,
        setup.probe_noise,
        setup.reference_noise if scheme == "free" else 0.0,
    ]
    if noise.max() < NO_SCATTER:
        raise AacmmError(
            f"all stated noise is below {NO_SCATTER / UM:g} µm or µrad; expected more; increase "
            "--encoder-noise, --probe-noise-mm or --u-reference-mm"
        )
    problem = task.problem(model, candidates)
    count = problem.vector.size
    if not count:
        raise AacmmError(
            f"{model.arm.name}: all parameters are exact; expected uncertain parameters; state "
            "half-widths, or use --no-prior"
        )
    situation = Situation.of(task, MeasurementConditions((), model), candidates, rng)
    with watched(range(records), progress, "plan", "record") as steps:
        rows = situation.rows
        score = d_optimality(rows)
        chosen = chosen_records(rows, situation.information, steps, score, EXCHANGE_ROUNDS)
    pool = problem.of(situation.pool)
    jacobian = pool.predict(pool.start, task.frame).jacobian[:, :, :count]
    tips = jacobian * situation.scales[:count]
    o1, u = _worth(situation, chosen, tips)
    random_choices = [rng.permutation(situation.pool.n)[:records].tolist() for _ in range(RANDOM)]
    worths = np.array([_worth(situation, choice, tips) for choice in random_choices])
    o1_random, u_random = worths.T
    return CalibrationPlan(
        **planned_records(task, situation, chosen),
        notes=notes,
        seed=seed,
        o1=o1,
        o1_random=o1_random,
        u=u,
        u_random=u_random,
    )


def _worth(situation: Situation, chosen: list[int], tips: Array) -> tuple[float, float]:
    """O1 of existing and chosen records, and RMS u of the tip after them [m].

    Args:
        tips: displacements by one unit of each parameter (n, 3, p) [m]. Parameters have the first
            columns of the rows, before frame and seats.
    """
    width = situation.nuisances
    others = width - tips.shape[2]
    prior, measured = np.split(situation.known, [width])
    chosen_rows = situation.rows[chosen].reshape(-1, width)
    # Columns of frame and seats first, for they are eliminated.
    data = np.roll(np.vstack([measured, chosen_rows]), others, axis=1)
    of_data = remaining_triangle(data, others)
    of_all = remaining_triangle(np.vstack([data, np.roll(prior, others, axis=1)]), others)
    o1 = Observability.of(of_data, len(chosen) + situation.before).o1
    root = tips @ np.linalg.inv(of_all)  # of the covariance, for that of parameters is R⁻¹ R⁻ᵀ
    variance = np.square(root).sum(axis=(1, 2))
    return o1, float(np.sqrt(variance.mean()))
