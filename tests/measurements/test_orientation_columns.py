"""Orientations by rotation vector and by roll, pitch and yaw: those of the quaternions of which
Pinocchio makes these.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest

from aacmm_pin import Measurements
from aacmm_pin._support.units import DEG
from aacmm_pin.errors import MeasurementFileError
from tests.cli import shell
from tests.oracle import close

QUATERNION = ["qw", "qx", "qy", "qz"]
FORMS = {
    "vector": ["rx_rad", "ry_rad", "rz_rad"],
    "angles": ["roll_deg", "pitch_deg", "yaw_deg"],
}


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> pd.DataFrame:
    """Records with orientations, three without."""
    path = tmp_path_factory.mktemp("oriented") / "data.csv"
    words = "simulate sino6 --scheme free --records 40 --orientation-noise 50urad --seed 3"
    shell.done(f"{words} -o {path}")
    read = pd.read_csv(path)
    read.loc[[0, 7, 39], QUATERNION] = np.nan
    return read


def in_form(table: pd.DataFrame, form: str) -> pd.DataFrame:
    """The table with its orientations in another form, by Pinocchio."""
    rows = []
    for w, x, y, z in table[QUATERNION].to_numpy():
        rotation = pin.Quaternion(w, x, y, z).toRotationMatrix() if np.isfinite(w) else None
        if rotation is None:
            rows.append(np.full(3, np.nan))
        elif form == "vector":
            rows.append(pin.log3(rotation))
        else:
            rows.append(pin.rpy.matrixToRpy(rotation) / DEG)
    return table.drop(columns=QUATERNION).join(pd.DataFrame(rows, columns=FORMS[form]))


@pytest.mark.parametrize("form", FORMS)
def test_orientations_are_those_of_the_quaternions(table, form, tmp_path):
    stated, expected = (Measurements.from_frame(t, 6) for t in (in_form(table, form), table))
    assert stated.orientation is not None
    assert expected.orientation is not None
    sign = np.sign(np.sum(stated.orientation * expected.orientation, axis=1, keepdims=True))
    # Pinocchio's logarithm loses digits near half a turn.
    close(stated.orientation * sign, expected.orientation, 1e-11)
    assert np.isnan(stated.orientation[[0, 7, 39]]).all()
    assert list(stated.extra.columns) == list(expected.extra.columns)
    path = tmp_path / "again.csv"
    stated.save(path)
    again = Measurements.read(path, 6)
    close(again.orientation, stated.orientation, 1e-12)


def test_angles_of_each_order_are_turns_about_rotated_axes(table, rng):
    axes = dict(zip("xyz", np.eye(3), strict=True))
    orders = [order for order in product("xyz", repeat=3) if order[0] != order[1] != order[2]]
    assert len(orders) == 12
    for order in orders:
        angles = rng.uniform(-np.pi, np.pi, (5, 3))
        names = [f"euler_{''.join(order)}_{angle}_deg" for angle in "abc"]
        stated = table.drop(columns=QUATERNION).iloc[1:6].reset_index(drop=True)
        stated = stated.join(pd.DataFrame(angles / DEG, columns=names))
        found = Measurements.from_frame(stated, 6)
        assert found.extra.columns.empty
        for (w, x, y, z), each in zip(found.orientation, angles, strict=True):
            turns = [pin.exp3(a * axes[k]) for a, k in zip(each, order, strict=True)]
            close(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.linalg.multi_dot(turns), 1e-12)


def test_commands_take_them(table, tmp_path):
    """The numbers are the same, and corrected readings have their orientation."""
    paths = [tmp_path / f"{name}.csv" for name in ("quaternion", "angles")]
    for path, stated in zip(paths, (table, in_form(table, "angles")), strict=True):
        stated.to_csv(path, index=False)
    first, second = (shell.found(f"calibrate sino6 {path} --no-cross-validation") for path in paths)
    assert first["rms_mm"]["calibrated"] == pytest.approx(second["rms_mm"]["calibrated"], rel=1e-6)
    shell.done(f"correct sino6 {paths[1]} -o {tmp_path / 'corrected.csv'}")
    assert "corrected_qw" in pd.read_csv(tmp_path / "corrected.csv")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rx_rad": 180.0}, "column rx_rad: 180 rad"),
        ({"rx_rad": None}, "rx_rad: empty"),
        ({"rx_deg": 1.0}, "rx_deg"),
        ({"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}, "column qw … qz, rx_rad … rz_rad"),
        ({"x_mm": None, "y_mm": None, "z_mm": None}, "without a position"),
    ],
)
def test_what_cannot_be(table, changes, said):
    stated = in_form(table, "vector").iloc[1:7].assign(**changes)
    if "rx_deg" in changes:
        stated = stated.drop(columns="rx_rad")
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.from_frame(stated, 6)
