"""The posterior over sets of blocks against quadrature, dense covariance matrices and all subsets.

Its order of records, causes and covariates does not matter: tests/hostile/test_invariance.py.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blind.regimes import regime_file
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.linalg import null_space

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis.candidates import Variants, candidates
from aacmm_pin.diagnosis.covariates import Covariate, covariates
from aacmm_pin.diagnosis.design_matrix import Block, Design, design_of
from aacmm_pin.diagnosis.gram_matrix import Gram, gram_of
from aacmm_pin.diagnosis.model_space import Candidates, ModelSpace, ModelState
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.search import explore
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from tests.diagnosis.dense_posterior import AMPLITUDES, WIDTHS, Dense, by_quadrature
from tests.few_causes import NO_WAVES
from tests.oracle import close

Array = NDArray[np.float64]
NOTHING: Any = None
NATS = 1e-6
"""Agreement of log posteriors that differ by rounding alone: they are of a few hundred, products of
up to 1e10.
"""


def space_of(dense: Dense, covariate_blocks: int = 0) -> ModelSpace:
    """The package's posterior of the same rows; the last blocks are of covariates."""
    owners = list(range(len(dense.columns))) if dense.owners is None else list(dense.owners)
    z = dense.nuisances.shape[1]
    ends = z + np.cumsum([0, *(c.shape[1] for c in dense.columns)])
    blocks = tuple(
        Block(c, 0, slice(int(ends[k]), int(ends[k + 1])), None, k in dense.positive)
        for k, c in enumerate(owners)
    )
    names = tuple(str(c) for c in range(max(owners) + 1))
    causes, width = len(names) - covariate_blocks, int(ends[-1])
    none = np.empty(0, int)
    design = Design(
        NOTHING, names, causes, blocks, (), z, np.ones(width), NOTHING, none, dense.prior, NOTHING
    )
    rows = np.column_stack([dense.nuisances, *dense.columns, dense.residual])
    places = np.arange(len(names)) if dense.places is None else np.array(dense.places)
    free = np.isin(np.arange(len(names)), list(dense.alone))
    follows = np.full(free.size, -1)
    none_of_blocks = np.full(len(blocks), np.nan)
    candidates = Candidates(design, dense.log_odds, places, free, follows, none_of_blocks)
    return ModelSpace(candidates, gram_of_rows(design, NOTHING, rows), dense.stated)


def gram_of_rows(design: Design, noise: RecordNoise, rows: Array) -> Gram:
    """Inner products of explicit rows, the residual last, and of what is known of the nuisances."""
    prior = np.zeros((len(design.prior), rows.shape[1]))
    prior[:, [*range(design.nuisances), -1]] = design.prior
    return Gram(design, noise, rows.T @ rows + prior.T @ prior, len(rows))


def made(
    columns: Sequence[Array],
    residual: Array,
    stated: bool,
    nuisances: Array | None = None,
    **more: Any,
) -> Dense:
    """Rows with a constant as nuisance, unless others are given, and candidates with a probability
    of 1, 1/2, 1/3, …
    """
    n = len(residual)
    nuisances = np.ones((n, 1)) if nuisances is None else nuisances
    log_odds = -np.log(np.arange(len(columns)) + 1.0) - np.log(3.0)
    prior = np.zeros((0, nuisances.shape[1] + 1))
    none = np.zeros((n, 0))
    return Dense(nuisances, columns, residual, log_odds, stated, none, prior, **more)


def widths_of(state: ModelState) -> Array:
    return WIDTHS[list(state.widths)]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("noise", [0.4, 1.0, 2.5])
