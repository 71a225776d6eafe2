"""The search on small matrices made by hand, against all subsets tried one by one with dense covariances."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from aacmm_pin.diagnosis.forward_backward_selection import EQUAL, SURE, WEAKEST, Question, _Search, rival_pairs, search
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import chi2

from aacmm_pin.diagnosis import forward_backward_selection, model_extension
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.gram_matrix import Gram, Part, Products
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.diagnosis.significance import Place
from aacmm_pin.effects import EncoderGain, JointPeriodicError

Array = NDArray[np.float64]
Blocks = tuple[int, ...]
MAGNITUDES = (0.2, 0.5, 1.0, 2.0, 10.0)
ADMITTED = 10.0
START = np.array([0.7])
"""Residual of the one nuisance's prior row."""


class Small:
    """Rows of one nuisance, of blocks of columns and of a residual with unit noise, and what the search makes of them.

    Args:
        columns: of each block (n, q); the nuisance is a column of ones.
        owners: candidate of each block; default one candidate a block.
        prior: probability of each candidate.
    """

    def __init__(
        self,
        columns: Sequence[Array],
        residual: Array,
        *,
        owners: Sequence[int] | None = None,
        prior: Sequence[float] | None = None,
        stated: bool = True,
        contained: Mapping[int, frozenset[int]] | None = None,
    ) -> None:
        self.columns, self.residual, self.stated = columns, residual, stated
        self.owners = list(range(len(columns))) if owners is None else list(owners)
        self.ones = np.ones((len(residual), 1))
        ends = 1 + np.cumsum([0, *(c.shape[1] for c in columns)])
        nothing: Any = None
        blocks = tuple(Block(c, k, slice(int(ends[k]), int(ends[k + 1])), nothing) for k, c in enumerate(self.owners))
        names = max(self.owners) + 1 if prior is None else len(prior)
        self.log_prior = np.log(np.full(names, 1.0 / names) if prior is None else np.array(prior))
        width, known = int(ends[-1]), np.array([[1.0, *START]])
        design = Design(nothing, (), names, blocks, 1, np.ones(width), nothing, np.empty(0, int), known, nothing, 0)
        rows = np.column_stack([self.ones, *columns, residual])
        self.gram = Gram(Products(design, lambda: [Part(rows[:7], 7), Part(rows[7:], len(rows) - 7)]))
        self.question = Question(design, self.log_prior, stated, contained or {}, np.zeros(len(blocks)))

    @property
    def steps(self) -> _Search:
        """The search, to take its steps one by one."""
        return _Search(self.question, self.gram)

    def found(self, *start: int) -> list[int]:
        """Blocks that the search admits."""
        return sorted(search(self.question, self.gram, start))

    # --- the dense side

    def _covariance(self, admitted: Sequence[int]) -> Array:
        free = np.column_stack([self.ones, *(ADMITTED * self.columns[k] for k in admitted)])
        return np.asarray(np.eye(len(free)) + free @ free.T)

    def _scatter(self, admitted: Sequence[int]) -> tuple[float, float]:
        """Variance factor and its degrees of freedom."""
        off, covariance = self.residual - self.ones @ START, self._covariance(admitted)
        total, dof = off @ np.linalg.solve(covariance, off), np.trace(np.linalg.inv(covariance))
        if self.stated and (total < dof or chi2.sf(total, dof) > 1e-3):
            return 1.0, np.inf
        return float(total / dof), float(dof)

    def evidence(self, block: int, beside: Sequence[int], scatter: tuple[float, float]) -> float:
        """Log ratio of two normal, or Student's, densities of the residual, averaged over the magnitudes."""
        variance, dof = scatter
        off, own = self.residual - self.ones @ START, self.columns[block]
        nothing = variance * self._covariance(beside)
        total, size = off @ np.linalg.solve(nothing, off), np.linalg.slogdet(nothing)[1]
        each = []
        for t in MAGNITUDES:
            there = nothing + t**2 * own @ own.T
            gain = 0.5 * (total - off @ np.linalg.solve(there, off))
            gain = gain if np.isinf(dof) else -0.5 * dof * np.log1p(-2.0 * gain / total)
            each.append(gain - 0.5 * (np.linalg.slogdet(there)[1] - size))
        return float(logsumexp(each) - np.log(len(each)))

    def of_set(self, admitted: Sequence[int]) -> float:
        """Log evidence of a set, prior included: of each beside those before it, by the scatter beside all."""
        scatter = self._scatter(admitted)
        each = [self.evidence(k, admitted[:number], scatter) for number, k in enumerate(admitted)]
        return float(sum(each) + sum(self.log_prior[self.owners[k]] for k in admitted))

    def subsets(self) -> list[Blocks]:
        """All sets in which a candidate stands once at most, and nothing beside what contains it."""
        contained, found = self.question.contained, []
        for size in range(len(self.columns) + 1):
            for some in itertools.combinations(range(len(self.columns)), size):
                mine = [self.owners[k] for k in some]
                if len(set(mine)) == size and not any(contained.get(a, frozenset()) & set(mine) for a in mine):
                    found.append(some)
        return found

    def best(self) -> list[int]:
        """The set with the largest evidence of all."""
        return list(max(self.subsets(), key=self.of_set))


