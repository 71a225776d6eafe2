"""Table 2 as printed beside the same numbers computed: what can be made again, and what cannot."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.papers.zero_offset.gauss_newton import MRAD, RUNS, iterations, printed_postures, printed_table2, simulated_run

HALF_DIGIT = 0.0005 + 1e-9
"""Half of the last printed digit [mm or deg]."""
KEYS = ["run", "iteration"]
NOTES = {
    (1, 0, "x3_mm"): "printed 14257, read as 142.57",
    (2, 0, "error3_mm"): "printed 3930: the last digit is lost, compared with 39.303",
    (1, 2, "theta_offset5_deg"): "with the keying slip; without it 1.203",
    (1, 3, "error2_mm"): "one digit differs; with 0.206 the paper's limit of 0.3 mm would have ended the run here",
    (1, 4, "error2_mm"): "printed as in iteration 3",
}
"""Remarks by run, iteration and quantity."""


def comparison() -> pd.DataFrame:
    """Every number of Table 2 as printed and as computed with increments rounded to 1 mrad, one row a number.

    Iteration 0 holds the reference coordinates and the position errors before the first iteration. Run 1 has the keying
    slip of :func:`aacmm_pin.papers.zero_offset.iterations`.

    Columns:
        run, iteration; kind: ``coordinate``, ``first error``, ``error`` or ``offset``; quantity: ``x1_mm`` (of point 1),
        ``error1_mm`` (of point 1), ``theta_offset1_deg`` (of joint 1), ...;
        unit: ``mm`` or ``deg``; printed, reproduced, difference (reproduced - printed): in that unit;
        verdict: ``reproduced`` where all printed digits agree; ``not derivable`` for offsets that are no whole number of
        milliradians and for errors beside such offsets; ``not reproduced`` elsewhere;
        note: a remark, or "".
    """
    runs = []
    for run in RUNS:
        rows = iterations(run, MRAD, keying_slip=True).assign(run=run).drop(columns="condition_number")
        rows.loc[0, [f"{axis}{point}_mm" for point in (1, 2, 3) for axis in "xyz"]] = (
            simulated_run(run).references.ravel() / MM
        )
        runs.append(rows)
    names = {"x_mm": "x", "y_mm": "y", "z_mm": "z", "position_error_mm": "error"}
    start = printed_postures().rename(columns=names).pivot(index="run", columns="point", values=list(names.values()))
    start.columns = start.columns.map("{0[0]}{0[1]}_mm".format)
    printed = _long(pd.concat([printed_table2(), start.reset_index().assign(iteration=0)]), "printed")
    table = printed.merge(_long(pd.concat(runs), "reproduced"), how="left", on=[*KEYS, "quantity"], validate="1:1")
    offset, error = (table["quantity"].str.startswith(name) for name in ("theta_offset", "error"))
    kinds = np.select([offset, error & (table["iteration"] == 0), error], ["offset", "first error", "error"], "coordinate")
    table.insert(2, "kind", kinds)
    table.insert(4, "unit", table["quantity"].str.rpartition("_")[2])
    table["difference"] = table["reproduced"] - table["printed"]
    whole = (table["printed"] * DEG / MRAD).round() * MRAD / DEG
    broken = offset & ((table["printed"] - whole).abs() > HALF_DIGIT)
    underivable = broken | ~offset & broken.groupby([table[key] for key in KEYS]).transform("any")
    agrees = table["difference"].abs() <= HALF_DIGIT
    table["verdict"] = np.select([agrees, underivable], ["reproduced", "not derivable"], "not reproduced")
    table["note"] = [NOTES.get(key, "") for key in table[[*KEYS, "quantity"]].itertuples(index=False, name=None)]
    return table


def _long(wide: pd.DataFrame, name: str) -> pd.DataFrame:
    """One row a number, ordered by run and iteration."""
    table = wide.melt(KEYS, var_name="quantity", value_name=name).dropna()
    return table.sort_values(KEYS, kind="stable", ignore_index=True)
