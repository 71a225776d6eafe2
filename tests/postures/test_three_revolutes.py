"""The closed form of three revolute joints finds every position of random chains."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin.postures.three_revolutes import candidates

pytestmark = pytest.mark.fast

CHAINS = 300


def placements(rotations: Array, shifts: Array) -> Array:
    whole = np.tile(np.eye(4), (len(shifts), 1, 1))
    whole[:, :3, :3] = rotations
    whole[:, :3, 3] = shifts
    return whole


def about_z(angles: Array) -> Array:
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0])
    return placements(turns.as_matrix(), np.zeros((len(angles), 3)))


def test_every_position_is_near_a_candidate(rng):
    b0, b1, b2 = (
        placements(Rotation.random(CHAINS, rng).as_matrix(), rng.uniform(-0.5, 0.5, (CHAINS, 3)))
        for _ in range(3)
    )
    c = rng.uniform(-0.5, 0.5, (CHAINS, 3))
    q = rng.uniform(-np.pi, np.pi, (CHAINS, 3))
    turned = b0 @ about_z(q[:, 0]) @ b1 @ about_z(q[:, 1]) @ b2 @ about_z(q[:, 2])
    p = np.einsum("nij,nj->ni", turned[:, :3, :3], c) + turned[:, :3, 3]
    found, who = candidates(b0, b1, b2, c, p)
    off = np.full(CHAINS, np.inf)
    np.minimum.at(off, who, np.abs(np.exp(1j * found) - np.exp(1j * q[who])).max(axis=1))
    assert off.max() < 1e-9
    assert len(who) < 4 * CHAINS  # two or four of each, and those that are nearly there
