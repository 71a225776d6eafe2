"""Table 3 diagnosed: what DH errors alone get wrong, what could be behind it, the extended arm, and the gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.progress import watched
from aacmm_pin._support.shown import Shown, report
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.papers.sino6 import printed_points
from aacmm_pin.papers.sino6_table3.causes import BOTH, DH, NOISE, POWERS, SIZES, noise_sizes, patterns
from aacmm_pin.papers.sino6_table3.evidence import DISCREPANCY, Evidence, evidence, left_out, probabilities
from aacmm_pin.papers.sino6_table3.marked_records import Contrast, StrictPick, contrast, strict_pick
from aacmm_pin.papers.sino6_table3.patterns import Pattern
from aacmm_pin.papers.sino6_table3.seats import MEASURED, SIXTH, Reading, TouchedSeats, touched_seats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TAUS = (0.05, 0.15, 0.30)
"""Model discrepancies for which evidence is given."""
SETTLED = 0.95
"""A cause at least this probable among all is named without doubt."""
POSSIBLE = 0.025
"""A cause could have made seat 6 if it spreads it as much as measured at least this often."""
RESAMPLES = 4000
FIVE, SIX = range(SIXTH), range(SIXTH + 1)
RIVALS = {"extended": BOTH, "by_spreads": BOTH, "noise_alone": NOISE}
"""Models that are compared with DH errors alone on seats left out."""


@dataclass(frozen=True, eq=False)
class HeldOutSeats:
    """Each seat predicted by models that know the other seats only.

    Attributes:
        seats: one row a seat: seat, measured_mm, and what four models predict: simulation_mm (median of DH errors within
            their half-widths, nothing learnt), recalibrated_mm (DH errors, the other seats known), extended_mm (DH
            errors and encoder noise, the other seats known by spreads and contrasts) with its 95 % interval
            extended_p025_mm, extended_p975_mm, by_spreads_mm (the same by spreads only), and noise_alone_mm (encoder noise
            without DH errors, the other seats known).
        rms_percent: RMS of the logarithm of measured over predicted by each model.
        gain: of the extended model, by spreads only, and of noise alone: 1 - RMS/RMS(recalibrated) of those logarithms.
        interval: their 95 % intervals, by resampling the seats.
    """

    seats: pd.DataFrame
    rms_percent: dict[str, float]
    gain: dict[str, float]
    interval: dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Table3Diagnosis(Shown):
    """What six printed spreads tell.

    Attributes:
        seats: seats and postures; ``reading`` says which.
        reading: what is at the printed coordinates.
        tau: model discrepancy of the logarithm of a spread.
        patterns: every cause that was weighed.
        shown: one row a seat: seat, measured_mm, dh_p05_mm, dh_median_mm, dh_p95_mm, measured_quantile among DH draws,
            noise_mm by encoder noise of the size that seats 1 to 5 give it, sampling_percent of a spread of 50 records.
        effective_numbers: how many numbers the six spreads by DH errors are worth, ``(Σλ)²/Σλ²`` of the eigenvalues of the
            covariance of their logarithms.
        noise: encoder noise by seats 1 to 5, 2.5 %, 50 %, 97.5 % (3,) [rad], without DH errors.
        noise_by_spreads_alone: encoder noise with DH errors beside it, by the spreads of seats 1 to 5 (3,) [rad].
        noise_beside_dh: the same by their contrasts of part and rest too.
        fit_percent, fit_p_value: RMS by which encoder noise misses seats 1 to 5, and the chance of as close a fit when it is
            right, by the sampling error of a spread alone.
        evidences: one row a cause: log-evidence for every τ with six seats and with five (``six_tau_0.15`` …), and its
            probability among all, ``five_probability``, ``six_probability``, at :attr:`tau`.
        predicted: one row a cause: median spread of each seat, seat1_mm …, when seats 1 to 5 give the size.
        seat6: what could have made seat 6, see :func:`seat6`.
        stand: a stand that yields with the power of the height above the lowest seat, as soft as seat 6 needs: the spreads
            that follow at seats 2 and 5, beside those measured.
        local_noise: standard deviation of each coordinate that seat 6 needs of its own [m].
        contrast: the marked part and the rest.
        strict_pick: how little a part can spread, however it was chosen.
        model: the extended model: the arm with :attr:`noise_beside_dh` as encoder noise.
        held_out_five, held_out_six: gain on a seat left out, of five and of six.
    """

    seats: TouchedSeats
    reading: Reading
    tau: float
    patterns: dict[str, Pattern]
    shown: pd.DataFrame
    effective_numbers: float
    noise: Array
    noise_by_spreads_alone: Array
    noise_beside_dh: Array
    fit_percent: float
    fit_p_value: float
    evidences: pd.DataFrame
    predicted: pd.DataFrame
    seat6: pd.DataFrame
    stand: pd.DataFrame
    local_noise: float
    contrast: Contrast
    strict_pick: StrictPick
    model: ErrorModel
    held_out_five: HeldOutSeats
    held_out_six: HeldOutSeats

    @property
    def verdict(self) -> Literal["explained", "ambiguous"]:
        """``explained`` if one cause stands out at seats 1 to 5, else ``ambiguous``."""
        return "explained" if self.evidences["five_probability"].max() >= SETTLED else "ambiguous"

    def log_bayes_factor(self, cause: str, other: str, seats: Literal["five", "six"], tau: float | None = None) -> float:
        """Logarithm of the Bayes factor of ``cause`` against ``other``; τ is one of those of :attr:`evidences`."""
        column = self.evidences.set_index("cause")[f"{seats}_tau_{self.tau if tau is None else tau:.2f}"]
        return float(column[cause] - column[other])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Measured spreads over what each cause predicts when seats 1 to 5 have given it its size."""
        return cast("Axes", report().plots.plot_spreads(self, ax))


