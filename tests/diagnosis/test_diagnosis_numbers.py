"""What the diagnosis works out lazily from inner products, against dense matrices of all records and plain formulas.

The dense side knows the records, the noise as stated and the columns of the design; covariances, seats, bars, priors and
everything that follows are built anew with NumPy and SciPy alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from aacmm_pin.diagnosis.evidence import Conditional
from aacmm_pin.diagnosis.nuisance_projection import Projection
from blind import chains, draw
from numpy.typing import NDArray
from scipy.linalg import null_space, orth, subspace_angles
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, f, kstest, multivariate_normal, t

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.cross_validation import parts_of
from aacmm_pin.calibration.fit import Fit, fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import chow_test as groups
from aacmm_pin.diagnosis import cross_validation as gain
from aacmm_pin.diagnosis import findings as geometric
from aacmm_pin.diagnosis import gram_matrix, model_extension
from aacmm_pin.diagnosis import significance as findings
from aacmm_pin.diagnosis.candidates import candidates
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.diagnosis.design_matrix import Block
from aacmm_pin.diagnosis.gram_matrix import Gram, products_of
from aacmm_pin.diagnosis.model_extension import Choice, ProblemOf, choose, free
from aacmm_pin.effects import Effect, EncoderSlip, JointPeriodicError
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.smooth_functions import Cosines
from aacmm_pin.measurements.records import Measurements

Array = NDArray[np.float64]
ENCODER, REFERENCE, PROBE, LENGTH = 8e-6, 12e-6, 10e-6, 20e-6
RECORDS = 60
MAGNITUDES = (0.2, 0.5, 1.0, 2.0, 10.0)
PLANS = ("free", "seats", "unknown-seats")


@dataclass(frozen=True, eq=False)
class Case:
    """What was diagnosed."""

    records: Measurements
    choice: Choice
    problem: ProblemOf

    def refit(self, effects: Sequence[Effect], used: NDArray[np.bool_] | None = None) -> Fit:
        return fit(self.problem(effects), used=used)


def case_of(path: Path, seed: int, cause: str | None, plan: str, **options: object) -> Case:
    """A file of the plant and what is chosen in it."""
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
    parts = parts_of(first, np.random.default_rng(1))[1]
    library = candidates(ErrorModel.of(arm), records, first.problem)
    return Case(records, choose(problem, first, library, covariates(arm, records), parts), problem)


def away(case: Case) -> Case:
    """The same at a point where no fit has ended: every residual is something, no gradient vanishes."""
    design = case.choice.design
    moved = design.tips + np.random.default_rng(5).normal(0.0, 4e-5, design.tips.shape)
    design = replace(design, tips=moved)
    gram = Gram(products_of(design, case.choice.parts))
    return replace(case, choice=replace(case.choice, design=design, gram=gram, held=gram))


@pytest.fixture(scope="module", params=PLANS)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    return away(case_of(tmp_path_factory.mktemp("plans") / "data.csv", 3, None, request.param))


@pytest.fixture(scope="module")
def free_case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return case_of(tmp_path_factory.mktemp("free") / "data.csv", 3, None, "free")


# --- the dense side


def covariance_of_records(records: Measurements) -> Array:
    """Readings, references and contacts (n, n, 3, 3): a seat with coordinates has its error in common [m²]."""
    by_reading = chains.read().jacobian(records.q)
    found = np.zeros((records.n, records.n, 3, 3))
    own = ENCODER**2 * by_reading @ by_reading.transpose(0, 2, 1) + 1e-24 * np.eye(3)
    seat = records.conditions.seat
    for i in range(records.n):
        found[i, i] = own[i] + (REFERENCE if seat is None else PROBE) ** 2 * np.eye(3)
        if seat is not None and records.known.all():
            found[i, seat == seat[i]] += REFERENCE**2 * np.eye(3)
    return found


def whitened(case: Case, part: NDArray[np.intp], kept: NDArray[np.bool_]) -> Array:
    """Rows of the kept records, columns and residual, unknown points taken out; each part has points of its own."""
    design, records = case.choice.design, case.records
    n, width = records.n, design.width
    jacobian = np.concatenate([columns for _, columns in design.strips()], axis=2)
    covariance = covariance_of_records(records)
    seat = records.conditions.seat
    unknown = seat is not None and not records.known.any()
    points = dict(zip(case.choice.fit.observations.labels, case.choice.fit.solution.point.seats, strict=True))
    target = np.array([points[s] for s in seat]) if unknown and seat is not None else records.reference
    found = []
    for number in np.unique(part[kept]):
        mine = np.flatnonzero(kept & (part == number))
        lower = np.linalg.cholesky(covariance[np.ix_(mine, mine)].transpose(0, 2, 1, 3).reshape(3 * mine.size, -1))
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


def _bars(records: Measurements, labels: list[str], points: dict[str, Array]) -> tuple[Array, Array]:
    """Lengths of the bars with an end among the seats; an end that nobody touched is free and takes its bar with it."""
    residual, rows = [], []
    for bar in records.bars():
        if bar.seat_a in labels and bar.seat_b in labels:
            way = points[bar.seat_a] - points[bar.seat_b]
            length = np.linalg.norm(way)
            row = np.zeros((len(labels), 3))
            row[labels.index(bar.seat_a)], row[labels.index(bar.seat_b)] = way / length / LENGTH, -way / length / LENGTH
            residual.append((length - bar.length) / LENGTH)
            rows.append(row.ravel())
    return np.array(residual), np.array(rows).reshape(-1, 3 * len(labels))


def prior_rows(case: Case) -> Array:
    """What is known of the nuisances (m, columns + 1), in units of their widths."""
    problem, x = case.choice.design.fit.problem, case.choice.design.fit.solution.point.x
    kept = case.choice.design.kept
    rows = np.zeros((kept.size, case.choice.design.width + 1))
    rows[:, : kept.size] = np.eye(kept.size)
    rows[:, -1] = ((x - problem.start) / problem.widths)[kept]
    return rows


def dense(case: Case, part: NDArray[np.intp], left_out: Sequence[int] = ()) -> Array:
    """All rows, prior rows last."""
    return np.vstack([whitened(case, part, ~np.isin(part, left_out) & case.choice.fit.used), prior_rows(case)])


def some_blocks(choice: Choice) -> list[int]:
    """One block of each size, spread over the library and the covariates."""
    sizes: dict[int, int] = {}
    for k, b in enumerate(choice.question.blocks):
        sizes.setdefault(b.size, k)
        if b.candidate in (2, 9):
            sizes.setdefault(-b.candidate, k)
    return sorted(set(sizes.values()))


def freedom(block: slice) -> float:
    """Within how many typical magnitudes the parameters of an admitted block are free."""
    return 10.0 if block.stop - block.start < 8 else 2.0


def beside(rows: Array, nuisances: int, blocks: Sequence[slice]) -> tuple[Array, Array]:
    """Rows with those of admitted blocks' own priors, and the columns that are refitted."""
    width = rows.shape[1]
    extra = np.vstack([np.eye(width)[s] / freedom(s) for s in blocks] or [np.empty((0, width))])
    rows = np.vstack([rows, extra])
    return rows, np.concatenate([rows[:, :nuisances], *(rows[:, s] for s in blocks)], axis=1)


