"""Maps of the workspace against the circle of every single cell, and what happens when a worker is
stopped.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy import workspace
from aacmm_pin.accuracy.comprehensive_accuracy import configuration_weights
from aacmm_pin.accuracy.volume import accuracy_volume
from aacmm_pin.accuracy.workspace import WorkspaceMap, map_caveats, map_workspace
from aacmm_pin.arm import Arm
from aacmm_pin.effects import (
    EncoderEccentricity,
    ErrorModel,
    LinkBending,
    SeatError,
    ThermalExpansion,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circle
from tests.again import again
from tests.arm_files import by_table, changed
from tests.notes import data_of
from tests.oracle import close

CELLS, SECTORS = (4, 6), 12


@pytest.fixture(scope="session")
def small(sino6) -> WorkspaceMap:
    return map_workspace(sino6, CELLS, SECTORS)


def cell_point(data: xr.Dataset, i: int, k: int) -> Array:
    return np.array([float(data["x_mm"][i]), 0.0, float(data["z_mm"][k])]) * 1e-3


@pytest.fixture(scope="session")
def circles(sino6, small) -> dict[tuple[int, int], ConfigurationCircle]:
    return {
        (i, k): configuration_circle(sino6, cell_point(small.data, i, k), count=480)
        for i in range(CELLS[0])
        for k in range(CELLS[1])
    }


# --- every cell is the circle of its centre


def test_cells_are_centres_of_the_default_extent(small):
    """The wrist reaches 1210.7 mm: with the margin 1220 in whole steps."""
    np.testing.assert_allclose(small.data["x_mm"], (np.arange(4) + 0.5) * 305, rtol=1e-12)
    np.testing.assert_allclose(
        small.data["z_mm"], -1220 + (np.arange(6) + 0.5) * 2440 / 6, rtol=1e-12
    )
    close(small.data["sector_deg"], np.arange(12) * 30, 1e-12)


@pytest.mark.parametrize(
    ("row", "change", "at"),
    [
        (1, {"d_mm": 1310.0}, "frame5"),
        again(1, {}, "frame5"),
        again(1, {"d_mm": -400.0}, "frame5"),
        (6, {}, "tip"),
        (6, {"d_mm": 400.0}, "tip"),
    ],
)
def test_no_place_that_is_reached_is_outside_the_default_box(row, change, at):
    """A tall base carries the shoulder up, and all that is reached with it; what is empty of the
    box of the wrist is its margin.
    """
    arm, wrist = changed("sino6", {row: change}), at == "frame5"
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (200_000, 6))
    q[:, 4:] *= not wrist
    x, y, z = arm.positions(q, at).T * 1e3
    along = {} if wrist else {"axis": [0.0, 0.0, -1.0]}
    extent, most = (
        map_workspace(arm, (1, 1), 1, **along).data.attrs["extent_mm"],
        25 if wrist else 1e9,
    )
    assert extent[0] == 0.0
    assert extent[1] - most < np.hypot(x, y).max() < extent[1]
    assert extent[2] < z.min() < extent[2] + most
    assert extent[3] - most < z.max() < extent[3]


def test_a_first_axis_beside_that_of_the_base_is_told(sino6):
    aside = changed("sino6", {1: {"a_mm": 200.0}}, convention="modified-dh")
    assert data_of(map_caveats(aside), "first_axis_off_z")
    assert not data_of(map_caveats(sino6), "first_axis_off_z")


def at_centres(circle: ConfigurationCircle, sectors: int) -> tuple[Array, Array]:
    """Configurations inside the limits where dense samples pass a sector's centre, and the numbers
    of the sectors.
    """
    found, numbers = [], []
    for component in np.unique(circle.component):
        mine = circle.component == component
        q, swivel, inside = circle.q[mine], circle.swivel[mine], circle.within_limits[mine]
        turn = (np.roll(swivel, -1) - swivel + np.pi) % (2 * np.pi) - np.pi
        step = (np.roll(q, -1, axis=0) - q + np.pi) % (2 * np.pi) - np.pi
        for sector in range(sectors):
            ahead = (sector * 2 * np.pi / sectors - swivel + np.pi) % (2 * np.pi) - np.pi
            passes = (ahead * turn >= 0) & (np.abs(ahead) < np.abs(turn)) & inside
            found.append(
                q[passes] + (ahead / np.where(turn == 0, 1, turn))[passes, None] * step[passes]
            )
            numbers.append(np.full(passes.sum(), sector))
    return np.concatenate(found), np.concatenate(numbers)


def at_circle(
    cell: xr.Dataset, circle: ConfigurationCircle, arm: Arm, within: float
) -> tuple[Array, Array, Array]:
    """Configurations at the centres of sectors, the numbers of these, and volumes [mm³]: the cell
    has their sectors and their extremes.
    """
    expected = circle.flexibility(SECTORS)
    assert tuple(bool(w) for w in cell["sector_works"].values) == expected.sectors
    assert float(cell["flexibility"]) == pytest.approx(expected.zeta)
    assert int(cell["working_sectors"]) == sum(expected.sectors)
    assert float(cell["arc_fraction"]) == pytest.approx(expected.arc_fraction, abs=2e-3)
    q, sector = at_centres(circle, SECTORS)
    accuracy = accuracy_volume(arm, q, at=circle.at)
    volume, u = 1e9 * accuracy.volume, 1e3 * accuracy.u
    found = [float(cell[name]) for name in ("best_mm3", "worst_mm3", *U)]
    ends = [volume.min(), volume.max(), u.min(), u.max()]
    assert found == pytest.approx(ends, rel=within)
    return q, sector, volume


U = ("smallest_u_mm", "largest_u_mm")


def test_cells_are_those_of_the_circle(sino6, small, circles):
    reached = 0
    for (i, k), circle in circles.items():
        cell = small.data.isel(x_mm=i, z_mm=k)
        assert bool(cell["reachable"]) == bool(len(circle))
        if not len(circle):
            assert not cell["sector_works"].any()
            for name in ("flexibility", "arc_fraction", "comprehensive_mm3", "best_mm3", *U):
                assert np.isnan(cell[name])
            continue
        reached += 1
        q, sector, volume = at_circle(cell, circle, sino6, 2e-3)
        pick = np.array(
            [np.flatnonzero(sector == s)[volume[sector == s].argmin()] for s in np.unique(sector)]
        )
        weights = configuration_weights(q[pick, 2], circle.point)
        assert float(cell["comprehensive_mm3"]) == pytest.approx(weights @ volume[pick], rel=1e-2)
        assert volume.min() * 0.99 < float(cell["comprehensive_mm3"]) < volume.max() * 1.01
    assert 10 < reached < 24
    assert small.unreachable == 24 - reached
    assert sum(small.working_sectors().values()) == reached


# --- maps of the tip


def test_a_map_of_the_tip_is_the_circle_of_every_cell(sino6):
    """With the stylus along an axis that is in no plane of symmetry."""
    axis = np.array([0.4, -0.3, -0.8])
    found = map_workspace(sino6, (2, 3), SECTORS, extent=[0.2, 1.2, -0.9, 1.1], axis=axis)
    assert found.data.attrs["working_point"] == "tip"
    close(found.data.attrs["stylus_axis"], axis / np.linalg.norm(axis), 1e-12)
    reached = 0
    for i, k in np.ndindex(2, 3):
        cell, point = found.data.isel(x_mm=i, z_mm=k), cell_point(found.data, i, k)
        circle = configuration_circle(sino6, point, axis=axis, count=480)
        assert bool(cell["reachable"]) == bool(len(circle))
        if len(circle):
            reached += 1
            at_circle(cell, circle, sino6, 5e-3)
    assert reached > 2


def test_a_map_of_the_tip_holds_off_the_plane(sino6):
    """Joint 1 turns all the way: where the half-plane is turned by 70° and the axis with it, u is
    that of the cell.
    """
    axis, turn = np.array([0.6, 0.2, -0.5]), rotation_about_z(np.radians(70.0))
    box = [0.5, 0.7, 0.1, 0.3]
    found = map_workspace(sino6, (1, 1), SECTORS, extent=box, axis=axis).data.isel(x_mm=0, z_mm=0)
    point = turn @ np.array([0.6, 0.0, 0.2])
    circle = configuration_circle(sino6, point, axis=turn @ axis, count=720)
    u = accuracy_volume(sino6, at_centres(circle, SECTORS)[0]).u
    assert float(found["smallest_u_mm"]) == pytest.approx(1e3 * u.min(), rel=5e-3)
    assert float(found["largest_u_mm"]) == pytest.approx(1e3 * u.max(), rel=5e-3)


def rotation_about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


# --- extended models


@pytest.fixture(scope="session")
def extended(sino6) -> ErrorModel:
    return ErrorModel(
        sino6,
        (
            LinkBending(link=3, values=(5e-5,), u=(2e-5,)),
            EncoderEccentricity(joint=3, values=(1e-4, 5e-5), u=(6e-5, 4e-5)),
            ThermalExpansion(values=(2.2e-5,), u=(4e-6,)),
            SeatError(seat="A", u=(1e-3,) * 3),
        ),
    )


BOX = [0.2, 0.9, -0.2, 0.6]


def test_a_map_of_an_extended_model(sino6, extended):
    alone, model, warm = (
        map_workspace(m, (2, 2), 6, extent=BOX, conditions=conditions)
        for m, conditions in (
            (sino6, None),
            (extended, None),
            (extended, Conditions(1, temperature=np.array([35.0]))),
        )
    )
    xr.testing.assert_equal(alone.data["flexibility"], model.data["flexibility"])
    for name in ("best_mm3", "worst_mm3", "comprehensive_mm3", "smallest_u_mm", "largest_u_mm"):
        assert (alone.data[name] < model.data[name]).all()
        assert (model.data[name] < warm.data[name]).all()
    q = np.radians(warm.data["smallest_u_theta_deg"].values.reshape(-1, 6))
    expected = accuracy_volume(
        extended, q, conditions=Conditions(1, temperature=np.array([35.0])), at="frame5"
    )
    np.testing.assert_allclose(
        warm.data["smallest_u_mm"].values.reshape(-1), 1e3 * expected.u, rtol=1e-9
    )


def test_a_map_names_what_it_leaves_out(sino6, extended, small, tmp_path):
    map_ = map_workspace(extended, (1, 2), 3, extent=BOX)
    assert map_.not_included == ("thermal_expansion",)
    map_.save(tmp_path / "map.nc")
    assert WorkspaceMap(xr.load_dataset(tmp_path / "map.nc"), 0.0).not_included == (
        "thermal_expansion",
    )
    assert small.not_included == ()


# --- files


def test_netcdf_returns_what_was_written(small, tmp_path):
    small.save(tmp_path / "map.nc")
    data = xr.load_dataset(tmp_path / "map.nc")
    again = WorkspaceMap(data, data.attrs["seconds"])
    xr.testing.assert_equal(again.data, small.data)
    assert (again.seconds, again.unreachable) == (small.seconds, small.unreachable)
    assert again.working_sectors() == small.working_sectors()
    assert again.data.attrs["schema"] == "aacmm-pin/map/1"
    assert again.sectors == SECTORS
    units = {"mm": "mm", "mm3": "mm3", "deg": "degree"}
    for name, variable in small.data.variables.items():
        assert again.data[name].dtype.kind == variable.dtype.kind
        assert name == "joint" or variable.attrs["units"] == units.get(
            str(name).rsplit("_", 1)[-1], "1"
        ), name
        assert name not in small.data.data_vars or variable.attrs["long_name"]


# --- what cannot be asked


def test_what_cannot_be_asked(sino6, extended, monkeypatch):
    monkeypatch.setattr(workspace, "_cells", lambda *job: pytest.fail("work began"))
    two = {"model": extended, "conditions": Conditions(2, temperature=np.array([20.0, 30.0]))}
    asked: list[tuple[dict[str, Any], type[Exception], str]] = [
        ({"extent": [0, 1, 1, -1]}, AacmmError, "Z0 < Z1"),
        ({"cells": (0, 5)}, AacmmError, "at least 1"),
        ({"axis": [0.0, 0.0, 0.0]}, AacmmError, "axis"),
        ({"method": "box", "extent": [2, 3, 0, 1]}, AacmmError, "zonotope"),
        (two, ShapeError, "conditions have 2 records"),
    ]
    for arguments, error, words in asked:
        with pytest.raises(error, match=words):
            map_workspace(**({"model": sino6, "cells": (2, 2)} | arguments))


def test_arms_that_cannot_be_mapped(zero6, robot_file):
    with pytest.raises(UnsupportedArmError, match="DH table"):
        map_workspace(
            Arm.from_urdf(robot_file("ur5_robot.urdf"), "ee_link"), (2, 2), progress=False
        )
    with pytest.raises(AacmmError, match="uncertainty"):
        map_workspace(zero6, (2, 2))
    with pytest.raises(AacmmError, match="stylus"):
        map_workspace(changed("sino6", stylus=None), (1, 1), axis=[0.0, 0.0, 1.0])


# --- processes


def test_an_elbow_that_stays_in_one_plane_has_no_sectors():
    """A robot with a spherical wrist: its swivel is 0 or 180° but for rounding, which is no sector
    passed.
    """
    rows = [
        (75, 310, -90, 0),
        (400, 0, 0, 0),
        (75, 0, -90, 0),
        (0, 400, 90, 0),
        (0, 0, -90, 0),
        (0, 80, 0, 0),
    ]
    known = {"a_mm": 0.02, "d_mm": 0.02, "alpha_rad": 5e-5, "theta_offset_rad": 5e-5}
    found = map_workspace(
        by_table("robot", rows, 170.0, uncertainty=known), (4, 4), 12, progress=False
    )
    reachable = found.data["reachable"].values.astype(bool)
    assert reachable.any()
    assert np.isnan(found.data["flexibility"].values[reachable]).all()
    assert data_of(found.caveats, "cells_without_sectors") == [{"cells": reachable.sum()}]