def mixed(rng: np.random.Generator, count: int, n: int = 40) -> list[Array]:
    """Columns that have much in common, of norm 10 or so."""
    common = rng.normal(size=(n, 2))
    return [1.2 * (rng.normal(size=(n, 1)) + common @ rng.normal(size=(2, 1))) for _ in range(count)]


@pytest.mark.parametrize(("stated", "noise"), [(True, 1.0), (True, 1.2), (True, 4.0), (False, 0.3)])
def test_log_evidence_of_every_set(stated: bool, noise: float) -> None:
    """Two variants of one candidate, a block of two columns, unlike priors; noise as stated, larger, and unknown."""
    rng = np.random.default_rng(4)
    columns = mixed(rng, 5)
    columns[1] = np.hstack([columns[1], rng.normal(size=(40, 1))])
    residual = 2.0 * columns[0][:, 0] - columns[3][:, 0] + noise * rng.normal(size=40)
    small = Small(columns, residual, owners=[0, 1, 1, 2, 3], prior=[0.5, 0.3, 0.15, 0.05], stated=stated)
    steps = small.steps
    for some in small.subsets():
        assert steps.log_evidence(some) == pytest.approx(small.of_set(some), abs=1e-5), some
    # Beside one: each candidate by the mean of its variants and its prior; what is there is struck out.
    odds, blocks = steps.odds((4,))
    each = np.array([small.evidence(k, (4,), small._scatter((4,))) for k in range(4)])
    wanted = [each[0], np.logaddexp(each[1], each[2]) - np.log(2.0), each[3]]
    np.testing.assert_allclose(odds, [*(wanted + small.log_prior[:3]), -np.inf], atol=1e-5)
    assert blocks[1] == 1 + int(each[2] > each[1])
    # In the place of one, by the scatter that is left with it.
    each = np.array([small.evidence(k, (4,), small._scatter((0, 4))) for k in range(4)])
    wanted = [each[0], np.logaddexp(each[1], each[2]) - np.log(2.0), each[3]]
    np.testing.assert_allclose(steps.odds_instead((0, 4), 0)[0], [*(wanted + small.log_prior[:3]), -np.inf], atol=1e-5)
    # The likeliest of all with the likeliest beside it, where one pair is asked for.
    alone = steps.odds(())
    first = alone[1][int(np.argmax(alone[0]))]
    odds, blocks = steps.odds((first,))
    assert steps.pairs((), 1) == [tuple(sorted((first, blocks[int(np.argmax(odds))])))]
    beside = {k: tuple(j for j in (0, 1, 3) if j != k) for k in (0, 1, 3)}
    strength = {k: small.evidence(k, rest, small._scatter(rest)) for k, rest in beside.items()}
    assert steps.by_strength((0, 1, 3)) == tuple(sorted(strength, key=lambda k: -strength[k]))