@pytest.mark.parametrize("left_out", [(), (1,), (0, 3)])
def test_inner_products(case: Case, left_out: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gram_matrix, "CHUNK", 7)  # several in every part
    choice = case.choice
    gram = Gram(products_of(choice.design, choice.parts), frozenset(left_out))
    rows = dense(case, choice.parts, left_out)
    wanted = rows.T @ rows
    size = np.sqrt(np.diag(wanted)) + 1e-3
    whole = slice(0, wanted.shape[0])
    np.testing.assert_allclose(gram.strip(whole) / np.outer(size, size), wanted / np.outer(size, size), atol=2e-6)
    np.testing.assert_allclose(gram.residual, wanted[-1], atol=2e-6 * size.max() * size[-1])
    gram.products.release()  # what is asked for now is worked out again
    for k in some_blocks(choice):
        own = choice.question.blocks[k].columns
        scale = np.outer(size[own], size[own])
        np.testing.assert_allclose(gram.inside(choice.question.blocks[k]) / scale, wanted[own, own] / scale, atol=2e-6)
    assert gram.free == len(rows) - choice.design.nuisances


@pytest.mark.parametrize("excluded", [False, True])
def test_a_seat_in_two_parts_has_points_of_its_own_in_each(case: Case, excluded: bool) -> None:
    """Also where records do not count, such as all of a seat in one part."""
    part = np.arange(RECORDS) % 3
    if excluded:
        seat, used = case.records.conditions.seat, np.arange(RECORDS) % 7 != 3
        used &= (part != 1) | (np.arange(RECORDS) > 20 if seat is None else seat != seat[0])
        fit_ = replace(case.choice.fit, used=used)
        case = replace(case, choice=replace(case.choice, fit=fit_, design=replace(case.choice.design, fit=fit_)))
    gram = Gram(products_of(case.choice.design, part), frozenset({2}))
    rows = dense(case, part, [2])
    np.testing.assert_allclose(gram.residual[-1], rows[:, -1] @ rows[:, -1], rtol=1e-6)
    assert gram.free == len(rows) - case.choice.design.nuisances


