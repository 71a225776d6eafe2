"""Couplings in arm files and in Python."""

from __future__ import annotations

import re

import numpy as np
import pytest

from aacmm_pin.arm import Arm, arm_text, dh_file, load_arm_file
from aacmm_pin.errors import AacmmError, ArmFileError
from tests.arm_files import RIGID, changed

SUM = "[[couplings]]\njoint = 3\nof = 2\nratio = -1.0\n"


def loaded(tmp_path, text: str) -> Arm:
    path = tmp_path / "arm.toml"
    path.write_text(arm_text(load_arm_file("sino6")) + "\n" + text, encoding="utf-8")
    return Arm.load(path)


def test_a_file_states_the_map_and_is_written_back(tmp_path):
    arm = loaded(tmp_path, SUM + "[[couplings]]\njoint = 5\nof = 5\nratio = 0.25\n")
    expected = np.eye(6)
    expected[2, 1], expected[4, 4] = -1.0, 0.25
    np.testing.assert_array_equal(arm.coupling_matrix, expected)
    path = tmp_path / "again.toml"
    path.write_text(arm_text(arm.file), encoding="utf-8")
    assert Arm.load(path).couplings == arm.couplings


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (SUM.replace("joint = 3", "joint = 9"), "couplings[1].joint is 9; expected a row with a"),
        (SUM + SUM, "couplings[2]: joint = 3, of = 2"),
        (SUM.replace("-1.0", "inf"), "couplings[1].ratio: inf; expected"),
        (SUM.replace("-1.0", "1e6"), "couplings[1].ratio is 1e+06; expected"),
        (SUM.replace("of = 2", "of = 3").replace("-1.0", "0"), "couplings are singular"),
        (SUM + "[[couplings]]\njoint = 2\nof = 3\nratio = -1.0\n", "couplings are singular"),
        (SUM.replace("of =", "from ="), "joint, of, ratio"),
    ],
)
def test_a_map_that_cannot_be_is_refused(tmp_path, text, words):
    with pytest.raises(ArmFileError, match=re.escape(words)):
        loaded(tmp_path, text)


def test_python_refuses_them_too(sino6):
    words = "SINO6: couplings[1].of is 9; expected a row with a joint"
    with pytest.raises(AacmmError, match=re.escape(words)):
        sino6.with_couplings((3, 9, 1.0))


def test_joints_are_counted_by_rows(sino6):
    arm = changed("sino6", {4: RIGID}).with_couplings((5, 3, 1.0))
    np.testing.assert_array_equal(arm.joint_angles(np.eye(5))[:, 3], [0, 0, 1, 1, 0])
    with pytest.raises(AacmmError, match="1, 2, 3, 5, 6"):
        arm.with_couplings((4, 3, 1.0))


def test_a_dh_table_of_a_urdf_has_the_same_map(rng):
    arm = Arm.from_urdf("ur5").with_couplings((3, 2, -1.0), (6, 6, 2.0))
    table = Arm.from_file(dh_file(arm))
    assert table.dh is not None
    assert not table.dh.moving.all()
    np.testing.assert_array_equal(table.coupling_matrix, arm.coupling_matrix)
