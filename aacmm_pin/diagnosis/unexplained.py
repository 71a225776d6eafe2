"""Structure that no cause of the library has: what it depends on, its shape, and the groups that do not fit in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import chi2

from aacmm_pin.diagnosis.findings import Strength, score
from aacmm_pin.diagnosis.gain import Gain
from aacmm_pin.diagnosis.groups import OddGroup, odd_groups
from aacmm_pin.diagnosis.model import Choice
from aacmm_pin.diagnosis.search import conditional
from aacmm_pin.units import MM


@dataclass(frozen=True, eq=False)
class Unexplained:
    """Structure that no cause of the library has.

    Attributes:
        p_value: chance of as much structure over any covariate when there is none, family-wise.
        depends_on: the covariates, strongest first.
        shapes: for each, value of the covariate and the smooth correction in x, y, z, one row a record [mm].
        gain: by how much the smooth correction lowers the RMS of held-out records below that of the causes alone, or None.
        groups: groups of records that do not agree with the others.
    """

    p_value: float
    depends_on: tuple[str, ...]
    shapes: dict[str, pd.DataFrame]
    gain: float | None
    groups: tuple[OddGroup, ...] = ()


def unexplained_by(choice: Choice, strong: list[Strength], held: Gain | None) -> Unexplained:
    """What was admitted that is no cause, or else whether anything seems left."""
    causes = choice.design.causes
    mine = [s for s in strong if choice.question.owner(s.block) >= causes]
    covariates_ = [choice.others[choice.question.owner(s.block) - causes] for s in mine]
    depends = tuple(dict.fromkeys(name for covariate in covariates_ for name in covariate.depends_on))
    odd = tuple(odd_groups(choice))
    shapes = {c.name: _shape(choice, s.block) for c, s in zip(covariates_, mine, strict=True)}
    if mine:
        p_value = min(s.p_value for s in mine)
    else:
        p_value = min(_any_structure(choice), *(group.p_value for group in odd), 1.0)
        depends = tuple(group.name for group in odd[:1])
    return Unexplained(p_value, depends, shapes, held.smooth_gain if held is not None and mine else None, odd)


def _any_structure(choice: Choice) -> float:
    """Chance of as much structure over any covariate when there is none: Bonferroni's bound."""
    left = conditional(choice.question, choice.gram, choice.admitted)
    blocks = [b for b in choice.design.blocks if b.candidate >= choice.design.causes]
    each = [float(chi2.sf(score(left, b), b.size)) for b in blocks]
    return min(1.0, len(each) * min(each, default=1.0))


def _shape(choice: Choice, block: int) -> pd.DataFrame:
    """The smooth correction over a covariate, record by record."""
    design = choice.design
    left = conditional(choice.question, choice.gram, choice.admitted)
    columns = design.blocks[block].columns
    step = left.solution()[np.isin(left.refitted, np.arange(columns.start, columns.stop))]
    shift = design.jacobian[:, :, columns] @ step / MM
    covariate = choice.others[choice.question.owner(block) - design.causes]
    table = {covariate.name: covariate.values} | {f"{axis}_mm": shift[:, k] for k, axis in enumerate("xyz")}
    return pd.DataFrame(table).sort_values(covariate.name, ignore_index=True)
