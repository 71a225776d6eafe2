"""Uncertainty of the distance between two touched points.

With the unit vector e between the points, sensitivities S and N (to the readings) at both ends,
covariance Σ of the parameters, and u_j of reading j (JCGM 100:2008, 5.2.2):

    u² = s Σ sᵀ + sum over j of u_j² [(e N_a)_j² + (e N_b)_j²],   s = e (S_b - S_a)

A parameter has the same error at both ends: only the difference of its effects counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, batch
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import MM, plain_mm
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources, omission
from aacmm_pin.accuracy.volume import expanded
from aacmm_pin.effects import ErrorModel, GivenModel, loaded
from aacmm_pin.errors import AacmmError

if TYPE_CHECKING:
    import pandas as pd

SHORTEST = 1e-9
"""Closer points have no direction between them [m]."""
MOST_PAIRS = 20_000_000
"""Of postures; so many take 0.5 GB."""


@dataclass(frozen=True, eq=False)
class LengthUncertainty(Shown):
    """The uncertainty of a distance, for all pairs of postures at its ends.

    Attributes:
        sources: parameters with an uncertainty.
        q_a, q_b: postures at the ends ``(n, nq)`` and ``(m, nq)`` [rad].
        length: the distance [m].
        contributions: change at each end for one u of each parameter, ``(n, p)`` and ``(m, p)``
            [m].
    """

    sources: ErrorSources
    q_a: Array
    q_b: Array
    length: float
    contributions: tuple[Array, Array]

    @cached_property
    def u(self) -> Array:
        """The standard uncertainty for each pair of postures, ``(n, m)`` [m]."""
        a, b = map(self.sources.independent, self.contributions)
        shared = self.sources.lasting
        variance_a = np.square(a).sum(axis=1)
        separate = variance_a[:, None] + np.square(b).sum(axis=1)
        shared_covariance = 2.0 * a[:, shared] @ b[:, shared].T
        return np.asarray(np.sqrt(np.maximum(separate - shared_covariance, 0.0)))

    def pair(self, number: int) -> tuple[int, int]:
        """Return the indices of a pair from its index in the flattened ``u``, such as
        ``u.argmin()``.
        """
        a, b = np.unravel_index(number, self.u.shape)
        return int(a), int(b)

    def budget(self, by: str = "parameter") -> pd.DataFrame:
        """Return shares in the mean variance over all pairs, as
        :meth:`AccuracyVolume.budget`.
        """
        a, b = self.contributions
        shared = self.sources.lasting
        cross_products = np.outer(a.mean(axis=0) * shared, b.mean(axis=0) * shared)
        mean_products = a.T @ a / len(a) + b.T @ b / len(b)
        mean_products -= cross_products + cross_products.T
        return self.sources.budget(mean_products, by)

    def __str__(self) -> str:
        sources = self.sources
        length = f"a length of {plain_mm(self.length)} mm"
        pairs = f"{len(self.q_a)} postures at A and {len(self.q_b)} at B"
        measures = f"{sources.arm.name} at {sources.at} measures {length}"
        of_pairs = f"Over all pairs of {pairs}, {expanded(self.u)}"
        return f"{measures}. {of_pairs}{omission(sources.not_included)}"


def length_uncertainty(
    model: GivenModel,
    q_a: ArrayLike,
    q_b: ArrayLike,
    *,
    at: str | None = None,
    encoder_noise: ArrayLike | None = None,
) -> LengthUncertainty:
    """Compute the uncertainty of the distance of two points, for all pairs of postures there.

    Args:
        model: arm, perhaps with causes of error; those that depend on conditions are ignored.
        q_a, q_b: postures at each of the two points, ``(n, nq)`` and ``(m, nq)`` [rad].
        at, encoder_noise: see :func:`accuracy_volume`.

    Raises:
        ShapeError: not finite arrays with nq columns.
        AacmmError: no uncertainty, negative noise, coinciding points, no pair, or too many.
    """
    model = loaded(model)
    arm = ErrorModel.arm_of(model)
    ends = batch(q_a, arm.nq, "q_a", "rad"), batch(q_b, arm.nq, "q_b", "rad")
    n, m = map(len, ends)
    if not 1 <= n * m <= MOST_PAIRS:
        raise AacmmError(f"{n} × {m} pairs of postures; expected 1 to {MOST_PAIRS} pairs")
    sources = ErrorSources.of(model, at, encoder_noise, ends[0], None)
    first, second = (arm.positions(q[:1], sources.at)[0] for q in ends)
    length = float(np.linalg.norm(second - first))
    if length < SHORTEST:
        raise AacmmError(f"the points are {length / MM:g} mm apart; expected two different points")
    direction = (second - first) / length
    along_a, along_b = (sources.u * (direction @ sources.sensitivity(q)) for q in ends)
    return LengthUncertainty(sources, *ends, length, (along_a, along_b))