def test_rivals_do_not_depend_on_the_order_of_the_admitted() -> None:
    """Evidence adds up from block to block, and differs by the order of blocks that have much in common."""
    rng = np.random.default_rng(5)
    columns = mixed(rng, 6)
    residual = 2.0 * columns[0][:, 0] + 1.5 * columns[1][:, 0] + columns[2][:, 0] + 2.0 * rng.normal(size=40)
    small, admitted = Small(columns, residual, stated=False), (0, 1, 2)
    values, more = [], []
    for order in itertools.permutations(admitted):
        values.append(small.steps.log_evidence(order))
        rivals = rival_pairs(small.question, small.gram, order)
        more.append({(tuple(sorted(some)), r.blocks): r.more for some, each in rivals.items() for r in each})
    assert np.ptp(values) < 1e-9
    assert np.ptp([small.of_set(order) for order in itertools.permutations(admitted)]) > 0.1
    for found in more:
        assert found == pytest.approx(more[0], abs=1e-9)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("true", [(), (0,), (1, 4), (0, 2, 5)])
def test_the_best_of_all_subsets(true: Blocks, stated: bool) -> None:
    """From nothing and from a wrong start alike."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        columns = mixed(rng, 6)
        residual = rng.normal(size=40) + sum((columns[k][:, 0] for k in true), np.zeros(40))
        small = Small(columns, residual, stated=stated)
        best = small.best()
        assert best == list(true) or not true
        assert small.found() == small.found(3) == small.found(0, 3) == (best if true else []), seed


def axes(*sizes: float, n: int = 40) -> tuple[list[Array], Array]:
    """Columns of norm 30 along unlike axes across the nuisance, and a residual that is so much along each of them."""
    basis = np.linalg.qr(np.column_stack([np.ones(n), np.eye(n)[:, 1:]]))[0][:, 1:]
    residual = basis[:, : len(sizes)] @ np.array(sizes) + START[0]
    return [30.0 * basis[:, k : k + 1] for k in range(len(sizes))], residual


def test_nothing_is_admitted_that_is_not_sure() -> None:
    """Where the dense odds of anything pass the threshold, and nowhere else; by its prior, too."""
    passed = []
    for size in np.linspace(3.0, 6.0, 25):
        for prior in ((0.9, 0.1), (0.01, 0.99)):
            columns, residual = axes(size, 0.0)
            small = Small(columns, residual, prior=prior)
            odds = [small.evidence(k, (), (1.0, np.inf)) + small.log_prior[k] for k in range(2)]
            passed.append(logsumexp(odds) >= SURE)
            assert small.found() == ([0] if passed[-1] else []), (size, prior)
    assert 10 < sum(passed) < 40


def test_of_two_that_look_the_same_the_likelier() -> None:
    columns, residual = axes(9.0, 0.0)
    for prior in ((0.8, 0.1, 0.1), (0.1, 0.1, 0.8)):
        small = Small([*columns, columns[0]], residual, prior=prior)
        assert small.found() == small.found(0) == small.found(2) == [int(np.argmax(prior))]


def test_that_one_of_two_is_there_may_be_sure_where_neither_is() -> None:
    neither = 0
    for size in np.linspace(4.0, 6.0, 41):
        columns, residual = axes(size)
        small = Small([columns[0], columns[0]], residual)
        odds = [small.evidence(k, (), (1.0, np.inf)) + small.log_prior[k] for k in range(2)]
        assert bool(small.found()) == (logsumexp(odds) >= SURE)
        neither += max(odds) < SURE <= logsumexp(odds)
    assert neither


def lures(first: float, second: float, *others: float) -> Small:
    """Columns 0 and 1 are there, column 2 is nearly their sum; further ones along axes of their own are there too."""
    columns, residual = axes(first, second, 0.0, *others)
    lure = 3.0 * (columns[0] + columns[1]) / np.sqrt(2.0) + 0.3 * columns[2]
    return Small([columns[0], columns[1], lure, *columns[3:]], residual)


def test_one_that_mimics_two_gives_way() -> None:
    small = lures(22.0, 15.0)
    assert max(range(3), key=lambda k: small.of_set((k,))) == 2
    assert small.found() == small.found(2) == small.best() == [0, 1]


def test_a_better_pair_stands_for_one_or_two(monkeypatch: pytest.MonkeyPatch) -> None:
    small = lures(22.0, 15.0, 14.0)
    for admitted, better in (((2,), True), ((1, 2), True), ((1, 2, 3), False)):
        assert (small.steps.better_pair(admitted) != admitted) == better
    monkeypatch.setattr(forward_backward_selection, "MOST_CAUSES", 2)
    assert lures(22.0, 15.0).steps.exchanged((2,)) == (0, 1)
    monkeypatch.setattr(forward_backward_selection, "MOST_CAUSES", 1)
    assert lures(22.0, 15.0).steps.exchanged((2,)) == (2,)


def test_pairs_begin_with_what_explains_something() -> None:
    """Before its prior; the second best of those that do not would be the best of all."""
    explained = []
    for size in np.linspace(0.0, 8.0, 41):
        small = Small(*axes(12.0, 9.0, size))
        explained.append(small.evidence(2, (), small._scatter(())))
        assert small.steps.pairs((), 3) == [(0, 1), (0, 2)][: 1 + (explained[-1] > 0)]
    assert min(explained) < 0
    assert any(0.1 < each < np.log(3.0) - 0.1 for each in explained)


def test_of_sets_that_come_back_the_best_stays() -> None:
    """Where one stands in the place of the other and back, and where what was admitted is taken out again."""
    small = Small(*axes(9.0, 8.0))
    for best in ((0,), (1,)):
        steps: Any = small.steps
        steps.log_evidence = lambda admitted, best=best: float(admitted == best)
        steps.odds_instead = lambda whole, _: (10.0 * np.array([1 in whole, 0 in whole]), {0: 0, 1: 1})
        assert steps.settled((0,)) == steps.settled((1,)) == best
    steps = small.steps
    steps.log_evidence = lambda admitted: float(admitted == (0,))
    steps.settled = lambda admitted: () if len(admitted) == 2 else admitted
    steps.better_pair = lambda admitted: admitted
    assert steps.grown(()) == (0,)


def test_one_gives_way_to_two_only_where_they_are_surely_better() -> None:
    gains = []
    for apart in np.linspace(0.0, 4.0, 30):
        small = lures(20.0 + apart, 20.0 - apart)
        gains.append(small.of_set((0, 1)) - small.of_set((2,)))
        assert small.steps.exchanged((2,)) == ((0, 1) if gains[-1] > SURE else (2,)), apart
        better = [pair for pair in ((0, 1), (0, 2), (1, 2)) if small.of_set(pair) > small.of_set((2,))]
        assert (small.steps.better_pair((2,)) == (2,)) == (not better)
    assert np.sum(np.array(gains) < SURE) > 5 < np.sum(np.array(gains) > SURE)
    assert any(1.0 < gain < SURE - 0.5 for gain in gains)


def test_the_weakest_three_are_tried_against_pairs() -> None:
    assert WEAKEST == 3
    # The lure is the strongest of three, and of four; what is there beside it is weaker.
    for others, tried in (((15.0, 14.0), True), ((15.0, 14.0, 13.0), False)):
        small = lures(25.0, 15.0, *others)
        rest = tuple(range(3, 3 + len(others)))
        assert small.of_set((0, 1, *rest)) > small.of_set((2, *rest)) + 2.0 * SURE
        assert small.steps.by_strength((2, *rest))[0] == 2
        assert small.steps.exchanged((2, *rest)) == ((0, 1, *rest) if tried else (2, *rest))


def test_two_that_two_others_look_like() -> None:
    """Their sum and difference, a little beside them: neither looks like one of the two, both look like both."""
    for beside, likely in ((0.1, True), (0.3, False)):
        columns, residual = axes(20.0, 8.0, 0.0)
        turned = np.hstack(columns[:2]) @ np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0) + beside * columns[2]
        small = Small([columns[0], columns[1], turned[:, :1], turned[:, 1:]], residual)
        less = small.of_set((2, 3)) - small.of_set((0, 1))
        assert less < -EQUAL
        assert (less > np.log(0.01)) == likely
        found = rival_pairs(small.question, small.gram, (0, 1))
        assert [*found] == [(0,), (1,), (0, 1)]
        for some, rivals in found.items():
            assert [rival.blocks for rival in rivals] == [(2, 3)]
            instead = small.of_set((*{0, 1}.difference(some), 2, 3)) - small.of_set((0, 1))
            instead -= SURE * (len(some) == 1)  # as one gives way to two in the search
            assert rivals[0].more == pytest.approx(instead, abs=1e-5)
        assert small.steps.exchanged((0, 1)) == (0, 1)
        assert small.steps.exchanged((2, 3)) == ((0, 1) if likely else (0, 1, 2))
        assert small.found(2, 3) == [0, 1]


def test_what_contains_two_stands_for_both() -> None:
    """A free block beside the causes that it contains: never both, and in their place only where that is better."""
    columns, residual = axes(12.0, 11.0, 0.0, 0.0)
    whole = np.hstack(columns[:2])
    for prior, wanted in (((0.02, 0.02, 0.96), [2]), ((0.49, 0.49, 0.02), [0, 1])):
        small = Small([columns[0], columns[1], whole], residual, prior=prior, contained={2: frozenset({0, 1})})
        assert small.best() == wanted
        assert small.found() == small.found(0, 1) == wanted
        assert small.question.struck_out((2,)) == {0, 1, 2}
        assert small.question.joined((0, 1), 2) == (2,)
        beside: Any = SimpleNamespace(left=small.steps.left((2,)), question=small.question, admitted=(2,))
        assert np.isfinite(Place.beside(beside, 0).odds).tolist() == [True, False, False]  # what is asked for competes


def test_two_give_way_to_what_contains_both_where_that_is_better_at_all() -> None:
    """And one does not, which is looked back at by itself."""
    columns, residual = axes(12.0, 11.0)
    gains = []
    for usual in np.geomspace(1e-3, 0.5, 30):
        prior = [0.5 - usual / 2, 0.5 - usual / 2, usual]
        small = Small([*columns, np.hstack(columns)], residual, prior=prior, contained={2: frozenset({0, 1})})
        gains.append(small.of_set((2,)) - small.of_set((0, 1)))
        assert small.steps.exchanged((0, 1)) == ((2,) if gains[-1] > 0 else (0, 1))
        assert small.of_set((2,)) > small.of_set((0,)) + 1.0
        assert small.steps.exchanged((0,)) == (0,)
    assert min(gains) < 0.0
    assert any(0.5 < gain < SURE - 0.5 for gain in gains)


def test_a_candidate_without_a_block() -> None:
    """It keeps its number, can never be found, and moves none of the others."""
    columns, residual = axes(9.0, 0.0, 8.0)
    for owners, absent in (([1, 2, 3], 0), ([0, 2, 3], 1), ([0, 1, 2], 3)):
        inside = {absent: frozenset({owners[0], owners[2]})}
        small = Small(columns, residual, owners=owners, prior=[0.25] * 4, contained=inside)
        assert small.found() == small.found(1) == small.best() == [0, 2]
        odds, blocks = small.steps.odds(())
        assert odds[absent] == -np.inf
        assert blocks == dict(zip(owners, range(3), strict=True))


def test_a_pair_needs_two_that_can_stand_together() -> None:
    """A second that contains the first takes its place; and where all others are struck out there is none."""
    columns, residual = axes(9.0, 5.0)
    small = Small([columns[0], np.hstack(columns)], residual, contained={1: frozenset({0})})
    assert small.steps.pairs((), 2) == []
    assert small.found() == small.best() == [1]


def test_never_more_than_the_most_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    columns, residual = axes(300.0, 60.0, 15.0)
    assert Small(columns, residual).found() == [0, 1, 2]
    monkeypatch.setattr(forward_backward_selection, "MOST_CAUSES", 2)
    assert Small(columns, residual).found() == [0, 1]


# --- from what was chosen to an extended arm


def at_once(**fields: Any) -> Choice:
    """A choice of which nothing is known but ``fields``."""
    nothing: Any = dict.fromkeys((each.name for each in dataclasses.fields(Choice)), None)
    return Choice(**nothing | fields)


@pytest.mark.parametrize(
    ("records", "near", "doubtful", "taken"),
    [
        (100, 2, None, "first"),  # too few to make sense at once
        (100, 3, (9, 6), "wider"),
        (100, 3, (9, 7), "first"),
        (1000, 4, None, "first"),  # too small a part of the records
        (1000, 5, (9, 6), "wider"),
        (100, 1, (9, 8), "nothing, else gain"),
        (100, 1, (9, 9), "nothing"),
        (1000, 4, None, "nothing"),
    ],
)
def test_excluded_records_are_tried_with_the_others(
    records: int, near: int, doubtful: tuple[int, int] | None, taken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that are not far, where they are several; what is found with them counts where it explains several."""
    excluded = np.arange(records) < near + 20
    far = np.where(np.arange(records) < near, 4.9, 5.1)  # among the others are such that say nothing
    first: Any = SimpleNamespace(used=~excluded & (np.arange(records) < records - 2), excluded=excluded, name="first")
    nothing = taken.startswith("nothing")  # is found in the first
    first.solution = SimpleNamespace(point=SimpleNamespace(prediction=SimpleNamespace(poses=None)))
    tried, put_back = [], np.flatnonzero(first.used | (np.arange(records) < near)).tolist()

    def fit(_: object, used: Array) -> Any:
        tried.append(np.flatnonzero(used).tolist())
        return SimpleNamespace(name="wider")

    judged = dict(zip(("first", "wider"), doubtful or (), strict=False))
    monkeypatch.setattr(model_extension, "fit", fit)
    first.problem = SimpleNamespace(measurements=None)
    monkeypatch.setattr(model_extension, "together", lambda *_: (np.zeros(records, dtype=bool), 1.0))
    monkeypatch.setattr(model_extension, "_times_the_limit", lambda *_: far)
    monkeypatch.setattr(model_extension, "_doubtful", lambda choice, _: judged[choice.fit.name])
    design: Any = SimpleNamespace(fit=None)
    gram: Any = SimpleNamespace(products=SimpleNamespace(release=lambda: None))
    monkeypatch.setattr(model_extension, "_standing", lambda _, at, *rest: at_once(fit=at, design=design, gram=gram))
    monkeypatch.setattr(model_extension, "products_of", lambda *_: "in parts")
    monkeypatch.setattr(Choice, "causes", property(lambda choice: () if nothing and choice.fit is first else (0,)))
    monkeypatch.setattr(Choice, "effects", [EncoderGain(3)])
    for torn in (False, True):
        tried.clear()
        monkeypatch.setattr(model_extension, "_torn", lambda *_, torn=torn: torn)
        parts = np.zeros(records, dtype=np.intp)
        found = model_extension.choose(lambda _: first, first, [], [], parts)
        assert found.fit.name == ("first" if nothing else taken)  # type: ignore[attr-defined]
        assert (found.otherwise == ("encoder_gain:3",)) == taken.endswith("gain")
        assert tried == ([put_back] if doubtful else [])
        assert (found.held is not None) == torn


