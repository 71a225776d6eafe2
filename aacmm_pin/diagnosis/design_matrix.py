"""Columns of all that is considered: what is refitted anyway, every cause of the library, every covariate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm.chain import axis
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.jacobian import Columns
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.diagnosis.candidates import Variants
from aacmm_pin.diagnosis.covariates import Carried, Covariate
from aacmm_pin.effects import Effect, JointZeroOffset
from aacmm_pin.effects.state import State

TYPICAL_SHIFT = 2e-5
"""Usual size of what no cause explains, for each smooth function of it: at the tip, or what is left there if more [m] …"""
TYPICAL_TURN = 2.0
"""… at a joint [rad] for each metre of that …"""
TYPICAL_GROWTH = 1.0
"""… and of all lengths [1] for each metre of that."""
MOST_DOUBLE = 10_000_000
"""More numbers than this are held in single precision: 6e-8 of a column is far below the noise of any record."""
AT_ONCE = 100
"""Columns that are worked out at once."""
TYPICAL_MISTAKE = 1e-3
"""Usual distance by which a target sat elsewhere, where one group of records was set up differently [m]."""


@dataclass(frozen=True, eq=False)
class Block:
    """Columns that are admitted together: one variant of a candidate.

    Attributes:
        candidate: number of the candidate.
        variant: number of the variant.
        columns: which columns.
    """

    candidate: int
    variant: int
    columns: slice

    @property
    def size(self) -> int:
        """How many columns."""
        return int(self.columns.stop - self.columns.start)


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
        jacobian: (n, 3, columns), scaled [m].
        kept: which of the fit's own parameters are nuisances.
        prior: rows of what is known of the nuisances beforehand, and their residuals (m, nuisances + 1).
        tips: (n, 3), in the frame of the references, the causes taken out that are candidates here [m].
        taken_out: how many of the calibration's estimated effects these are, its last ones.
    """

    fit: Fit
    names: tuple[str, ...]
    causes: int
    blocks: tuple[Block, ...]
    nuisances: int
    scales: Array
    jacobian: Array
    kept: Index
    prior: Array
    tips: Array
    taken_out: int


def design_of(fit: Fit, library: Sequence[Variants], others: Sequence[Covariate], taken_out: int = 0) -> Design:
    """The columns of every candidate in the arm as calibrated.

    Args:
        fit: the calibration.
        library: causes to consider.
        others: covariates that anything else may depend on.
        taken_out: so many of the estimated effects, the last ones, are no nuisances but candidates: what they do is taken
            out of the tips, so that they can be chosen again or not. A geometric value among them is a nuisance as well,
            within what the arm states of it.
    """
    problem, point = fit.problem, fit.solution.point
    width = problem.vector.size
    stays = problem.vector.slices[-taken_out].start if taken_out else width
    own = point.prediction.jacobian
    arm_u = problem.vector.arm_u
    within = stays + np.flatnonzero(arm_u[stays:] > 0.0)
    kept = np.concatenate([np.arange(stays), within, np.arange(width, own.shape[2])])
    tips = point.prediction.tips - own[:, :, stays:width] @ point.x[stays:width]
    variants = [variant for variants in library for variant in variants]
    carried = [way for covariate in others for way in covariate.variants]
    typical = [ParameterVector(problem.model.arm, (variant,)).typical for variant in variants]
    left = np.sqrt(np.square(fit.solution.system.deviation[fit.used]).mean())
    typical += [np.full(way.functions.shape[1] * len(way.quantities), _typical(way, left)) for way in carried]
    counts = [*(len(variants) for variants in library), *(len(covariate.variants) for covariate in others)]
    owners = [(number, which) for number, count in enumerate(counts) for which in range(count)]
    ends = kept.size + np.cumsum([0, *(t.size for t in typical)])
    blocks = [Block(*owner, slice(int(ends[k]), int(ends[k + 1]))) for k, owner in enumerate(owners)]
    scales = np.concatenate([problem.scales[:stays], arm_u[within], problem.scales[width:], *typical])
    size = len(own) * 3 * scales.size
    jacobian = np.empty((len(own), 3, scales.size), dtype=np.float64 if size <= MOST_DOUBLE else np.float32)
    first = 0
    for columns in _every(fit, own[:, :, kept], variants, carried):
        last = first + columns.shape[2]
        np.multiply(columns, scales[first:last], out=jacobian[:, :, first:last], casting="same_kind")
        first = last
    names = (*(variants[0].label for variants in library), *(covariate.name for covariate in others))
    prior = np.zeros((width + within.size, kept.size + 1))
    prior[:width, :stays] = problem.prior[:, :stays]
    prior[:width, -1] = problem.prior[:, :stays] @ ((point.x - problem.start) / problem.widths)[:stays]
    prior[width:, stays : stays + within.size] = np.eye(within.size)
    return Design(fit, names, len(library), tuple(blocks), kept.size, scales, jacobian, kept, prior, tips, taken_out)