@pytest.mark.parametrize("admitted", [(), (5,), (5, -1), (5, None)])  # None: one with many columns
@pytest.mark.parametrize("left_out", [(), (1,)])
def test_conditional_and_evidence(case: Case, admitted: tuple[int | None, ...], left_out: tuple[int, ...]) -> None:
    """χ², gradient, information by least squares; evidence as the ratio of two Gaussian marginal likelihoods."""
    choice = case.choice
    question = choice.question
    many = max(range(len(question.blocks)), key=lambda k: question.blocks[k].size)
    admitted = tuple(many if k is None else k % len(question.blocks) for k in admitted)
    variance = 1.7
    gram = Gram(products_of(choice.design, choice.parts), frozenset(left_out))
    left = Conditional(Projection(gram, admitted), variance)
    slices = [question.blocks[k].columns for k in admitted]
    rows, refitted = beside(dense(case, choice.parts, left_out), choice.design.nuisances, slices)
    basis = np.linalg.qr(refitted)[0]
    free_rows = rows - basis @ (basis.T @ rows)
    residual = free_rows[:, -1]
    assert left.projection.chi2 == pytest.approx(residual @ residual, rel=1e-6)
    step = -np.linalg.lstsq(refitted, rows[:, -1])[0]
    np.testing.assert_allclose(left.projection.solution(), step, atol=1e-5 * np.abs(step).max())
    data = rows[: len(rows) - choice.design.nuisances - sum(s.stop - s.start for s in slices)]
    own = np.concatenate([np.arange(choice.design.nuisances), *(np.arange(s.start, s.stop) for s in slices)])
    covariance = np.linalg.inv(refitted.T @ refitted)
    np.testing.assert_allclose(left.covariance, variance * covariance, atol=1e-6 * np.abs(covariance).max())
    assert left.projection.determined == pytest.approx(np.trace(data[:, own].T @ data[:, own] @ covariance), rel=1e-5)
    for k in some_blocks(choice):
        if k in admitted:
            assert left.evidences[k] == -np.inf
            continue
        block = question.blocks[k]
        columns = free_rows[:, block.columns]
        scale = max(np.abs(columns.T @ columns).max(), 1e-6)
        np.testing.assert_allclose(left.information(block), columns.T @ columns / variance, atol=1e-6 * scale)
        np.testing.assert_allclose(
            left.gradient[block.columns], columns.T @ residual / variance, atol=1e-6 * np.sqrt(scale) * np.sqrt(len(rows))
        )
        wanted = log_bayes_factor(data, choice.design.nuisances, rows, slices, block.columns, variance)
        assert left.evidences[k] == pytest.approx(wanted, abs=1e-4)
        assert left.evidence(k) == pytest.approx(wanted, abs=1e-4)


def log_bayes_factor(
    data: Array, nuisances: int, rows: Array, admitted: Sequence[slice], block: slice, variance: float
) -> float:
    """Log of N(r; m, V + τ² G Gᵀ) over N(r; m, V), averaged over τ: V holds noise, nuisances, admitted causes.

    With a variance factor v, all that was known beforehand is as much less sure as the records are.
    """
    start = rows[len(data) : len(data) + nuisances, -1]  # the nuisances are where -start is, give or take one
    known = np.concatenate([data[:, :nuisances], *(freedom(s) * data[:, s] for s in admitted)], axis=1)
    residual = data[:, -1] - data[:, :nuisances] @ start
    nothing = variance * (np.eye(len(data)) + known @ known.T)
    columns = data[:, block]
    base = multivariate_normal.logpdf(residual, cov=nothing)
    each = [multivariate_normal.logpdf(residual, cov=nothing + t**2 * columns @ columns.T) for t in MAGNITUDES]
    return float(np.logaddexp.reduce(each) - np.log(len(each)) - base)


@pytest.mark.parametrize("left_out", [(), (1,)])
@pytest.mark.parametrize("taken_out", [0, 1, 2])
def test_evidence_without_one_of_the_admitted(case: Case, taken_out: int, left_out: tuple[int, ...]) -> None:
    """As marginal likelihoods beside the others alone, the block that was taken out among the candidates."""
    choice, question, variance = case.choice, case.choice.question, 1.7
    admitted = (5, 17, len(question.blocks) - 1)
    gram = Gram(products_of(choice.design, choice.parts), frozenset(left_out))
    for dof in (50.0, np.inf):  # of a variance that comes from the records, and of a known one
        whole = Conditional(Projection(gram, admitted), variance, dof)
        found = whole.evidences_without(admitted[taken_out])
        place = findings.Place.of(replace(choice, gram=gram), whole, admitted[taken_out])
        odds = question.odds(question.without(question.struck_out(place.left.projection.admitted), found))
        np.testing.assert_allclose(place.odds, odds, atol=1e-6)
    rest = [k for k in admitted if k != admitted[taken_out]]
    slices = [question.blocks[k].columns for k in rest]
    all_rows = dense(case, choice.parts, left_out)
    rows, _ = beside(all_rows, choice.design.nuisances, slices)
    data = all_rows[: len(all_rows) - choice.design.nuisances]
    for k in sorted({*some_blocks(choice), *admitted}):
        if k in rest:
            assert found[k] == -np.inf
            continue
        wanted = log_bayes_factor(data, choice.design.nuisances, rows, slices, question.blocks[k].columns, variance)
        assert found[k] == pytest.approx(wanted, abs=1e-4)


def test_evidence_of_all_admitted_together(case: Case) -> None:
    """Bayes factors of marginal likelihoods, each beside the blocks before it, add up."""
    choice, question, variance = case.choice, case.choice.question, 1.7
    admitted = (5, 17, len(question.blocks) - 1)
    gram = Gram(products_of(choice.design, choice.parts))
    all_rows = dense(case, choice.parts)
    data = all_rows[: len(all_rows) - choice.design.nuisances]
    wanted = 0.0
    for count, k in enumerate(admitted):
        before = [question.blocks[j].columns for j in admitted[:count]]
        rows, _ = beside(all_rows, choice.design.nuisances, before)
        wanted += log_bayes_factor(data, choice.design.nuisances, rows, before, question.blocks[k].columns, variance)
    found = Conditional(Projection(gram, admitted), variance).of_admitted()
    assert found == pytest.approx(wanted, abs=1e-4)