def test_how_far_from_its_target_a_record_is() -> None:
    """Over what one of all records may be off with a chance of 1 %, by Bonferroni's bound; none where nothing is said."""
    limit = chi2.isf(0.01 / 4, 3)
    off = np.array([[3e-5, 0.0, 0.0], [0.0, 4e-5, 0.0], [0.0, 3e-5, 4e-5], [np.nan] * 3])
    targets = np.full((4, 3), 0.5)
    says = np.array([True, True, True, False])
    observations = SimpleNamespace(says=says, counts=3 * says, deviations=lambda tips, _: tips - targets)
    at: Any = SimpleNamespace(observations=observations, solution=SimpleNamespace(point=SimpleNamespace(seats=None)))
    judge: Any = SimpleNamespace(residual_noise=np.array([1.0, 4.0, 1.0, 1.0])[:, None, None] * 1e-10 * np.eye(3))
    found = model_extension._times_the_limit(at, targets + off, judge)
    np.testing.assert_allclose(found, np.array([3.0, 2.0, 5.0, 0.0]) / np.sqrt(limit), rtol=1e-6)
    choice: Any = SimpleNamespace(fit=at, tips=targets + off)
    for variance, count in ((1.5, 1), (1.0, 2), (0.5, 3)):  # the limit is 14.3
        judge.residual_noise = np.full(4, variance * 1e-10)[:, None, None] * np.eye(3)
        assert model_extension._doubtful(choice, judge) == count


