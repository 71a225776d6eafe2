"""Angles in one file, references in another."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.cli import shell
from tests.tables import PLACES


@pytest.fixture(scope="module")
def table(sino6):
    records = simulate_measurements(sino6, "free", 30, rng=np.random.default_rng(1))
    return records.to_frame().assign(record=[f"r{k}" for k in range(30)])


@pytest.fixture
def files(table, tmp_path):
    """Writes both files, the second by the rows of a table."""

    def write(references: pd.DataFrame):
        robot, tracker = tmp_path / "robot.csv", tmp_path / "tracker.csv"
        table.drop(columns=PLACES).to_csv(robot, index=False)
        references.to_csv(tracker, index=False, sep=";", decimal=",")
        return robot, tracker

    return write


def test_rows_are_joined_by_label_or_in_order(table, files):
    whole = Measurements.from_frame(table)
    shuffled = table[["record", *PLACES]].sample(frac=1.0, random_state=2)
    for references in (shuffled, table[PLACES]):
        robot, tracker = files(references)
        found = Measurements.read(robot, 6, tracker)
        np.testing.assert_allclose(found.reference, whole.reference, atol=1e-12)
        np.testing.assert_allclose(found.q, whole.q, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t[["record", *PLACES]].iloc[1:], "r0"),
        (lambda t: pd.concat([t, t.iloc[:1]])[["record", *PLACES]], "again"),
        (lambda t: t[PLACES].iloc[1:], "29 rows"),
        (lambda t: t[["record", *PLACES, "time_s"]], "time_s"),
    ],
)
def test_files_that_do_not_fit_are_named(table, files, change, said):
    robot, tracker = files(change(table))
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.read(robot, 6, tracker)


def test_the_option_of_commands(table, files):
    robot, tracker = files(table[["record", *PLACES]])
    assert shell.found(f"check sino6 {robot} --references {tracker}")["with_reference"] == 30
    status, _, err = shell.run(f"correct sino6 {robot} --references {tracker}")
    assert status == 2
    assert "--references" in err
