"""The paper's tables, and its calibration: zero offsets from three known points by least squares, with its rounding.

With zero offsets ``s``, 0 at first, the tip is computed at ``q + s``. The misses ``ΔQ`` of the three points and the
derivatives ``G`` of the tips with respect to the offsets give ``ΔQ = G Δδ`` (7), whose least squares solution is the
increment ``Δδ = (Gᵀ G)⁻¹ Gᵀ ΔQ`` (8); then again from ``s + Δδ``.

**Rounding.** Every printed offset before a run's last iteration is a whole number of milliradians: the increments were
rounded so, or their sums, which comes to the same. The iteration then ends in every run at the true offsets rounded to
1 mrad. The rest, up to 0.42 mrad or 0.024° a joint, is what the paper's last position errors and its 0.02° come from
(:func:`rounding_residuals`); unrounded, three iterations reach the true offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.papers.read_table import read_table

RUNS = range(1, 4)
OFFSETS_DEG = [f"theta_offset{joint}_deg" for joint in range(1, 7)]
ERRORS_MM = [f"error{point}_mm" for point in range(1, 4)]
MRAD = 1e-3
"""What the paper rounded its increments to [rad]."""


def printed_table1() -> pd.DataFrame:
    """DH values and true zero offsets of the simulated arm, one row a DH row, the stylus last [deg, mm].

    The link lengths a are as printed; the coordinates of Table 2 come out with a = 0 only, as in the bundled ``zero6``.
    """
    return read_table("zero_offset", "table1")


def printed_postures() -> pd.DataFrame:
    """The nine postures of Table 2, three a run: joint angles [deg], reference coordinates, first position errors [mm].

    Corrected in one digit: the position error of run 2, point 3, which stands there as 39.30, is 39.303 here.
    """
    return read_table("zero_offset", "postures")


def printed_table2() -> pd.DataFrame:
    """Table 2: zero offsets [deg] after each iteration of each run, and the position errors of its three points [mm]."""
    return read_table("zero_offset", "table2")


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated calibration of the paper.

    Attributes:
        nominal: the DH table without zero offsets.
        true_offsets: what the calibration should find (6,) [rad].
        q: indications (3, 6) [rad].
        references: coordinates of the points (3, 3) [m].
    """

    nominal: DHTable
    true_offsets: Array
    q: Array
    references: Array

    def misses(self, offsets: Array) -> Array:
        """ΔQ, reference minus computed position, for ``offsets`` (6,) [rad]: (3, 3) [m]."""
        return self.references - self.nominal.positions(self.q + offsets)

    def matrix(self, offsets: Array) -> Array:
        """G, the derivatives of the three positions with respect to the zero offsets: (9, 6) [m/rad]."""
        return self.nominal.position_and_jacobian(self.q + offsets)[1].reshape(-1, self.nominal.nq)

    def increment(self, offsets: Array) -> Array:
        """Δδ of (8): (6,) [rad]. Solved by singular values; the normal equations would square the condition number."""
        return np.asarray(np.linalg.lstsq(self.matrix(offsets), self.misses(offsets).ravel(), rcond=None)[0])


def simulated_run(run: int) -> Run:
    """Run 1, 2 or 3 of the paper with the bundled arm ``zero6``; the references are the arm's own positions, unrounded.

    Raises:
        UnknownNameError: no such run.
    """
    if run not in RUNS:
        raise UnknownNameError("run", str(run), [str(known) for known in RUNS])
    q = printed_postures().query("run == @run").filter(like="theta").to_numpy(dtype=np.float64) * DEG
    dh = load_arm_file("zero6").dh
    return Run(replace(dh, theta_offset=np.zeros(dh.rows)), dh.theta_offset[dh.moving], q, dh.positions(q))


def assembled_arm() -> Arm:
    """The paper's arm before its calibration: ``zero6`` with every zero offset 0."""
    file = load_arm_file("zero6")
    rows = [row.model_copy(update={"theta_offset_rad": 0.0}) for row in file.joints]
    return Arm.from_file(file.model_copy(update={"joints": rows, "name": "zero6 as assembled"}))


def iterations(run: int, rounding: float = 0.0, *, keying_slip: bool = False, count: int = 4) -> pd.DataFrame:
    """The paper's iterations (7), (8) of one run from zero offsets on, one row an iteration; row 0 is the start.

    Columns: iteration, theta_offset1_deg … theta_offset6_deg, error1_mm … error3_mm (distance of the computed from the
    reference position of each point), condition_number (of G at these offsets; the next iteration starts from it).

    Args:
        run: number of the run, 1 to 3.
        rounding: increments are rounded to whole multiples of this [rad]; 0 leaves them as they are.
        keying_slip: make the slip of Table 2, run 1, iteration 2: it has 1.776° → 1.719° for joint 5, an increment of
            -0.001 rad, where (8) gives -0.010; what follows obeys (8) again.
        count: number of iterations. There is no stopping rule here; the paper stops when all errors are below 0.3 mm.

    Raises:
        UnknownNameError: no such run.
    """
    simulation = simulated_run(run)
    offsets, rows = np.zeros(simulation.nominal.nq), []
    for iteration in range(count + 1):
        errors = np.linalg.norm(simulation.misses(offsets), axis=1) / MM
        rows.append([iteration, *(offsets / DEG), *errors, np.linalg.cond(simulation.matrix(offsets))])
        increment = simulation.increment(offsets)
        if rounding:
            increment = np.round(increment / rounding) * rounding
        if keying_slip and (run, iteration) == (1, 1):
            increment[4] = -1 * MRAD
        offsets = offsets + increment
    return pd.DataFrame(rows, columns=["iteration", *OFFSETS_DEG, *ERRORS_MM, "condition_number"])


def rounding_residuals(roundings: Sequence[float] = (1e-3, 1e-4, 1e-5, 0.0)) -> pd.DataFrame:
    """What is left after eight iterations when increments are rounded more and more finely, one row a rounding and run.

    Columns: rounding_mrad, run, error1_mm … error3_mm, rms_error_mm (of the three), expected_rms_error_mm,
    largest_offset_error_deg. Expected is the root mean square over all arms, each joint's rest being uniform within ± half
    the rounding: ``rounding/√12 · ‖G‖/√3`` with the Frobenius norm. The one arm here stays below it, by up to three times.
    """
    rows = []
    for rounding, run in product(roundings, RUNS):
        simulation, last = simulated_run(run), iterations(run, rounding, count=8).iloc[-1]
        norm = np.linalg.norm(simulation.matrix(simulation.true_offsets)) / MM
        largest = np.abs(last[OFFSETS_DEG] - simulation.true_offsets / DEG).max()
        rms = np.sqrt(np.square(last[ERRORS_MM]).mean())
        rows.append([rounding / MRAD, run, *last[ERRORS_MM], rms, rounding / 6.0 * norm, largest])  # √12 √3 = 6
    names = ["rounding_mrad", "run", *ERRORS_MM, "rms_error_mm", "expected_rms_error_mm", "largest_offset_error_deg"]
    return pd.DataFrame(rows, columns=names)
