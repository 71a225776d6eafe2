"""What the diagnosis works out lazily from inner products, against dense matrices of all records
and plain formulas.

The dense side knows the records, the noise as stated and the columns of the design; covariances,
seats, bars, priors and everything that follows are built anew with NumPy and SciPy alone.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blind import chains, draw
from numpy.typing import NDArray
from scipy.linalg import null_space, orth, subspace_angles
from scipy.special import logsumexp
from scipy.stats import chi2, kstest, t

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.cross_validation import fold_numbers
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import gram_matrix
from aacmm_pin.diagnosis import held_out_gain as gain
from aacmm_pin.diagnosis import significance as findings
from aacmm_pin.diagnosis import unexplained as groups
from aacmm_pin.diagnosis.candidates import Variants, candidates
from aacmm_pin.diagnosis.choice import Choice, seats_are_divided
from aacmm_pin.diagnosis.covariates import Covariate, covariates
from aacmm_pin.diagnosis.design_matrix import Block, Design, design_of
from aacmm_pin.diagnosis.gram_matrix import Gram, gram_of
from aacmm_pin.diagnosis.linear_model import (
    WIDTHS,
    Base,
    Conditional,
    Likelihood,
)
from aacmm_pin.diagnosis.model_extension import ProblemOf, free
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from tests.again import again
from tests.few_causes import NO_WAVES
from tests.oracle import close

Array = NDArray[np.float64]
ENCODER, REFERENCE, PROBE, LENGTH = 8e-6, 12e-6, 10e-6, 20e-6
RECORDS = 60
PLANS = (again("free"), "seats", "unknown-seats")


@dataclass(frozen=True, eq=False)
class Case:
    """What is considered behind the records of one file."""

    records: Measurements
    library: tuple[Variants, ...]
    others: tuple[Covariate, ...]
    folds: NDArray[np.intp]
    problem: ProblemOf
    design: Design

    @property
    def fit(self) -> Fit:
        return self.design.fit

    @property
    def noise(self) -> RecordNoise:
        """As stated; records share nothing."""
        n = self.records.n
        return RecordNoise(self.fit.noise.whitening, np.arange(n), np.ones(n))

    def refit(self, effects: Sequence[Effect], used: NDArray[np.bool_] | None = None) -> Fit:
        return fit(self.problem(effects), used=used)

    def block(self, label: str) -> int:
        """The first block of a cause."""
        return next(
            k for k, b in enumerate(self.design.blocks) if self.design.names[b.candidate] == label
        )

    def choice(self, blocks: Blocks = (), only: Sequence[int] | None = None) -> Choice:
        """These blocks, whatever the records say, among some candidates, without a background."""
        every = Candidates.of(self.design, self.library)
        if only is not None:
            odds = every.log_odds[list(only)]
            every = replace(every, design=with_blocks(self.design, only), log_odds=odds)
        space = ModelSpace(every, gram_of(every.design, self.noise), True, (0.0,))
        posterior = Posterior(space, {blocks: 1.0}, 0.0)
        return Choice(self.fit, posterior, self.library, self.others, self.folds)


def with_blocks(design: Design, numbers: Sequence[int]) -> Design:
    """The design with some of the blocks alone, in this order."""
    chosen = [design.blocks[number] for number in numbers]
    starts = {block.columns.start for block in chosen}
    sources = list[tuple[slice, Any]]()
    scales = [design.scales[: design.nuisances]]
    moved = dict[int, slice]()
    first = design.nuisances
    for columns, source in design.sources:
        if columns.start in starts:
            moved[columns.start] = slice(first, first := first + columns.stop - columns.start)
            sources.append((moved[columns.start], source))
            scales.append(design.scales[columns])
    blocks = tuple(replace(block, columns=moved[block.columns.start]) for block in chosen)
    return replace(design, blocks=blocks, sources=tuple(sources), scales=np.concatenate(scales))


def case_of(path: Path, seed: int, cause: str | None, plan: str, **options: object) -> Case:
    """A file of the plant and what may be in it."""
    draw(seed, cause, plan=plan, records=RECORDS, small_terms=False, **options).write(path)  # type: ignore[arg-type]
    records = Measurements.read(path, 6)
    arm = Arm.load("sino6")
    setup = Setup(
        encoder_noise=np.full(6, ENCODER),
        reference_noise=REFERENCE,
        probe_noise=None if plan == "free" else PROBE,
        length_noise=LENGTH,
    )

    def problem(effects: Sequence[Effect]) -> Problem:
        asked = problem_of(ErrorModel.of(arm), records, ["geometry", *effects], setup)
        return replace(asked, candidates=len(effects))

    first = fit(problem([]))
    folds = fold_numbers(first, np.random.default_rng(1))[1]
    library = candidates(ErrorModel.of(arm), records, first.problem)
    others = covariates(arm, records)[::3]  # all of them have three thousand columns
    return Case(
        records, tuple(library), tuple(others), folds, problem, design_of(first, library, others)
    )


def away(case: Case) -> Case:
    """The same at a point where no fit has ended: every residual is something, no gradient
    vanishes.
    """
    moved = case.design.tips + np.random.default_rng(5).normal(0.0, 4e-5, case.design.tips.shape)
    return replace(case, design=replace(case.design, tips=moved))


def without(
    design: Design, noise: RecordNoise, part: NDArray[np.intp], left_out: Sequence[int]
) -> Gram:
    """The products of all parts but some, each with points of its own."""
    whole = gram_of(design, noise, [part == k for k in np.unique(part)])
    return whole.without(gram_of(design, noise, [part == k for k in left_out]))


def alone(gram: Gram, stated: bool = True) -> Conditional:
    """Nothing but nuisances."""
    base = Base(gram, 0.0)
    return Conditional(base, (), (), Likelihood(gram.free - base.determined, stated))


def with_residual(gram: Gram, products: Array, square: float) -> Gram:
    """The products with another residual, by its products with all columns and with itself."""
    matrix = gram.matrix.copy()
    matrix[:-1, -1] = matrix[-1, :-1] = products
    matrix[-1, -1] = square
    return replace(gram, matrix=matrix)


@pytest.fixture(scope="module", params=PLANS)
def case(request, tmp_path_factory) -> Case:
    with NO_WAVES if request.param == "seats" else contextlib.nullcontext():
        path = tmp_path_factory.mktemp("plans") / "data.csv"
        return away(case_of(path, 3, None, request.param))


@pytest.fixture(scope="module")
def free_case(tmp_path_factory) -> Case:
    return case_of(tmp_path_factory.mktemp("free") / "data.csv", 3, None, "free")


# --- the dense side


def covariance_of_records(records: Measurements) -> Array:
    """Readings, references and contacts (n, n, 3, 3): a seat with coordinates has its error in
    common [m²].
    """
    by_reading = chains.read().jacobian(records.q)
    found = np.zeros((records.n, records.n, 3, 3))
    own = ENCODER**2 * by_reading @ by_reading.transpose(0, 2, 1) + 1e-24 * np.eye(3)
    seat = records.conditions.seat
    for i in range(records.n):
        found[i, i] = own[i] + (REFERENCE if seat is None else PROBE) ** 2 * np.eye(3)
        if seat is not None and records.known.all():
            found[i, seat == seat[i]] += REFERENCE**2 * np.eye(3)
    return found


def whitened(
    case: Case,
    part: NDArray[np.intp],
    kept: NDArray[np.bool_],
    postures: RecordNoise | None = None,
) -> Array:
    """Rows of the kept records, columns and residual, unknown points taken out; each part has
    points of its own.
    """
    design, records = case.design, case.records
    n, width = records.n, design.width
    jacobian = design.rows(np.arange(n))
    covariance = covariance_of_records(records)
    if postures is not None:
        root = postures.ratio * np.linalg.inv(case.noise.whitening)
        same = (postures.group[:, None] == postures.group) & (postures.group >= 0)
        covariance += same[:, :, None, None] * np.einsum("iab,jcb->ijac", root, root)
    seat = records.conditions.seat
    unknown = seat is not None and not records.known.any()
    points = dict(zip(case.fit.observations.labels, case.fit.point.seats, strict=True))
    target = (
        np.array([points[s] for s in seat]) if unknown and seat is not None else records.reference
    )
    found = []
    for number in np.unique(part[kept]):
        mine = np.flatnonzero(kept & (part == number))
        lower = np.linalg.cholesky(
            covariance[np.ix_(mine, mine)].transpose(0, 2, 1, 3).reshape(3 * mine.size, -1)
        )
        raw = np.concatenate([jacobian[mine], (design.tips - target)[mine][:, :, None]], axis=2)
        rows = np.linalg.solve(lower, raw.reshape(3 * mine.size, -1))
        if unknown and seat is not None:
            labels = sorted(set(seat[mine]))
            of_seat = -np.kron(seat[mine][:, None] == np.array(labels), np.eye(3))
            tie, tied = _bars(records, labels, points)
            rows = np.vstack([rows, np.column_stack([np.zeros((tie.size, width)), tie])])
            outside = null_space(np.vstack([np.linalg.solve(lower, of_seat), tied]).T, rcond=1e-9)
            rows = outside.T @ rows
        found.append(rows)
    assert n == RECORDS
    return np.concatenate(found)


def _bars(
    records: Measurements, labels: list[str], points: dict[str, Array]
) -> tuple[Array, Array]:
    """Lengths of the bars with an end among the seats; an end that nobody touched is free and takes
    its bar with it.
    """
    residual, rows = [], []
    for bar in records.bars():
        if bar.seat_a in labels and bar.seat_b in labels:
            way = points[bar.seat_a] - points[bar.seat_b]
            length = np.linalg.norm(way)
            row = np.zeros((len(labels), 3))
            row[labels.index(bar.seat_a)], row[labels.index(bar.seat_b)] = (
                way / length / LENGTH,
                -way / length / LENGTH,
            )
            residual.append((length - bar.length) / LENGTH)
            rows.append(row.ravel())
    return np.array(residual), np.array(rows).reshape(-1, 3 * len(labels))


def prior_rows(case: Case) -> Array:
    """What is known of the nuisances (m, columns + 1), in units of their widths."""
    problem, x = case.design.fit.problem, case.design.fit.point.x
    kept = case.design.kept
    rows = np.zeros((kept.size, case.design.width + 1))
    rows[:, : kept.size] = np.eye(kept.size)
    rows[:, -1] = ((x - problem.start) / problem.widths)[kept]
    return rows


def dense(case: Case, part: NDArray[np.intp], left_out: Sequence[int] = ()) -> Array:
    """All rows, prior rows last."""
    return np.vstack(
        [whitened(case, part, ~np.isin(part, left_out) & case.fit.used), prior_rows(case)]
    )


def some_blocks(design: Design) -> list[int]:
    """One block of each size, spread over the library and the covariates."""
    sizes: dict[int, int] = {}
    for k, b in enumerate(design.blocks):
        sizes.setdefault(b.size, k)
        if b.candidate in (2, 9):
            sizes.setdefault(-b.candidate, k)
    return sorted(set(sizes.values()))


def of_block(rows: Array, block: Block) -> Array:
    """Rows of the parameters of a block."""
    own = rows[:, block.columns]
    return own if block.combinations is None else own @ block.combinations


def same_products(found: Array, rows: Array) -> None:
    wanted = rows.T @ rows
    size = np.sqrt(np.diag(wanted)) + 1e-3
    close(found / np.outer(size, size), wanted / np.outer(size, size), 2e-6)


@pytest.mark.parametrize("left_out", [(0, 3), again(())])
def test_inner_products(case, left_out, monkeypatch):
    monkeypatch.setattr(gram_matrix, "ROWS_OF_A_GROUP", 21)  # several streams in every part
    design = case.design
    gram = without(design, case.noise, case.folds, left_out)
    rows = dense(case, case.folds, left_out)
    same_products(gram.matrix, rows)
    left = alone(gram)
    for k in some_blocks(design):
        own = of_block(rows, design.blocks[k])
        size = np.sqrt(np.square(own).sum(axis=0)) + 1e-3
        z = rows[:, : design.nuisances]
        off = own - z @ np.linalg.lstsq(z, own)[0]
        scale = np.outer(size, size)
        close(left.left.of_block(k)[0] / scale, off.T @ off / scale, 2e-6)
    assert gram.free == len(rows) - design.nuisances


def test_without_a_part_the_others_are_left(case):
    """Where no seat is in two of them."""
    design, noise = case.design, case.noise
    assert not seats_are_divided(case.folds, case.fit)
    one, whole = np.unique(case.folds)[1], gram_of(design, noise)
    others = whole.without(gram_of(design, noise, [case.folds == one]))
    rows = dense(case, case.folds, [one])
    same_products(others.matrix, rows)
    assert others.free == len(rows) - design.nuisances
    assert others.directions is whole.directions


@pytest.mark.parametrize("ratio", [0.5, again(3.0)])
def test_inner_products_with_an_error_that_records_share(case, ratio, monkeypatch):
    """Groups of one to four records of a seat, all of each in one stream."""
    monkeypatch.setattr(gram_matrix, "ROWS_OF_A_GROUP", 15)
    used = case.fit.used & (np.arange(RECORDS) % 11 != 3)
    case = replace(
        case, design=replace(case.design, fit=replace(case.fit, weights=used.astype(float)))
    )
    seat = case.records.conditions.seat
    labels = np.zeros(RECORDS, dtype="U9") if seat is None else seat.astype("U9")
    four = np.random.default_rng(6).integers(0, 20 if seat is None else 3, RECORDS)
    names = [f"{number} {label}" for number, label in zip(four, labels, strict=True)]
    group = np.full(RECORDS, -1)
    group[used] = np.unique(np.array(names)[used], return_inverse=True)[1]
    count = np.bincount(group[used]).astype(float)
    assert count.max() > 2
    numbers = np.full(count.size, 3.0)
    postures = RecordNoise(case.noise.whitening, group, numbers, ratio)
    gram = gram_of(case.design, postures)
    one = np.zeros(RECORDS, dtype=np.intp)
    rows = np.vstack([whitened(case, one, used, postures), prior_rows(case)])
    same_products(gram.matrix, rows)
    assert gram.free == len(rows) - case.design.nuisances


@pytest.mark.parametrize("ratio", [0.5, again(3.0)])
def test_records_that_share_an_error_in_several_parts(free_case, ratio):
    """These parts add up all the same, and what is left without one has no direction below zero."""
    group = np.random.default_rng(6).integers(0, 20, RECORDS)
    group = np.unique(np.where(free_case.fit.used, group, -1), return_inverse=True)[1]
    group -= not free_case.fit.used.all()
    count = np.bincount(group[group >= 0]).astype(float)
    numbers = np.full(count.size, 3.0)
    noise = RecordNoise(free_case.noise.whitening, group, numbers, ratio)
    gram = gram_of(free_case.design, noise)
    part = np.arange(RECORDS) % 3
    assert any(np.unique(part[group == g]).size > 1 for g in range(count.size))
    parts = [part == k for k in range(3)]
    size = np.sqrt(np.diag(gram.matrix)) + 1.0
    scale = np.outer(size, size)
    together = gram_of(gram.design, gram.noise, parts)
    close(together.matrix / scale, gram.matrix / scale, 1e-10)
    some = np.r_[0 : gram.design.nuisances, -150:0]
    for one in parts:
        others = gram.without(gram_of(gram.design, gram.noise, [one]))
        left = (others.matrix / scale)[np.ix_(some, some)]
        assert np.linalg.eigvalsh(left).min() > -1e-9


@pytest.mark.parametrize("excluded", [False, True])
def test_a_seat_in_two_parts_has_points_of_its_own_in_each(case, excluded):
    """Also where records do not count, such as all of a seat in one part."""
    part = np.arange(RECORDS) % 3
    if excluded:
        seat, used = case.records.conditions.seat, np.arange(RECORDS) % 7 != 3
        used &= (part != 1) | (np.arange(RECORDS) > 20 if seat is None else seat != seat[0])
        case = replace(
            case, design=replace(case.design, fit=replace(case.fit, weights=used.astype(float)))
        )
    gram = without(case.design, case.noise, part, [2])
    rows = dense(case, part, [2])
    same_products(gram.matrix, rows)
    assert gram.free == len(rows) - case.design.nuisances
    if case.records.conditions.seat is not None:
        assert seats_are_divided(part, case.fit)
        torn = replace(case, folds=part).choice(only=few(case)).gram_of_folds
        assert torn.free == gram.free + gram_of(case.design, case.noise, [part == 2]).free


def test_retained_fraction_and_canonical_correlation(case):
    design = case.design
    left = alone(gram_of(design, case.noise))
    rows = dense(case, np.zeros(RECORDS, dtype=np.intp))
    basis = np.linalg.qr(rows[:, : design.nuisances])[0]
    off = rows - basis @ (basis.T @ rows)
    some = some_blocks(design)
    compared = 0
    for k in some:
        columns, own = (of_block(each, design.blocks[k]) for each in (rows, off))
        values = np.linalg.svd(own, compute_uv=False)
        if values[-1] < 1e-4 * values[0]:
            continue  # the best step is then a matter of rounding
        step = np.linalg.lstsq(own, off[:, -1])[0]
        wanted = np.linalg.norm(own @ step) / np.linalg.norm(columns @ step)
        assert findings.retained(left, k) == pytest.approx(wanted, rel=1e-3)
        compared += 1
    assert compared > 2
    for one, other in itertools.pairwise(some):
        a, b = (of_block(off, design.blocks[k]) for k in (one, other))
        spans = [orth(columns, rcond=3e-5) for columns in (a, b)]
        if min(min(np.linalg.svd(x)[1]) for x in (a, b)) > 1e-3 * np.abs(a).max():
            wanted = np.cos(subspace_angles(*spans).min())
            assert left.left.canonical(one, other) == pytest.approx(wanted, abs=1e-5)


def test_prior_of_the_candidates(free_case):
    """One half to the library, each cause by how usual it is, one half to the covariates alike."""
    design, library = free_case.design, free_case.library
    of_blocks = Candidates.of(design, library)
    prior, causes = np.bincount(of_blocks.owners, np.exp(of_blocks.log_odds)), design.causes
    usual = np.array([variants[0].prior_weight for variants in library])
    np.testing.assert_allclose(prior[:causes], 0.5 * usual / usual.sum(), rtol=1e-12)
    np.testing.assert_allclose(prior[causes:], 0.5 / len(free_case.others), rtol=1e-12)
    # Beside a curve that can be all of these functions stands none of them.
    curve = free_case.block("joint_error_curve:3")
    wave = free_case.block("joint_periodic_error:3")
    other = free_case.block("joint_periodic_error:2")
    gain_ = free_case.block("encoder_gain:3")
    barred = {k: of_blocks.barred((k,)) for k in (curve, wave)}
    assert barred[curve][[curve, wave, gain_]].all()
    assert not barred[curve][other]
    assert barred[wave][[curve, wave, wave + 1]].all()
    assert not barred[wave][[gain_, other]].any()


# --- chances when nothing is there


def nothing_there(case: Case, draws: int, seed: int) -> tuple[Array, Array]:
    """Products of all columns with draws of noise and of true values within what is stated, and
    dense rows of one draw.
    """
    rows = dense(case, case.folds)
    noise = np.random.default_rng(seed).standard_normal((len(rows), draws))
    return rows[:, :-1].T @ noise, np.column_stack([rows[:, :-1], noise[:, 0]])


def test_the_score_is_chi2_when_nothing_is_there(case):
    """By noise drawn here; the first draw also by least squares."""
    chosen = some_blocks(case.design)
    case = replace(
        case, design=with_blocks(case.design, chosen), folds=np.zeros(RECORDS, dtype=np.intp)
    )
    design = case.design
    gram = gram_of(design, case.noise)
    products, rows = nothing_there(case, 300, 7)
    scores, ranks = np.empty((300, len(chosen))), []
    roots = []
    for k in range(len(chosen)):
        information, _ = alone(gram).left.of_block(k)
        ranks.append(np.linalg.matrix_rank(information, rtol=1e-10, hermitian=True))
        roots.append(np.linalg.pinv(information, rcond=1e-10))
    for draw_, own in zip(scores, products.T, strict=True):
        left = alone(with_residual(gram, own, 1.0))
        for k, root in enumerate(roots):
            _, gradient = left.left.of_block(k)
            draw_[k] = gradient @ root @ gradient
    basis = np.linalg.qr(rows[:, : design.nuisances])[0]
    left_of = rows[:, -1] - basis @ (basis.T @ rows[:, -1])
    for k, (block, rank) in enumerate(zip(design.blocks, ranks, strict=True)):
        assert kstest(scores[:, k], chi2(rank).cdf).pvalue > 1e-3
        # Of a free curve some coefficients are all but unknown: left out by the same bound as in
        # the pseudo-inverse.
        columns = of_block(rows, block)
        across = columns - basis @ (basis.T @ columns)
        taken = across @ np.linalg.lstsq(across, left_of, rcond=1e-5)[0]
        assert scores[0, k] == pytest.approx(np.square(taken).sum(), rel=1e-3, abs=1e-5)


SEATS_LONG = pytest.mark.parametrize(
    "case", ["free", "unknown-seats", again("seats")], indirect=True
)


def few(case: Case) -> list[int]:
    """Blocks of the causes of two joints, of many forms one in twenty, so that a hundred draws stay
    cheap.
    """
    names, free_form = case.design.names, Candidates.of(case.design, case.library).free
    owners = [
        k for k in range(case.design.causes) if names[k].endswith((":2", ":3")) and not free_form[k]
    ]
    blocks = enumerate(case.design.blocks)
    return [k for k, b in blocks if b.candidate in owners and b.variant % 20 == 0]


@SEATS_LONG
@pytest.mark.parametrize("stated", [True, False])
def test_the_family_wise_p_value_is_no_smaller_than_chance(case, stated):
    """P(p ≤ α) ≤ α for the best of all candidates in noise, known or not."""
    case = replace(case, folds=np.zeros(RECORDS, dtype=np.intp))
    some = case.choice(only=few(case)).candidates
    gram = gram_of(some.design, case.noise)
    rows = dense(replace(case, design=some.design), case.folds)
    noise = np.random.default_rng(11).standard_normal((len(rows), 120))
    found = []
    for own in noise.T:
        left = alone(with_residual(gram, rows[:, :-1].T @ own, own @ own), stated)
        best = int(np.argmax(logsumexp(left.additions(), axis=1) + some.log_odds))
        found.append(findings.family_wise_p_value(some, left, best))
    assert kstest(found, "uniform", alternative="greater").pvalue > 1e-3


def odds_of(rows: Array, block: Block, residual: Array, nuisances: int) -> float:
    """Log evidence of a block against nothing, averaged over the widths, by covariances of what the
    nuisances leave.
    """
    across = np.linalg.qr(rows[:, :nuisances], mode="complete")[0][:, nuisances:]
    left, own = across.T @ residual, across.T @ of_block(rows, block)
    each = []
    for width in WIDTHS:
        covariance = np.eye(len(own)) + width**2 * own @ own.T
        change = left @ left - left @ np.linalg.solve(covariance, left)
        each.append(0.5 * change - 0.5 * np.linalg.slogdet(covariance)[1])
    return float(logsumexp(each) - np.log(len(WIDTHS)))


@SEATS_LONG
def test_the_largest_odds_when_nothing_is_there(case):
    """p is Markov's bound for odds by explicit rows."""
    case = replace(case, folds=np.zeros(RECORDS, dtype=np.intp))
    some = case.choice(only=few(case)).candidates
    design = some.design
    gram = gram_of(design, case.noise)
    rows = dense(replace(case, design=design), case.folds)
    noise = np.random.default_rng(13).standard_normal(len(rows))
    z = rows[:, : design.nuisances]
    for strength, k in itertools.product((3.0, 5.0), (0, len(design.blocks) - 1)):
        own = of_block(rows, design.blocks[k])[:, 0]
        own = own - z @ np.linalg.lstsq(z, own)[0]
        residual = noise + strength * own / np.linalg.norm(own)
        there = alone(with_residual(gram, rows[:, :-1].T @ residual, residual @ residual))
        assert there.variance == 1.0
        odds = odds_of(rows, design.blocks[k], residual, design.nuisances) + some.log_odds[k]
        bound = np.exp(logsumexp(some.log_odds) - odds)
        p_value = findings.family_wise_p_value(some, there, k)
        assert p_value == pytest.approx(min(bound, 1.0), rel=1e-4)


