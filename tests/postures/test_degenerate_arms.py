"""Arms and points at which postures are not single ones or curves, and searches that end at their
limit of work.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.accuracy.workspace import map_workspace
from aacmm_pin.arm import Arm, load_arm_file
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import solution_curves
from aacmm_pin.postures.configurations import configuration_circle
from aacmm_pin.postures.general_ik import reaching_postures
from aacmm_pin.report.json_summaries import map_summary
from tests.notes import data_of

H = np.pi / 2
# a, d [mm] and alpha [rad] of each row
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
    "planar": [(300, 0, np.pi), (250, 0, np.pi), (200, 0, 0), (250, 0, 0), (0, 0, 0), (0, 0, 0)],
    "all lengths zero": [(0, 0, 0)] * 6,
    "lengths zero, axes crossed": [(0, 0, H)] * 6,
    "one axis": [(0, 100, 0)] * 6,
    "sphere": [(0, 0, H), (0, 0, -H), (0, 0, H), (0, 500, -H), (0, 0, H), (0, 100, 0)],
}


def arm_of(name: str) -> Arm:
    file, rows = load_arm_file("sino6"), []
    for row, (a, d, alpha) in zip(file.joints, ROWS[name], strict=True):
        change = {
            "a_mm": a,
            "d_mm": d,
            "alpha_rad": alpha,
            "theta_offset_rad": 0.0,
            "limits_rad": (-3.1, 3.1),
        }
        rows.append(row.model_copy(update=change))
    return Arm.from_file(file.model_copy(update={"name": name, "joints": rows}))


def test_families_are_told() -> None:
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
        np.testing.assert_allclose(reached, point, atol=1e-3)  # named to a tenth of a degree
        if not name.startswith("parallel"):
            away = configuration_circle(arm, [0.0, 0.0, 0.7], rest=[0.0, 0.0])
            assert (len(away), away.complete) == (0, False), name
            assert "degenerate" in away.reason
            assert "families" not in away.reason


def test_no_condition_hangs() -> None:
    """A point and an axis, a full pose: single postures, curves, families or out of reach, and
    never another.
    """
    for name in ("all axes parallel", "all lengths zero", "sphere"):
        arm = arm_of(name)
        for conditions in ({"rotation": np.eye(3)}, {"axis": [0, 0.6, 0.8]}):
            for point in ([0.0, 0.0, 0.0], [0.2, 0.1, 0.0]):
                found = reaching_postures(arm, point, count=8, most_starts=1024, **conditions)
                assert bool(found.reason) == (not len(found))
                assert np.abs(arm.positions(found.q) - point).max(initial=0.0) < 1e-9


def test_map_of_families() -> None:
    """In its own plane every cell of a planar arm is reached, in families of postures; beside it
    none is.
    """
    whole = map_workspace(arm_of("planar"), (2, 3), extent=[0.1, 0.5, -0.1, 0.1], progress=False)
    np.testing.assert_array_equal(whole.data["reachable"], [[0, 1, 0]] * 2)
    assert (whole.incomplete, map_summary(whole)["incomplete"], whole.unreachable) == (6, 6, 4)
    assert "missing in 6 cells" in str(whole)
    with pytest.raises(AacmmError, match="the wrist does not leave the shoulder"):
        map_workspace(arm_of("all lengths zero"), (2, 2), progress=False)


def test_places_where_no_arm_is(sino6: Arm) -> None:
    for point in ([1e155, 0, 0], [0, -101.0, 0], [0, 0, 1e308]):
        for ask in (configuration_circle, reaching_postures):
            with pytest.raises(AacmmError, match="expected -100 to 100 m"):
                ask(sino6, point)
    with pytest.raises(AacmmError, match="expected -100 to 100 m"):
        map_workspace(sino6, (2, 2), extent=[0, 1e3, 0, 1])


def test_a_search_that_ends_early_says_so(sino6: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
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
    np.testing.assert_allclose(sino6.positions(part.q, "frame5"), [point] * len(part), atol=1e-9)
    few = reaching_postures(sino6, point, axis=[0, 0, -1], count=20, most_starts=100)
    assert (few.complete, few.search.ended) == (False, True)
    assert "limit of work" in str(few)
