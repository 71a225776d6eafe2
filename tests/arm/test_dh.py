"""The DH table against changed tables and printed coordinates; tests of the arm hold it against
Pinocchio.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin._support.batches import ROWS_PER_BATCH
from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import screws
from aacmm_pin.arm.dh import DHTable, table
from aacmm_pin.arm.file import ArmFile
from aacmm_pin.errors import AacmmError, ShapeError


@pytest.fixture
def dh(arm_file: ArmFile) -> DHTable:
    return arm_file.dh


def random_q(dh: DHTable, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(-np.pi, np.pi, (n, dh.nq))


def test_errors_move_the_arm_as_a_changed_table_does(dh: DHTable, rng: np.random.Generator) -> None:
    q, errors = random_q(dh, rng, 5), rng.normal(0, 0.1, (5, dh.rows, 4))
    changed = [table(dh.values() + e, dh.convention, list(dh.moving)).chain for e in errors]
    each = np.concatenate([chain.positions(q[k : k + 1]) for k, chain in enumerate(changed)])
    same, of_parameters = changed[0].positions(q), errors.reshape(5, -1)
    np.testing.assert_allclose(dh.chain.positions(q, of_parameters), each, rtol=0, atol=1e-14)
    np.testing.assert_allclose(dh.chain.positions(q, of_parameters[:1]), same, rtol=0, atol=1e-14)


def test_links_between_joints_make_the_arm(dh: DHTable, rng: np.random.Generator) -> None:
    (q,), (first, *links) = random_q(dh, rng, 1), dh.links()
    for turn, link in zip(screws(q, 0.0, 2), links, strict=True):
        first = first @ turn @ link
    np.testing.assert_allclose(first[:3, 3], dh.chain.positions(q[None])[0], rtol=0, atol=1e-14)


def test_parts_of_a_batch_do_not_change_results(dh: DHTable, rng: np.random.Generator) -> None:
    n = 2 * ROWS_PER_BATCH + 3
    q, errors = random_q(dh, rng, n), rng.normal(0, 1e-3, (n, 4 * dh.rows))
    some = [
        0,
        ROWS_PER_BATCH - 1,
        ROWS_PER_BATCH,
        2 * ROWS_PER_BATCH - 1,
        2 * ROWS_PER_BATCH,
        n - 1,
    ]
    alone, together = (
        dh.chain.position_and_sensitivity(q[some]),
        dh.chain.position_and_sensitivity(q),
    )
    for one, many in zip(alone, together, strict=True):
        np.testing.assert_allclose(many[some], one, rtol=0, atol=1e-15)
    moved = dh.chain.positions(q[some], errors[some])
    np.testing.assert_allclose(dh.chain.positions(q, errors)[some], moved, rtol=0, atol=1e-15)
    position, sensitivity = dh.chain.position_and_sensitivity(np.empty((0, dh.nq)))
    assert (position.shape, sensitivity.shape) == ((0, 3), (0, 3, 4 * dh.rows))


# The simulated measurements of the 2010 paper on the zero offsets of a six-joint measuring arm:
# angles [deg], tip [mm].
PRINTED = np.array(
    [
        [-90, -90, 0, 90, 0, 90, 138.558, 575.782, -283.282],
        [120, 90, 120, -20, 70, 50, -652.092, 645.842, 202.687],
        [-90, 0, 0, 90, 0, 0, 142.570, 522.883, 503.830],
        [-90, 10, 10, 90, 10, 10, 61.557, 434.090, 594.691],
        [0, 90, 0, -90, 0, 90, 320.850, 157.437, -251.305],
        [-120, 140, 20, 60, 10, 150, -148.998, -518.998, -237.442],
        [50, -80, 50, 40, -60, 40, -463.903, -760.076, 176.659],
        [10, 80, 30, 150, 30, 140, 186.165, 160.292, 290.970],
        [40, 30, 60, 150, 90, -90, 179.320, 102.388, 101.179],
    ]
)


def test_zero6_returns_the_27_printed_coordinates(zero6: Arm) -> None:
    tip = zero6.positions(PRINTED[:, :6] * DEG)
    assert np.abs(tip / MM - PRINTED[:, 6:]).max() <= 0.0005  # half of the last printed digit


def test_what_is_refused() -> None:
    for rows, moving, said in (
        (np.zeros((2, 3)), None, r"rows has shape \(2, 3\), expected \(n, 4\)"),
        (np.full((2, 4), np.nan), None, r"rows\[0, 0\] is nan"),
        (np.zeros((2, 4)), [True], "moving has 1 entries, expected one for each of the 2 rows"),
    ):
        with pytest.raises(ShapeError, match=said):
            table(rows, "standard-dh", moving)
    with pytest.raises(AacmmError, match=r"'standard'.*standard-dh, modified-dh"):
        table(np.zeros((2, 4)), "standard")  # type: ignore[arg-type]


def test_table_keeps_its_own_numbers() -> None:
    rows = np.arange(8.0).reshape(2, 4)
    mine = table(rows)
    rows[:] = 0.0
    mine.values()[:] = 0.0
    np.testing.assert_array_equal(mine.values(), np.arange(8.0).reshape(2, 4))
