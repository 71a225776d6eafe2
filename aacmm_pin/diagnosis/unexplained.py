"""Structure that no cause of the library has: what it depends on, its shape, and the groups that do not fit in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.calibration.shared_exclusions import Shared, shared_by
from aacmm_pin.diagnosis.branches import Branches, branches_of
from aacmm_pin.diagnosis.chow_test import OddGroup, odd_groups
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.cross_validation import Gain
from aacmm_pin.diagnosis.design_matrix import Design
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.diagnosis.significance import Ratio, Strength

LEFT = 1e-3
"""Structure over some covariate with less chance than this is left, even if nothing is sure about it …"""
LEFT_ALONE = 1e-6
"""… and with less than this, where nothing was named: without stated noise far records, which scatter more, look so."""


@dataclass(frozen=True, eq=False)
class Unexplained(Shown):
    """Structure that no cause of the library has.

    Attributes:
        p_value: chance of as much structure over any covariate when there is none, family-wise.
        threshold: structure with less chance than this is left.
        depends_on: the covariates, strongest first.
        shapes: for each, one row a record: the covariates; the smooth correction, in x, y, z of the tip [mm], or as angle of
            a joint [µrad] or growth of all lengths [µm/m]; and the same as each record has it (``_of_record``).
        acts_on: for each, in words, what it acts on.
        gain: by how much the smooth correction lowers the RMS of held-out records below that of the causes alone, or None.
        groups: groups of records that do not agree with the others.
        excluded: what the excluded records share, or None.
        branches: the joint over which the residuals fall into two branches, or None.
    """

    p_value: float
    threshold: float
    depends_on: tuple[str, ...]
    shapes: dict[str, pd.DataFrame]
    acts_on: dict[str, str]
    gain: float | None
    groups: tuple[OddGroup, ...] = ()
    excluded: Shared | None = None
    branches: Branches | None = None

    @property
    def left(self) -> bool:
        """Whether structure is left beyond chance."""
        return self.p_value < self.threshold

    @property
    def in_words(self) -> tuple[str, ...]:
        """What it depends on, and which groups do not fit in."""
        odd = {group.name: group for group in self.groups}
        covariates = [name for name in self.depends_on if name not in odd]
        return (
            *([f"something that no cause explains depends on {', '.join(covariates)}"] if covariates else []),
            *(f"{g.name} does not agree with the other records: {g.times:.1f} times as far off" for g in self.groups),
            *([] if self.branches is None else [str(self.branches)]),
        )


def unexplained_by(choice: Choice, strong: list[Strength], held: Gain | None, named: bool) -> Unexplained:
    """What was admitted that is no cause, or else whether anything seems left; ``named``: something was found."""
    causes = choice.design.causes
    mine = [s for s in strong if choice.question.owner(s.block) >= causes]
    covariates_ = [choice.others[choice.question.owner(s.block) - causes] for s in mine]
    depends = tuple(dict.fromkeys(name for covariate in covariates_ for name in covariate.depends_on))
    odd = tuple(odd_groups(choice))
    shapes = {c.name: _shape(choice, s.block) for c, s in zip(covariates_, mine, strict=True)}
    acts_on = {c.name: _way(choice, s.block).acts_on for c, s in zip(covariates_, mine, strict=True)}
    if mine:
        p_value = min(s.p_value for s in mine)
    else:
        p_value = min(_any_structure(choice), *(group.p_value for group in odd), 1.0)
        depends = tuple(group.name for group in odd[:1])
    shared = shared_by(choice.fit)
    if shared is not None:
        p_value, depends = min(p_value, shared.p_value), tuple(dict.fromkeys((*depends, shared.name)))
    gain = held.smooth_gain if held is not None and mine else None
    threshold = LEFT if named else LEFT_ALONE
    return Unexplained(p_value, threshold, depends, shapes, acts_on, gain, odd, shared, branches_of(choice))


def _any_structure(choice: Choice) -> float:
    """Chance of as much structure over any covariate when there is none: Bonferroni's bound."""
    blocks = [b for b in choice.design.blocks if b.candidate >= choice.design.causes]
    each = [float(chi2_sf(Ratio.of(choice.left, b).value, b.size)) for b in blocks]
    return min(1.0, len(each) * min(each, default=1.0))


def _way(choice: Choice, block: int) -> Carried:
    b = choice.design.blocks[block]
    return choice.others[b.candidate - choice.design.causes].variants[b.variant]


def _shape(choice: Choice, block: int) -> pd.DataFrame:
    """The smooth correction over a covariate, record by record, and what the records say of it."""
    design, way = choice.design, _way(choice, block)
    left, columns = choice.left.projection, design.blocks[block].columns
    step = left.solution()[np.isin(left.refitted, np.arange(columns.start, columns.stop))]
    count = len(way.quantities)
    # Each function has one column for each quantity; the first function is the constant where there is one.
    sizes = way.functions @ (step * design.scales[columns]).reshape(-1, count)
    axes = _axes(design, block, way, count)
    off = choice.fit.observations.deviations(choice.tips, choice.fit.solution.point.seats)[:, :3]
    each = sizes - np.einsum("nij,ni->nj", axes, off) / np.square(axes).sum(axis=1)
    covariate = choice.others[design.blocks[block].candidate - design.causes]
    table = covariate.values.copy()
    for k, (name, unit) in enumerate(way.quantities.items()):
        table[name], table[f"{name}_of_record"] = sizes[:, k] / unit, each[:, k] / unit
    return table[choice.fit.used].sort_values(list(covariate.values.columns), ignore_index=True)


def _axes(design: Design, block: int, way: Carried, count: int) -> Array:
    """Shift of the tip for one unit of each quantity (n, 3, quantities)."""
    strongest = np.argmax(
        np.abs(way.functions), axis=1
    )  # a column is a function times the shift; divide by one that is there
    of_tips = design.columns(block)[:, :3]
    own = (of_tips / design.scales[design.blocks[block].columns]).reshape(len(strongest), 3, -1, count)
    row = np.arange(len(strongest))
    return np.asarray(own[row, :, strongest] / way.functions[row, strongest][:, None, None])
