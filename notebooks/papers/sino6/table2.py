"""Table 2 of the paper, reproduced, and the counts of exact geometry for the same cells.

**How the paper counts.** The text does not define the regions, so this is an assumption. No number
in it is tuned. The 48 × 48 regions are a grid of *joint angles*: θ1 = θ3 = 0, and θ2 and θ4 at -π +
i π/49 with i = 1 … 48. The working point of a cell is the point that this "highest" posture
reaches. The paper evaluates the configuration circle in seven equal steps of θ2, from the highest
posture to the lowest. Each end represents one sector, and each of the five other steps two
symmetrical sectors. A step counts if θ2 >= -π, and if a pair exists by (11) and (13): both cosines
lie within ±1. θ4 of a pair is not checked. If the triangle of the lowest posture does not close,
its angle thek2 is zero, as the real part of a complex inverse cosine, and the lowest end does not
count.

**Why these counts are too small.** Near the base axis the circle of the elbow encloses the vertical
through the shoulder. The true extreme of θ2 then lies on the far side, at 180° minus the planar
extreme, with the base rotated by about 180°. Steps beyond it belong to no posture, and the paper
does not evaluate the true postures with the rotated base.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.postures.configurations import PER_TURN_IN_MAP
from aacmm_pin.postures.curve_sampling import Components, Sectors
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.wrist import Wrist
from papers.sino6.equations import ConfigurationsAtTheta2, PlanarConfigurations, tube_end_to_point
from papers.sino6.tables import NominalArm, printed_table2, sino6_nominal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = 48
"""Cells along each of θ2 and θ4."""
SECTORS = 12
"""Sectors of the circle; the seven steps of θ2 stand for 1 + 5·2 + 1 of them."""
LIMITS = np.pi * np.array([[0, 2], [-1, 0], [0, 2], [-1, 0], [0, 2]])
"""Joint limits [rad]: θ2 and θ4 in [-π, 0]; the other joints rotate freely."""


@dataclass(frozen=True, eq=False)
class Table2(Shown):
    """Table 2 as printed, reproduced, and exact.

    Attributes:
        counts: working_sectors (0 to 12) and the number of cells: paper_cells, reproduced_cells,
            exact_cells.
        cells: one row for each cell: theta2_deg, theta4_deg, x_mm, z_mm (DH base frame),
            reproduced_sectors, exact_sectors, behind_axis (whether the base axis is between the
            elbow of this posture and the point).
    """

    counts: pd.DataFrame
    cells: pd.DataFrame

    @property
    def total_variation(self) -> dict[str, float]:
        """Total variation distance to the printed shares of cells, for ``reproduced`` and
        ``exact``: 0 if equal, 1 without overlap.
        """
        names = ("reproduced", "exact")
        apart = {
            name: (self.counts[f"{name}_cells"] - self.counts["paper_cells"]).abs().sum()
            for name in names
        }
        return {name: float(0.5 * cells / len(self.cells)) for name, cells in apart.items()}

    @property
    def mean_flexibility(self) -> dict[str, float]:
        """Mean of ζ over the cells, for ``paper``, ``reproduced`` and ``exact``."""
        zeta, names = self.counts["working_sectors"] / SECTORS, ("paper", "reproduced", "exact")
        return {
            name: float(np.average(zeta, weights=self.counts[f"{name}_cells"])) for name in names
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the number of cells over the number of working sectors."""
        from papers.plots import plot_table2

        return plot_table2(self, ax)


def reproduce_table2(grid: int = GRID) -> Table2:
    """Table 2 by the assumption of this module, and by exact geometry for the same cells.

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
    """θ2 and θ4 at the interior nodes of [-π, 0]², each (n,) [rad], and the points with θ1 = θ3 =
    0, (n, 3) [m].
    """
    nodes = np.arange(1, grid + 1) * np.pi / (grid + 1) - np.pi
    theta2, theta4 = (angle.ravel() for angle in np.meshgrid(nodes, nodes, indexing="ij"))
    zero = np.zeros_like(theta2)
    q = np.column_stack([zero, theta2, zero, theta4, zero])
    return theta2, theta4, arm.dh.chain.positions(q)


def _sectors_by_steps(
    arm: NominalArm, points: Array, theta2: Array, theta4: Array
) -> NDArray[np.int64]:
    """Number of working sectors by the steps of the paper: (n,)."""
    planar = PlanarConfigurations(arm, points)
    sweep = np.nansum(planar.sweep_parts(tube_end_to_point(arm, theta4)), axis=1)
    steps = theta2 - np.linspace(0.0, 1.0, 1 + SECTORS // 2)[:, None] * sweep
    at = [ConfigurationsAtTheta2(arm, points, step) for step in steps]
    # by the printed root
    exists = np.abs([each.cosine_theta1(each.theta4[:, 0]) for each in at]) <= 1.0
    exists[0], exists[-1] = True, planar.lowest_exists
    sectors = np.full(len(steps), 2)
    sectors[[0, -1]] = 1
    return np.asarray(sectors @ (exists & (steps >= -np.pi)))


def exact_sectors(arm: NominalArm, points: Array) -> NDArray[np.int64]:
    """Number of swivel angles with a posture within the limits: (n,).

    The twelve swivel angles are 30° apart and begin at the highest elbow. θ2 and θ4 are in [-π, 0],
    and θ1 and θ3 are free. The postures are those of :mod:`aacmm_pin.postures`.
    """
    wrist, swivel = Wrist.of(arm.dh), Swivel(arm.dh, np.array([0.0, 0.0, -1.0]))
    curves = wrist.curves(points, PER_TURN_IN_MAP)
    components = Components(swivel, points, curves, wrist)
    return np.asarray(Sectors.of(components, LIMITS, SECTORS).working.sum(axis=1))