# --- groups, and records left out


def test_what_one_cause_brings(rng):
    """A ratio of sums over the parts, each distance over its noise, with Student's interval
    (Cochran 1977, 6.4).
    """
    part, (with_it, without), u = (
        np.arange(20) % 4,
        rng.uniform(0.5, 2.0, (2, 20)),
        rng.uniform(1.0, 3.0, 20),
    )
    fit_ = SimpleNamespace(residual_noise=np.square(u)[:, None, None] * np.eye(3))
    choice: Any = SimpleNamespace(fit=fit_, folds=part, in_one_fold=lambda _: False)
    left, whole = (
        np.array([np.square(d / u)[part == k].sum() for k in range(4)]) for d in (with_it, without)
    )
    share = left.sum() / whole.sum()
    off = t.ppf(0.975, 3) * np.sqrt(4.0 / 3.0 * np.square(left - share * whole).sum()) / whole.sum()
    wanted = [1.0 - np.sqrt(max(s, 0.0)) for s in (share, share + off, share - off)]
    held_out = {"median": with_it, 7: without}
    assert gain.cause_gain(choice, held_out, 7) == pytest.approx(wanted, rel=1e-9)


def test_the_interval_of_the_gain_is_that_of_many_parts(rng):
    squares = 1.0 + 0.5 * rng.uniform(-1.0, 1.0, 400)
    low, high = gain._interval(np.column_stack([np.ones(400), squares]), rng)
    u = 0.5 * squares.std(ddof=1) / 20.0 / np.sqrt(squares.mean())
    assert high - low == pytest.approx(2.0 * 1.96 * u, rel=0.08)
    assert low < 1.0 - np.sqrt(squares.mean()) < high


