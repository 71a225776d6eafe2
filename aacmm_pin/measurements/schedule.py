"""Schedule of a virtual workshop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.effects import Conditions, ErrorModel, Labels
from aacmm_pin.errors import AacmmError

MOST_IN_SESSION = 200
RECORD_INTERVAL = (20.0, 40.0)
"""[s]"""
PAUSE_LENGTH = (180.0, 900.0)
"""[s]"""
PAUSES = 1 / 40
"""Per record."""
BREAK = (3600.0, 3 * 3600.0)
"""Between sessions [s]; the arm stays on."""
DAY = 24 * 3600.0
OVERSHOOT = 0.2
"""Share of joints whose last motion is reversed."""


def sessions(records: int) -> Index:
    """Session of each record, from 0, of equal sizes: (records,)."""
    count = -(-records // MOST_IN_SESSION)
    return np.sort(np.arange(records) % count)


def workshop_conditions(
    model: ErrorModel,
    session: Index,
    q: Array,
    seat: Labels | None,
    temperature_range: float,
    rng: np.random.Generator,
) -> Conditions:
    """Conditions of records in order.

    Time counts from switching on. The temperature stays within ± ``temperature_range`` of the
    reference: offset (4/10), drift (3/10), sine of the day (2/10) and noise (1/10), all random. The
    approach is the sign of the motion since the record before (first: the mean posture), reversed
    for one joint in five. Probe directions are random, if ``model`` needs them. ``session`` is
    ascending (n,); q is (n, nq) [rad].

    Raises:
        AacmmError: a negative or infinite range.
    """
    if not (np.isfinite(temperature_range) and temperature_range >= 0):
        raise AacmmError(f"temperature_range is {temperature_range:g} K; expected 0 K or more")
    n = len(session)
    steps = rng.uniform(*RECORD_INTERVAL, size=n)
    steps += (rng.random(n) < PAUSES) * rng.uniform(*PAUSE_LENGTH, size=n)
    steps += (np.diff(session, prepend=session[:1]) > 0) * rng.uniform(*BREAK, size=n)
    time = np.cumsum(steps)
    offset, drift, phase = rng.uniform(-1.0, 1.0, size=3)
    warmth = 0.4 * offset + 0.3 * drift * time / time.max(initial=1.0)
    warmth += 0.2 * np.sin(2 * np.pi * time / DAY + np.pi * phase)
    warmth += rng.uniform(-0.1, 0.1, size=n)
    way = np.sign(np.diff(q, axis=0, prepend=q.mean(axis=0, keepdims=True)))
    came_back = rng.random(q.shape) < OVERSHOOT
    labels = None
    if session.any():
        labels = np.array([str(number + 1) for number in session], dtype=object)
    conditions = Conditions(
        n,
        time=time,
        temperature=model.arm.reference_temperature + temperature_range * warmth,
        approach=np.where(came_back, -way, way) + 0.0,
        seat=seat,
        session=labels,
    )
    needs = {need for effect in model.effects for need in effect.needs}
    if "probe_direction" in needs:
        # A stream of its own: all other numbers are the same without it.
        directions = probe_directions(n, rng.spawn(1)[0])
        conditions = replace(conditions, probe_direction=directions)
    return conditions.with_usual(needs, q.shape[1])


def probe_directions(n: int, rng: np.random.Generator) -> Array:
    """Random unit vectors (n, 3), as directions of probing."""
    vectors = rng.normal(size=(n, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