def test_marginal_likelihood_by_quadrature(stated, noise):
    """Blocks of one and two parameters beside two nuisances, of eleven rows."""
    rng = np.random.default_rng(5)
    nuisances = np.column_stack([np.ones(11), rng.normal(size=11)])
    columns = [rng.normal(size=(11, 1)), rng.normal(size=(11, 2))]
    residual = columns[0][:, 0] + 0.5 * columns[1][:, 1] + noise * rng.normal(size=11)
    dense = made(columns, residual, stated, nuisances)
    space = space_of(dense)
    states = [
        ModelState((), (), 0),
        ModelState((0,), (1,), 0),
        ModelState((0,), (4,), 0),
        ModelState((1,), (3,), 0),
    ]
    found = [space.log_posterior(state) for state in states]
    expected = [by_quadrature(dense, state.blocks, widths_of(state)) for state in states]
    close(np.subtract(found, found[0]), np.subtract(expected, expected[0]), NATS)


@dataclass(frozen=True, eq=False)
class Measured:
    """A calibration of a blind file, and what is considered behind what it leaves."""

    fit: Fit
    library: tuple[Variants, ...]
    others: tuple[Covariate, ...]
    stated: bool

    @staticmethod
    def of(folder: Path, seed: int, stated: bool, **given: object) -> Measured:
        file = regime_file(
            seed, faults=2, outliers=0.0, own_u=False, torque=False, environment=False, **given
        )
        file.write(folder)
        arm = Arm.load(file.words(folder)[0])
        measurements = Measurements.read(folder / "data.csv", arm.nq)
        noises = (
            {"encoder_noise": file.encoder_u, "reference_noise": file.regime.reference_u}
            if stated
            else {}
        )
        frame = "external" if file.external else "base"
        setup = Setup.of(
            arm, reference_frame=frame, probe_noise=noises.get("reference_noise"), **noises
        )
        problem = problem_of(ErrorModel.of(arm), measurements, ["geometry"], setup)
        library = candidates(ErrorModel.of(arm), measurements, problem)
        others = covariates(arm, measurements)[::3]  # all of them have thousands of columns
        return Measured(fit(problem), tuple(library), tuple(others), stated)

    @cached_property
    def space(self) -> ModelSpace:
        design = design_of(self.fit, self.library, self.others)
        whitening = self.fit.noise.whitening
        noise = RecordNoise(whitening, np.arange(len(whitening)), np.ones(len(whitening)))
        return ModelSpace(Candidates.of(design, self.library), gram_of(design, noise), self.stated)


FILES: list[dict[str, Any]] = [
    {
        "seed": 1,
        "stated": True,
        "arm": "sino6",
        "evidence": "free",
        "records": 60,
        "external": True,
    },
    {
        "seed": 2,
        "stated": False,
        "arm": "standard-dh",
        "evidence": "seats",
        "records": 48,
        "external": False,
    },
]


@pytest.fixture(scope="module", params=FILES, ids=["frame of the references", "seats"])
def measured(request, tmp_path_factory) -> Measured:
    with NO_WAVES if request.param["external"] else contextlib.nullcontext():
        return Measured.of(tmp_path_factory.mktemp("file"), **request.param)