def test_what_records_are_divided_by():
    """Bars before seats, and only where no coordinates are stated; three groups, each with more
    than three records.
    """
    labels = np.array([*"aaaabbbbcccc"], dtype=object)
    other = np.array([*"ddddeeeeffff"], dtype=object)

    def divided(known: bool, **by: Any) -> list[str]:
        conditions = SimpleNamespace(
            **{name: by.get(name) for name in ("seat", "session", "marker")}
        )
        records: Any = SimpleNamespace(
            known=np.array([known] * 12), bar=by.get("bar"), conditions=conditions
        )
        there = groups.label_groups(records)
        for group in there:
            label = group.name.removeprefix(f"{group.kind} ")
            np.testing.assert_array_equal(group.records, by[group.kind] == label)
        return [group.name for group in there]

    of_bars = ["bar a", "bar b", "bar c"]
    sessions = ["session d", "session e", "session f"]
    assert divided(False, bar=labels, seat=other, session=other) == [*sessions, *of_bars]
    assert divided(False, seat=labels) == ["seat a", "seat b", "seat c"]
    assert divided(True, bar=labels) == divided(True, seat=other) == []
    assert divided(True, session=np.where(np.arange(12) > 0, labels, "b")) == []
    assert divided(True, marker=np.where(labels == "c", "b", labels)) == []
    assert divided(True, marker=np.where(labels == "c", "", labels)) == []


