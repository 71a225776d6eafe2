"""The posterior over sets of blocks against quadrature, dense covariance matrices, all subsets, and
permutations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from blind.regimes import regime_file
from numpy.typing import NDArray

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Fit
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis.candidates import Variants, candidates
from aacmm_pin.diagnosis.covariates import Covariate, covariates
from aacmm_pin.diagnosis.design_matrix import Block, Design, design_of
from aacmm_pin.diagnosis.exploration import explore
from aacmm_pin.diagnosis.gram_matrix import Gram, PartRows, Products, products_of
from aacmm_pin.diagnosis.held_postures import HeldPostures
from aacmm_pin.diagnosis.linear_model import LARGE, gains
from aacmm_pin.diagnosis.model_space import Candidates, ModelSpace, ModelState
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from tests.diagnosis.dense_posterior import AMPLITUDES, WIDTHS, Dense, by_quadrature
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
        Block(c, 0, slice(int(ends[k]), int(ends[k + 1])), NOTHING) for k, c in enumerate(owners)
    )
    names = tuple(str(c) for c in range(max(owners) + 1))
    causes, width = len(names) - covariate_blocks, int(ends[-1])
    design = Design(
        NOTHING,
        names,
        causes,
        blocks,
        z,
        np.ones(width),
        NOTHING,
        np.empty(0, int),
        dense.prior,
        NOTHING,
        0,
    )
    rows = np.column_stack([dense.nuisances, *dense.columns, dense.residual])
    postures = HeldPostures(np.arange(len(rows)), np.ones(len(rows)), np.ones(len(rows)), 0.0)
    products = Products(design, lambda: [PartRows(rows, len(rows))], postures)
    return ModelSpace(
        Candidates(design, dense.log_odds, dense.contained), Gram(products), dense.stated
    )


def made(
    columns: Sequence[Array],
    residual: Array,
    stated: bool,
    nuisances: Array | None = None,
    contained: Mapping[int, frozenset[int]] | None = None,
    owners: Sequence[int] | None = None,
) -> Dense:
    """Rows with a constant as nuisance, unless others are given, and candidates with a probability
    of 1, 1/2, 1/3, …
    """
    n = len(residual)
    nuisances = np.ones((n, 1)) if nuisances is None else nuisances
    log_odds = -np.log(np.arange(len(columns)) + 1.0) - np.log(3.0)
    prior = np.zeros((0, nuisances.shape[1] + 1))
    return Dense(
        nuisances,
        columns,
        residual,
        log_odds,
        stated,
        np.zeros((n, 0)),
        prior,
        owners,
        contained or {},
    )


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
        return Measured(fit(problem), tuple(library), tuple(covariates(arm, measurements)), stated)

    def again(
        self, library: Sequence[Variants] | None = None, others: Sequence[Covariate] | None = None
    ) -> ModelSpace:
        """The posterior, with candidates in this order."""
        library = self.library if library is None else library
        design = design_of(self.fit, library, self.others if others is None else others)
        gram = Gram(products_of(design, np.zeros(len(design.tips), int)))
        return ModelSpace(Candidates.of(design, library), gram, self.stated)

    @cached_property
    def space(self) -> ModelSpace:
        """The posterior, with the candidates as they are."""
        return self.again()

    @cached_property
    def probabilities(self) -> dict[str, float]:
        """Inclusion probability of each candidate."""
        return probabilities(self.space)


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
def measured(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Measured:
    return Measured.of(tmp_path_factory.mktemp("file"), **request.param)


def probabilities(space: ModelSpace) -> dict[str, float]:
    return dict(zip(space.candidates.design.names, explore(space).inclusion.tolist(), strict=True))


def dense_of(space: ModelSpace) -> Dense:
    """The same rows, explicit."""
    products, design = space.gram.products, space.candidates.design
    (part,), (columns, weights) = products.parts, products.background
    rows = part.rows.astype(np.float64)
    prior = products.prior.rows[:, [*range(design.nuisances), design.width]]
    own = [rows[:, block.columns] for block in design.blocks]
    first, background = rows[:, : design.nuisances], rows[:, columns] @ weights
    odds = space.candidates.log_odds
    return Dense(first, own, rows[:, -1], odds, space.stated, background, prior, free=part.free)


def random_states(space: ModelSpace, rng: np.random.Generator, count: int) -> list[ModelState]:
    """States of up to five blocks of causes and covariates."""
    found = []
    for number in range(count):
        size = number % 6
        blocks = tuple(
            sorted(rng.choice(len(space.candidates.blocks), size, replace=False).tolist())
        )
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
    states = random_states(space, rng, 30)
    found = [space.log_posterior(state) for state in states]
    expected = [
        dense.log_posterior(state.blocks, widths_of(state), AMPLITUDES[state.amplitude])
        for state in states
    ]
    close(np.subtract(found, found[0]), np.subtract(expected, expected[0]), NATS)


def test_additions_are_the_posterior_of_larger_sets(
    measured: Measured, rng: np.random.Generator
) -> None:
    """At each width, of blocks of every size, beside sets of every size."""
    space = measured.space
    sizes = np.array([block.size for block in space.candidates.blocks])
    for state in random_states(space, rng, 6):
        additions = space.conditional(state).additions
        for size in np.unique(sizes):
            block = int(
                rng.choice(
                    np.flatnonzero((sizes == size) & ~np.isin(np.arange(sizes.size), state.blocks))
                )
            )
            own = [
                ModelState((*state.blocks, block), (*state.widths, k), state.amplitude)
                for k in range(len(WIDTHS))
            ]
            found = additions[block] + space._log_prior((*state.blocks, block))
            close(found, [space.log_posterior(each) for each in own], NATS)


def test_evidence_where_rounding_left_no_factor(rng: np.random.Generator) -> None:
    """Of information whose smallest eigenvalue is far below zero: as if it were zero, and the other
    blocks as they are.
    """
    columns, gradient = rng.standard_normal((3, LARGE + 2, LARGE)), rng.standard_normal((3, LARGE))
    nothing = np.linalg.qr(rng.standard_normal((LARGE, 1)))[0]
    columns[1] -= columns[1] @ nothing @ nothing.T
    exact = columns.transpose(0, 2, 1) @ columns
    rounded = exact.copy()
    rounded[1] -= 2.0 / WIDTHS.max() ** 2 * nothing @ nothing.T
    found = gains(rounded, gradient[:, :, None])
    for k, (s, g) in enumerate(zip(exact, gradient, strict=True)):
        for width, gain, volume in zip(WIDTHS, found[0][k, :, 0], found[1][k], strict=True):
            assert gain == pytest.approx(
                0.5 * g @ np.linalg.solve(s + np.eye(LARGE) / width**2, g), rel=1e-9
            )
            assert volume == pytest.approx(
                0.5 * np.linalg.slogdet(np.eye(LARGE) + width**2 * s)[1], rel=1e-9
            )


# --- all subsets


def eight(rng: np.random.Generator, n: int = 24) -> list[Array]:
    """Columns that have something in common."""
    common = rng.normal(size=(n, 1))
    return [rng.normal(size=(n, 1)) + 0.5 * common for _ in range(8)]


def two_imitate_one(rng: np.random.Generator, stated: bool) -> Dense:
    columns = eight(rng)
    columns[2] = columns[0] + columns[1] + 0.3 * rng.normal(size=columns[0].shape)
    return made(columns, 1.2 * (columns[0] + columns[1])[:, 0] + rng.normal(size=24), stated)


def one_contains_two(rng: np.random.Generator, stated: bool) -> Dense:
    columns = eight(rng)
    columns[2] = np.hstack(
        [columns[0] + columns[1], columns[0] - columns[1], columns[3] + columns[4]]
    )
    residual = 1.1 * columns[0][:, 0] - 0.9 * columns[1][:, 0] + rng.normal(size=24)
    return made(columns, residual, stated, contained={2: frozenset({0, 1})})


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
    ("problem", "stated"),
    [
        (two_imitate_one, True),
        (one_contains_two, False),
        (three_imitate_two, True),
        (two_variants, False),
    ],
)
def test_exploration_finds_the_mass_of_all_subsets(problem, stated, rng):
    dense = problem(rng, stated)
    space = space_of(dense)
    expected, largest = dense.inclusion(most=5)
    assert largest < 5e-3  # so that still larger sets do not count
    found = np.zeros(len(dense.columns))
    for blocks, weight in explore(space).weights.items():
        found[list(blocks)] += weight
    close(found, expected, 0.02)


# --- order


def test_order_of_the_blocks_of_a_state(measured, rng):
    space = measured.space
    for state in random_states(space, rng, 12):
        order = rng.permutation(len(state.blocks))
        blocks, widths = (tuple(each[k] for k in order) for each in (state.blocks, state.widths))
        assert space.log_posterior(
            ModelState(blocks, widths, state.amplitude)
        ) == space.log_posterior(state)


def labelled(space: ModelSpace, state: ModelState) -> list[tuple[str, int, int]]:
    """The name of each block's candidate, the number of its variant, and of its width."""
    design = space.candidates.design
    own = [design.blocks[k] for k in state.blocks]
    return [
        (design.names[b.candidate], b.variant, w) for b, w in zip(own, state.widths, strict=True)
    ]


