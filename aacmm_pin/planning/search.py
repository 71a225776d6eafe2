"""A sequential design: records chosen one by one from a pool, the best first, by updates of rank
three of an inverse.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.planning.detection_power import Size

OTHER_DISTANCE_WEIGHT = 1e-3
"""Weight of the better determined direction, which only decides among records that are equal in the
worse one.
"""

Score = Callable[["SequentialDesign"], Array]
"""What each record of the pool would be worth if it came next (n,)."""


class SequentialDesign:
    """The state of a choice: which records of a pool are taken, and the covariance of all unknowns
    that they leave.

    Attributes:
        pool: whitened rows of the candidates (n, 3, p).
        covariance: of the unknowns with what is taken (p, p).
        taken: numbers of the records taken.
    """

    def __init__(self, pool: Array, information: Array) -> None:
        self.pool, self.information = pool, information
        self.covariance = np.linalg.inv(information)
        self.taken: list[int] = []
        self.seen = pool @ self.covariance
        self.free: Mask = np.ones(len(pool), dtype=bool)

    @property
    def scatter(self) -> Array:
        """Covariance of each record as predicted, its noise being one (n, 3, 3)."""
        of_unknowns = self.seen @ self.pool.transpose(0, 2, 1)
        return np.eye(3) + of_unknowns

    def take(self, record: int) -> None:
        """One more record: ``Σ - Σ Aᵀ (I + A Σ Aᵀ)⁻¹ A Σ`` (Woodbury), and the same for what the
        pool sees of it.
        """
        rows = self.pool[record]
        seen = self.seen[record].copy()
        gain = np.linalg.solve(np.eye(3) + seen @ rows.T, seen)
        self.covariance = self.covariance - seen.T @ gain
        self.seen = self.seen - (self.pool @ seen.T) @ gain
        self.taken.append(record)
        self.free[record] = False

    def drop(self, record: int) -> None:
        """One record less, computed anew: an update back would lose the information of a record
        with little noise.
        """
        self.taken.remove(record)
        self.free[record] = True
        rows = self.pool[self.taken].reshape(-1, self.pool.shape[2])
        self.covariance = np.linalg.inv(self.information + rows.T @ rows)
        self.seen = self.pool @ self.covariance

    def run(self, count: int, score: Score, steps: Iterable[int] | None = None) -> None:
        """Take the best record ``count`` times."""
        for _ in range(count) if steps is None else steps:
            self.take(self._best(score))

    def exchange(self, score: Score) -> None:
        """Look once at every record taken, and take the one instead that does better when all
        others stay.
        """
        for record in list(self.taken):
            self.drop(record)
            self.take(self._best(score))

    def _best(self, score: Score) -> int:
        scores = np.where(self.free, score(self), -np.inf)
        return int(np.argmax(scores))


def t_optimality(one: Index, other: Index, sizes: tuple[Size, Size]) -> Score:
    """The smaller of the two distances of a pair of causes, columns ``one`` and ``other``, after
    one more record.
    """

    def score(choice: SequentialDesign) -> Array:
        inverse = np.linalg.inv(choice.scatter)
        distances = []
        for columns, size in ((one, sizes[0]), (other, sizes[1])):
            seen = choice.seen[:, :, columns]
            before = choice.covariance[np.ix_(columns, columns)]
            after = np.linalg.inv(before - seen.transpose(0, 2, 1) @ inverse @ seen)
            distances.append(np.einsum("nij,jm,im->n", after, size.factor, size.factor))
        return np.asarray(np.minimum(*distances) + OTHER_DISTANCE_WEIGHT * np.maximum(*distances))

    return score


def d_optimality(choice: SequentialDesign) -> Array:
    """Information of a record about all unknowns together: log determinant, Bayesian D-optimality
    (Chaloner, Verdinelli 1995).
    """
    return np.asarray(np.linalg.slogdet(choice.scatter)[1])
