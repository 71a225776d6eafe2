"""What every error does: it comes whole from a worker process, and quotes no file at length."""

from __future__ import annotations

import pickle

import pytest

from aacmm_pin.arm import Arm
from aacmm_pin.errors import AacmmError, ArmFileError, MeasurementFileError, UnknownNameError
from aacmm_pin.measurements import Measurements

pytestmark = pytest.mark.fast


@pytest.mark.parametrize(
    "error",
    [
        AacmmError("a"),
        ArmFileError("a.toml", "joints", "b"),
        MeasurementFileError("a.csv", 3, "c", "d"),
        UnknownNameError("a", "b", ["c"]),
    ],
)
def test_as_it_was_behind_a_process(error):
    found = pickle.loads(pickle.dumps(error))
    assert (type(found), str(found), vars(found)) == (type(error), str(error), vars(error))


def test_long_names_and_lines(tmp_path):
    table, arm = tmp_path / "a.csv", tmp_path / "a.toml"
    table.write_text(f"{'a' * 5000}\n1\n")
    with pytest.raises(MeasurementFileError, match="no angles") as told:
        Measurements.read(table)
    assert len(str(told.value)) < 1500
    arm.write_text(
        f'schema = "aacmm-pin/arm/1"\nname = "a"\n[urdf]\nfile = "{"a" * 400}.urdf"\nframe = "b"\n'
    )
    with pytest.raises(ArmFileError, match="no such file"):
        Arm.load(arm)
