"""The tables of the zero-offset paper, and its simulated calibration, reproduced number by number.

六自由度关节式坐标测量机关节零位偏差的标定算法, 2010
(calibration of the joint zero offsets of a six-joint measuring arm). The arm is the bundled
``zero6``. The paper computes the tip at ``q + s`` with zero offsets ``s``, which are 0 at first.
``ΔQ`` is the deviation of three known points from the computed tips, and ``G`` the derivative of
the tips with respect to the offsets. The least squares solution of ``ΔQ = G Δδ`` (7) is the
increment ``Δδ = (Gᵀ G)⁻¹ Gᵀ ΔQ`` (8). The next iteration begins at ``s + Δδ``.

**Rounding.** Every printed offset before the last iteration of a run is a whole number of
milliradians. The paper therefore rounded the increments, or their sums, which is equivalent. Every
run ends at the true offsets, rounded to 1 mrad. The remaining errors, up to 0.42 mrad or 0.024° for
each joint, cause the last position errors of the paper and its 0.02°. Without rounding, three
iterations reach the true offsets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.errors import UnknownNameError
from papers.read_table import read_table

RUNS = range(1, 4)
ITERATIONS = 4
"""Number of iterations of the longest run; the paper stops if all errors are below 0.3 mm."""
OFFSETS_DEG = [f"theta_offset{joint}_deg" for joint in range(1, 7)]
ERRORS_MM = [f"error{point}_mm" for point in range(1, 4)]
MRAD = 1e-3
"""Rounding step of the increments in the paper [rad]."""
HALF_DIGIT = 0.0005 + 1e-9
"""Half of the last printed digit [mm or deg]."""
KEYS = ["run", "iteration"]
NOTES = {
    (1, 0, "x3_mm"): "The paper prints 14257; the decimal point is missing.",
    (
        2,
        0,
        "error3_mm",
    ): "The paper prints 3930. The comparison uses 39.303.",
    (
        1,
        2,
        "theta_offset5_deg",
    ): "The printed value contains a typing error; without the error it would be 1.203.",
    (
        1,
        3,
        "error2_mm",
    ): "One digit differs. With 0.206 mm, the limit of 0.3 mm would have ended the run here.",
    (1, 4, "error2_mm"): "The paper repeats the value of iteration 3.",
}
"""Remarks by run, iteration and quantity."""


def printed_table1() -> pd.DataFrame:
    """DH values and true zero offsets of the simulated arm [deg, mm]; the last row is the stylus.

    The link lengths a are as printed. The coordinates of Table 2 require a = 0, as in the bundled
    ``zero6``.
    """
    return read_table("zero_offset_table1")


def printed_postures() -> pd.DataFrame:
    """The nine postures of Table 2, three for each run: joint angles [deg], reference coordinates
    and first position errors [mm].

    The position error of run 2, point 3 is 39.303, corrected from the printed 39.30.
    """
    return read_table("zero_offset_postures")


def printed_table2() -> pd.DataFrame:
    """Table 2: zero offsets [deg] after each iteration of each run, and the position errors of its
    three points [mm].
    """
    return read_table("zero_offset_table2")


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated calibration of the paper.

    Attributes:
        nominal: the DH table without zero offsets.
        q: indications (3, 6) [rad].
        references: coordinates of the points (3, 3) [m].
    """

    nominal: DHTable
    q: Array
    references: Array

    def misses(self, offsets: Array) -> Array:
        """ΔQ for ``offsets`` (6,) [rad]: reference minus computed position (3, 3) [m]."""
        return self.references - self.nominal.chain.positions(self.q + offsets)

    def matrix(self, offsets: Array) -> Array:
        """G, the derivatives of the three positions with respect to the zero offsets: (9, 6)
        [m/rad].
        """
        _, jacobian = self.nominal.chain.position_and_jacobian(self.q + offsets)
        return jacobian.reshape(-1, self.nominal.nq)

    def increment(self, offsets: Array) -> Array:
        """Δδ of (8): (6,) [rad], by singular values.

        The normal equations would square the condition number.
        """
        return np.asarray(
            np.linalg.lstsq(self.matrix(offsets), self.misses(offsets).ravel(), rcond=None)[0]
        )


def simulated_run(run: int) -> Run:
    """Run 1, 2 or 3 of the paper with the bundled arm ``zero6``.

    The references are the positions of the arm without rounding.

    Raises:
        UnknownNameError: no such run.
    """
    if run not in RUNS:
        raise UnknownNameError("run", str(run), [str(known) for known in RUNS])
    q = (
        printed_postures().query("run == @run").filter(like="theta").to_numpy(dtype=np.float64)
        * DEG
    )
    dh = load_arm_file("zero6").dh
    return Run(replace(dh, theta_offset=np.zeros(dh.rows)), q, dh.chain.positions(q))


