"""When and how the records of a run were taken: clock, temperatures, directions of approach, and
what else was noted.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from blind.chains import Chain
from blind.kinematics import Array

INTERVAL_S = (20.0, 40.0)
SESSIONS = 3
PAUSE_S = (1800.0, 7200.0)
SWING_K = (2.5, 3.0)
READING_ERROR_K = 0.2


@dataclass(frozen=True, eq=False)
class Conditions:
    """n records: clock [s], temperature of the arm and its reading [°C], approach (n, R) of each
    row, index of the seat (-1: none), session, operator, relative humidity [%], payload at the tip
    [kg], number of the marker on the last body, number of the held posture.
    """

    time: Array
    temperature: Array
    temperature_reading: Array
    approach: Array
    seat: NDArray[np.int_]
    session: NDArray[np.int_]
    operator: NDArray[np.int_]
    humidity: Array
    payload: Array
    marker: NDArray[np.int_]
    posture: NDArray[np.int_]

    @staticmethod
    def still(n: int, rows: int) -> Conditions:
        """That leave a sound arm of R rows as it is."""
        zero, none = np.zeros(n), np.zeros(n, dtype=int)
        approach = np.ones((n, rows))
        return Conditions(
            zero,
            zero + 20.0,
            zero + 20.0,
            approach,
            none - 1,
            none,
            none,
            zero,
            zero,
            none,
            np.arange(n),
        )

    def take(self, rows: NDArray[np.int_]) -> Conditions:
        return Conditions(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


def run(
    rng: np.random.Generator,
    arm: Chain,
    seat: NDArray[np.int_],
    session: NDArray[np.int_],
    pace: float,
    reading_error: bool,
) -> Conditions:
    """Conditions of a run over the given seats and sessions (n,); ``pace`` stretches the clock."""
    n = len(seat)
    interval = rng.uniform(*INTERVAL_S, n) * pace
    interval[0] = rng.uniform(*INTERVAL_S)
    pause = np.diff(session, prepend=0) > 0
    interval[pause] += rng.uniform(*PAUSE_S, int(pause.sum()))
    time = np.cumsum(interval)
    swing = rng.uniform(-2.0, 2.0, session[-1] + 1)[session] + 1.5 * _wave(rng, time, 9000.0)
    swing *= rng.uniform(*SWING_K) / np.abs(swing).max()
    temperature = arm.reference_temperature + swing
    error = (
        np.sqrt(0.5) * READING_ERROR_K * (rng.standard_normal() + rng.standard_normal(n))
        if reading_error
        else 0.0
    )
    moved = np.where(arm.moving, rng.choice([-1.0, 1.0], (n, arm.rows)), 0.0)
    humidity = (
        48.0
        + 7.0 * _wave(rng, time, 13000.0)
        + 3.0 * _wave(rng, time, 2500.0)
        + rng.normal(0.0, 0.3, n)
    )
    operator = (np.arange(n) // max(5, n // 20) + rng.integers(2)) % 2
    nothing = Conditions.still(n, arm.rows)
    return replace(
        nothing,
        time=time,
        temperature=temperature,
        temperature_reading=temperature + error,
        approach=moved,
        seat=seat,
        session=session,
        operator=operator,
        humidity=humidity,
    )


def _wave(rng: np.random.Generator, time: Array, period: float) -> Array:
    """A smooth random function of time, of order one."""
    rates = 2.0 * np.pi / (period * rng.uniform(0.6, 1.8, 3))
    return np.cos(time[:, None] * rates + rng.uniform(0.0, 2.0 * np.pi, 3)) @ rng.uniform(
        0.3, 0.8, 3
    )
