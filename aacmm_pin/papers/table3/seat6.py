"""What could have made seat 6 spread 2.5 times as much as seat 5, and what could not."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.papers.sino6 import printed_points
from aacmm_pin.papers.spread import Pattern, evidence, predictive
from aacmm_pin.papers.table3.causes import POWERS
from aacmm_pin.papers.table3.postures import MEASURED, SIXTH

LEAST = 0.025
"""A cause could have done it if it spreads seat 6 as much as measured at least this often."""


def seat6(patterns: dict[str, Pattern], tau: float, rng: np.random.Generator) -> pd.DataFrame:
    """Seat 6 by each cause, one row each, the likeliest first.

    Columns: cause; ratio_median of the spread at seat 6 over that at seat 5 and ratio_probability, how often it is at least
    that measured, both before any measurement, with the sampling error of a spread; predicted_mm, predicted_p975_mm
    of seat 6 when seats 1 to 5 are known and as_large_probability, how often it is at least that measured, with the
    model discrepancy; possible, whether that is often enough.
    """
    measured_ratio = MEASURED[SIXTH] / MEASURED[SIXTH - 1]
    rows = []
    for name, pattern in patterns.items():
        sampled = np.tile(pattern.log_spread, (max(1, 4000 // len(pattern.second)), 1))
        sd = np.tile(pattern.log_sd, (len(sampled) // len(pattern.second), 1))
        ratio = np.exp(np.diff((sampled + sd * rng.normal(size=sd.shape))[:, SIXTH - 1 :], axis=1)[:, 0])
        five = evidence(pattern.take(list(range(SIXTH))), MEASURED[:SIXTH], tau)
        drawn = predictive(five, pattern.take([SIXTH]), tau, rng)[:, 0]
        rows.append(
            {
                "cause": name,
                "ratio_median": float(np.median(ratio)),
                "ratio_probability": float((ratio >= measured_ratio).mean()),
                "predicted_mm": float(np.median(drawn)) / MM,
                "predicted_p975_mm": float(np.quantile(drawn, 0.975)) / MM,
                "as_large_probability": float((drawn >= MEASURED[SIXTH]).mean()),
            }
        )
    table = pd.DataFrame(rows).sort_values("as_large_probability", ascending=False, ignore_index=True, kind="stable")
    return table.assign(possible=table["as_large_probability"] >= LEAST)


def stand_by_power(by_noise: Array) -> pd.DataFrame:
    """A stand that yields with the height above the lowest seat, as soft as seat 6 needs: what seats 2 and 5 would show.

    Columns: power of the height; seat2_mm, seat5_mm, the spreads that follow; measured beside them.

    Args:
        by_noise: spreads of the seats by what is there without the stand (6,) [m].
    """
    height = printed_points()[:, 2] - printed_points()[:, 2].min()
    needed = MEASURED[SIXTH] ** 2 - by_noise[SIXTH] ** 2
    rows = []
    for power in POWERS:
        spreads = np.sqrt(by_noise**2 + needed * (height / height[SIXTH]) ** (2 * power)) / MM
        rows.append((power, spreads[1], MEASURED[1] / MM, spreads[4], MEASURED[4] / MM))
    return pd.DataFrame(rows, columns=["power", "seat2_mm", "seat2_measured_mm", "seat5_mm", "seat5_measured_mm"])


def local_noise_needed(by_noise: Array) -> float:
    """Standard deviation of each coordinate that something at seat 6 alone must add [m]."""
    return float(np.sqrt((MEASURED[SIXTH] ** 2 - by_noise[SIXTH] ** 2) / 3.0))