def assembled_arm() -> Arm:
    """The paper's arm before its calibration: ``zero6`` with every zero offset 0."""
    file = load_arm_file("zero6")
    rows = [row.model_copy(update={"theta_offset_rad": 0.0}) for row in file.joints]
    return Arm.from_file(file.model_copy(update={"joints": rows, "name": "zero6 as assembled"}))


def iterations(run: int, *, rounded: bool = False) -> pd.DataFrame:
    """Iterations 0 (start) to 4 of (7) and (8) for one run, which starts with offsets of zero.

    Columns: iteration, theta_offset1_deg … theta_offset6_deg, error1_mm … error3_mm (distance
    between computed and reference position of each point).

    Args:
        run: number of the run, 1 to 3.
        rounded: increments are whole milliradians, as in the paper. Run 1 also has the typing
            error of iteration 2: the increment of joint 5 is -0.001 rad (1.776° → 1.719°), but
            (8) gives -0.010 rad. The later iterations agree with (8).

    Raises:
        UnknownNameError: no such run.
    """
    simulation = simulated_run(run)
    offsets, rows = np.zeros(simulation.nominal.nq), []
    for iteration in range(ITERATIONS + 1):
        errors = np.linalg.norm(simulation.misses(offsets), axis=1) / MM
        rows.append([iteration, *(offsets / DEG), *errors])
        increment = simulation.increment(offsets)
        if rounded:
            increment = np.round(increment / MRAD) * MRAD
            if (run, iteration) == (1, 1):
                increment[4] = -1 * MRAD
        offsets = offsets + increment
    return pd.DataFrame(rows, columns=["iteration", *OFFSETS_DEG, *ERRORS_MM])


def comparison() -> pd.DataFrame:
    """One row for each number of Table 2, as printed and as computed with rounded
    :func:`iterations`.

    Iteration 0 has the reference coordinates and the position errors before the first iteration.

    Columns:
        run, iteration; kind: ``coordinate``, ``first error``, ``error`` or ``offset``; quantity:
        ``x1_mm`` (of point 1), ``error1_mm`` (of point 1), ``theta_offset1_deg`` (of joint 1), ...;
        unit: ``mm`` or ``deg``, for printed, reproduced and difference (reproduced - printed);
        verdict: ``reproduced`` if all printed digits agree; ``not derivable`` for offsets that are
            no whole number of milliradians, and for the errors of such offsets; else ``not
            reproduced``;
        note: a remark, or "".
    """
    coordinates, runs = [f"{axis}{point}_mm" for point in (1, 2, 3) for axis in "xyz"], []
    for run in RUNS:
        rows = iterations(run, rounded=True).assign(run=run)
        rows.loc[0, coordinates] = simulated_run(run).references.ravel() / MM
        runs.append(rows)
    names = {"x_mm": "x", "y_mm": "y", "z_mm": "z", "position_error_mm": "error"}
    start = (
        printed_postures()
        .rename(columns=names)
        .pivot(index="run", columns="point", values=list(names.values()))
    )
    start.columns = start.columns.map("{0[0]}{0[1]}_mm".format)
    printed = _long(
        pd.concat([printed_table2(), start.reset_index().assign(iteration=0)]), "printed"
    )
    table = printed.merge(
        _long(pd.concat(runs), "reproduced"), how="left", on=[*KEYS, "quantity"], validate="1:1"
    )
    offset, error = (table["quantity"].str.startswith(name) for name in ("theta_offset", "error"))
    kinds = np.select(
        [offset, error & (table["iteration"] == 0), error],
        ["offset", "first error", "error"],
        "coordinate",
    )
    table.insert(2, "kind", kinds)
    table.insert(4, "unit", table["quantity"].str.rpartition("_")[2])
    table["difference"] = table["reproduced"] - table["printed"]
    whole = (table["printed"] * DEG / MRAD).round() * MRAD / DEG
    broken = offset & ((table["printed"] - whole).abs() > HALF_DIGIT)
    underivable = broken | ~offset & broken.groupby([table[key] for key in KEYS]).transform("any")
    agrees = table["difference"].abs() <= HALF_DIGIT
    table["verdict"] = np.select(
        [agrees, underivable], ["reproduced", "not derivable"], "not reproduced"
    )
    table["note"] = [
        NOTES.get(key, "") for key in table[[*KEYS, "quantity"]].itertuples(index=False, name=None)
    ]
    return table


def _long(wide: pd.DataFrame, name: str) -> pd.DataFrame:
    """One row for each number, in the order of run and iteration."""
    table = wide.melt(KEYS, var_name="quantity", value_name=name).dropna()
    return table.sort_values(KEYS, kind="stable", ignore_index=True)
