"""All effects of a calibration at once give what each gives by itself."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.calibration.jacobian import Columns
from aacmm_pin.effects import (
    BearingTilt,
    Conditions,
    EncoderEccentricity,
    ErrorModel,
    JointZeroOffset,
    LinkLength,
    LinkTwist,
    SeatError,
    State,
    StylusOffset,
    ThermalExpansion,
    sensitivity,
)
from tests.oracle import close

pytestmark = pytest.mark.fast


@pytest.mark.parametrize("n", [1, 8])
def test_columns_of_all_effects_are_those_of_each(n, sino6, rng):
    """Tips and derivatives; constant twists, those of a record, an exact arcsine, what bends, and a
    seat.

    In a single record thermal expansion too is a parameter with constant twists, at several places
    at once.
    """
    q = np.column_stack([rng.uniform(low, high, n) for low, high in sino6.limits])
    seat = np.array(["A", "", "B", "A"] * 2, dtype=object)[:n]
    known = Conditions(n, temperature=rng.uniform(15.0, 30.0, n), seat=seat)
    effects = [
        LinkLength(2), LinkTwist(3), JointZeroOffset(1), StylusOffset(),
        EncoderEccentricity(4), ThermalExpansion(), BearingTilt(2), SeatError("A")
    ]  # fmt: skip
    columns = Columns.of(State(sino6, q, known, sino6.chain.tip), effects)
    x = rng.normal(size=columns.vector.size) * columns.vector.typical
    model = ErrorModel(sino6, tuple(e.at(tuple(x[own])) for e, own in columns.vector))
    state = columns.at(x)
    close(state.position, model.predict(q, known, as_referenced=True), 1e-14)
    wanted = np.concatenate([sensitivity(e, state) for e in effects], axis=2)
    np.testing.assert_allclose(columns.jacobian(state), wanted, rtol=1e-12, atol=1e-14)
    given, estimated = model.effects[1::2], effects[::2]
    some = Columns.of(columns.state, estimated, given)
    at = np.concatenate([x[own] for own in columns.vector.slices[::2]])
    close(some.at(at).position, state.position, 1e-14)
    wanted = np.concatenate([sensitivity(e, state) for e in estimated], axis=2)
    np.testing.assert_allclose(some.jacobian(some.at(at)), wanted, rtol=1e-9, atol=1e-12)
    assert columns.bends(x)
    assert not columns.bends(np.where(np.arange(x.size) == columns.vector.slices[6].start, 0.0, x))