def drawn_choice(case: Case, rng: np.random.Generator, session: float = 1.0) -> Choice:
    """The fit of all records with noise as stated, the first session's so many times larger,
    without any cause.
    """
    own = covariance_of_records(case.records)[range(RECORDS), range(RECORDS)]
    labels = case.records.conditions.session
    assert labels is not None
    off = np.einsum("nij,nj->ni", np.linalg.cholesky(own), rng.standard_normal((RECORDS, 3)))
    off[labels == labels[0]] *= session
    arm = Arm.load("sino6")
    records = replace(case.records, reference=arm.positions(case.records.q) + off)
    asked = problem_of(ErrorModel.of(arm), records, ["geometry"], case.fit.problem.setup)
    at = fit(asked, used=np.ones(RECORDS, dtype=bool))
    library = case.library[:2]
    drawn = replace(case, records=records, library=library, others=())
    return replace(drawn, design=design_of(at, library, ())).choice()


def test_p_values_of_groups_are_uniform_when_nothing_is_there(free_case, monkeypatch):
    """The first session's p, over draws of noise; Bonferroni's factor taken back, so only what it
    did not cut off.
    """
    monkeypatch.setattr(groups, "THRESHOLDS", replace(THRESHOLDS, odd=2.0))
    rng = np.random.default_rng(21)
    labels = free_case.records.conditions.session
    assert labels is not None
    chances = []
    for _ in range(40):
        drawn = groups.odd_groups(drawn_choice(free_case, rng))
        chances.append(next(g.p_value for g in drawn if g.name == f"session {labels[0]}"))
    cut = np.array(chances)
    assert np.mean(cut == 1.0) == pytest.approx(1 - 1 / len(set(labels)), abs=0.2)
    assert kstest(cut[cut < 1.0], "uniform").pvalue > 1e-3


