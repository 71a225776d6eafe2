"""The arm with the encoder noise that Table 3 suggests, and what it is worth on a seat that had no part in finding it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.progress import watched
from aacmm_pin._support.shown import Shown
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.papers.spread import Evidence, Pattern, left_out
from aacmm_pin.papers.table3.causes import BOTH, DH, NOISE
from aacmm_pin.papers.table3.postures import SIXTH
from aacmm_pin.papers.table3.strict_pick import StrictPick

RESAMPLES = 4000


@dataclass(frozen=True, eq=False)
class HeldOutSeats(Shown):
    """Each seat predicted by models that know the other seats only.

    Attributes:
        seats: one row a seat: seat, measured_mm, and what four models predict: simulation_mm (median of DH errors within
            their half-widths, nothing learnt), recalibrated_mm (DH errors, the other seats known), extended_mm (DH
            errors and encoder noise, the other seats known by spreads and contrasts) with its 95 % interval
            extended_p025_mm, extended_p975_mm, by_spreads_mm (the same by spreads only), and noise_alone_mm (encoder noise
            without DH errors, the other seats known).
        off: logarithm of measured over predicted by each model (seats,).
        gain: of the extended model, by spreads only, and of noise alone: 1 - RMS/RMS(recalibrated) of those logarithms.
        interval: their 95 % intervals, by resampling the seats.
        better: number of seats that each predicts better than the recalibrated model.
    """

    seats: pd.DataFrame
    off: dict[str, Array]
    gain: dict[str, float]
    interval: dict[str, tuple[float, float]]
    better: dict[str, int]

    @property
    def rms_percent(self) -> dict[str, float]:
        """RMS of the logarithms of measured over predicted by each model, as a percentage."""
        return {name: float(100 * np.sqrt(np.square(off).mean())) for name, off in self.off.items()}


EXTENDED, BY_SPREADS, ALONE = "extended", "by_spreads", "noise_alone"


def held_out_seats(
    patterns: dict[str, Pattern],
    measured: Array,
    tau: float,
    rng: np.random.Generator,
    pick: StrictPick,
    progress: bool = False,
) -> HeldOutSeats:
    """Leave each seat out in turn.

    Args:
        patterns: DH errors, encoder noise, and both, by their names.
        measured: spreads of the seats that take part, the first of those of the patterns (k,) [m].
        tau: model discrepancy.
        rng: for the predictions and the resampling.
        pick: what the contrasts of the seats that are not left out say of DH errors beside noise.
        progress: show a bar in a notebook, or on stderr at a terminal.
    """
    seats = list(range(len(measured)))
    own = {"recalibrated": DH, EXTENDED: BOTH, BY_SPREADS: BOTH, ALONE: NOISE}
    prior = {EXTENDED: lambda known: by_contrast(patterns, pick, known)}
    with watched(own.items(), progress, f"{len(seats)} seats left out in turn", "model") as models:
        left = {
            name: left_out(patterns[cause].take(seats), measured, rng, tau, prior=prior.get(name)) for name, cause in models
        }
    simulation = np.exp(np.median(patterns[DH].take(seats).log_spread, axis=0)) / MM
    table = pd.DataFrame({"seat": left[EXTENDED]["seat"], "measured_mm": measured / MM, "simulation_mm": simulation})
    off = {"simulation": np.log(measured / MM / simulation)}
    for name, predicted in left.items():
        table[f"{name}_mm"] = predicted["predicted_mm"]
        off[name] = predicted["log_ratio"].to_numpy()
    for end in ("p025", "p975"):
        table[f"extended_{end}_mm"] = left[EXTENDED][f"predicted_{end}_mm"]
    drawn = rng.integers(0, len(seats), size=(RESAMPLES, len(seats)))
    gains, intervals, better = {}, {}, {}
    for name in (EXTENDED, BY_SPREADS, ALONE):
        low, high = np.quantile(_gain(off[name][drawn], off["recalibrated"][drawn]), [0.025, 0.975])
        gains[name], intervals[name] = float(_gain(off[name], off["recalibrated"])), (float(low), float(high))
        better[name] = int((np.abs(off[name]) < np.abs(off["recalibrated"])).sum())
    return HeldOutSeats(table, off, gains, intervals, better)


def by_contrast(patterns: dict[str, Pattern], pick: StrictPick, seats: Sequence[int]) -> Array:
    """Weight of each draw of DH errors and noise together by the contrasts of part and rest at ``seats``: (draws,)."""
    both, dh, five = patterns[BOTH].second, patterns[DH].second, list(range(SIXTH))
    of_dh = np.tile(dh[:, five].mean(axis=1), len(both) // len(dh))
    return pick.chance(1.0 - of_dh / both[:, five].mean(axis=1), [k for k in seats if k in five])


def _gain(after: Array, before: Array) -> Array:
    return np.asarray(1.0 - np.sqrt(np.square(after).mean(axis=-1) / np.square(before).mean(axis=-1)))


def noise_beside(found: Evidence, sizes: Array) -> Array:
    """Posterior 2.5 %, 50 % and 97.5 % of the encoder noise beside DH errors (3,) [rad].

    Args:
        found: the mixture in the light of the spreads.
        sizes: encoder noise of each of its draws (draws,) [rad].
    """
    tried, which = np.unique(sizes, return_inverse=True)
    share = np.bincount(which, weights=found.weights)
    below = np.cumsum(share) - share / 2
    return np.asarray(np.exp(np.interp([0.025, 0.5, 0.975], below, np.log(tried))))


def with_encoder_noise(model: ErrorModel, noise: float) -> ErrorModel:
    """The model of an arm whose file states ``noise`` [rad] for every encoder; save it with :meth:`ErrorModel.save`."""
    file = model.file()
    joints = [row if row.fixed else row.model_copy(update={"encoder_noise_rad": noise}) for row in file.joints]
    return ErrorModel.of(Arm.from_file(file.model_copy(update={"joints": joints})))
