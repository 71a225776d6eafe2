"""Uncertainty of lengths: against draws of the exact model in which both ends have one arm and
readings of their own.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin import (
    AacmmError,
    Arm,
    ErrorModel,
    circle_accuracy,
    configuration_circle,
    length_uncertainty,
)
from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy import usable_postures
from aacmm_pin.accuracy.parameter_draws import exact_positions, source_errors
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.arm.file import Covariance
from aacmm_pin.effects import EncoderEccentricity, LinkBending
from tests.again import again
from tests.arm_files import changed

DRAWS = 20_000
SAME = 0.03
"""Five standard deviations of a standard deviation from so many draws, and the second order."""
EFFECTS = (
    LinkBending(link=3, values=(5e-5,), u=(2e-5,)),
    EncoderEccentricity(joint=3, values=(1e-4, 5e-5), u=(6e-5, 4e-5)),
)


def together() -> ErrorModel:
    """An extended arm that knows parameters of its own and of its effects together."""
    names, u = ("d3", "theta_offset3", "encoder_eccentricity:3.cos"), (2e-5, 4e-5, 6e-5)
    covariance = Covariance(
        parameters=names, standard_uncertainty_si=u, correlation=((), (0.6,), (-0.5, -0.8))
    )
    return ErrorModel(changed("sino6", covariance=covariance), EFFECTS)


def drawn(
    model: Arm | ErrorModel, q: tuple[Array, Array], noise: float, rng: np.random.Generator
) -> float:
    """Standard deviation of the exact distance of the tips at two postures (1, nq)."""
    sources = ErrorSources.of(model, None, noise, q[0], None)
    first, second = (source_errors(sources, rng, DRAWS) for _ in q)
    shared = [i for i, p in enumerate(sources.parameters) if p.scope != "record"]
    second[:, shared] = first[:, shared]
    tips = [
        exact_positions(sources, end, None, errors)
        for end, errors in zip(q, (first, second), strict=True)
    ]
    return float(np.linalg.norm(tips[1] - tips[0], axis=1).std())


@pytest.mark.parametrize("kind", ["arm", again("together")])
def test_lengths_are_as_uncertain_as_draws_say(kind, sino6, rng):
    model = sino6 if kind == "arm" else together()
    qa, qb = rng.uniform(*sino6.limits.T, (2, 2, 6))
    for k, noise in enumerate((5e-5, 0.0) if kind == "arm" else (5e-5,)):
        ends = qa[[k]], qb[[k]]
        u = length_uncertainty(model, *ends, encoder_noise=noise).u[0, 0]
        assert u == pytest.approx(drawn(model, ends, noise, rng), rel=SAME)


def test_what_turns_both_ends_leaves_their_distance(sino6, rng):
    """Two touches that differ in joint 1 alone: only the noise of the readings is left of what acts
    above that joint.
    """
    q = rng.uniform(*sino6.limits.T, (1, 6))
    turned = q + np.array([0.5, 0, 0, 0, 0, 0])
    there, back = (
        length_uncertainty(sino6, *ends, encoder_noise=1e-5).u[0, 0]
        for ends in ((q, turned), (turned, q))
    )
    assert there == pytest.approx(back, rel=1e-12)
    first = next(i for i, p in enumerate(sino6.parameters) if p.name == "theta_offset1")
    s = sino6.sensitivity(np.concatenate([q, turned]))[:, :, first]
    e = np.diff(sino6.positions(np.concatenate([q, turned])), axis=0)[0]
    assert abs((s[1] - s[0]) @ e) < 1e-12 < abs(s[0] @ e)


def test_pairs_of_postures_at_two_points(sino6):
    a, b = (configuration_circle(sino6, np.array([0.4, y, 0.3]), count=24) for y in (0.0, 0.3))
    ends = map(usable_postures, (a, b))
    length = length_uncertainty(sino6, *ends, at=a.at, encoder_noise=1e-5)
    assert length.length == pytest.approx(0.3, rel=1e-12)
    assert length.u.shape == (int(a.within_limits.sum()), int(b.within_limits.sum()))
    for number in (length.u.argmin(), length.u.argmax()):
        i, j = length.pair(int(number))
        pair = length_uncertainty(
            sino6, length.q_a[[i]], length.q_b[[j]], at=a.at, encoder_noise=1e-5
        )
        assert pair.u[0, 0] == pytest.approx(length.u[i, j], rel=1e-7)
    assert length.budget()["share"].sum() == pytest.approx(1.0)
    assert length.u.max() < 2 * circle_accuracy(a, encoder_noise=1e-5).u.max()


def test_no_length_without_two_points(sino6):
    q = np.full((2, 6), 0.3)
    with pytest.raises(AacmmError, match="two different points"):
        length_uncertainty(sino6, q, q)
    with pytest.raises(AacmmError, match="2 × 0 pairs"):
        length_uncertainty(sino6, q, q[:0])
