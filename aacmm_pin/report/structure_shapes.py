"""What no cause explains, record by record: the smooth correction over a covariate, and the partial
residuals.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin.diagnosis import Choice
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.design_matrix import Design


def shapes_of(choice: Choice) -> dict[str, pd.DataFrame]:
    """See :attr:`aacmm_pin.diagnosis.unexplained.Unexplained.shapes`."""
    return {choice.covariate(k).name: _shape(choice, k) for k in choice.covariates}


def _shape(choice: Choice, block: int) -> pd.DataFrame:
    """The smooth correction over a covariate, record by record, and the partial residuals."""
    design, way = choice.design, choice.way(block)
    model, columns = choice.posterior.median_model, design.blocks[block].columns
    step = model.estimate[model.places[block]]
    count = len(way.quantities)
    # Each function has one column for each quantity; the first function is the constant where there
    # is one.
    sizes = way.functions @ (step * design.scales[columns]).reshape(-1, count)
    axes = _axes(design, block, way, count)
    off = design.deviations(choice.tips)[:, :3]
    each = sizes - np.einsum("nij,ni->nj", axes, off) / np.square(axes).sum(axis=1)
    covariate = choice.covariate(block)
    table = covariate.values.copy()
    for k, (name, unit) in enumerate(way.quantities.items()):
        table[name], table[f"{name}_of_record"] = sizes[:, k] / unit, each[:, k] / unit
    return table[choice.fit.used].sort_values(list(covariate.values.columns), ignore_index=True)


def _axes(design: Design, block: int, way: Carried, count: int) -> Array:
    """Shift of the tip for one unit of each quantity (n, 3, quantities)."""
    row = np.arange(len(way.functions))
    # a column is a function times the shift; divide by one that is there
    strongest = np.argmax(np.abs(way.functions), axis=1)
    of_tips = design.columns(block)[:, :3]
    unscaled = of_tips / design.scales[design.blocks[block].columns]
    own = unscaled.reshape(len(row), 3, -1, count)[row, :, strongest]
    return np.asarray(own / way.functions[row, strongest][:, None, None])