def diagnose_table3(
    rng: np.random.Generator,
    reading: Reading = "stylus down",
    *,
    draws: int = 6000,
    tau: float = DISCREPANCY,
    seats: TouchedSeats | None = None,
    progress: bool = True,
) -> Table3Diagnosis:
    """Diagnose the printed Table 3.

    Args:
        rng: for all that is drawn.
        reading: what is at the printed coordinates.
        draws: arms with DH errors.
        tau: model discrepancy; one of 0.05, 0.15, 0.3.
        seats: the postures of that reading, where they are known already.
        progress: show bars in a notebook, or on stderr at a terminal.

    Raises:
        UnknownNameError: no such reading.
        KeyError: another τ.
    """
    seats = seats or touched_seats(reading)
    found = patterns(seats, rng, draws, progress)
    evidences, five = _evidences(found, tau)
    predicted = {cause: _predicted(known, found[cause], rng) for cause, known in five.items()}
    noise = five[NOISE].size(rng)
    pick = strict_pick(seats, rng)
    both = evidence(found[BOTH].take(FIVE), MEASURED[:SIXTH], tau, by_contrast(found, pick, [*FIVE]))
    beside = noise_beside(both, noise_sizes(found[NOISE]))
    shown, effective = _shown(found, float(noise[1]))
    by_noise = shown["noise_mm"].to_numpy() * MM
    fit_percent, fit_p_value = _closeness(found[NOISE])
    return Table3Diagnosis(
        seats=seats,
        reading=reading,
        tau=tau,
        patterns=found,
        shown=shown,
        effective_numbers=effective,
        noise=noise,
        noise_by_spreads_alone=noise_beside(five[BOTH], noise_sizes(found[NOISE])),
        noise_beside_dh=beside,
        fit_percent=fit_percent,
        fit_p_value=fit_p_value,
        evidences=evidences,
        predicted=pd.DataFrame(predicted, index=[f"seat{k + 1}_mm" for k in SIX]).T.rename_axis("cause"),
        seat6=seat6(found, five, tau, rng),
        stand=_stand(by_noise),
        local_noise=local_noise_needed(by_noise),
        contrast=contrast(seats, rng),
        strict_pick=pick,
        model=with_encoder_noise(seats.model, float(beside[1])),
        held_out_five=held_out_seats(found, MEASURED[:SIXTH], tau, rng, pick, progress),
        held_out_six=held_out_seats(found, MEASURED, tau, rng, pick, progress),
    )