def test_retained_fraction_and_canonical_correlation(case: Case) -> None:
    choice, question = case.choice, case.choice.question
    left = Conditional(Projection(choice.held, ()))
    rows = dense(case, choice.parts)
    basis = np.linalg.qr(rows[:, : choice.design.nuisances])[0]
    off = rows - basis @ (basis.T @ rows)
    some = some_blocks(choice)
    for k in some:
        own = question.blocks[k].columns
        values = np.linalg.svd(off[:, own], compute_uv=False)
        if values[-1] < 1e-4 * values[0]:
            continue  # the best step is then a matter of rounding
        step = np.linalg.lstsq(off[:, own], off[:, -1])[0]
        wanted = np.linalg.norm(off[:, own] @ step) / np.linalg.norm(rows[:, own] @ step)
        assert findings.retained(left, question.blocks[k]) == pytest.approx(wanted, rel=1e-3)
    for one, other in itertools.pairwise(some):
        a, b = (question.blocks[k] for k in (one, other))
        spans = [orth(off[:, block.columns], rcond=3e-5) for block in (a, b)]
        if min(min(np.linalg.svd(off[:, x.columns])[1]) for x in (a, b)) > 1e-3 * np.abs(off[:, a.columns]).max():
            wanted = np.cos(subspace_angles(*spans).min())
            assert findings.canonical(left, a, b) == pytest.approx(wanted, abs=1e-5)


def test_pairs_that_cannot_be_told_apart(case: Case) -> None:
    """By what the other cause, within its largest size, leaves of each; where either of two shows at all."""
    choice = narrowed(case.choice)
    choice = replace(choice, gram=Gram(products_of(choice.design, choice.parts)))
    rows = dense(replace(case, choice=choice), choice.parts)
    basis = np.linalg.qr(rows[:, : choice.design.nuisances])[0]
    off = rows - basis @ (basis.T @ rows)
    blocks = choice.question.blocks
    alone = [b for b in blocks if sum(other.candidate == b.candidate for other in blocks) == 1]
    shown = [b for b in alone if np.square(off[:, b.columns]).sum() >= 15.0 * b.size]

    def apart(mine: Block, its: Block) -> float:
        could = np.vstack([off[:, its.columns], np.eye(its.size) / MAGNITUDES[-1]])
        does = np.vstack([off[:, mine.columns], np.zeros((its.size, mine.size))])
        return float(np.square(does - could @ np.linalg.lstsq(could, does)[0]).sum()) / mine.size

    wanted = [
        (choice.design.names[one.candidate], choice.design.names[other.candidate])
        for one, other in itertools.combinations(shown, 2)
        if min(apart(one, other), apart(other, one)) < 2.0 * np.log(19.0)
    ]
    assert findings.look_alikes(choice) == wanted


def test_prior_of_the_candidates(free_case: Case) -> None:
    """Nine tenths to the library, each cause by how usual it is, one tenth to the covariates alike."""
    choice = free_case.choice
    prior, causes = np.exp(choice.question.log_prior), choice.design.causes
    usual = np.array([variants[0].usual for variants in choice.library])
    np.testing.assert_allclose(prior[:causes], 0.9 * usual / usual.sum(), rtol=1e-12)
    np.testing.assert_allclose(prior[causes:], 0.1 / len(choice.others), rtol=1e-12)
    first = [variants[0] for variants in choice.library]
    inside = {
        owner: {k for k, e in enumerate(first) if freer.cause in e.contained_in and freer.place == e.place}
        for owner, freer in enumerate(first)
    }
    assert choice.question.contained == {owner: causes for owner, causes in inside.items() if causes} != {}


