"""Records chosen one by one, then exchanged, and criteria of the choice."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.planning.separability import Pair, Separation

OTHER_DISTANCE_WEIGHT = 1e-3
"""Weight of the better determined direction: it decides among equals."""

Score = Callable[[Array], Array]
"""Value of each record as the next one (n,), from the present information (p, p)."""


def chosen_records(
    rows: Array, information: Array, steps: Iterable[int], score: Score, rounds: int
) -> list[int]:
    """Numbers of the records ``rows`` (n, 3, p) that are best beside ``information`` (p, p).

    Each of the ``steps`` adds one. Then each is exchanged for the best one, up to ``rounds`` times,
    until nothing changes (Fedorov 1972).
    """
    taken: list[int] = []

    def take_best() -> None:
        measured = rows[taken].reshape(-1, rows.shape[2])
        scores = score(information + measured.T @ measured)
        scores[taken] = -np.inf
        taken.append(int(np.argmax(scores)))

    for _ in steps:
        take_best()
    for _ in range(rounds):
        before = set(taken)
        for record in taken.copy():
            taken.remove(record)
            take_best()
        if set(taken) == before:
            break
    return taken


def d_optimality(rows: Array) -> Score:
    """Growth of the log determinant of the information by each record (n, 3, p): Bayesian
    D-optimality (Chaloner, Verdinelli 1995).
    """

    def score(information: Array) -> Array:
        factor = np.eye(3) + rows @ np.linalg.inv(information) @ rows.transpose(0, 2, 1)
        _, growth = np.linalg.slogdet(factor)
        return np.asarray(growth)

    return score


def t_optimality(
    rows: Array, blocks: Sequence[slice], sizes: Sequence[Array], pairs: Sequence[Pair]
) -> Score:
    """The smaller distance of the worst distinguished pair, if only these two act.

    The ``blocks`` are the last columns of the rows, one for each cause.
    """
    nuisances = rows.shape[2] - blocks[-1].stop
    columns = np.arange(rows.shape[2])
    nuisance_columns, cause_columns = np.split(columns, [nuisances])

    def score(information: Array) -> Array:
        one, other = pairs[0]
        if len(pairs) > 1:
            of_nuisances = information[:nuisances, :nuisances]
            shared = information[:nuisances, nuisances:]
            absorbed = shared.T @ np.linalg.solve(of_nuisances, shared)
            values, axes = np.linalg.eigh(information[nuisances:, nuisances:] - absorbed)
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T
            one, other = Separation.of(root, blocks, sizes).worst(pairs)
        first, second = cause_columns[blocks[one]], cause_columns[blocks[other]]
        acting = np.r_[nuisance_columns, first, second]
        pool = rows[:, :, acting]
        covariance = np.linalg.inv(information[np.ix_(acting, acting)])
        # Woodbury's identity updates the covariance for each record of the pool.
        by_record = pool @ covariance
        inverse = np.linalg.inv(np.eye(3) + by_record @ pool.transpose(0, 2, 1))
        middle = nuisances + first.size
        distances = []
        for cause, block in ((one, slice(nuisances, middle)), (other, slice(middle, acting.size))):
            of_cause = by_record[:, :, block]
            reduction = of_cause.transpose(0, 2, 1) @ inverse @ of_cause
            information_after = np.linalg.inv(covariance[block, block] - reduction)
            size = sizes[cause]
            distances.append(np.einsum("nij,jm,im->n", information_after, size, size))
        return np.asarray(np.minimum(*distances) + OTHER_DISTANCE_WEIGHT * np.maximum(*distances))

    return score
