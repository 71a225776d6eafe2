"""Whether records that follow each other share an error: of a joint, or of the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

FEWEST_IN_ORDER = 30
"""With fewer records the limits of chance are too wide to be of use."""
LEAST_PART_OF_LEVER = 1e-3
"""A joint says nothing of records that it displaces by less than this part of its largest
displacement.
"""


@dataclass(frozen=True)
class RunOrder(Shown):
    """Records that follow each other in time share an error.

    Attributes:
        joint: row of the joint whose error they share; None for a displacement of the tip in the
            room.
        correlation: lag-1 autocorrelation of the whitened residuals along the displacement by the
            joint, or along the axes of the room.
        limit: 95 % limit of the correlation if the records share nothing.
        p_value: chance of such a correlation at any joint or at the tip if they share nothing.
        records: how many have a residual along that displacement.
    """

    joint: int | None
    correlation: float
    limit: float
    p_value: float
    records: int

    @property
    def note(self) -> Note:
        """Note that consecutive records share an error."""
        data = {"correlation": self.correlation, "limit": self.limit}
        if self.joint is None:
            return Note("run_order_of_tip", data)
        return Note("run_order_of_joint", {"joint": self.joint, **data})

    def __str__(self) -> str:
        return str(self.note)


def run_order_of(choice: Choice) -> RunOrder | None:
    """The joint, or the tip, with the largest autocorrelation in the order of time, else of the
    rows; None if it is not significant.

    For independent residuals of n records, the lag-1 autocorrelation has a standard deviation of
    ``1/√n`` (Bartlett 1946, J. R. Stat. Soc. B 8).
    """
    residuals_by_joint = [*signed_residuals(choice).items()]
    run_orders = []
    for joint, residuals in residuals_by_joint:
        finite_residuals = residuals[np.isfinite(residuals).all(axis=1)]
        if len(finite_residuals) < FEWEST_IN_ORDER:
            continue
        centred = finite_residuals - finite_residuals.mean(axis=0)
        correlation = float((centred[1:] * centred[:-1]).sum() / np.square(centred).sum())
        numbers = centred.size
        p_value = float(chi2_sf(numbers * correlation**2, 1)) * len(residuals_by_joint)
        limit = float(ndtri(0.975) / np.sqrt(numbers))
        run_orders.append(
            RunOrder(joint, correlation, limit, min(p_value, 1.0), len(finite_residuals))
        )
    significant = [
        run_order
        for run_order in run_orders
        if run_order.correlation > 0.0 and run_order.p_value < THRESHOLDS.left
    ]
    return min(significant, key=lambda run_order: run_order.p_value, default=None)


def signed_residuals(choice: Choice) -> dict[int | None, Array]:
    """Whitened residuals of the used records beyond all that was found, in the order of time: of
    each joint along its displacement (n, 1), nan if it has none; of the tip (n, 3) under None.
    """
    fit = choice.design.fit
    records = fit.problem.measurements
    order = records.order_in_time
    order = order[choice.fit.used[order]]
    residuals = choice.whitened_deviations[order]
    displacements = choice.noise.whitening[order, :3, :3] @ choice.design.of_angles[order, :3]
    residuals_by_joint: dict[int | None, Array] = {None: residuals}
    for number, joint_row in enumerate(fit.problem.model.arm.chain.moving_rows()):
        levers = np.linalg.norm(displacements[:, :, number], axis=1)
        is_displaced = levers > LEAST_PART_OF_LEVER * levers.max(initial=0.0)
        along = np.einsum("ni,ni->n", displacements[:, :, number], residuals)
        signed = along / np.where(is_displaced, levers, 1.0)
        residuals_by_joint[int(joint_row)] = np.where(is_displaced, signed, np.nan)[:, None]
    return residuals_by_joint