def test_inner_values_by_their_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole order unless another is far better; the top of a parabola; u of a step by the gaps between the records."""
    records = Measurements.of(np.zeros((4, 6)), conditions=Conditions(4, time=np.array([0.0, 10.0, 30.0, 70.0])))
    fit_ = SimpleNamespace(problem=SimpleNamespace(measurements=records))
    for far, wanted in ((1.0, 4.0), (3.0, 4.11)):
        choice: Any = SimpleNamespace(variant=lambda _: JointPeriodicError(3, 4.0), fit=fit_, library=())
        peak = far / 0.11**2  # so much better than the whole order
        monkeypatch.setattr(
            model_extension, "_evidences", lambda _, k, tried, p=peak: np.array([-p * (e.order - 4.11) ** 2 for e in tried])
        )
        refined = model_extension._refined(choice, 0)
        assert isinstance(refined, JointPeriodicError)
        assert refined.order == pytest.approx(wanted, abs=1e-3)
    slip: Any = SimpleNamespace(variant=lambda _: EncoderSlip(3, 20.0), fit=fit_)
    monkeypatch.setattr(model_extension, "_evidences", lambda _, k, tried: np.zeros(len(tried)))
    times = np.array([0.0, 5.0, 20.0, 50.0])
    gaps = np.array([0.0, 10.0, 20.0, 40.0])  # around each of them; the first is the first record itself
    variance = np.square(times - 20.0).mean() + np.square(gaps).mean() / 12.0
    assert model_extension.step_of(slip, 0, "time_s") == model_extension.Step(pytest.approx(np.sqrt(variance)), 0.0, 50.0)


def test_what_residuals_may_depend_on(sino6: Arm, rng: np.random.Generator) -> None:
    n, time = 80, np.sort(rng.uniform(0.0, 5e3, 80))
    q, session = rng.uniform(-2.0, 2.0, (n, 6)), np.array(["a"] * 30 + ["b"] * 50, dtype=object)
    records = Measurements.of(q, sino6.positions(q), conditions=Conditions(n, time=time, session=session))
    found = {covariate.name: covariate for covariate in covariates(sino6, records)}
    assert [way.carrier for way in found["joint 3"].variants] == ["before 3"]
    angles = [f"angle {row}" for row in range(1, 7)]
    assert [way.carrier for way in found["time"].variants] == ["room", *angles, "lengths", "room", "room"]

    def same(functions: Array, columns: Sequence[Array]) -> None:
        wanted = np.stack(columns, axis=1)
        np.testing.assert_allclose(functions, wanted / np.sqrt(np.square(wanted).mean(axis=0)), rtol=1e-9, atol=1e-12)

    inside = [(session == name).astype(float) for name in ("a", "b")]
    same(found["time"].variants[-1].functions, [s * (time - time @ s / s.sum()) ** k for k in range(3) for s in inside])
    for way, acts, turns in zip(found["joint 2 × joint 4"].variants, (1, 3), (3, 1), strict=True):
        assert way.carrier == f"angle {acts + 1}"
        own, other = q[:, acts], q[:, turns]
        same(way.functions, [f * g(other) for f in (np.ones(n), np.cos(own), np.sin(own)) for g in (np.cos, np.sin)])


def test_smooth_functions_are_orthogonal_over_the_records(rng: np.random.Generator) -> None:
    values = rng.permutation(40) ** 2.0
    functions = Cosines.over("time", values, 6).of_values(values)
    np.testing.assert_allclose(functions.T @ functions / 40.0, np.diag([1.0] + [0.5] * 6), atol=1e-12)


def test_ratio_and_its_directions() -> None:
    left: Any = SimpleNamespace(information=lambda _: np.diag([3.99, 0.99, 8.99]), gradient=np.array([7.0, 4.0, 2.0, 0.0]))
    assert findings.Ratio.of(left, Block(0, 0, slice(1, 4), EncoderSlip(3, 0.0))) == pytest.approx((8.0, 2.0))


def test_structure_that_nothing_has_takes_from_the_probability(free_case: Case) -> None:
    """By the chance that as many of its ten directions look as strong as the cause, of all that have as many columns."""
    choice = replace(free_case.choice, admitted=(5,))
    block, blocks = choice.question.blocks[5], choice.question.blocks
    own = findings.Ratio.of(findings.Place.of(choice, choice.left, 5).left, block).value
    alike = len({b.candidate for b in blocks if b.size >= block.size})
    excess = 10.0 * own / block.size / f.isf(0.3 / alike, block.size, 10.0)
    with_it, alone = (findings.strengths(choice, e, [], np.random.default_rng(1))[0].probability for e in (excess, 0.0))
    assert with_it == pytest.approx(0.7 * alone, rel=1e-6)


# --- chances when nothing is there


def nothing_there(case: Case, draws: int, seed: int) -> tuple[Array, Array]:
    """Products of all columns with draws of noise and of true values within what is stated, and dense rows of one draw."""
    choice = case.choice
    rows = dense(case, choice.parts)
    noise = np.random.default_rng(seed).standard_normal((len(rows), draws))
    return rows[:, :-1].T @ noise, np.column_stack([rows[:, :-1], noise[:, 0]])


def scores(left: Conditional, block: Block, products: Array) -> Array:
    gradients = left.gradients(products)[block.columns]
    return np.asarray(np.einsum("id,id->d", gradients, np.linalg.pinv(left.information(block), rcond=1e-10) @ gradients))


@pytest.mark.parametrize("own_draws", [True, False])
def test_the_score_is_chi2_when_nothing_is_there(case: Case, own_draws: bool) -> None:
    """By noise drawn here, and by the draws of the package itself; the first draw also by least squares."""
    choice, question = case.choice, case.choice.question
    gram = choice.held
    left = Conditional(Projection(gram, ()))
    products, rows = nothing_there(case, 1000, 7)
    if own_draws:
        products = gram.products.drawn(1000, np.random.default_rng(9))
    for k in some_blocks(choice):
        block = question.blocks[k]
        rank = np.linalg.matrix_rank(left.information(block), rtol=1e-10, hermitian=True)
        drawn = scores(left, block, products)
        assert kstest(drawn, chi2(rank).cdf).pvalue > 1e-3
        if not own_draws:
            # Of a free curve some coefficients are all but unknown: left out by the same bound as in the pseudo-inverse.
            basis = np.linalg.qr(rows[:, : choice.design.nuisances])[0]
            own = rows[:, block.columns] - basis @ (basis.T @ rows[:, block.columns])
            left_of = rows[:, -1] - basis @ (basis.T @ rows[:, -1])
            taken = own @ np.linalg.lstsq(own, left_of, rcond=1e-5)[0]
            assert drawn[0] == pytest.approx(np.square(taken).sum(), rel=1e-3, abs=1e-5)


def narrowed(choice: Choice) -> Choice:
    """Only the causes of two joints, so that a hundred draws stay cheap."""
    names = choice.design.names
    few = [
        c
        for c in range(choice.design.causes)
        if names[c].endswith((":2", ":3")) and choice.question.contained.get(c) is None
    ]
    number = {c: k for k, c in enumerate(few)}
    prior = choice.question.log_prior[few]
    design = choice.design.of([k for k, b in enumerate(choice.question.blocks) if b.candidate in number])
    design = replace(design, blocks=tuple(replace(b, candidate=number[b.candidate]) for b in design.blocks))
    question = replace(choice.question, design=design, log_prior=prior, contained={}, log_share=np.zeros(len(design.blocks)))
    return replace(choice, question=question, design=design)


def test_the_family_wise_p_value_is_no_smaller_than_chance(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """P(p ≤ α) ≤ α for the best of all candidates in noise, and p is not so large that it never says anything."""
    monkeypatch.setattr(findings, "DRAWS", 100)
    choice = narrowed(case.choice)
    products, _ = nothing_there(replace(case, choice=choice), 120, 11)
    gram = Gram(products_of(choice.design, choice.parts))
    rng = np.random.default_rng(12)
    found = []
    for k in range(products.shape[1]):
        left = Conditional(Projection(gram, ()))
        left.__dict__["gradient"] = left.gradients(products[:, k : k + 1])[:, 0]  # where the property keeps it
        odds = choice.question.odds(left.evidences)
        best = int(np.argmax(odds))
        block = choice.question.best_blocks(left.evidences)[best]
        found.append(findings.family_wise(choice.question, left, float(odds[best]), block, rng))
    assert kstest(found, "uniform", alternative="greater").pvalue > 1e-3
    assert np.quantile(found, 0.2) < 0.4


# --- groups, and records left out


def test_what_one_cause_brings(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """A ratio of sums over the parts, each distance over its noise, with Student's interval (Cochran 1977, 6.4)."""
    part, (with_it, without), u = np.arange(20) % 4, rng.uniform(0.5, 2.0, (2, 20)), rng.uniform(1.0, 3.0, 20)
    each = [(k, [with_it[part == k], without[part == k]]) for k in range(4)]
    of_part = {k: (np.flatnonzero(part == k), None) for k in range(4)}
    monkeypatch.setattr(gain, "_predictions", lambda *_: iter(each))
    noise = np.square(u)[:, None, None] * np.eye(3)
    fit_ = SimpleNamespace(residual_noise=noise)
    choice: Any = SimpleNamespace(fit=fit_, in_one_part=lambda _: False, held=None, of_part=of_part)
    left, whole = (np.array([np.square(d / u)[part == k].sum() for k in range(4)]) for d in (with_it, without))
    share = left.sum() / whole.sum()
    off = t.ppf(0.975, 3) * np.sqrt(4.0 / 3.0 * np.square(left - share * whole).sum()) / whole.sum()
    wanted = [1.0 - np.sqrt(max(s, 0.0)) for s in (share, share + off, share - off)]
    assert gain.brought(choice, (7,), 7) == pytest.approx(wanted, rel=1e-9)


