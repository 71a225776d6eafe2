"""Columns of all that is considered: what is refitted anyway, every cause of the library, every
covariate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.calibration import Fit, ParameterVector, information_of_seats, pulls_on_seats
from aacmm_pin.calibration.jacobian import Columns
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.covariates import Carried, Covariate
from aacmm_pin.effects import Carrier, Discrepancy, Effect, JointZeroOffset, Part, State

TYPICAL_SHIFT = 2e-5
"""Usual root mean square of what no cause explains, all smooth functions of it together: at the
tip, or what is left there if more [m] …"""
TYPICAL_TURN = 2.0
"""… at a joint [rad] for each metre of that …"""
TYPICAL_GROWTH = 1.0
"""… and of all lengths [1] for each metre of that."""
AT_ONCE = 100
"""Columns that are worked out at once …"""
NUMBERS_AT_ONCE = 1_000_000
"""… or as many as have so many numbers, where that is fewer."""


@dataclass(frozen=True, eq=False)
class Block:
    """Columns that are admitted together: one variant of a candidate.

    Attributes:
        candidate: number of the candidate.
        variant: number of the variant.
        columns: which columns.
        source: what they come from; of a known cause with another nonlinear parameter, both.
    """

    candidate: int
    variant: int
    columns: slice
    source: tuple[Effect, ...] | Carried

    @property
    def size(self) -> int:
        """How many columns."""
        return int(self.columns.stop - self.columns.start)


@dataclass(frozen=True, eq=False)
class Design:
    """Columns of all that is considered, at the point where a calibration ended; worked out when
    they are asked for.

    Attributes:
        fit: the calibration.
        names: label of each candidate; covariates after the causes.
        causes: number of causes of the library among them.
        blocks: their columns.
        nuisances: number of nuisance columns, which come first.
        scales: by which each column is multiplied, so that all are of one order (columns,).
        kept: which of the fit's own parameters are nuisances.
        known: the nuisances that stand for what is stated of known causes that were taken out.
        prior: rows of what is known of the nuisances beforehand, and their residuals (m, nuisances
            + 1).
        tips: (n, 3), in the frame of the references, the causes taken out that are candidates here
            [m]; with orientations (n, 6), see :class:`Prediction`.
        taken_out: how many of the calibration's estimated effects these are, its last ones.
    """

    fit: Fit
    names: tuple[str, ...]
    causes: int
    blocks: tuple[Block, ...]
    nuisances: int
    scales: Array
    kept: Index
    known: Index
    prior: Array
    tips: Array
    taken_out: int

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.scales.size

    def of(self, numbers: Sequence[int]) -> Design:
        """The same with some of the blocks alone, in this order."""
        first = self.nuisances
        scales = [self.scales[:first]]
        blocks = []
        for number in numbers:
            block = self.blocks[number]
            end = first + block.size
            blocks.append(replace(block, columns=slice(first, end)))
            scales.append(self.scales[block.columns])
            first = end
        return replace(self, blocks=tuple(blocks), scales=np.concatenate(scales))

    def column_blocks(self) -> Iterator[tuple[slice, Array]]:
        """The columns of all in turn, a limited number at once: which, and (n, 3 or 6, q), scaled
        [m, rad].
        """
        if self.nuisances:
            yield slice(0, self.nuisances), self.columns(None)
        most = max(min(AT_ONCE, NUMBERS_AT_ONCE // self.tips.size), 1)
        for _, group in groupby(self.blocks, key=lambda b: b.columns.start // most):
            for _, same in groupby(group, key=lambda b: isinstance(b.source, Carried)):
                some = list(same)
                columns = slice(some[0].columns.start, some[-1].columns.stop)
                yield columns, self._of([b.source for b in some]) * self.scales[columns]

    def columns(self, block: int | None) -> Array:
        """The columns of a block, or of the nuisances where it is None, scaled (n, 3 or 6, q) [m,
        rad]; kept.
        """
        if block not in self._kept:
            if block is None:
                own = self.fit.point.prediction.jacobian[:, :, self.kept]
                self._kept[block] = own * self.scales[: self.nuisances]
            else:
                self._kept[block] = (
                    self._of([self.blocks[block].source]) * self.scales[self.blocks[block].columns]
                )
        return self._kept[block]

    def combined(self, chosen: Index, weights: Array) -> Array:
        """Combinations of the columns of some blocks, which are ``chosen``, by ``weights``
        (columns, r) (n, 3 or 6, r).
        """
        whole = np.zeros((self.width, weights.shape[1]))
        whole[chosen] = weights
        found = np.zeros((*self.tips.shape, weights.shape[1]))
        for block in self.blocks:
            if (own := whole[block.columns]).any():
                found += self._of([block.source]) @ (self.scales[block.columns][:, None] * own)
        return found

    def deviations(self, tips: Array) -> Array:
        """How far tips are from their targets, the places of seats at their best for these tips (n,
        3 or 6) [m, rad].
        """
        observations = self.fit.observations
        points = self.fit.point.seats
        touched = np.flatnonzero(observations.seat >= 0)
        off = observations.deviations(tips, points)
        if not touched.size:
            return off
        whole, tie, _ = information_of_seats(self.fit)
        pull = -tie * np.nan_to_num(points - observations.stated)
        np.add.at(pull, observations.seat[touched], pulls_on_seats(self.fit, off[:, :3]))
        moved = np.einsum("sij,sj->si", np.linalg.pinv(whole, hermitian=True), pull)
        return observations.deviations(tips, points + moved)

    @property
    def of_angles(self) -> Array:
        """Displacement by one unit of each joint (n, 3 or 6, nq) [m/rad, or m/m where it
        slides].
        """
        rows = self.fit.problem.model.arm.chain.moving_rows()
        return self._calibrated.columns([JointZeroOffset(row) for row in rows])

    @cached_property
    def _kept(self) -> dict[int | None, Array]:
        return {}

    def _of(self, sources: Sequence[tuple[Effect, ...] | Carried]) -> Array:
        """Columns of causes alone, or of covariates alone (n, 3 or 6, q) [m/unit]."""
        effects = [effect for source in sources if isinstance(source, tuple) for effect in source]
        if effects:
            return self._calibrated.columns(effects)
        return np.concatenate(
            [self._calibrated.carried(way) for way in sources if isinstance(way, Carried)], axis=2
        )

    @cached_property
    def _calibrated(self) -> _Calibrated:
        return _Calibrated(self.fit)


def design_of(
    fit: Fit, library: Sequence[Variants], others: Sequence[Covariate], taken_out: int = 0
) -> Design:
    """The columns of every candidate in the arm as calibrated.

    Args:
        fit: the calibration.
        library: causes to consider.
        others: covariates that anything else may depend on.
        taken_out: so many of the estimated effects, the last ones, are no nuisances but candidates:
            what they do is taken out of the tips, so that they can be chosen again or not. What the
            arm states of a geometric value among them, or of a cause that it is known to have, is a
            nuisance as well, within its u.
    """
    problem = fit.problem
    point = fit.point
    width = problem.vector.size
    stays = problem.vector.slices[-taken_out].start if taken_out else width
    own = point.prediction.jacobian
    known = {variants[0].identity: variants[0].u for variants in library if is_change(variants[0])}
    stated_u = problem.vector.stated_u
    known_u = np.zeros(width)
    for effect, place in problem.vector:
        if place.start >= stays and effect.identity in known:
            stated_u[place] = known_u[place] = known[effect.identity]
    within = stays + np.flatnonzero(stated_u[stays:] > 0.0)
    kept = np.concatenate([np.arange(stays), within, np.arange(width, own.shape[2])])
    tips = point.prediction.poses - own[:, :, stays:width] @ (point.x - problem.start)[stays:width]
    left = np.sqrt(np.square(fit.system.deviation[fit.used]).mean())
    candidates: list[Sequence[tuple[Effect, ...] | Carried]] = [
        *map(_sources, library),
        *(each.variants for each in others),
    ]
    blocks = []
    typical = []
    first = kept.size
    for number, variants in enumerate(candidates):
        for which, source in enumerate(variants):
            typical.append(_typical(source, left))
            blocks.append(
                Block(number, which, slice(first, first := first + typical[-1].size), source)
            )
    scales = np.concatenate(
        [problem.scales[:stays], stated_u[within], problem.scales[width:], *typical]
    )
    names = (
        *(variants[0].label for variants in library),
        *(covariate.name for covariate in others),
    )
    prior = np.zeros((width + within.size, kept.size + 1))
    prior[:width, :stays] = problem.prior_rows[:, :stays]
    prior[:width, -1] = (
        problem.prior_rows[:, :stays] @ ((point.x - problem.start) / problem.widths)[:stays]
    )
    prior[width:, stays : stays + within.size] = np.eye(within.size)
    held = np.flatnonzero(np.isin(kept, np.flatnonzero(known_u)))
    return Design(
        fit,
        names,
        len(library),
        tuple(blocks),
        kept.size,
        scales,
        kept,
        held,
        prior,
        tips,
        taken_out,
    )


def _sources(variants: Variants) -> list[tuple[Effect, ...]]:
    """What each variant changes: itself; and the known cause too, if the variant has another
    nonlinear parameter than this.
    """
    first = variants[0]
    both = is_change(variants[0]) and variants[0].nonlinear.field
    return [(effect, first) if both and effect is not first else (effect,) for effect in variants]


class _Calibrated:
    """The calibrated arm in its records."""

    def __init__(self, fit: Fit) -> None:
        problem = fit.problem
        point = fit.point
        arm = problem.model.arm
        records = problem.measurements
        self.drawn = State(arm, records.q, records.conditions, arm.chain.tip, turns=problem.turns)
        given = ParameterVector(arm, (*problem.model.effects, *fit.effects))
        self.state = Columns.of(self.drawn, given.effects).at(given.values)
        self.frame = point.frame.rotation if problem.external else np.eye(3)
        self._of_carriers = dict[str, Array]()

    def columns(self, effects: Sequence[Effect]) -> Array:
        """∂(pose)/∂parameters of effects that are all zero, in the frame of the references (n, 3 or
        6, p) [m/unit].
        """
        columns = Columns.of(self.drawn, effects).jacobian(self.state)
        if not self.state.turns:
            return self.frame @ columns
        return np.concatenate([self.frame @ half for half in np.split(columns, 2, axis=1)], axis=1)

    def carried(self, way: Carried) -> Array:
        """Shift of the tip by each function on each axis of the carrier (n, 3 or 6, functions ·
        axes) [m/unit].
        """
        axes = self._axes(way.carrier)
        return np.asarray(
            np.einsum("nm,nij->nimj", way.functions, axes).reshape(*axes.shape[:2], -1)
        )

    def _axes(self, name: str) -> Array:
        """Shift of the tip by one unit on each axis of a carrier (n, 3 or 6, axes)."""
        if name not in self._of_carriers:
            constant = Part(Carrier(name), ())
            unit = Discrepancy(name, (constant,), constant.coefficients)
            self._of_carriers[name] = self.columns([unit])
        return self._of_carriers[name]


def _typical(source: tuple[Effect, ...] | Carried, left: float) -> Array:
    """Usual magnitudes of the columns (q,)."""
    if isinstance(source, tuple):
        return np.array([term.typical for effect in source for term in effect.terms])
    shift = max(TYPICAL_SHIFT, left)
    sizes = {"rad": TYPICAL_TURN * shift, "1": TYPICAL_GROWTH * shift}
    typical = sizes.get(Carrier(source.carrier).kind.unit, shift)
    functions = source.functions.shape[1]
    return np.full(functions * len(source.quantities), typical / np.sqrt(functions))
