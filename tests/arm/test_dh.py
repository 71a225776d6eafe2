"""The DH table: its links, parts of a batch, refusals; `test_arm` holds it against Pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin._support.batches import ROWS_PER_BATCH
from aacmm_pin._support.checks import Array
from aacmm_pin.arm import ArmFile
from aacmm_pin.arm.chain import screws
from aacmm_pin.arm.dh import DHTable, table
from aacmm_pin.errors import AacmmError, ShapeError
from tests.oracle import close

pytestmark = pytest.mark.fast


@pytest.fixture
def dh(arm_file: ArmFile) -> DHTable:
    return arm_file.dh


def random_q(dh: DHTable, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(-np.pi, np.pi, (n, dh.nq))


def test_links_between_joints_make_the_arm(dh, rng):
    (q,), (first, *links) = random_q(dh, rng, 1), dh.chain.links()
    slides = dh.chain.prismatic
    motions = screws(np.where(slides, 0.0, q), np.where(slides, q, 0.0), 2)
    for motion, link in zip(motions, links, strict=True):
        first = first @ motion @ link
    close(first[:3, 3], dh.chain.positions(q[None])[0], 1e-14)


def test_parts_of_a_batch_do_not_change_results(dh, rng):
    n = 2 * ROWS_PER_BATCH + 3
    q = random_q(dh, rng, n)
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
        close(many[some], one, 1e-15)


def test_unusable_table_is_refused():
    for rows, moving, said in (
        (np.zeros((2, 3)), None, r"rows has shape \(2, 3\); expected \(n, 4\)"),
        (np.full((2, 4), np.nan), None, r"rows\[0, 0\] is nan"),
        (np.zeros((2, 4)), [True], "moving has 1 entries; expected 2"),
    ):
        with pytest.raises(ShapeError, match=said):
            table(rows, "standard-dh", moving)
    with pytest.raises(AacmmError, match=r"'standard'.*standard-dh, modified-dh"):
        table(np.zeros((2, 4)), "standard")  # type: ignore[arg-type]
