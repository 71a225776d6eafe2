"""Arms and points at which postures are not single ones or curves, and searches that end at their
limit of work.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin._support.display import Note
from aacmm_pin.accuracy.workspace import map_workspace
from aacmm_pin.arm import Arm
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import solution_curves
from aacmm_pin.postures.configurations import configuration_circle
from aacmm_pin.postures.general_ik import reaching_postures
from aacmm_pin.report.json_summaries import map_summary
from tests.arm_files import by_table
from tests.notes import data_of
from tests.oracle import close

pytestmark = pytest.mark.fast

H = 90.0
# a, d [mm] and alpha [°] of each row
ROWS = {
    "parallel joints 2 and 3": [
        (0, 0, H),
        (400, 0, 0),
        (0, 0, H),
        (0, 400, -H),
        (0, 0, H),
        (0, 100, 0),
    ],
    "all axes parallel": [(200, 0, 0)] * 6,
    "planar": [(300, 0, 180.0), (250, 0, 180.0), (200, 0, 0), (250, 0, 0), (0, 0, 0), (0, 0, 0)],
    "one axis": [(0, 100, 0)] * 6,
    "wrist at the shoulder": [*[(0, 0, H)] * 5, (100, 0, 0)],
    "sphere": [(0, 0, H), (0, 0, -H), (0, 0, H), (0, 500, -H), (0, 0, H), (0, 100, 0)],
}


def arm_of(name: str) -> Arm:
    known = {"a_mm": 0.02, "d_mm": 0.02, "alpha_rad": 5e-5, "theta_offset_rad": 5e-5}
    return by_table(name, [(*row, 0.0) for row in ROWS[name]], 177.0, uncertainty=known)


def test_families_are_told():
    """Where each arm's wrist is anyhow, and places that it cannot reach though no step brings it
    nearer.
    """
    for name in ROWS:
        arm = arm_of(name)
        q = np.array([[0.3, -0.5, 0.7, 0.9, 0.0, 0.0]])
        point = (
            np.array([0.0, 0.0, 0.3])
            if name.startswith("parallel")
            else arm.positions(q, "frame5")[0]
        )
        circle = configuration_circle(arm, point, rest=[0.0, 0.0])
        assert (len(circle), circle.complete, circle.reason) == (
            0,
            False,
            "; ".join(map(str, circle.notes)),
        ), name
        named = circle.reason[circle.reason.index("(") + 1 : circle.reason.index(")")]
        reached = arm.positions(
            np.deg2rad([[float(angle) for angle in named.split(",")]]), "frame5"
        )[0]
        close(reached, point, 1e-3)  # named to a tenth of a degree
        if not name.startswith("parallel"):
            away = configuration_circle(arm, [0.0, 0.0, 0.7], rest=[0.0, 0.0])
            assert (len(away), away.complete) == (0, False), name
            assert "singular" in away.reason
            assert "families" not in away.reason


def test_no_condition_hangs():
    """A point and an axis, a full pose: single postures, curves, families or out of reach, and
    never another.
    """
    for name in ("all axes parallel", "one axis", "sphere"):
        arm = arm_of(name)
        for conditions in ({"rotation": np.eye(3)}, {"axis": [0, 0.6, 0.8], "tool": [1, 0, 0]}):
            for point in ([0.0, 0.0, 0.0], [0.2, 0.1, 0.0]):
                found = reaching_postures(arm, point, count=8, most_starts=1024, **conditions)
                assert bool(found.reason) == (not len(found))
                assert np.abs(arm.positions(found.q) - point).max(initial=0.0) < 1e-9


def test_map_of_families():
    """In its own plane every cell of a planar arm is reached, in families of postures; beside it
    none is.
    """
    whole = map_workspace(arm_of("planar"), (2, 3), extent=[0.1, 0.5, -0.1, 0.1])
    np.testing.assert_array_equal(whole.data["reachable"], [[0, 1, 0]] * 2)
    assert (whole.incomplete, map_summary(whole)["incomplete"], whole.unreachable) == (6, 6, 4)
    assert "missing in 6 cells" in str(whole)
    with pytest.raises(AacmmError, match="no joint moves the wrist"):
        map_workspace(arm_of("wrist at the shoulder"), (2, 2))


def test_a_search_that_ends_early_says_so(sino6, monkeypatch):
    """What it has found until then is returned."""
    point = [0.2, -0.5, 0.2]
    whole = configuration_circle(sino6, point, count=20)
    assert (whole.complete, whole.notes) == (True, ())
    pose = reaching_postures(sino6, point, axis=[0, 0, -1], count=20)
    assert (pose.complete, pose.search.ended) == (True, False)
    monkeypatch.setattr(solution_curves, "MOST_STEPS", 70)
    part = configuration_circle(sino6, point, count=20)
    assert 0 < part.component.max() < whole.component.max()
    assert not part.complete
    assert data_of(part.notes, "search_ended")
    close(sino6.positions(part.q, "frame5"), [point] * len(part), 1e-9)
    few = reaching_postures(sino6, point, axis=[0, 0, -1], count=20, most_starts=100)
    assert (few.complete, few.search.ended) == (False, True)
    assert str(Note("search_ended")) in str(few)