def test_the_interval_of_the_gain_is_that_of_many_parts(rng: np.random.Generator) -> None:
    squares = 1.0 + 0.5 * rng.uniform(-1.0, 1.0, 400)
    low, high = gain._interval(np.ones(400), np.sqrt(squares), np.arange(400), rng)
    u = 0.5 * squares.std(ddof=1) / 20.0 / np.sqrt(squares.mean())
    assert high - low == pytest.approx(2.0 * 1.96 * u, rel=0.08)
    assert low < 1.0 - np.sqrt(squares.mean()) < high


@pytest.mark.parametrize("known", [True, False])
def test_causes_have_to_prove_themselves(known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the noise is known a cause may harm by chance, else it has to help by more; groups of their own stay."""
    error = 1.0 / np.sqrt(3.0)  # of the mean of the four parts below
    for mean in (-3.0, -1.7, -1.6, 1.6, 1.7):
        better = mean * error + np.array([-1.0, 1.0, -1.0, 1.0])
        monkeypatch.setattr(gain, "_losses", lambda choice, training, blocks, b=better: 0.0 * b if 7 in blocks else b)
        fit_: Any = SimpleNamespace(stated=True, unmodelled=0.0 if known else 1e-5)
        for whole in (True, False):
            choice: Any = SimpleNamespace(fit=fit_, in_one_part=lambda block, whole=whole: whole)
            stays = whole or mean > (-1.64 if known else 1.64)
            assert gain.survivors(choice, (7,), choice) == ((7,) if stays else ()), (mean, whole)


def misfit(rows: Array, nuisances: int, measured: int) -> tuple[float, float]:
    """χ² with what is refitted at its best, and the degrees of freedom that priors leave."""
    z, data = rows[:, :nuisances], rows[:measured, :nuisances]
    left = rows[:, -1] - z @ np.linalg.lstsq(z, rows[:, -1])[0]
    determined = np.trace(data.T @ data @ np.linalg.inv(z.T @ z))
    return float(left @ left), measured - float(determined)


@pytest.mark.parametrize("alike", [True, False])
def test_chow_s_test_of_every_session(case: Case, alike: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where residuals do not scatter alike, each side's variance and degrees of freedom are those of its own records."""
    monkeypatch.setattr(groups, "ODD", 2.0)
    labels = case.records.conditions.session
    assert labels is not None
    rng = np.random.default_rng(8)
    off = (labels == labels[0])[:, None] * rng.normal(0.0, 2e-5, (RECORDS, 3))
    used = case.choice.fit.used & (np.arange(RECORDS) != 7)
    fit_ = replace(case.choice.fit, used=used)
    design = replace(case.choice.design, fit=fit_, tips=case.choice.design.tips + off)
    choice = replace(case.choice, fit=fit_, design=design, admitted=())
    case = replace(case, choice=choice)
    spread = np.zeros((RECORDS, 3)) if alike else rng.normal(0.0, 1.0, (RECORDS, 3))
    scatter = np.exp(spread)[:, :, None] * np.eye(3)
    if not alike:
        monkeypatch.setattr(groups, "_scatter", lambda _: scatter)
    names, part = np.unique(labels, return_inverse=True)
    nuisances = choice.design.nuisances
    found = {group.name: group for group in groups.odd_groups(choice) if group.name.startswith("session")}
    assert len(found) == len(names) >= 3
    assert [group.p_value for group in found.values()] == sorted(group.p_value for group in found.values())
    assert found[f"session {labels[0]}"].p_value < 0.5  # the others' bound is 1
    total = dense(case, part)
    whole = misfit(total, nuisances, len(total) - nuisances)
    for number, name in enumerate(names):
        rows = dense(case, part, [number])
        others = misfit(rows, nuisances, len(rows) - nuisances)
        more = whole[1] - others[1]
        ratio = max((whole[0] - others[0]) / more, 0.0) / (others[0] / others[1])
        group = found[f"session {name}"]
        assert group.times == pytest.approx(np.sqrt(ratio), rel=1e-4)
        own, rest = (np.exp(spread[side]).ravel() for side in (used & (labels == name), used & (labels != name)))
        of_own, of_rest = (c.sum() ** 2 / c.size / np.square(c).sum() for c in (own, rest))
        chance = f.sf(ratio * rest.mean() / own.mean(), more * of_own, others[1] * of_rest)
        assert group.p_value == pytest.approx(min(1.0, len(names) * chance), rel=1e-3)
        assert group.records == int(np.sum(used & (labels == name)))


def test_causes_that_leave_the_noise_untold_are_not_admitted(free_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    choice = free_case.choice
    monkeypatch.setattr(model_extension, "_chosen", lambda *_: replace(choice, admitted=(5,)))
    monkeypatch.setattr(model_extension, "refitted", lambda *_: SimpleNamespace(tells_noise=False))
    found = model_extension._standing(free_case.problem, choice.fit, choice.library, choice.others, choice.parts, False)
    assert found.admitted == ()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.95])
