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
    degrees of freedom and n what the group adds to these; Bonferroni's bound over the groups.
    """
    found = []
    for what, names, part in _groupings(choice.fit.problem.measurements, choice):
        gram = Gram(products_of(choice.design, part))
        whole = Projection(gram, choice.admitted)
        for number, name in enumerate(names):
            others = Projection(gram.without(number), choice.admitted)
            more = whole.dof - others.dof
            if more < 1.0 or others.dof < 1.0 or others.chi2 <= 0.0:
                continue
            ratio = max((whole.chi2 - others.chi2) / more, 0.0) / (others.chi2 / others.dof)
            p_value = min(1.0, len(names) * float(f_sf(ratio, more, others.dof)))
            if p_value < ODD:
                records = int(np.sum(choice.fit.used & (part == number)))
                found.append(OddGroup(f"{what} {name}", records, float(np.sqrt(ratio)), p_value))
    return sorted(found, key=lambda group: group.p_value)


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
