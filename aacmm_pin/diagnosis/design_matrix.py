"""Columns of what is refitted anyway, of every place where a cause may act, and of every covariate.

A place has the columns of one basis. Each of its forms, a cause with a nonlinear value, is a small
matrix in this basis: hundreds of orders of a wave need no columns.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.calibration import Fit, HeldEffects, information_of_seats
from aacmm_pin.calibration.parameter_vector import Columns
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.covariates import Carried, Covariate
from aacmm_pin.effects import Carrier, Discrepancy, Effect, State

TYPICAL_SHIFT = 2e-5
"""Typical root mean square of all smooth functions of a covariate, at the tip [m]. The RMS of the
residuals replaces it if that is larger.
"""
TYPICAL_TURN = 2.0
"""The same of the angle of a joint, for each metre of the shift [rad/m]."""
TYPICAL_GROWTH = 1.0
"""The same of the relative change of lengths, for each metre of the shift [1/m]."""
MANY_VARIANTS = 20
"""A candidate with more variants has families of its own, since it may be barred as a whole."""
MOST_COMBINATIONS = 10_000
"""Number of combinations that are kept: each round of the search needs the same again."""

Source = tuple[Effect, ...] | Carried
"""Where columns come from; of a known cause with another nonlinear value, both."""


@dataclass(frozen=True, eq=False)
class Block:
    """Parameters that are admitted together: one variant of a candidate.

    Attributes:
        candidate, variant: their numbers.
        columns: the columns of the design that it moves along.
        combinations: of these columns, one for each parameter (columns, q); None if each
            column is a parameter.
        positive: whether nature has its only parameter above zero.
    """

    candidate: int
    variant: int
    columns: slice
    combinations: Array | None
    positive: bool = False

    @property
    def size(self) -> int:
        """Number of parameters."""
        width = self.columns.stop - self.columns.start
        return int(width if self.combinations is None else self.combinations.shape[1])

    def in_parameters(self, rows: Array) -> Array:
        """Products with all columns (m, columns) as products with the parameters (m, q)."""
        products = rows[..., self.columns]
        return products if self.combinations is None else np.asarray(products @ self.combinations)

    def in_columns(self, values: Array) -> Array:
        """Values of the parameters (q, ...) as coefficients of the columns (columns, ...)."""
        return values if self.combinations is None else np.asarray(self.combinations @ values)


@dataclass(frozen=True, eq=False)
class Family:
    """Blocks with equally many parameters that are evaluated together: of one place, or any without
    combinations.

    Attributes:
        blocks: their numbers (b,).
        columns: those of the place (columns,); without combinations those of each block (b, q).
        combinations: of each block (columns, b, q), or None.
        positive: of each block (b,), see :class:`Block`.
    """

    blocks: Index
    columns: Index
    combinations: Array | None
    positive: Mask

    def some(self, chosen: Mask) -> Family:
        """The family of some of the blocks (b,)."""
        if self.combinations is None:
            return Family(self.blocks[chosen], self.columns[chosen], None, self.positive[chosen])
        combinations = self.combinations[:, chosen]
        return Family(self.blocks[chosen], self.columns, combinations, self.positive[chosen])

    def in_parameters(self, products: Array) -> Array:
        """Products of the family's columns (r, columns), without combinations those of each block
        (r, b, q), as products of the parameters (b, r, q).
        """
        if self.combinations is not None:
            products = np.tensordot(products, self.combinations, 1)
        return products.transpose(1, 0, 2)

    def information(self, matrix: Array) -> Array:
        """Information of each block (b, q, q), by the products of all columns."""
        products = matrix[self.columns[..., :, None], self.columns[..., None, :]]
        if self.combinations is None:
            return np.asarray(products)
        return np.asarray(self.combinations.transpose(1, 2, 0) @ self.in_parameters(products))


@dataclass(frozen=True, eq=False)
class Design:
    """Columns of all that is considered, at the end of a calibration; worked out when asked for.

    Attributes:
        names: label of each candidate; covariates after the causes.
        causes: number of causes among them.
        blocks: what may be admitted.
        sources: what the columns after the nuisances come from.
        nuisances: number of nuisance columns, which come first.
        scales: factors that bring all columns to one order (columns,).
        kept: which of the fit's own parameters are nuisances.
        known: nuisances for what is stated of known causes that were taken out.
        prior: rows of what is known of the nuisances beforehand, and their residuals (m, nuisances
            + 1).
        tips: (n, 3), in the frame of the references, without the causes that are candidates here
            [m]; with orientations (n, 6), see :class:`Prediction`.
    """

    fit: Fit
    names: tuple[str, ...]
    causes: int
    blocks: tuple[Block, ...]
    sources: tuple[tuple[slice, Source], ...]
    nuisances: int
    scales: Array
    kept: Index
    known: Index
    prior: Array
    tips: Array

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.scales.size

    @cached_property
    def owners(self) -> Index:
        """Candidate of every block (blocks,)."""
        return np.array([block.candidate for block in self.blocks], dtype=np.intp)

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """The blocks by their columns and number of parameters."""
        alike = defaultdict[tuple[int | None, int, int], list[int]](list)
        count_of_variants = np.bincount(self.owners)
        for number, block in enumerate(self.blocks):
            basis = None if block.combinations is None else block.columns.start
            has_many = count_of_variants[block.candidate] > MANY_VARIANTS
            apart = block.candidate if has_many else -1
            alike[basis, block.size, apart].append(number)
        families = []
        for (basis, *_), numbers in alike.items():
            blocks = [self.blocks[number] for number in numbers]
            positive = np.array([block.positive for block in blocks])
            columns = np.array([np.arange(b.columns.start, b.columns.stop) for b in blocks])
            if basis is not None:
                columns = columns[0]
            combinations = [b.combinations for b in blocks if b.combinations is not None]
            stacked = np.stack(combinations, axis=1) if combinations else None
            families.append(Family(np.array(numbers), columns, stacked, positive))
        return tuple(families)

    def rows(self, records: Index) -> Array:
        """All columns in some records, scaled (n, 3 or 6, columns) [m, rad]."""
        rows = np.empty((records.size, self.tips.shape[1], self.width))
        jacobian = self.fit.point.prediction.jacobian[records]
        rows[:, :, : self.nuisances] = jacobian[:, :, self.kept]
        arm = _Calibrated(self.fit, records)
        of_causes = [source for _, source in self.sources if not isinstance(source, Carried)]
        if of_causes:
            effects = tuple(itertools.chain.from_iterable(of_causes))
            of_effects = arm.of(effects)
            rows[:, :, self.nuisances : self.nuisances + of_effects.shape[2]] = of_effects
        for columns, source in self.sources:
            if isinstance(source, Carried):
                rows[:, :, columns] = arm.of(source)
        rows *= self.scales
        return rows

    def labels(self, blocks: Iterable[int]) -> tuple[str, ...]:
        """Labels of the candidates of some blocks."""
        return tuple(self.names[self.blocks[k].candidate] for k in blocks)

    def weights(self, block: int) -> Array:
        """Coefficients of all columns for one unit of each parameter of a block (columns, q)."""
        parameters = self.blocks[block]
        weights = np.zeros((self.width, parameters.size))
        weights[parameters.columns] = parameters.in_columns(np.eye(parameters.size))
        return weights

    def columns(self, block: int) -> Array:
        """Displacement of all records by each parameter of a block (n, 3 or 6, q) [m, rad]."""
        return self.moved(self.weights(block), np.arange(len(self.tips)))

    def moved(self, weights: Array, records: Index) -> Array:
        """Displacement of some records by all columns times ``weights`` (columns, r) (n, 3 or 6, r)
        [m, rad].
        """
        in_units = self.scales[:, None] * weights
        jacobian = self.fit.point.prediction.jacobian[records]
        moved = jacobian[:, :, self.kept] @ in_units[: self.nuisances]
        arm = _Calibrated(self.fit, records)
        for columns, source in self.sources:
            if in_units[columns].any():
                moved += arm.of(source) @ in_units[columns]
        return np.asarray(moved)

    def deviations(self, tips: Array) -> Array:
        """Deviations of tips from their targets (n, 3 or 6) [m, rad]; one least-squares step moves
        each seat to where its records and stated coordinates put it.
        """
        observations = self.fit.observations
        seats = self.fit.point.seats
        touched = np.flatnonzero(observations.seat >= 0)
        deviations = observations.deviations(tips, seats)
        if not touched.size:
            return deviations
        information = information_of_seats(self.fit)
        gradient = -information.stated * np.nan_to_num(seats - observations.stated)
        by_record = information.pulls @ deviations[touched, :3, None]
        np.add.at(gradient, observations.seat[touched], by_record[:, :, 0])
        covariance = np.linalg.pinv(information.total, hermitian=True)
        step = np.einsum("sij,sj->si", covariance, gradient)
        return observations.deviations(tips, seats + step)


def displacements(fit: Fit, effects: Sequence[Effect]) -> Array:
    """Displacement of all records by each parameter of effects (n, 3 or 6, q) [m/unit]."""
    all_records = np.arange(fit.problem.measurements.n)
    return _Calibrated(fit, all_records).of(tuple(effects))


def held_effects(fit: Fit, effects: Sequence[Effect], covariance: Array) -> HeldEffects:
    """Effects with a joint covariance (q, q) [units] beside the fit that held them."""
    response = fit.response(displacements(fit, effects))
    return HeldEffects(tuple(effects), covariance, response)


def design_of(
    fit: Fit,
    library: Sequence[Variants],
    all_covariates: Sequence[Covariate],
) -> Design:
    """The columns of every candidate in the arm as calibrated.

    What the candidates among the estimated effects do, and curves of the fit's model, is taken out
    of the tips. What the arm states of a known cause, or of a geometric value among them, is a
    nuisance within its u.
    """
    problem = fit.problem
    taken_out = problem.candidates
    point = fit.point
    width = problem.vector.size
    staying = problem.vector.slices[-taken_out].start if taken_out else width
    jacobian = point.prediction.jacobian
    u_of_change = {
        variants[0].identity: variants[0].u for variants in library if is_change(variants[0])
    }
    stated_u = problem.vector.stated_u
    known_u = np.zeros(width)
    for effect, entries in problem.vector:
        if entries.start >= staying and effect.identity in u_of_change:
            stated_u[entries] = u_of_change[effect.identity]
            known_u[entries] = u_of_change[effect.identity]
    # Parameters that are taken out, but that the arm states with a u.
    stated = staying + np.flatnonzero(stated_u[staying:] > 0.0)
    frame_columns = np.arange(width, jacobian.shape[2])
    kept = np.concatenate([np.arange(staying), stated, frame_columns])
    nuisance_scales = np.concatenate(
        [problem.scales[:staying], stated_u[stated], problem.scales[width:]]
    )
    columns = _ColumnsOf(fit, kept.size)
    for number, variants in enumerate(library):
        columns.add_cause(number, variants)
    for number, covariate in enumerate(all_covariates, len(library)):
        for variant, carried in enumerate(covariate.variants):
            block = Block(number, variant, columns.of(carried), None)
            columns.blocks.append(block)
    labels = [variants[0].label for variants in library]
    names = (*labels, *(covariate.name for covariate in all_covariates))
    prior = np.zeros((width + stated.size, kept.size + 1))
    prior_rows = problem.prior_rows[:, :staying]
    prior[:width, :staying] = prior_rows
    change = point.x - problem.start
    prior[:width, -1] = prior_rows @ (change / problem.widths)[:staying]
    prior[width:, staying : staying + stated.size] = np.eye(stated.size)
    design = Design(
        fit,
        names,
        len(library),
        tuple(columns.blocks),
        tuple(columns.sources),
        kept.size,
        np.concatenate([nuisance_scales, *columns.scales]),
        kept,
        np.flatnonzero(np.isin(kept, np.flatnonzero(known_u))),
        prior,
        point.prediction.poses,
    )
    by_candidates = jacobian[:, :, staying:width] @ change[staying:width]
    tips = design.tips - by_candidates
    curves = [effect for effect in problem.model.effects if effect.free_form]
    by_curves = sum(displacements(fit, [curve]) @ curve.values for curve in curves)
    return replace(design, tips=tips - by_curves)


@lru_cache(maxsize=MOST_COMBINATIONS)
def _combinations(effect: Effect, basis: Effect) -> Array:
    """Combinations of the scaled columns of a basis, one for each parameter of an effect (columns,
    q).
    """
    return effect.in_basis(basis) * typical_of(effect) / typical_of(basis)[:, None]


class _ColumnsOf:
    """The blocks and columns of candidates, numbered one after the other from ``first``."""

    def __init__(self, fit: Fit, first: int) -> None:
        self.arm, self.records = fit.problem.model.arm, fit.problem.measurements
        remaining = float(np.sqrt(np.square(fit.system.deviation[fit.used]).mean()))
        self.typical_shift = max(TYPICAL_SHIFT, remaining)
        self.next_column = first
        self.blocks = list[Block]()
        self.sources = list[tuple[slice, Source]]()
        self.scales = list[Array]()
        self.bases = dict[object, slice]()

    def add_cause(self, number: int, variants: Variants) -> None:
        """Add a block for each variant of a cause."""
        first = variants[0]
        changes = is_change(first)
        basis = None
        for variant, effect in enumerate(variants):
            # Variants that differ by a nonlinear parameter are combinations of one basis.
            shares_basis = variant > 0 and effect.nonlinear.field
            if not changes and not shares_basis:
                basis = effect.basis(self.arm, self.records)
            if basis is not None:
                if basis.identity not in self.bases:
                    self.bases[basis.identity] = self.of((basis,))
                columns = self.bases[basis.identity]
                combinations = _combinations(effect, basis)
            else:
                # A known cause with another nonlinear value has columns of its change too.
                beside_change = changes and bool(first.nonlinear.field) and effect is not first
                columns = self.of((effect, first) if beside_change else (effect,))
                combinations = None
            single = len(effect.terms) == 1 and not is_change(effect)
            # Files give torques of the drive, or of the load, which have the opposite sign.
            positive = single and effect.terms[0].positive and "torque" not in effect.needs
            self.blocks.append(Block(number, variant, columns, combinations, positive))

    def of(self, source: Source) -> slice:
        """New columns of a source, each scaled by its typical magnitude."""
        if isinstance(source, Carried):
            shift = self.typical_shift
            size_by_unit = {"rad": TYPICAL_TURN * shift, "1": TYPICAL_GROWTH * shift}
            typical = size_by_unit.get(Carrier(source.carrier).kind.unit, shift)
            decay = np.broadcast_to(source.decay, source.functions.shape[1])
            of_functions = typical * decay / np.linalg.norm(decay)
            scales = np.repeat(of_functions, len(source.quantities))
        else:
            scales = np.concatenate([*map(typical_of, source)])
        columns = slice(self.next_column, self.next_column + scales.size)
        self.next_column = columns.stop
        self.sources.append((columns, source))
        self.scales.append(scales)
        return columns


def typical_of(effect: Effect) -> Array:
    """Typical magnitudes of the parameters of an effect (q,) [units]."""
    return np.array([term.typical for term in effect.terms])


class _Calibrated:
    """The calibrated arm at some records: how its tips move with any source."""

    def __init__(self, fit: Fit, chosen: Index) -> None:
        self.chosen = chosen
        problem = fit.problem
        arm = problem.model.arm
        records = problem.measurements.take(chosen)
        tip = arm.chain.tip
        self.nominal = State(arm, records.q, records.conditions, tip, with_rotation=problem.turns)
        effects = (*problem.model.effects, *fit.effects)
        self.state = Columns.of(self.nominal, (), effects).at(np.zeros(0))
        self.frame = fit.point.frame.rotation if problem.external else np.eye(3)
        self._by_carrier = dict[str, Array]()

    def of(self, source: Source) -> Array:
        """Displacement by one unit of each parameter (n, 3 or 6, q) [m/unit].

        A :class:`Carried` source is smooth functions of a covariate times a motion of the carrier,
        such as the tip or a joint: one column for each function and axis.
        """
        if not isinstance(source, Carried):
            return self._columns(source)
        if source.carrier not in self._by_carrier:
            carrier = Carrier(source.carrier)
            unit = Discrepancy("", carrier, functions=(), size=len(carrier.quantities))
            self._by_carrier[source.carrier] = self._columns([unit])
        by_axes = self._by_carrier[source.carrier]  # (n, 3 or 6, axes)
        moved = np.einsum("nm,nij->nimj", source.functions[self.chosen], by_axes)
        return np.asarray(moved.reshape(*by_axes.shape[:2], -1))

    def _columns(self, effects: Sequence[Effect]) -> Array:
        """∂(pose)/∂parameters of effects that are all zero, in the references' frame (n, 3 or 6, p)
        [m/unit].
        """
        columns = Columns.of(self.nominal, effects).jacobian(self.state)
        if not self.state.with_rotation:
            return self.frame @ columns
        translations, rotations = np.split(columns, 2, axis=1)
        return np.concatenate([self.frame @ translations, self.frame @ rotations], axis=1)
