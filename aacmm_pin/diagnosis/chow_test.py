"""Groups of records that do not agree with all others: a bar, a seat, a session, a marker that was set up badly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import f_sf
from aacmm_pin.diagnosis.covariates import FEWEST_GROUPS, FEWEST_RECORDS
from aacmm_pin.diagnosis.gram_matrix import Gram, products_of
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.diagnosis.nuisance_projection import Projection
from aacmm_pin.measurements.records import Measurements

ODD = 1e-4
"""Family-wise level at which a group counts as odd."""


@dataclass(frozen=True)
class OddGroup(Shown):
    """A group whose records are farther off than the others let expect.

    Attributes:
        name: such as ``bar left``.
        records: how many it has.
        times: by how much its records, predicted by the others, are farther off than those are from one another.
        p_value: chance of that in a good set, for the best of all groups.
    """

    name: str
    records: int
    times: float
    p_value: float


def odd_groups(choice: Choice) -> list[OddGroup]:
    """The groups that stand out when all that was admitted is refitted without them, worst first.

    Chow's test (Econometrica 28, 1960): ``F = ((χ² - χ²₋) / n) / (χ²₋ / ν₋)`` with χ²₋ of the other records, ν₋ their
    degrees of freedom and n what the group adds to these; Bonferroni's bound over the groups. Where the noise of the
    encoders is not stated, all of the scatter may be theirs: see :func:`_by_readings`.
    """
    found, used = [], choice.fit.used
    design, admitted = choice.design.of(sorted(choice.admitted)), tuple(range(len(choice.admitted)))
    for what, names, part in _groupings(choice.fit.problem.measurements, choice):
        gram = Gram(products_of(design, part))
        whole = Projection(gram, admitted)
        for number, name in enumerate(names):
            others = Projection(gram.without(number), admitted)
            more = whole.dof - others.dof
            if more < 1.0 or others.dof < 1.0 or others.chi2 <= 0.0:
                continue
            ratio = max((whole.chi2 - others.chi2) / more, 0.0) / (others.chi2 / others.dof)
            chance = float(f_sf(ratio, more, others.dof))
            if choice.fit.problem.setup.encoder_noise is None:
                (own, sure), (rest, of_rest) = (
                    _by_readings(choice, used & some) for some in (part == number, part != number)
                )
                chance = max(chance, float(f_sf(ratio * rest / own, more * sure, others.dof * of_rest)))
            if (p_value := min(1.0, len(names) * chance)) < ODD:
                records = int(np.sum(used & (part == number)))
                found.append(OddGroup(f"{what} {name}", records, float(np.sqrt(ratio)), p_value))
    return sorted(found, key=lambda group: group.p_value)


def _by_readings(choice: Choice, some: NDArray[np.bool_]) -> tuple[float, float]:
    """What some records (n,) scatter by if it is all by their readings, whose errors move far tips, and in few directions.

    Returns:
        Mean square of a whitened coordinate, one rad of noise in each encoder; and as certain as which part of all the
        coordinates it is: ``(Σ tr C)² / (3 n Σ tr C²)`` with the covariance C of each record (Satterthwaite 1946).
    """
    whiten = choice.fit.noise.whitening[some]
    each = whiten @ choice.fit.problem.reading_covariance[some].sum(axis=1) @ whiten.transpose(0, 2, 1)
    total, count = float(np.trace(each, axis1=1, axis2=2).sum()), 3 * len(each)
    return total / count, total**2 / (count * float(np.square(each).sum()))


def _groupings(records: Measurements, choice: Choice) -> Iterator[tuple[str, list[str], Index]]:
    """Ways to divide the records: their name, the groups, and the group of each record (n,)."""
    free = not records.known.any()
    labels: list[tuple[str, NDArray[Any] | None]] = [
        ("bar", records.bar if free else None),
        ("seat", records.conditions.seat if free and records.bar is None else None),
        ("session", records.conditions.session),
        ("marker", records.conditions.marker),
    ]
    for what, known in labels:
        if known is None:
            continue
        names, part = np.unique(known, return_inverse=True)
        used = np.bincount(part, weights=choice.fit.used)
        if len(names) >= FEWEST_GROUPS and used.min() > FEWEST_RECORDS:
            yield what, [str(name) for name in names], part.astype(np.intp)