@pytest.mark.parametrize(
    ("parts", "torn"), [([0, 0, 1, 1, 0, 1], False), ([0, 1, 1, 1, 0, 1], True), ([0, 0, 0, 1, 0, 1], True)]
)
def test_seats_and_bars_in_several_parts(parts: list[int], torn: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seats 0 and 1 at the ends of a bar, seat 2 alone; two records at none. The search then takes all as one part."""
    observations = SimpleNamespace(seat=np.array([0, 1, 2, 2, -1, -1]), clusters=np.array([0, 0, 1]))
    at: Any = SimpleNamespace(observations=observations, stated=True, problem=SimpleNamespace(candidates=0))
    assert model_extension._torn(at, np.array(parts)) == torn
    monkeypatch.setattr(model_extension, "products_of", lambda _, parts: parts)
    for name in ("design_of", "question_of", "search"):
        monkeypatch.setattr(model_extension, name, lambda *_: None)
    found: Any = model_extension._chosen(at, (), (), np.array(parts), [])
    assert found.gram.products.tolist() == ([0] * 6 if torn else parts)


@pytest.mark.parametrize(
    ("moved", "used", "parts", "inside"),
    [
        ([0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], True),
        ([0, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], False),
        ([0, 1, 1, 1], [1, 0, 1, 1], [0, 0, 1, 1], True),
        ([0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 0, 0], False),  # nothing is left out
        ([0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 1, 1], False),
    ],
)
def test_a_cause_of_records_that_are_left_out_together(
    moved: list[int], used: list[int], parts: list[int], inside: bool
) -> None:
    columns = np.zeros((4, 3, 2))
    columns[:, 2, 1] = moved
    design: Any = SimpleNamespace(columns=lambda _: columns)
    fit: Any = SimpleNamespace(used=np.array(used, dtype=bool))
    assert at_once(design=design, fit=fit, parts=np.array(parts)).in_one_part(0) == inside


def test_the_top_of_a_parabola() -> None:
    """Between the neighbours of the best; no further, and nowhere where there is no top."""
    tried: list[Any] = [JointPeriodicError(3, order) for order in (2.0, 2.5, 3.5)]
    for top in (2.3, 2.9):
        evidences = -np.array([(2.0 - top) ** 2, (2.5 - top) ** 2, (3.5 - top) ** 2])
        assert model_extension._between(tried, evidences, 1).order == pytest.approx(top)  # type: ignore[attr-defined]
    flat, at_the_end = np.zeros(3), np.array([0.0, -1.0, -2.0])
    assert model_extension._between(tried, flat, 1) == tried[1]
    assert model_extension._between(tried, at_the_end, 0) == tried[0]