def _every(fit: Fit, nuisances: Array, variants: Sequence[Effect], carried: Sequence[Carried]) -> Iterator[Array]:
    """The columns of all in turn, a limited number at once (n, 3, …) [m/unit]."""
    yield nuisances
    vector = ParameterVector(fit.problem.model.arm, tuple(variants))
    for _, some in groupby(vector, key=lambda entry: entry[1].start // AT_ONCE):
        yield _columns_of(fit, [effect for effect, _ in some])[0]
    carriers = _Carriers(fit) if carried else None
    for way in carried:
        assert carriers is not None
        yield carriers.columns(way)


def _columns_of(fit: Fit, effects: Sequence[Effect]) -> tuple[Array, State]:
    """∂(tip)/∂parameters of effects that are all zero, in the calibrated arm and the frame of the references (n, 3, p)."""
    problem, point = fit.problem, fit.solution.point
    given = ParameterVector(problem.model.arm, (*problem.model.effects, *fit.solution.effects))
    records = problem.measurements
    columns = Columns.of(problem.model.arm, records.q, records.conditions, (*given.effects, *effects))
    state = columns.at(np.pad(given.values, (0, columns.vector.size - given.size)))
    found = columns.jacobian(state)[:, :, given.size :]
    return (point.frame.rotation @ found if problem.external else found), state


class _Carriers:
    """What covariates act on, at every record."""

    def __init__(self, fit: Fit) -> None:
        arm = fit.problem.model.arm
        self.rows = [place // 2 for place in arm.chain.moving_axes()]
        self.of_angles, self.state = _columns_of(fit, [JointZeroOffset(row) for row in self.rows])
        self.frame = fit.solution.point.frame.rotation if fit.problem.external else np.eye(3)

    def columns(self, way: Carried) -> Array:
        """Shift of the tip by each function on each axis of the carrier (n, 3, functions · axes) [m/unit]."""
        axes = self._axes(way.carrier)
        return np.asarray(np.einsum("nm,nij->nimj", way.functions, axes).reshape(len(axes), 3, -1))

    def _axes(self, carrier: str) -> Array:
        what, _, row = carrier.partition(" ")
        if what == "room":
            return np.broadcast_to(np.eye(3), (self.state.n, 3, 3))
        if what == "target":
            return np.asarray(self.frame @ self.state.rotation[-1])
        if what == "before":
            return np.asarray(self.frame @ self.state.rotation[axis(int(row)) - 1])
        if what == "angle":
            number = self.rows.index(int(row))
            return self.of_angles[:, :, number : number + 1]
        return np.asarray((self.state.position @ self.frame.T)[:, :, None])


def _typical(way: Carried, left: float) -> float:
    shift = max(TYPICAL_SHIFT, left)
    sizes = {"angle": TYPICAL_TURN * shift, "lengths": TYPICAL_GROWTH * shift, "target": TYPICAL_MISTAKE}
    return sizes.get(way.carrier.split(" ")[0], shift)
