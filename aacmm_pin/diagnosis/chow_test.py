"""Groups of records that do not agree with all others: a bar, a seat, a session, a marker that was set up badly."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import f_sf
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.covariates import FEWEST_GROUPS, FEWEST_RECORDS
from aacmm_pin.diagnosis.gram_matrix import Gram, products_of
from aacmm_pin.diagnosis.linear_model import Base, Conditional
from aacmm_pin.diagnosis.model_space import Blocks
from aacmm_pin.measurements.records import Measurements

ODD = 1e-4
"""Family-wise level at which a group counts as odd."""
BY_READINGS = (0.0, 0.25, 0.5, 0.75, 0.95)
"""Parts of a scatter that may be of the readings; not all, for these move some tips in one plane only."""


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
    """The groups that stand out when the causes are refitted without them, worst first; where structure over a covariate was
    found, when the geometry alone is.

    Chow's test (Econometrica 28, 1960): ``F = ((χ² - χ²₋) / n) / (χ²₋ / ν₋)`` with χ²₋ of the other records, ν₋ their
    degrees of freedom and n what the group adds to these; Bonferroni's bound over the groups. Where the noise of the
    encoders is not stated, both are compared with what the residuals of a group vary by: see :func:`_scatter`.
    """
    found, used, scatter = [], choice.fit.used, _scatter(choice)
    # A group that was set up badly may be what a covariate was found by.
    blocks = () if choice.covariates else choice.posterior.median
    design = choice.design.of(blocks)
    for what, names, part in _groupings(choice.fit.problem.measurements, choice):
        gram = Gram(products_of(design, part, choice.held.products.noise))
        whole = _beside(choice, gram, blocks)
        for number, name in enumerate(names):
            others = _beside(choice, gram.without(number), blocks)
            more = whole.dof - others.dof
            if more < 1.0 or others.dof < 1.0 or others.chi2 <= 0.0:
                continue
            ratio = max((whole.chi2 - others.chi2) / more, 0.0) / (others.chi2 / others.dof)
            (own, sure), (rest, of_rest) = (_mean(scatter[used & some]) for some in (part == number, part != number))
            chance = float(f_sf(ratio * rest / own, more * sure, others.dof * of_rest))
            if (p_value := min(1.0, len(names) * chance)) < ODD:
                records = int(np.sum(used & (part == number)))
                found.append(OddGroup(f"{what} {name}", records, float(np.sqrt(ratio)), p_value))
    return sorted(found, key=lambda group: group.p_value)


def _beside(choice: Choice, gram: Gram, blocks: Blocks) -> Conditional:
    """Some of the records beside the nuisances and these blocks, without the background."""
    left = choice.posterior.left
    return Conditional.of(Base(gram, 0.0), tuple(range(len(blocks))), left.widths[: len(blocks)], left.likelihood)


def _scatter(choice: Choice) -> Array:
    """Covariance of each whitened residual (n, 3, 3), up to a factor: one, where the noise of the encoders is stated.

    Else a part of the scatter, the likeliest of ``BY_READINGS``, is taken to be of the readings, whose errors move far tips
    more, and in few directions.
    """
    fit, alike = choice.design.fit, np.broadcast_to(np.eye(3), (len(choice.tips), 3, 3))
    used = fit.used & fit.observations.says
    if fit.problem.setup.encoder_noise is not None or not used.any():
        return alike
    whiten = choice.held.products.noise.whitening[:, :3, :3]
    off = choice.design.deviations(choice.tips)[:, :3]
    left = np.einsum("nij,nj->ni", whiten, off)[used]
    point = fit.solution.point
    by_reading = whiten @ fit.problem.reading_jacobian(point.x, point.frame)[:, :3]
    readings = by_reading @ by_reading.transpose(0, 2, 1)
    readings = readings * (3.0 / np.trace(readings[used], axis1=1, axis2=2).mean())
    likely = {}
    for share in BY_READINGS:
        mixed = (1.0 - share) * alike + share * readings
        chi2 = np.einsum("ni,nij,nj->", left, np.linalg.inv(mixed[used]), left)
        likely[-np.linalg.slogdet(mixed[used])[1].sum() - left.size * np.log(chi2)] = mixed
    return np.asarray(likely[max(likely)])


def _mean(scatter: Array) -> tuple[float, float]:
    """Mean variance of the residuals' coordinates, covariances (n, 3, 3); and as certain as which part of them it is.

    The part is ``(Σ tr C)² / (3 n Σ tr C²)`` (Satterthwaite 1946).
    """
    total, count = float(np.trace(scatter, axis1=1, axis2=2).sum()), 3 * len(scatter)
    return total / count, total**2 / (count * float(np.square(scatter).sum()))


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
