"""Groups of records that do not agree with all others: a bar, a seat, a session, a marker that was
set up badly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import f_sf
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.gram_matrix import Gram, gram_of
from aacmm_pin.diagnosis.linear_model import Base, Conditional, Members
from aacmm_pin.diagnosis.model_space import Blocks
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import Measurements


@dataclass(frozen=True)
class OddGroup(Shown):
    """A group whose records are farther off than the others let expect.

    Attributes:
        name: such as ``bar left``.
        records: how many it has.
        times: by how much its records, predicted by the others, are farther off than those are from
            one another.
        p_value: chance of that in a good set, for the best of all groups.
    """

    name: str
    records: int
    times: float
    p_value: float


class Grouping(NamedTuple):
    """A way to divide the records: its name, the names of the groups, and the group of each record
    (n,).
    """

    what: str
    names: list[str]
    part: Index


def odd_groups(choice: Choice) -> list[OddGroup]:
    """The groups that stand out when the causes are refitted without them, worst first; where
    structure over a covariate was found, when the geometry alone is.

    Chow's test (Econometrica 28, 1960): ``F = ((χ² - χ²₋) / n) / (χ²₋ / ν₋)`` with χ²₋ of the other
    records, ν₋ their degrees of freedom and n what the group adds to these; Bonferroni's bound over
    the groups. Both are compared with what the residuals of a group vary by, for errors of readings
    move far tips more, and in few directions.
    """
    groupings = _groupings(choice.fit.problem.measurements, choice)
    tested = [group for grouping in groupings for group in _tested(choice, grouping)]
    odd = [group for group in tested if group.p_value < THRESHOLDS.odd]
    return sorted(odd, key=lambda group: group.p_value)


def _tested(choice: Choice, grouping: Grouping) -> Iterator[OddGroup]:
    """Chow's test of every group that adds to the others."""
    scatter = _scatter(choice)
    # A group that was set up badly may be what a covariate was found by.
    blocks = () if choice.covariates else choice.posterior.median
    design = choice.design.of(blocks)
    parts = [grouping.part == number for number in range(len(grouping.names))]
    gram = gram_of(design, choice.noise, parts)
    used = choice.fit.used
    of_all = _without_background(choice, gram, blocks)
    for name, mine in zip(grouping.names, parts, strict=True):
        without = gram.without(gram_of(design, choice.noise, [mine]))
        others = _without_background(choice, without, blocks)
        more = of_all.dof - others.dof
        if more < 1.0 or others.dof < 1.0 or others.chi2 <= 0.0:
            continue
        ratio = max((of_all.chi2 - others.chi2) / more, 0.0) / (others.chi2 / others.dof)
        of_group = _spread(scatter[used & mine])
        of_others = _spread(scatter[used & ~mine])
        f_ratio = ratio * of_others.variance / of_group.variance
        chance = float(f_sf(f_ratio, more * of_group.certainty, others.dof * of_others.certainty))
        p_value = min(1.0, len(grouping.names) * chance)
        records = int(np.sum(used & mine))
        yield OddGroup(f"{grouping.what} {name}", records, float(np.sqrt(ratio)), p_value)


def _without_background(choice: Choice, gram: Gram, blocks: Blocks) -> Conditional:
    """Some of the records beside the nuisances and these blocks, without the background."""
    model = choice.posterior.median_model
    widths = model.widths[: len(blocks)]
    members = Members(Base(gram, 0.0), tuple(range(len(blocks))))
    return Conditional(members, widths, model.likelihood)


def _scatter(choice: Choice) -> Array:
    """Covariance of each residual beside all that was found, in units of the noise (n, 3, 3)."""
    whitening = choice.noise.whitening[:, :3, :3]
    covariances = choice.scatter_left.covariances[:, :3, :3]
    return np.asarray(whitening @ covariances @ whitening.transpose(0, 2, 1))


class Spread(NamedTuple):
    """Mean variance of coordinates of residuals; the part of them that, if all were alike, would
    state it as well.
    """

    variance: float
    certainty: float


def _spread(scatter: Array) -> Spread:
    """Of residuals with covariances (n, 3, 3); the part is ``(Σ tr C)² / (3 n Σ tr C²)``
    (Satterthwaite 1946).
    """
    count = 3 * len(scatter)
    total = float(np.trace(scatter, axis1=1, axis2=2).sum())
    squares = float(np.square(scatter).sum())
    return Spread(total / count, total**2 / (count * squares))


def _groupings(records: Measurements, choice: Choice) -> Iterator[Grouping]:
    """Ways to divide the records into enough groups with enough records."""
    conditions = records.conditions
    labels = {"bar": records.bar, "seat": conditions.seat if records.bar is None else None}
    if records.known.any():
        labels = {}
    labels |= {"session": conditions.session, "marker": conditions.marker}
    for what, label_of_record in labels.items():
        if label_of_record is None:
            continue
        names, part = np.unique(label_of_record, return_inverse=True)
        used = np.bincount(part, weights=choice.fit.used)
        if len(names) >= THRESHOLDS.fewest_groups and used.min() > THRESHOLDS.fewest_records:
            yield Grouping(what, [str(name) for name in names], part.astype(np.intp))