def rows_of(space: ModelSpace) -> Array:
    """The whitened rows, the residual last; unknown points are taken out by the rows' own null
    space.
    """
    design = space.candidates.design
    at, points = design.fit.observations, design.fit.point.seats
    mine = np.flatnonzero(design.fit.used & at.has_target)
    off = at.deviations(design.tips, points)[mine, :, None]
    whitening = space.gram.noise.whitening
    raw = whitening[mine] @ np.concatenate([design.rows(mine), off], axis=2)
    rows = raw.reshape(3 * mine.size, -1)
    touched = sorted({int(k) for k in at.seat[mine] if k >= 0})
    if not touched:
        return np.asarray(rows)
    by_seat = np.zeros((mine.size, 3, len(at.labels), 3))
    for number, record in enumerate(mine):
        if at.seat[record] >= 0:
            by_seat[number, :, at.seat[record]] = -whitening[record]
    derivative = by_seat.reshape(3 * mine.size, -1)
    stated = [k for k in touched if at.is_stated[k]]
    ties = np.zeros((3 * len(stated), rows.shape[1]))
    by_ties = np.zeros((len(ties), derivative.shape[1]))
    for number, k in enumerate(stated):
        own = slice(3 * number, 3 * number + 3)
        ties[own, -1] = (points[k] - at.stated[k]) / at.stated_u[k]
        by_ties[own, 3 * k : 3 * k + 3] = np.diag(np.ones(3) / at.stated_u[k])
    lengths, by_lengths = [], []
    for (one, other), length, u in zip(at.ends, at.value, at.value_u, strict=True):
        if one in touched and other in touched:
            way = points[one] - points[other]
            row = np.zeros((len(at.labels), 3))
            row[one], row[other] = np.array([1, -1])[:, None] * way / np.linalg.norm(way) / u
            by_lengths.append(row.ravel())
            lengths.append(np.eye(rows.shape[1])[-1] * (np.linalg.norm(way) - length) / u)
    every = np.concatenate([rows, ties, np.reshape(lengths, (-1, rows.shape[1]))])
    bars = np.reshape(by_lengths, (-1, derivative.shape[1]))
    by = np.concatenate([derivative, by_ties, bars])
    return np.asarray(null_space(by.T, rcond=1e-10).T @ every)


def dense_of(space: ModelSpace) -> Dense:
    """The same rows, explicit."""
    design = space.candidates.design
    rows = rows_of(space)
    directions = space.gram.directions
    own = [
        rows[:, block.columns]
        @ (np.eye(block.size) if block.combinations is None else block.combinations)
        for block in design.blocks
    ]
    return Dense(
        rows[:, : design.nuisances],
        own,
        rows[:, -1],
        space.candidates.log_odds,
        space.stated,
        rows[:, -1 - len(directions) : -1] @ directions,
        design.prior,
        positive=frozenset(k for k, block in enumerate(design.blocks) if block.positive),
    )


def random_states(
    space: ModelSpace, rng: np.random.Generator, count: int, of: Sequence[int] | Array | None = None
) -> list[ModelState]:
    """States of up to five blocks of causes and covariates, or of some of these."""
    found = []
    every = np.arange(len(space.candidates.blocks)) if of is None else np.array(of)
    for number in range(count):
        size = number % 6
        blocks = tuple(sorted(rng.choice(every, size, replace=False).tolist()))
        found.append(
            ModelState(
                blocks,
                tuple(rng.integers(len(WIDTHS), size=size).tolist()),
                number % len(AMPLITUDES),
            )
        )
    return found


def test_real_designs_by_covariance_matrices(measured, rng):
    space = measured.space
    dense = dense_of(space)
    states = random_states(space, rng, 12)
    found = [space.log_posterior(state) for state in states]
    expected = [
        dense.log_posterior(state.blocks, widths_of(state), AMPLITUDES[state.amplitude])
        for state in states
    ]
    close(np.subtract(found, found[0]), np.subtract(expected, expected[0]), NATS)


def allowed(space: ModelSpace, blocks: Sequence[int]) -> Array:
    """Blocks of which none is in a set."""
    return np.setdiff1d(np.arange(len(space.candidates.blocks)), blocks)


def by_one(state: ModelState, block: int, width: int) -> ModelState:
    return ModelState((*state.blocks, block), (*state.widths, width), state.amplitude)


def test_additions_are_the_posterior_of_larger_sets(measured, rng):
    """At each width, of blocks of every size, beside sets of every size without what is
    positive.
    """
    space = measured.space
    blocks = space.candidates.blocks
    sizes = np.array([block.size * (1 - 2 * block.positive) for block in blocks])
    assert -1 in sizes
    for state in random_states(space, rng, 6, of=np.flatnonzero(sizes > 0)):
        additions = space.conditional(state).additions()
        for size in np.unique(sizes):
            mine = allowed(space, state.blocks)
            block = int(rng.choice(mine[sizes[mine] == size]))
            own = [by_one(state, block, k) for k in range(len(WIDTHS))]
            found = additions[block] + space._log_prior((*state.blocks, block))
            close(found, [space.log_posterior(each) for each in own], NATS)


