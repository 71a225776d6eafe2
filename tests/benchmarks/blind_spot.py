"""A robot whose every encoder is eccentric and whose every joint yields, as a measurement file and
the truth behind it.

The machine is the tests' own plant (``tests/blind``): true eccentric discs, equilibrium under
gravity iterated until the arm stands. It shares no code with the package, which sees the files that
are written here and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from blind import chains
from blind.conditions import Conditions
from blind.kinematics import Array
from blind.machine import Machine
from blind.truth import Hidden

ARM = Path(__file__).with_name("tool_robot.toml")
RECORDS, HELD_OUT = 200, 300
NOISE = 1e-5
"""Standard deviation of every measured coordinate [m]."""
ECCENTRICITY = 1e-4
"""Of each disc over its radius: the amplitude of the error [rad]."""
COMPLIANCE = 1e-5
"""Of each joint [rad/(N·m)]."""
ERRORS = np.array([1e-4, 1e-4, 2e-4, 2e-4])
"""Standard deviations of the errors of a, d, alpha, theta_offset [m, m, rad, rad]."""
ASSEMBLED = 50.0
"""Nobody assembles worse than so many of these: 5 mm and 10 mrad."""
STEP = 1e-6
"""Of differences [m] and [rad]; of a compliance a tenth of it [rad/(N·m)]."""


@dataclass(frozen=True, eq=False)
class BlindSpot:
    """A machine with twelve faults, measured at some poses and to be predicted at others.

    Attributes:
        machine: the robot as it is, faults included.
        q, held_out: indications of the records and of the poses held out (n, 6) [rad].
        positions: measured tips of the records in the base frame (n, 3) [m].
        truth: tips at the poses held out, without noise (n, 3) [m].
    """

    machine: Machine
    q: Array
    held_out: Array
    positions: Array
    truth: Array

    @staticmethod
    def of(
        seed: int, eccentricity: float = ECCENTRICITY, compliance: float = COMPLIANCE
    ) -> BlindSpot:
        """A machine drawn from the seed; a fault of size zero is none."""
        rng = np.random.default_rng(seed)
        arm = chains.read(ARM)
        rows = range(1, arm.rows + 1)
        phases = rng.uniform(-np.pi, np.pi, arm.rows)
        discs = [{"amplitude_rad": eccentricity, "phase_rad": float(phase)} for phase in phases]
        faults = [
            Hidden("encoder_eccentricity", row, p)
            for row, p in zip(rows, discs, strict=True)
            if eccentricity
        ]
        faults += [
            Hidden("joint_compliance", row, {"compliance_rad_per_nm": compliance})
            for row in rows
            if compliance
        ]
        machine = Machine(arm, rng.normal(size=arm.exact.shape) * ERRORS, tuple(faults))
        q, held_out = (rng.uniform(*arm.limits.T, (n, arm.rows)) for n in (RECORDS, HELD_OUT))
        seen, truth = tips(machine, q), tips(machine, held_out)
        return BlindSpot(machine, q, held_out, seen + rng.normal(size=seen.shape) * NOISE, truth)

    @property
    def nominal(self) -> Array:
        """Tips of the arm file at the poses held out (n, 3) [m]."""
        return self.machine.arm.tips(self.held_out)

    @property
    def faults(self) -> dict[str, Hidden]:
        """What is wrong, by ``cause:joint``."""
        return {fault.key: fault for fault in self.machine.faults}

    def off(self, predicted: Array) -> float:
        """Root mean square distance of predicted tips (n, 3) [m] from the true ones at the poses
        held out [m].
        """
        return float(np.sqrt(np.sum((predicted - self.truth) ** 2, axis=1).mean()))

    @cached_property
    def neighbours(self) -> dict[str, list[Machine]]:
        """The machine with each of its unknown values a step off: ``geometry``, then fault by
        fault.
        """
        machine, found = self.machine, {"geometry": []}
        for where in np.ndindex(machine.values.shape):
            values = machine.values.copy()
            values[where] += STEP
            found["geometry"].append(replace(machine, values=values))
        for key, fault in self.faults.items():
            others = [f for f in machine.faults if f is not fault]
            found[key] = [machine.with_faults([*others, f]) for f in _stepped(fault)]
        return found

    def derivatives(self, q: Array) -> dict[str, Array]:
        """Of the tips by these values: each (3 n, values) [m per step]."""
        here = tips(self.machine, q).ravel()
        return {
            key: np.stack([tips(m, q).ravel() - here for m in all_], axis=1)
            for key, all_ in self.neighbours.items()
        }

    @cached_property
    def here(self) -> dict[str, Array]:
        """The same at the records."""
        return self.derivatives(self.q)

    def whitened(self, columns: dict[str, Array]) -> Array:
        """Columns of the records over their noise, and below them one row for each geometric value:
        how far off it may be.

        Without it d of parallel axes could go off by metres against each other, and the weights
        with them.
        """
        records = np.hstack([*columns.values()]) / NOISE
        rows = np.zeros((self.machine.values.size, records.shape[1]))
        np.fill_diagonal(
            rows, STEP / np.broadcast_to(ASSEMBLED * ERRORS, self.machine.values.shape).ravel()
        )
        return np.vstack([records, rows])

    @cached_property
    def perfect(self) -> float:
        """Error at the poses held out of one who knows the plant, and fits all its values to the
        noisy records [m].

        To first order: what the noise alone moves the least-squares fit by.
        """
        records = self.whitened(self.here)
        noise = np.zeros(len(records))
        noise[: self.positions.size] = (self.positions - tips(self.machine, self.q)).ravel() / NOISE
        step = np.linalg.lstsq(records, noise, rcond=None)[0]
        moved = np.hstack([*self.derivatives(self.held_out).values()]) @ step
        return self.off(self.truth + moved.reshape(-1, 3))

    @cached_property
    def visibility(self) -> dict[str, float]:
        """λ of each fault: what it leaves of χ² in the records when geometry and all other faults
        are fitted without it.
        """
        here = tips(self.machine, self.q)
        found = {}
        for key, fault in self.faults.items():
            without = self.machine.with_faults([f for f in self.machine.faults if f is not fault])
            others = self.whitened({name: c for name, c in self.here.items() if name != key})
            shift = np.zeros(len(others))
            shift[: here.size] = (here - tips(without, self.q)).ravel() / NOISE
            left = shift - others @ np.linalg.lstsq(others, shift, rcond=None)[0]
            found[key] = float(left @ left)
        return found


def tips(machine: Machine, q: Array) -> Array:
    """Where the machine's tip is at indications q (n, 6) [rad]: (n, 3) [m]."""
    return machine.observed(q, Conditions.still(*q.shape))


def _stepped(fault: Hidden) -> list[Hidden]:
    """The fault a step larger, and for a disc a step turned too."""
    p = fault.parameters
    if fault.cause == "joint_compliance":
        return [
            replace(
                fault, parameters={"compliance_rad_per_nm": p["compliance_rad_per_nm"] + 0.1 * STEP}
            )
        ]
    turned = p["phase_rad"] + STEP / p["amplitude_rad"]
    return [
        replace(fault, parameters={**p, "amplitude_rad": p["amplitude_rad"] + STEP}),
        replace(fault, parameters={**p, "phase_rad": turned}),
    ]
