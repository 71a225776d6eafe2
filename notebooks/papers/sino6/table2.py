"""Table 2 of the paper made again, and beside it what exact geometry says about the same cells.

**How the paper's counts come about** (an assumption, as the text does not say it; nothing in it is
tuned): the 48 × 48 regions are a grid in *joint* space, θ1 = θ3 = 0 and θ2, θ4 at -π + i π/49, i =
1 … 48; each cell's working point is where this "highest" configuration reaches. Its configuration
circle is walked in seven equal steps of θ2 from the highest to the lowest configuration: the two
ends stand for one sector each, the five steps between for a mirror-image pair each. A step counts
if θ2 >= -π and a pair exists by (11) and (13), that is both cosines lie within ±1; θ4 of a pair is
not checked. Where the triangle of the lowest configuration does not close, its angle thek2 is taken
as zero, as the real part of a complex inverse cosine would be, and the lowest end does not count.

**Why these counts are too small.** Near the base axis the elbow's circle encloses the vertical
through the shoulder. Then the true extreme of θ2 lies on the far side, 180° minus the planar one,
with the base turned by about 180°. Steps beyond it belong to no configuration, and the real ones
with the turned base are not looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.postures.curve_sampling import Components, Sectors
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.wrist_ik import FEW_PER_TURN, Wrist, wrist_curves, wrist_equations
from papers.sino6.equations import ConfigurationsAtTheta2, PlanarConfigurations, tube_end_to_point
from papers.sino6.tables import NominalArm, printed_table2, sino6_nominal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = 48
"""Cells along each of θ2 and θ4."""
SECTORS = 12
"""Sectors of the circle; the seven steps of θ2 stand for 1 + 5·2 + 1 of them."""
LIMITS = np.pi * np.array([[0, 2], [-1, 0], [0, 2], [-1, 0], [0, 2]])
"""θ2 and θ4 stay in [-π, 0], the others turn freely [rad]."""


@dataclass(frozen=True, eq=False)
class Table2(Shown):
    """Table 2 as printed, reproduced, and exact.

    Attributes:
        counts: working_sectors (0 to 12) and the number of cells: paper_cells, reproduced_cells,
            exact_cells.
        cells: one row a cell: theta2_deg, theta4_deg, x_mm, z_mm (DH base frame),
            reproduced_sectors, exact_sectors, behind_axis (the point, as seen from the elbow of the
            cell's own posture).
    """

    counts: pd.DataFrame
    cells: pd.DataFrame

    @property
    def total_variation(self) -> dict[str, float]:
        """Half the summed differences from the printed shares of cells, ``reproduced`` and
        ``exact``: 0 alike, 1 apart.
        """
        names = ("reproduced", "exact")
        apart = {
            name: (self.counts[f"{name}_cells"] - self.counts["paper_cells"]).abs().sum()
            for name in names
        }
        return {name: float(0.5 * cells / len(self.cells)) for name, cells in apart.items()}

    @property
    def mean_flexibility(self) -> dict[str, float]:
        """Mean of ζ over the cells, by the names ``paper``, ``reproduced``, ``exact``."""
        zeta, names = self.counts["working_sectors"] / SECTORS, ("paper", "reproduced", "exact")
        return {
            name: float(np.average(zeta, weights=self.counts[f"{name}_cells"])) for name in names
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Cells by their working sectors."""
        from papers.plots import plot_table2

        return plot_table2(self, ax)


def reproduce_table2(grid: int = GRID) -> Table2:
    """Table 2 by the assumption in the module's docstring, and by exact geometry on the same cells.

    Args:
        grid: cells along each of θ2 and θ4.
    """
    arm = sino6_nominal()
    theta2, theta4, points = generating_grid(arm, grid)
    cells = pd.DataFrame(
        {
            "theta2_deg": theta2 / DEG,
            "theta4_deg": theta4 / DEG,
            "x_mm": points[:, 0] / MM,
            "z_mm": points[:, 2] / MM,
            "reproduced_sectors": _sectors_by_steps(arm, points, theta2, theta4),
            "exact_sectors": exact_sectors(arm, points),
            "behind_axis": points[:, 0]
            < 0.0,  # the elbow is in front of the base axis, P behind it
        }
    )
    paper = printed_table2().set_index("working_sectors")["cells"]
    counts = pd.DataFrame({"working_sectors": np.arange(SECTORS + 1)})
    counts["paper_cells"] = counts["working_sectors"].map(paper).fillna(0).astype(int)
    for name in ("reproduced", "exact"):
        counts[f"{name}_cells"] = np.bincount(cells[f"{name}_sectors"], minlength=SECTORS + 1)
    return Table2(counts, cells)


def generating_grid(arm: NominalArm, grid: int = GRID) -> tuple[Array, Array, Array]:
    """θ2 and θ4 at the interior nodes of [-π, 0]², (n,) [rad] each, and the points reached with
    θ1 = θ3 = 0, (n, 3) [m].
    """
    nodes = np.arange(1, grid + 1) * np.pi / (grid + 1) - np.pi
    theta2, theta4 = (angle.ravel() for angle in np.meshgrid(nodes, nodes, indexing="ij"))
    zero = np.zeros_like(theta2)
    q = np.column_stack([zero, theta2, zero, theta4, zero])
    return theta2, theta4, arm.dh.chain.positions(q)


def _sectors_by_steps(
    arm: NominalArm, points: Array, theta2: Array, theta4: Array
) -> NDArray[np.int64]:
    """Working sectors by the paper's walk over the circle: (n,)."""
    planar = PlanarConfigurations(arm, points)
    sweep = np.nansum(planar.sweep_parts(tube_end_to_point(arm, theta4)), axis=1)
    steps = theta2 - np.linspace(0.0, 1.0, 1 + SECTORS // 2)[:, None] * sweep
    at = [ConfigurationsAtTheta2(arm, points, step) for step in steps]
    # On the printed root.
    exists = np.abs([each.cosine_theta1(each.theta4[:, 0]) for each in at]) <= 1.0
    exists[0], exists[-1] = True, planar.lowest_exists
    sectors = np.full(len(steps), 2)
    sectors[[0, -1]] = 1
    return np.asarray(sectors @ (exists & (steps >= -np.pi)))


def exact_sectors(arm: NominalArm, points: Array) -> NDArray[np.int64]:
    """How many of twelve swivel angles, 30° apart from the highest elbow on, have a true
    configuration: (n,).

    True means θ2 and θ4 in [-π, 0], θ1 and θ3 free, on the traced curves of
    :mod:`aacmm_pin.postures`.
    """
    wrist, swivel = Wrist.of(arm.dh), Swivel(arm.dh, np.array([0.0, 0.0, -1.0]))
    curves = wrist_curves(wrist, points, FEW_PER_TURN)
    components = Components(swivel, wrist_equations(wrist, points), points, curves.curves, wrist)
    return np.asarray(Sectors.of(components, LIMITS, SECTORS).working.sum(axis=1))