def test_what_is_left_without_members_and_with_a_block_more(measured, rng):
    """As of the other set alone, by covariance matrices, at the same widths: χ², evidence, and what
    any further block adds.
    """
    space = measured.space
    dense = dense_of(space)
    either = [k for k, block in enumerate(space.candidates.blocks) if not block.positive]
    nothing = dense.log_posterior((), (), 0.0) - space.log_posterior(ModelState((), (), 0))

    def expected(state: ModelState) -> float:
        amplitude = AMPLITUDES[state.amplitude]
        return dense.log_posterior(state.blocks, widths_of(state), amplitude) - nothing

    for number, state in enumerate(random_states(space, rng, 6, of=either)):
        members = state.blocks
        gone = tuple(rng.permutation(members)[: number % 3].tolist())
        kept = [k for k in members if k not in gone]
        rest = state.of(kept)
        beside = space.conditional(rest)
        log_prior = space._log_prior(rest.blocks)
        assert beside.log_evidence + log_prior == pytest.approx(expected(rest), abs=NATS)
        for _ in range(2):  # one block more, and another beside it
            pool = [k for k in either if k not in {*rest.blocks, *gone}]
            block, width = int(rng.choice(pool)), int(rng.integers(len(WIDTHS)))
            beside, rest = beside.plus(block, width), by_one(rest, block, width)
            log_prior = space._log_prior(rest.blocks)
            assert beside.log_evidence + log_prior == pytest.approx(expected(rest), abs=NATS)
            there = space.conditional(rest)
            close(beside.additions()[either], there.additions()[either], NATS)
            further, other = rng.choice([k for k in pool if k != block], 2, replace=False).tolist()
            for each in (further, other):
                information, gradient = there.left.of_block(each)
                size = np.sqrt(np.diag(information)) + 1.0
                scale = np.outer(size, size)
                close(beside.left.of_block(each)[0] / scale, information / scale, 1e-7)
                close(beside.left.of_block(each)[1] / size, gradient / size, 1e-6)
            correlation = there.left.canonical(further, other)
            assert beside.left.canonical(further, other) == pytest.approx(correlation, abs=1e-5)


def test_a_positive_block_more(measured, rng):
    """Beside a set without any, its evidence has the part above zero."""
    space = measured.space
    blocks = space.candidates.blocks
    some = [k for k, block in enumerate(blocks) if block.positive]
    either = np.flatnonzero([not block.positive for block in blocks])
    for state in random_states(space, rng, 6, of=either):
        block, width = int(rng.choice(some)), int(rng.integers(len(WIDTHS)))
        found = space.conditional(state).plus(block, width)
        larger = by_one(state, block, width)
        there = space.conditional(larger)
        assert found.left.chi2 == pytest.approx(there.left.chi2, abs=1e-6)
        assert found.log_evidence == pytest.approx(there.log_evidence, abs=NATS)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("noise", [0.8, 1.1])
def test_evidence_of_a_parameter_above_zero(width, noise, rng):
    """Twice the integral over its positive half, where the noise is as stated."""
    for sign in (-1.0, 1.0):
        column = rng.normal(size=(30, 1))
        column -= column.mean()  # of the nuisance nothing is left
        off = rng.normal(size=30)
        off -= off.mean()
        residual = sign * 0.4 * column[:, 0] + noise * off * np.sqrt(30.0) / np.linalg.norm(off)
        dense = made([column], residual, True, positive=frozenset({0}))
        space = space_of(dense)
        state = ModelState((0,), (list(WIDTHS).index(width),), 0)
        conditional = space.conditional(state)
        assert conditional.variance == 1.0
        value, own = width * 6e-5 * np.arange(-200_000, 200_001), column[:, 0]
        chi2 = residual @ residual + 2.0 * value * (own @ residual) + value**2 * (own @ own)
        density = np.exp(-0.5 * (chi2 - chi2.min() + np.square(value / width)))
        half, whole = (trapezoid(density[k], value[k]) for k in (value >= 0.0, slice(None)))
        both = space_of(made([column], residual, True)).conditional(state)
        found = conditional.log_evidence - both.log_evidence
        assert found == pytest.approx(np.log(2.0 * half / whole), abs=1e-4)


