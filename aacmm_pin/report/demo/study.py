"""What the tour computes, once, for all sections of its page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy.volume import METHODS, AccuracyVolume, Method, accuracy_volume, circle_accuracy
from aacmm_pin.accuracy.workspace import WorkspaceMap, map_workspace
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import ArmFile, load_arm_file
from aacmm_pin.papers.sino6 import Table2, Table3, predict_table3, printed_points, reproduce_table2
from aacmm_pin.papers.table3 import Table3Diagnosis, diagnose_table3, expected_of_records
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circle
from aacmm_pin.report.demo.hidden import Hidden, hide_and_find

SEED = 1
"""Seed of every random number on the page."""
DRAWS = 4000
"""Monte Carlo draws for a configuration."""
ARM_OF_THE_PAPER = "SINO6"


@dataclass(frozen=True, eq=False)
class Study:
    """What was computed for the page.

    Attributes:
        arm_file, arm: the arm.
        circle: every configuration at the working point.
        accuracy: of those within limits, by the zonotope.
        best, worst: numbers of the configurations with the smallest and largest volume in ``accuracy``.
        methods: accuracy of these two by every method.
        map: flexibility and accuracy over the half-plane.
        sectors: sectors of the configuration circle.
        hidden: an effect hidden in simulated measurements, and found.
        table2, table3, table3_tip: the paper's tables beside ours; None for another arm than the paper's.
        diagnosed, of_records: what Table 3 tells, and what its records would; None likewise.
    """

    arm_file: ArmFile
    arm: Arm
    circle: ConfigurationCircle
    accuracy: AccuracyVolume
    best: int
    worst: int
    methods: dict[Method, AccuracyVolume]
    map: WorkspaceMap
    sectors: int
    hidden: Hidden
    table2: Table2 | None
    table3: Table3 | None
    table3_tip: Table3 | None
    diagnosed: Table3Diagnosis | None
    of_records: pd.DataFrame | None

    @property
    def inside(self) -> Array:
        """Swivel angles of the configurations within limits [rad]."""
        return self.circle.swivel[self.circle.within_limits]

    @property
    def monte_carlo_text(self) -> str:
        """The volume by Monte Carlo against the zonotope, in words."""
        low, high = 100 * (self.methods["monte-carlo"].volume / self.methods["zonotope"].volume - 1)
        return f"{low:+.1f} % where the volume is smallest and {high:+.1f} % where it is largest"


def make_study(arm_name: str, progress: bool, cells: tuple[int, int], sectors: int) -> Study:
    """Compute everything; arguments and errors as in :func:`aacmm_pin.report.demo.run_demo`."""
    arm_file = load_arm_file(arm_name)
    arm = Arm.from_file(arm_file)
    circle = configuration_circle(arm, printed_points()[0])
    accuracy = circle_accuracy(circle)
    best, worst = int(np.argmin(accuracy.volume)), int(np.argmax(accuracy.volume))
    rng = np.random.default_rng(SEED)
    ends = accuracy.q[[best, worst]]
    methods = {
        m: accuracy_volume(arm, ends, at=circle.at, method=m, rng=rng, draws=DRAWS, progress=progress) for m in METHODS
    }
    map_ = map_workspace(arm, cells, sectors, progress=progress)
    hidden = hide_and_find(arm, SEED, progress)
    of_paper = arm.name == ARM_OF_THE_PAPER
    table2 = reproduce_table2(progress=progress) if of_paper else None
    table3 = predict_table3(np.random.default_rng(SEED), arm=arm) if of_paper else None
    at_tip = predict_table3(np.random.default_rng(SEED), arm=arm, reading="tip") if of_paper else None
    diagnosed = diagnose_table3(np.random.default_rng(SEED), progress=progress) if of_paper else None
    of_records = None
    if diagnosed is not None:
        of_records = expected_of_records(diagnosed.seats, diagnosed.tau, np.random.default_rng(SEED))
    tables = (table2, table3, at_tip, diagnosed, of_records)
    return Study(arm_file, arm, circle, accuracy, best, worst, methods, map_, sectors, hidden, *tables)
