"""Sufficient statistics: whitened inner products of residuals, nuisances and candidate columns, part by part.

Everything that choosing among causes needs, a projection, a score, an evidence, a held-out prediction, is arithmetic on
these inner products, so that trying another set of causes costs next to nothing. The nuisances are what is refitted
anyway: geometry with its prior, the reference frame; the unknown points of the observations are projected out of the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aacmm_pin.calibration.columns import Columns
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.checks import Array, Index
from aacmm_pin.diagnosis.library import Candidate, Covariate
from aacmm_pin.observations import Observation

TYPICAL_STRUCTURE = 2e-5
"""Usual size at the tip of what no cause explains [m]."""


@dataclass(frozen=True, eq=False)
class Block:
    """Columns that are admitted together: one variant of a candidate, or the smooth functions of a covariate.

    Attributes:
        candidate: number of the candidate.
        variant: number of the variant.
        columns: which columns.
        typical: usual magnitude of each column's parameter (q,).
    """

    candidate: int
    variant: int
    columns: slice
    typical: Array


@dataclass(frozen=True, eq=False)
class Design:
    """Columns of all that is considered, at the point where a calibration ended.

    Attributes:
        fit: the calibration.
        names: label of each candidate; covariates after the causes.
        causes: number of causes of the library among them.
        blocks: their columns.
        nuisances: number of nuisance columns, which come first.
        scales: by which each column was multiplied, so that all are of one order (columns,).
        jacobian: (n, 3, columns) [m].
        kept: which of the fit's own parameters are nuisances.
        tips: (n, 3), in the frame of the references, the causes taken out that are candidates here [m].
    """

    fit: Fit
    names: tuple[str, ...]
    causes: int
    blocks: tuple[Block, ...]
    nuisances: int
    scales: Array
    jacobian: Array
    kept: Index
    tips: Array


def design_of(fit: Fit, library: Sequence[Candidate], others: Sequence[Covariate], taken_out: int = 0) -> Design:
    """The columns of every candidate in the arm as calibrated.

    Args:
        fit: the calibration.
        library: causes to consider.
        others: covariates that anything else may depend on.
        taken_out: so many of the estimated effects, the last ones, are no nuisances but candidates: what they do is taken
            out of the tips, so that they can be chosen again or not.
    """
    problem, point = fit.problem, fit.solution.point
    frame = point.frame
    width = sum(len(e.terms) for e in problem.estimated)
    stays = width - sum(len(e.terms) for e in problem.estimated[len(problem.estimated) - taken_out :])
    own = point.prediction.jacobian
    kept = np.concatenate([np.arange(stays), np.arange(width, own.shape[2])])
    tips = point.prediction.tips - own[:, :, stays:width] @ point.x[stays:]
    given = (*problem.model.effects, *problem.effects(point.x))
    variants = [variant for candidate in library for variant in candidate.variants]
    columns = Columns.of(problem.model.arm, problem.measurements.q, problem.measurements.conditions, (*given, *variants))
    values = [v for effect in given for v in effect.values]
    state = columns.at(np.concatenate([values, np.zeros(sum(len(v.terms) for v in variants))]))
    of_variants = columns.jacobian(state)[:, :, len(values) :]
    if problem.external:
        of_variants = frame.rotation @ of_variants
    parts = [own[:, :, kept], of_variants]
    blocks: list[Block] = []
    first = nuisances = kept.size
    scales = [problem.scales[kept]]
    for number, candidate in enumerate(library):
        for which, variant in enumerate(candidate.variants):
            typical = np.array([t.typical for t in variant.terms])
            blocks.append(Block(number, which, slice(first, first + typical.size), np.ones(typical.size)))
            scales.append(typical)
            first += typical.size
    for number, covariate in enumerate(others, start=len(library)):
        axes = frame.rotation @ state.rotation[-1] if covariate.of_target else np.broadcast_to(np.eye(3), (len(own), 3, 3))
        smooth = np.einsum("nm,nij->nimj", covariate.functions, axes).reshape(len(own), 3, -1)
        parts.append(smooth)
        blocks.append(Block(number, 0, slice(first, first + smooth.shape[2]), np.ones(smooth.shape[2])))
        scales.append(np.full(smooth.shape[2], TYPICAL_STRUCTURE))
        first += smooth.shape[2]
    names = (*(candidate.label for candidate in library), *(covariate.name for covariate in others))
    scale = np.concatenate(scales)
    jacobian = np.concatenate(parts, axis=2) * scale
    return Design(fit, names, len(library), tuple(blocks), nuisances, scale, jacobian, kept, tips)


@dataclass(frozen=True, eq=False)
class Gram:
    """Inner products of all columns and, last, the residual.

    Attributes:
        products: (columns + 1, columns + 1).
        free: rows less the unknown points that were projected out.
    """

    products: Array
    free: int

    def __add__(self, other: Gram) -> Gram:
        return Gram(self.products + other.products, self.free + other.free)

    def __sub__(self, other: Gram) -> Gram:
        return Gram(self.products - other.products, self.free - other.free)


def prior_of(design: Design) -> Gram:
    """What is known of the nuisances beforehand, as rows."""
    problem, x = design.fit.problem, design.fit.solution.point.x
    size = design.jacobian.shape[2] + 1
    own = design.kept[design.kept < x.size]
    rows = np.zeros((own.size, size))
    rows[:, : own.size] = np.eye(own.size)
    rows[:, -1] = ((x - problem.start) / problem.widths)[own]
    return Gram(rows.T @ rows, 0)


def grams_of(design: Design, part: Index) -> list[Gram]:
    """Inner products of the used records of each part; an observation with unknown points belongs to one part whole.

    Args:
        design: the columns.
        part: number of the part of each record, from 0 (n,).
    """
    fit = design.fit
    count = int(part.max(initial=0)) + 1
    size = design.jacobian.shape[2] + 1
    totals = [np.zeros((size, size)) for _ in range(count)]
    free = [0] * count
    for observation, values in zip(fit.observations, fit.solution.point.nuisances, strict=True):
        used = fit.used[observation.records]
        if not used.any():
            continue
        whiten = np.linalg.inv(np.linalg.cholesky(fit.noise[observation.records] + observation.covariance()))
        if not observation.unknowns:
            for number in range(count):
                mine = used & (part[observation.records] == number)
                if mine.any():
                    rows = _rows(design, observation.records[mine], whiten[mine], _off(design, observation, values)[mine])
                    totals[number] += rows.T @ rows
                    free[number] += len(rows)
            continue
        rows = _projected(design, observation, values, whiten, used)
        number = int(part[observation.records[used]][0])
        totals[number] += rows.T @ rows
        free[number] += len(rows) - observation.unknowns
    return [Gram(products, rows) for products, rows in zip(totals, free, strict=True)]


def _off(design: Design, observation: Observation, values: Array) -> Array:
    return np.asarray(design.tips[observation.records] - observation.targets(values)[0])


def _rows(design: Design, records: Index, whiten: Array, off: Array) -> Array:
    """Whitened columns and residual of some records (3 m, columns + 1)."""
    columns = whiten @ design.jacobian[records]
    residual = np.einsum("nij,nj->ni", whiten, off)
    return np.concatenate([columns.reshape(3 * len(records), -1), residual.reshape(-1, 1)], axis=1)


def _projected(design: Design, observation: Observation, values: Array, whiten: Array, used: NDArray[np.bool_]) -> Array:
    """The same with the observation's unknown points at their best, whatever the columns do."""
    records = observation.records[used]
    rows = _rows(design, records, whiten[used], _off(design, observation, values)[used])
    tie, by_tie = observation.ties(values)
    tied = np.zeros((tie.size, rows.shape[1]))
    tied[:, -1] = tie
    rows = np.vstack([rows, tied])
    by = np.vstack([-(whiten[used] @ observation.targets(values)[1][used]).reshape(-1, values.size), by_tie])
    q, _ = np.linalg.qr(by)
    return np.asarray(rows - q @ (q.T @ rows))