# --- all subsets


def eight(rng: np.random.Generator, n: int = 24) -> list[Array]:
    """Columns that have something in common."""
    common = rng.normal(size=(n, 1))
    return [rng.normal(size=(n, 1)) + 0.5 * common for _ in range(8)]


def two_imitate_one(rng: np.random.Generator, stated: bool) -> Dense:
    columns = eight(rng)
    columns[2] = columns[0] + columns[1] + 0.3 * rng.normal(size=columns[0].shape)
    return made(columns, 1.2 * (columns[0] + columns[1])[:, 0] + rng.normal(size=24), stated)


def one_stands_alone(rng: np.random.Generator, stated: bool) -> Dense:
    """At one place, a free curve or the two that it can imitate."""
    columns = eight(rng)
    columns[2] = np.hstack(
        [columns[0] + columns[1], columns[0] - columns[1], columns[3] + columns[4]]
    )
    residual = 1.1 * columns[0][:, 0] - 0.9 * columns[1][:, 0] + rng.normal(size=24)
    places = [0, 0, 0, 1, 2, 3, 4, 5]
    return made(columns, residual, stated, places=places, alone=frozenset({2}))


def two_that_act_together(rng: np.random.Generator, stated: bool) -> Dense:
    """The most probable set is of two of which neither alone says anything; a draw in which the
    approximation with the widths of one of them is too low by 2.6.
    """
    return one_stands_alone(np.random.default_rng(4), stated)


def some_above_zero(rng: np.random.Generator, stated: bool) -> Dense:
    """Of four positive ones, one acts and another would with the other sign."""
    columns = eight(rng)
    residual = -0.9 * columns[0][:, 0] + 0.5 * columns[1][:, 0] + rng.normal(size=24)
    return made(columns, residual, stated, positive=frozenset({0, 1, 2, 3}))


def three_imitate_two(rng: np.random.Generator, stated: bool) -> Dense:
    columns = eight(rng)
    mixed = np.hstack(columns[:3]) @ rng.normal(size=(3, 2))
    columns[3:5] = list((mixed + 0.2 * rng.normal(size=mixed.shape)).T[:, :, None])
    return made(columns, 1.5 * (columns[3] - columns[4])[:, 0] + rng.normal(size=24), stated)


def two_variants(rng: np.random.Generator, stated: bool) -> Dense:
    """Of one candidate, both alike; one more candidate is weak."""
    columns = eight(rng)
    columns[1] = columns[0] + 0.3 * rng.normal(size=columns[0].shape)
    residual = 1.0 * columns[0][:, 0] + 0.6 * columns[5][:, 0] + rng.normal(size=24)
    return made(columns, residual, stated, owners=[0, 0, 1, 2, 3, 4, 5, 6])


@pytest.mark.parametrize(
    ("problem", "stated", "most"),
    [
        (two_imitate_one, True, 4),
        (one_stands_alone, False, 5),
        (two_that_act_together, False, 4),
        (some_above_zero, True, 4),
        (some_above_zero, False, 4),
        (three_imitate_two, True, 5),
        (two_variants, False, 4),
    ],
)
def test_exploration_finds_the_mass_of_all_subsets(problem, stated, most, rng):
    dense = problem(rng, stated)
    space = space_of(dense)
    expected, largest = dense.inclusion(most)
    assert largest < 5e-3  # so that still larger sets do not count
    found = np.zeros(len(dense.columns))
    for blocks, weight in explore(space).weights.items():
        found[list(blocks)] += weight
    close(found, expected, 0.02)