def test_a_session_with_larger_residuals(free_case):
    labels = free_case.records.conditions.session
    assert labels is not None
    choice = drawn_choice(free_case, np.random.default_rng(2), session=3.0)
    (group,) = groups.odd_groups(choice)
    assert group.name == f"session {labels[0]}"
    assert group.times == pytest.approx(3.0, rel=0.25)
    assert group.records == int(np.sum(choice.fit.used & (labels == labels[0])))
    assert group.p_value < 1e-8


@pytest.mark.parametrize("cause", [None, "encoder_eccentricity"])
def test_held_out_prediction_is_that_of_a_refit(tmp_path, cause):
    """Records left out are as far from a calibration of all others as the inner products say."""
    case = case_of(tmp_path / "data.csv", 3, cause, "free")
    blocks = () if cause is None else (case.block(f"{cause}:{draw(3, cause).hidden[0].joint}"),)
    causes = [free(case.library[case.design.blocks[k].candidate][0]) for k in blocks]
    case = replace(case, design=design_of(case.refit(causes), case.library, case.others))
    choice = case.choice(blocks)
    for number in np.unique(case.folds)[:3].tolist():
        out = choice.fit.used & (case.folds == number)
        whole = choice.gram_of_folds
        others = whole.without(gram_of(case.design, case.noise, [out]))
        space = ModelSpace(choice.candidates, others, True, (0.0,))
        rows = np.flatnonzero(out)
        fold = {
            model: np.linalg.norm(poses - case.records.reference[rows], axis=1)
            for model, poses in gain._fold(choice, whole, number, rows).items()
        }
        widths = WIDTHS[list(space.marginal(blocks).best.widths)]
        effects = [
            effect.at((), tuple(width * term.typical for term in effect.terms))
            for effect, width in zip(map(choice.variant, blocks), widths, strict=True)
        ]
        refit = case.refit(effects, used=choice.fit.used & ~out)
        wanted = np.linalg.norm(
            refit.point.prediction.tips[out] - case.records.reference[out], axis=1
        )
        close(fold["median"], wanted, 2e-8)
        # A refit without its only cause would find another scatter than the records have.
        for block in blocks:
            close(fold[block], fold["recalibrated"], 1e-12)
        if not blocks:
            close(fold["recalibrated"], wanted, 2e-8)