def test_the_part_of_the_scatter_that_readings_have(share: float) -> None:
    """Residuals drawn with it, in a turned frame; records that do not count are far off."""
    rng, n = np.random.default_rng(3), 600
    used, frame = np.arange(n) % 6 > 0, Rotation.from_rotvec([0.4, -0.9, 1.1]).as_matrix()
    whitening = np.where(np.arange(n) % 2, 1e4, 3e4)[:, None, None] * np.eye(3)
    levers = rng.normal(size=(n, 3, 2)) * rng.uniform(0.1, 1.0, (n, 1, 1))  # by two readings: in one plane each
    white = whitening @ frame @ levers
    readings = white @ white.transpose(0, 2, 1)
    wanted = (1 - share) * np.eye(3) + share * readings * 3.0 / np.trace(readings[used], axis1=1, axis2=2).mean()
    drawn = (np.linalg.cholesky(wanted) @ rng.normal(size=(n, 3, 1))) * np.where(used, 1.0, 100.0)[:, None, None]
    tips = 1.0 + (np.linalg.inv(whitening) @ (5.0 * drawn))[:, :, 0]
    problem = SimpleNamespace(
        setup=SimpleNamespace(encoder_noise=None),
        reading_jacobian=lambda _, placed: placed.rotation @ levers,
    )
    fit_ = SimpleNamespace(
        used=used,
        problem=problem,
        observations=SimpleNamespace(says=np.ones(n, dtype=bool), deviations=lambda tips, _: tips - 1.0),
        noise=SimpleNamespace(whitening=whitening),
        solution=SimpleNamespace(point=SimpleNamespace(x=None, seats=None, frame=SimpleNamespace(rotation=frame))),
    )
    choice: Any = SimpleNamespace(fit=fit_, tips=tips)
    np.testing.assert_allclose(groups._scatter(choice), wanted, atol=1e-12)
    problem.setup.encoder_noise = np.full(6, 1e-6)
    np.testing.assert_array_equal(groups._scatter(choice), np.broadcast_to(np.eye(3), (n, 3, 3)))