def state_of(
    space: ModelSpace, labels: Sequence[tuple[str, int, int]], amplitude: int
) -> ModelState:
    design = space.candidates.design
    number = {(design.names[b.candidate], b.variant): k for k, b in enumerate(design.blocks)}
    pairs = sorted((number[name, variant], width) for name, variant, width in labels)
    return ModelState(tuple(k for k, _ in pairs), tuple(w for _, w in pairs), amplitude)


def records_in_another_order(measured: Measured, rng: np.random.Generator) -> ModelSpace:
    space = measured.space
    products = space.gram.products
    (part,) = products.parts
    rows = part.rows[rng.permutation(len(part.rows))]
    gram = Gram(Products(products.design, lambda: [PartRows(rows, part.free)], products.noise))
    return ModelSpace(space.candidates, gram, space.stated)


def causes_in_another_order(measured: Measured, rng: np.random.Generator) -> ModelSpace:
    return measured.again(
        library=[measured.library[k] for k in rng.permutation(len(measured.library))]
    )


def covariates_in_another_order(measured: Measured, rng: np.random.Generator) -> ModelSpace:
    return measured.again(
        others=[measured.others[k] for k in rng.permutation(len(measured.others))]
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "other",
    [causes_in_another_order, records_in_another_order, covariates_in_another_order],
)
def test_order_of_records_causes_and_covariates(
    measured: Measured, other: Any, rng: np.random.Generator
) -> None:
    space = measured.space
    again = other(measured, rng)
    for state in random_states(space, rng, 12):
        there = state_of(again, labelled(space, state), state.amplitude)
        assert again.log_posterior(there) == pytest.approx(space.log_posterior(state), abs=NATS)
    # Sets below a twentieth of the best are approximate, and their order decides which: of 106
    # probabilities the largest difference was 1.1e-4.
    assert probabilities(again) == pytest.approx(measured.probabilities, abs=5e-4)
