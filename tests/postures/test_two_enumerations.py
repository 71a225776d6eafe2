"""Two ways to all configurations of the nominal arm that share no code: traced curves, and closed forms at each swivel."""

from __future__ import annotations

import numpy as np

from aacmm_pin.arm.limits import broken_limits, into_limits
from aacmm_pin.papers.sino6.nominal import sino6_nominal
from aacmm_pin.papers.sino6.table2 import exact_sectors, generating_grid
from aacmm_pin.postures.curve_sampling import Components, at_swivel, sector_centres
from aacmm_pin.postures.elbow_swivel import Swivel
from aacmm_pin.postures.wrist_ik import Wrist, wrist_curves, wrist_system

TURN = [0.0, 2 * np.pi]
LIMITS = np.array([TURN, [-np.pi, 0.0], TURN, [-np.pi, 0.0], TURN])


def test_working_sectors_of_the_papers_cells_agree() -> None:
    """Every eleventh of the 48 × 48 cells: the rims, the base axis and all the classes of the table are among them."""
    arm = sino6_nominal()
    points = generating_grid(arm)[2][::11]
    wrist = Wrist.of(arm.dh, np.zeros(1))
    swivel = Swivel(arm.dh, np.array([0.0, 0.0, -1.0]))
    components = Components(swivel, wrist_system(wrist, points), points, wrist_curves(wrist, points, 6), wrist)
    q, sector, cell = at_swivel(components, sector_centres(12))
    inside = ~broken_limits(into_limits(q, LIMITS), LIMITS).any(axis=1)
    works = np.zeros((len(points), 12), dtype=int)
    works[cell[inside], sector[inside]] = 1
    counts = works.sum(axis=1)
    assert len(np.unique(counts)) >= 4
    np.testing.assert_array_equal(counts, exact_sectors(arm, points))