def _evidences(found: dict[str, Pattern], tau: float) -> tuple[pd.DataFrame, dict[str, Evidence]]:
    """The table of log-evidences, and the evidence of each cause from five seats at ``tau``."""
    table, at_tau = pd.DataFrame({"cause": list(found)}), {}
    for name, seats in (("six", SIX), ("five", FIVE)):
        for each in TAUS:
            of_cause = {cause: evidence(pattern.take(seats), MEASURED[seats], each) for cause, pattern in found.items()}
            table[f"{name}_tau_{each:.2f}"] = [one.log_evidence for one in of_cause.values()]
            if each == tau:
                at_tau[name] = of_cause
        table[f"{name}_probability"] = probabilities(list(at_tau[name].values()))
    return table, at_tau["five"]


def _predicted(known: Evidence, pattern: Pattern, rng: np.random.Generator) -> Array:
    which, u = known.sampled(rng)
    return np.asarray(np.median(np.exp(u[:, None] + pattern.log_spread[which]), axis=0) / MM)


def _shown(found: dict[str, Pattern], noise: float) -> tuple[pd.DataFrame, float]:
    log = found[DH].log_spread
    low, middle, high = np.exp(np.quantile(log, [0.05, 0.5, 0.95], axis=0)) / MM
    table = pd.DataFrame({"seat": np.arange(1, len(MEASURED) + 1), "measured_mm": MEASURED / MM})
    table = table.assign(dh_p05_mm=low, dh_median_mm=middle, dh_p95_mm=high)
    table["measured_quantile"] = (log < np.log(MEASURED)).mean(axis=0)
    table["noise_mm"] = noise * np.sqrt(found[NOISE].second[0]) / MM
    table["sampling_percent"] = 100 * found[NOISE].log_sd[0]
    values = np.linalg.eigvalsh(np.cov(log.T))
    return table, float(values.sum() ** 2 / np.square(values).sum())


def _closeness(noise: Pattern) -> tuple[float, float]:
    """RMS misfit of seats 1 to 5 at the best size [%], and the chance of one at most as large."""
    residual, sd = np.log(MEASURED[:SIXTH]) - noise.log_spread[0, :SIXTH], noise.log_sd[0, :SIXTH]
    off = residual - np.average(residual, weights=1.0 / sd**2)
    return float(100 * np.sqrt(np.square(off).mean())), float(chi2_cdf(np.square(off / sd).sum(), SIXTH - 1))