def test_what_records_are_divided_by() -> None:
    """Bars before seats, and only where no coordinates are stated; three groups, each with more than three records that
    count.
    """
    labels, other = np.array([*"aaaabbbbcccc"], dtype=object), np.array([*"aaaabbbbcccc"[::-1]], dtype=object)
    used = np.ones(12, dtype=bool)

    def divided(known: bool, used: NDArray[np.bool_] = used, **by: Any) -> list[str]:
        conditions = SimpleNamespace(**{name: by.get(name) for name in ("seat", "session", "marker")})
        records: Any = SimpleNamespace(known=np.array([known] * 12), bar=by.get("bar"), conditions=conditions)
        choice: Any = SimpleNamespace(fit=SimpleNamespace(used=used))
        found = list(groups._groupings(records, choice))
        assert all([names[k] for k in part] == list(by[what]) for what, names, part in found)
        return [what for what, *_ in found]

    assert divided(False, bar=labels, seat=other, session=other, marker=labels) == ["bar", "session", "marker"]
    assert divided(False, seat=other) == ["seat"]
    assert divided(True, bar=labels) == divided(True, seat=other) == []
    assert divided(True, used=np.arange(12) > 0, session=labels) == []
    assert divided(True, session=np.where(labels == "c", "b", labels)) == []


def test_chow_s_test_is_uniform_when_nothing_is_there(free_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first session's p, over draws of noise; Bonferroni's factor taken back, so only what it did not cut off."""
    monkeypatch.setattr(groups, "ODD", 2.0)
    choice = replace(free_case.choice, admitted=())
    narrow = narrowed(choice)
    target = free_case.records.reference
    own = covariance_of_records(free_case.records)[range(RECORDS), range(RECORDS)]
    scales, rng = choice.design.nuisances, np.random.default_rng(21)
    labels = free_case.records.conditions.session
    assert labels is not None
    sessions = len(set(labels))
    start = prior_rows(free_case)[:, -1]
    chances = []
    for _ in range(60):
        off = np.einsum("nij,nj->ni", np.linalg.cholesky(own), rng.standard_normal((RECORDS, 3)))
        step = rng.standard_normal(scales) - start
        tips = target + off - choice.design.columns(None) @ step
        drawn = groups.odd_groups(replace(narrow, design=replace(narrow.design, tips=tips)))
        chances.append(next(g.p_value for g in drawn if g.name == f"session {labels[0]}"))
    cut = np.minimum(np.array(chances), 1.0)
    assert np.mean(cut == 1.0) == pytest.approx(1 - 1 / sessions, abs=0.2)
    assert kstest(cut[cut < 1.0], "uniform").pvalue > 1e-3


def test_a_geometric_finding_is_what_the_records_alone_say(free_case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """One zero offset six stated u off, all other values drawn: (value - truth)/u is standard normal, whatever is stated."""
    monkeypatch.setattr(geometric, "MOVED", 2.0)
    monkeypatch.setattr(geometric, "LEAST_SHARE", 0.1)
    choice, vector = narrowed(replace(free_case.choice, admitted=())), free_case.choice.fit.problem.vector
    own = covariance_of_records(free_case.records)[range(RECORDS), range(RECORDS)]
    nuisances, rng = choice.design.nuisances, np.random.default_rng(31)
    number = next(places.start for effect, places in vector if effect.label == "joint_zero_offset:4")
    u = free_case.choice.fit.problem.widths[number]
    start, away = prior_rows(free_case)[:, -1], []
    for _ in range(40):
        off = np.einsum("nij,nj->ni", np.linalg.cholesky(own), rng.standard_normal((RECORDS, 3)))
        truth = rng.standard_normal(nuisances)
        truth[number] = 6.0
        tips = free_case.records.reference + off - choice.design.columns(None) @ (truth - start)
        design = replace(choice.design, tips=tips)
        drawn = replace(choice, design=design, gram=Gram(products_of(design, choice.parts)))
        effect = next(e for e, _ in geometric._moved(drawn) if e.label == "joint_zero_offset:4")
        away.append((effect.values[0] - 6.0 * u) / effect.u[0])
    assert kstest(away, "norm").pvalue > 1e-3


@pytest.mark.parametrize("cause", [None, "encoder_eccentricity"])
def test_held_out_prediction_is_that_of_a_refit(tmp_path: Path, cause: str | None) -> None:
    """Records left out are as far from a calibration of all others as the inner products say."""
    case = case_of(tmp_path / "data.csv", 3, cause, "free")
    choice = case.choice
    assert bool(choice.causes) == (cause is not None)
    effects = [free(choice.variant(k)) for k in choice.causes]
    for number in choice.held.parts[:3]:
        out = choice.fit.used & (choice.parts == number)
        refit = case.refit(effects, used=choice.fit.used & ~out)
        wanted = np.linalg.norm(refit.solution.point.prediction.tips[out] - case.records.reference[out], axis=1)
        found = gain._predicted(choice, choice.held.without(number), choice.causes, number)
        np.testing.assert_allclose(found, wanted, atol=2e-8)