def test_estimates_answer_a_curve_that_a_refit_holds(free_case):
    """Their derivative by each value of the curve, by refits; the curve has the posterior's u."""
    case = free_case
    curve, other = case.block("joint_error_curve:3"), case.block("encoder_eccentricity:2")
    blocks = tuple(sorted((curve, other)))
    choice = case.choice(blocks)
    model = choice.posterior.median_model
    effect = choice.variant(curve)
    width = WIDTHS[model.widths[blocks.index(other)]]
    beside = choice.variant(other)
    within = beside.at((), tuple(float(width) * term.typical for term in beside.terms))

    def refit(values: Array) -> Fit:
        held = ErrorModel(Arm.load("sino6"), (effect.at(tuple(values.tolist())),))
        setup = case.fit.problem.setup
        asked = problem_of(held, case.records, ["geometry", within], setup)
        return fit(replace(asked, candidates=1), used=case.fit.used)

    zero = np.zeros(len(effect.terms))
    at = refit(zero)
    found = choice.held_curves(at, [effect])
    own = model.entries[curve]
    typical = np.array([term.typical for term in effect.terms])
    wanted = model.covariance[own, own] * np.outer(typical, typical)
    close(found.covariance / wanted, np.ones_like(wanted), 1e-9)
    close(found.effects[0].u / np.sqrt(np.diag(wanted)), np.ones(len(typical)), 1e-9)
    close(found.of_effect(effect), found.covariance, 0.0)
    scales = np.sqrt(np.diag(at.covariance))
    for number in (2, len(zero) // 2):
        step = 2e-5 * np.eye(len(zero))[number]
        change = (refit(step).point.x - refit(-step).point.x) / 4e-5
        size = np.abs(change / scales).max()
        close(found.response[:, number] / scales / size, change / scales / size, 0.01)
    added = found.response @ wanted @ found.response.T
    close(found.added_covariance, added, 1e-9 * np.abs(added).max())