def seat6(found: dict[str, Pattern], five: dict[str, Evidence], tau: float, rng: np.random.Generator) -> pd.DataFrame:
    """Seat 6 by each cause, one row each, the likeliest first.

    Columns: cause; ratio_median of the spread at seat 6 over that at seat 5 and ratio_probability, how often it is at least
    that measured, both before any measurement, with the sampling error of a spread; predicted_mm, predicted_p975_mm
    of seat 6 when seats 1 to 5 are known and as_large_probability, how often it is at least that measured, with the
    model discrepancy; possible, whether that is often enough.
    """
    rows = []
    for name, pattern in found.items():
        log, sd = (np.tile(each, (max(1, 4000 // len(each)), 1)) for each in (pattern.log_spread, pattern.log_sd))
        ratio = np.exp(np.diff((log + sd * rng.normal(size=sd.shape))[:, SIXTH - 1 :], axis=1)[:, 0])
        drawn = five[name].predictive(pattern.take([SIXTH]), tau, rng)[:, 0]
        rows.append(
            {
                "cause": name,
                "ratio_median": float(np.median(ratio)),
                "ratio_probability": float((ratio >= MEASURED[SIXTH] / MEASURED[SIXTH - 1]).mean()),
                "predicted_mm": float(np.median(drawn)) / MM,
                "predicted_p975_mm": float(np.quantile(drawn, 0.975)) / MM,
                "as_large_probability": float((drawn >= MEASURED[SIXTH]).mean()),
            }
        )
    table = pd.DataFrame(rows).sort_values("as_large_probability", ascending=False, ignore_index=True, kind="stable")
    return table.assign(possible=table["as_large_probability"] >= POSSIBLE)


def _stand(by_noise: Array) -> pd.DataFrame:
    height = printed_points()[:, 2] - printed_points()[:, 2].min()
    needed = MEASURED[SIXTH] ** 2 - by_noise[SIXTH] ** 2
    rows = []
    for power in POWERS:
        spreads = np.sqrt(by_noise**2 + needed * (height / height[SIXTH]) ** (2 * power)) / MM
        rows.append((power, spreads[1], MEASURED[1] / MM, spreads[4], MEASURED[4] / MM))
    return pd.DataFrame(rows, columns=["power", "seat2_mm", "seat2_measured_mm", "seat5_mm", "seat5_measured_mm"])


def local_noise_needed(by_noise: Array) -> float:
    """Standard deviation of each coordinate that something at seat 6 alone must add to the spreads ``by_noise`` (6,) [m]."""
    return float(np.sqrt((MEASURED[SIXTH] ** 2 - by_noise[SIXTH] ** 2) / 3.0))


def by_contrast(found: dict[str, Pattern], pick: StrictPick, seats: list[int]) -> Array:
    """Weight of each draw of DH errors and noise together by the contrasts of part and rest at ``seats``: (draws,)."""
    of_dh = np.tile(found[DH].second[:, :SIXTH].mean(axis=1), SIZES)
    share = 1.0 - of_dh / found[BOTH].second[:, :SIXTH].mean(axis=1)
    return pick.chance(share, [k for k in seats if k in FIVE])


def noise_beside(both: Evidence, sizes: Array) -> Array:
    """Posterior 2.5 %, 50 % and 97.5 % (3,) [rad] of the encoder noise beside DH errors, of ``sizes``, in their mixture."""
    share = both.weights.reshape(len(sizes), -1).sum(axis=1)
    return np.asarray(np.exp(np.interp([0.025, 0.5, 0.975], np.cumsum(share) - share / 2, np.log(sizes))))


def with_encoder_noise(model: ErrorModel, noise: float) -> ErrorModel:
    """The model of an arm whose file states ``noise`` [rad] for every encoder; save it with :meth:`ErrorModel.save`."""
    file = model.file()
    joints = [row if row.fixed else row.model_copy(update={"encoder_noise_rad": noise}) for row in file.joints]
    return ErrorModel.of(Arm.from_file(file.model_copy(update={"joints": joints})))


def held_out_seats(
    found: dict[str, Pattern],
    measured: Array,
    tau: float,
    rng: np.random.Generator,
    pick: StrictPick,
    progress: bool = False,
) -> HeldOutSeats:
    """Leave each of the seats with the spreads ``measured`` (k,) [m] out in turn.

    The extended model weighs DH errors beside noise by what the contrasts of the other seats say, see ``pick``.
    """
    seats = range(len(measured))
    prior = {"extended": lambda known: by_contrast(found, pick, known)}
    with watched(
        {"recalibrated": DH, **RIVALS}.items(), progress, f"{len(seats)} seats left out in turn", "model"
    ) as models:
        left = {name: left_out(found[cause].take(seats), measured, rng, tau, prior.get(name)) for name, cause in models}
    simulation = np.exp(np.median(found[DH].take(seats).log_spread, axis=0)) / MM
    table = pd.DataFrame({"seat": np.arange(1, len(seats) + 1), "measured_mm": measured / MM, "simulation_mm": simulation})
    table = table.assign(**{f"{name}_mm": predicted["predicted_mm"] for name, predicted in left.items()})
    table = table.assign(**{f"extended_{end}_mm": left["extended"][f"{end}_mm"] for end in ("p025", "p975")})
    off = {name: np.log((table["measured_mm"] / table[f"{name}_mm"]).to_numpy()) for name in ("simulation", *left)}
    resampled = rng.integers(0, len(seats), size=(RESAMPLES, len(seats)))

    def gain(name: str, rows: Index) -> Array:
        after, before = (np.square(off[which][rows]).mean(axis=-1) for which in (name, "recalibrated"))
        return np.asarray(1.0 - np.sqrt(after / before))

    intervals = {name: np.quantile(gain(name, resampled), [0.025, 0.975]) for name in RIVALS}
    return HeldOutSeats(
        table,
        {name: float(100 * np.sqrt(np.square(values).mean())) for name, values in off.items()},
        {name: float(gain(name, np.arange(len(seats)))) for name in RIVALS},
        {name: (float(low), float(high)) for name, (low, high) in intervals.items()},
    )
