"""How little a part can spread, however it was chosen: a bound that tells scattered records from systematic ones.

No choice of g records of a seat spreads less than the g nearest the mean. Records that a systematic cause moves along
a closed curve are nearly all as far from their mean, and even the nearest spread nearly as much as the rest; records
that scatter have near ones. So a printed part that spreads little says that records scatter, whatever the paper's way
to choose it; as long as the postures go round the circle. On an arc of it a systematic cause may have near records
too: by the half about θ3 = π DH errors alone reach what is printed in nine arms of ten. ``touched_seats(arc=…,
start=…)`` tries it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.effects.gravity import GravityEffect
from aacmm_pin.papers.sino6 import implied_counts, printed_table3
from aacmm_pin.papers.spread import TouchedSeats, part_and_rest
from aacmm_pin.papers.table3.causes import DH, NOISE, systematic
from aacmm_pin.papers.table3.postures import SIXTH

COUNTS = [round(count) for count in implied_counts()["marked_count"][:SIXTH]]
"""Records in the marked part of seats 1 to 5."""
_PRINTED = printed_table3()[:SIXTH]
MEASURED_LOGS = np.log((_PRINTED["high_accuracy_part_std_mm"] / _PRINTED["rest_std_mm"]).to_numpy(dtype=np.float64))
"""Logarithms of the printed ratios of seats 1 to 5."""
SHARES = np.linspace(0.0, 1.0, 11)
"""Shares of the variance that are random."""
LEAST = 0.05
"""A share is possible if the printed contrast is reached at least this often."""


@dataclass(frozen=True, eq=False)
class StrictPick(Shown):
    """Smallest possible ratios of part and rest at seats 1 to 5, and how often they reach those printed.

    Attributes:
        causes: one row a cause alone: cause; ratio_median, of the geometric mean over the seats; reached, the share of draws
            in which it is at most that printed.
        shares: the same for DH errors and encoder noise together by random_share, the share of noise in the variance.
        logs: logarithms of the ratios behind ``shares`` (shares, draws, 5).
    """

    causes: pd.DataFrame
    shares: pd.DataFrame
    logs: Array

    @property
    def least_random_share(self) -> float:
        """The random share from which on the printed contrast is reached in one of twenty draws."""
        reached = np.maximum.accumulate(self.shares["reached"].to_numpy())
        return float(np.interp(LEAST, reached, self.shares["random_share"].to_numpy()))

    def chance(self, share: Array, seats: Sequence[int] = tuple(range(SIXTH))) -> Array:
        """How often the contrast printed for some of the ``seats`` 1 to 5 (from 0) is reached, by random share (n,): (n,).

        The likelihood of a share when nothing is known of how the part was chosen but that it was not better than strictly.
        """
        keep = list(seats)
        reached = (self.logs[:, :, keep].mean(axis=2) <= MEASURED_LOGS[keep].mean()).mean(axis=1)
        return np.asarray(np.interp(share, SHARES, np.maximum.accumulate(reached)))


def strict_pick(seats: TouchedSeats, rng: np.random.Generator, draws: int = 1000) -> StrictPick:
    """Pick strictly among records simulated by each cause alone, and by DH errors and encoder noise together."""
    five = TouchedSeats(seats.model, seats.q[:SIXTH], seats.labels[:SIXTH], seats.at)
    by_dh, by_noise = _by_dh(five, rng, draws), _by_noise(five.levers(), rng, draws)
    moved = {DH: by_dh, NOISE: by_noise}
    for name, effects in systematic().items():
        flexible = np.array([isinstance(effect, GravityEffect) for effect in effects for _ in effect.terms])
        typical = np.array([term.typical for effect in effects for term in effect.terms])
        normal = rng.normal(size=(draws, len(typical)))
        values = np.where(flexible, np.abs(normal), normal) * typical
        moved[name] = np.asarray(np.einsum("nip,dp->dni", five.sensitivity(effects), values, optimize=True))
    rows = [(cause, *_reached(_log_ratios(five, positions))) for cause, positions in moved.items()]
    causes = pd.DataFrame(rows, columns=["cause", "ratio_median", "reached"])
    units = [np.sqrt(_mean_square(five, each))[:, None, None] for each in (by_dh, by_noise)]
    one, other = by_dh / units[0], by_noise / units[1]
    logs = np.stack([_log_ratios(five, np.sqrt(1 - share) * one + np.sqrt(share) * other) for share in SHARES])
    shares = pd.DataFrame([(w, *_reached(log)) for w, log in zip(SHARES, logs, strict=True)])
    return StrictPick(causes, shares.set_axis(["random_share", "ratio_median", "reached"], axis=1), logs)


def _by_dh(seats: TouchedSeats, rng: np.random.Generator, draws: int) -> Array:
    sensitivity = seats.model.sensitivity(seats.all_q, at=seats.at)
    return np.asarray(np.einsum("nip,dp->dni", sensitivity, parameter_errors(seats.model, rng, draws), optimize=True))


def _by_noise(levers: Array, rng: np.random.Generator, draws: int) -> Array:
    noise = rng.normal(size=(draws, len(levers), levers.shape[2]))
    return np.asarray(np.einsum("nij,dnj->dni", levers, noise, optimize=True))


def _mean_square(seats: TouchedSeats, moved: Array) -> Array:
    """Mean over the seats of the squared spread (draws,)."""
    parts = seats.by_seat(np.moveaxis(moved, 1, 0))
    return np.asarray(np.mean([part.var(axis=0).sum(axis=1) for part in parts], axis=0))


def _log_ratios(seats: TouchedSeats, positions: Array) -> Array:
    """Logarithms of the smallest possible ratios (draws, seats)."""
    logs = []
    for part, count in zip(seats.by_seat(np.moveaxis(positions, 1, 0)), COUNTS, strict=True):
        near, far = part_and_rest(np.moveaxis(part, 0, 1), count, "after")
        logs.append(np.log(near / far))
    return np.stack(logs, axis=1)


def _reached(logs: Array) -> tuple[float, float]:
    mean = logs.mean(axis=1)
    return float(np.exp(np.median(mean))), float((mean <= MEASURED_LOGS.mean()).mean())
