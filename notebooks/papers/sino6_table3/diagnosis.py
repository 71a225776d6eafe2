"""The diagnosis of Table 3: prediction from DH errors, causes, extended arm, and gain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from scipy.special import softmax

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.units import MM
from aacmm_pin.effects import ErrorModel
from papers.sino6_table3.evidence import DISCREPANCY, INTERVAL, Evidence, evidence
from papers.sino6_table3.patterns import BOTH, DH, NOISE, NOISE_SIZES, Pattern, patterns
from papers.sino6_table3.selection_bias import FIVE, MarkedPart, marked_part
from papers.sino6_table3.simulated_touches import MEASURED, SIXTH, TouchedSeats, touched_seats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TAUS = (0.05, 0.15, 0.30)
"""Model discrepancies τ for which the evidence is computed."""
SETTLED = 0.95
"""A cause with at least this probability counts as certain."""
POSSIBLE = 0.025
"""A cause can explain seat 6 if it reaches the measured spread with at least this probability."""
RESAMPLES = 4000
SIX = range(len(MEASURED))
LEARNT = {"recalibrated": DH, "extended": BOTH, "noise_alone": NOISE}
"""Cause of each model that uses the seats that are not held out."""


@dataclass(frozen=True, eq=False)
class HeldOutSeats:
    """Each of seats 1 to 5, predicted by models that use only the four others.

    Attributes:
        seats: one row for each seat: seat, measured_mm, and the predictions of four models:
            nominal_mm (median of DH errors within their half-widths), recalibrated_mm (DH errors
            that fit the other seats), extended_mm (DH errors and encoder noise that fit spreads
            and contrasts of the other seats) and noise_alone_mm (encoder noise that fits the other
            seats). The last three have 95 % intervals: extended_p025_mm, extended_p975_mm, ….
        rms_percent: RMS of the logarithm of measured / predicted, for each model [%].
        gain: 1 - RMS/RMS(recalibrated), for the extended model and for noise alone.
        interval: 95 % interval of each gain, by resampling the seats.
    """

    seats: pd.DataFrame
    rms_percent: dict[str, float]
    gain: dict[str, float]
    interval: dict[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Table3Diagnosis(Shown):
    """The diagnosis of six printed spreads.

    Attributes:
        seats: seats and postures.
        patterns: the pattern of each compared cause.
        noise: encoder noise without DH errors, from seats 1 to 5; quantiles 2.5 %, 50 %, 97.5 %
            (3,) [rad].
        noise_beside_dh: encoder noise with DH errors, also from the contrasts; quantiles as above.
        evidences: one row for each cause: logarithm of the evidence for each model discrepancy τ,
            with six seats and with five (``six_tau_0.15`` …); probabilities at τ = 0.15,
            ``five_probability`` and ``six_probability``.
        predicted: one row for each cause: median spread of each seat, seat1_mm …, with the size
            that fits seats 1 to 5.
        seat6: one row for each cause, the most probable first. ratio_probability: probability that
            the ratio of seat 6 to seat 5 reaches the measured ratio, without measurements and with
            the sampling error. predicted_mm, predicted_p975_mm: seat 6 from seats 1 to 5.
            as_large_probability: probability that it reaches the measured spread, with the model
            discrepancy. possible: whether this probability is large enough.
        marked: the marked part and the rest.
        held_out: gain on held-out seats.
    """

    seats: TouchedSeats
    patterns: dict[str, Pattern]
    noise: Array
    noise_beside_dh: Array
    evidences: pd.DataFrame
    predicted: pd.DataFrame
    seat6: pd.DataFrame
    marked: MarkedPart
    held_out: HeldOutSeats

    @property
    def verdict(self) -> Literal["explained", "ambiguous"]:
        """``explained`` if one cause is certain by seats 1 to 5, else ``ambiguous``."""
        return "explained" if self.evidences["five_probability"].max() >= SETTLED else "ambiguous"

    @property
    def shown(self) -> pd.DataFrame:
        """One row for each seat: seat, measured_mm, and predictions.

        dh_p05_mm, dh_median_mm, dh_p95_mm: DH errors. measured_quantile: quantile of the measured
        spread among DH errors. noise_mm: encoder noise that fits seats 1 to 5. sampling_percent:
        sampling error of a spread of 50 records.
        """
        spreads, noise = np.sqrt(self.patterns[DH].second), self.patterns[NOISE]
        low, median, high = np.quantile(spreads, [0.05, 0.5, 0.95], axis=0) / MM
        columns = {
            "seat": np.arange(1, len(MEASURED) + 1),
            "measured_mm": MEASURED / MM,
            "dh_p05_mm": low,
            "dh_median_mm": median,
            "dh_p95_mm": high,
            "measured_quantile": (spreads < MEASURED).mean(axis=0),
            "noise_mm": self.noise[1] * np.sqrt(noise.second[0]) / MM,
            "sampling_percent": 100 * noise.log_sd[0],
        }
        return pd.DataFrame(columns)

    @property
    def fit(self) -> tuple[float, float]:
        """RMS misfit of encoder noise at seats 1 to 5 [%], and the probability of a closer fit.

        The probability uses only the sampling error of a spread.
        """
        noise = self.patterns[NOISE].take(FIVE)
        residual, sd = np.log(MEASURED[FIVE]) - noise.log_spread[0], noise.log_sd[0]
        off = residual - np.average(residual, weights=1.0 / sd**2)
        return float(100 * np.sqrt(np.square(off).mean())), float(
            chi2_cdf(np.square(off / sd).sum(), SIXTH - 1)
        )

    @property
    def local_noise(self) -> float:
        """Additional standard deviation of each coordinate at seat 6 [m]."""
        return float(
            np.sqrt(
                (MEASURED[SIXTH] ** 2 - self.noise[1] ** 2 * self.patterns[NOISE].second[0, SIXTH])
                / 3.0
            )
        )

    @property
    def model(self) -> ErrorModel:
        """The extended model: the arm with the encoder noise :attr:`noise_beside_dh`."""
        noise = np.full(self.seats.model.arm.nq, self.noise_beside_dh[1])
        return replace(self.seats.model, arm=self.seats.model.arm.with_encoder_noise(noise))

    def log_bayes_factor(
        self, cause: str, other: str, seats: Literal["five", "six"], tau: float = DISCREPANCY
    ) -> float:
        """Logarithm of the Bayes factor of ``cause`` against ``other``, for one τ of TAUS."""
        column = self.evidences.set_index("cause")[f"{seats}_tau_{tau:.2f}"]
        return float(column[cause] - column[other])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the measured spreads, and the predictions of causes that fit seats 1 to 5."""
        from papers.plots import plot_spreads

        return plot_spreads(self, ax)


def diagnose_table3(
    rng: np.random.Generator, seats: TouchedSeats | None = None, *, draws: int = 6000
) -> Table3Diagnosis:
    """Diagnose the printed Table 3 with ``draws`` arms with DH errors.

    The default of ``seats`` is :func:`touched_seats`.
    """
    seats = seats or touched_seats()
    found, marked = patterns(seats, rng, draws), marked_part(seats, rng)
    five = {cause: evidence(pattern.take(FIVE), MEASURED[FIVE]) for cause, pattern in found.items()}
    expected = {cause: known.predictive(found[cause], rng) for cause, known in five.items()}
    predicted = {cause: np.median(spreads, axis=0) / MM for cause, spreads in expected.items()}
    both = evidence(found[BOTH].take(FIVE), MEASURED[FIVE], prior=by_contrast(found, marked, FIVE))
    return Table3Diagnosis(
        seats=seats,
        patterns=found,
        noise=np.exp(np.quantile(five[NOISE].sampled(rng)[1], INTERVAL)),
        noise_beside_dh=_noise_beside(both),
        evidences=_evidences(found),
        predicted=pd.DataFrame(predicted, index=[f"seat{k + 1}_mm" for k in SIX]).T.rename_axis(
            "cause"
        ),
        seat6=_seat6(found, expected, rng),
        marked=marked,
        held_out=held_out_seats(found, marked, rng),
    )


def _evidences(found: dict[str, Pattern]) -> pd.DataFrame:
    table = pd.DataFrame({"cause": list(found)})
    for name, seats in (("six", SIX), ("five", FIVE)):
        for each in TAUS:
            known = [
                evidence(pattern.take(seats), MEASURED[seats], each) for pattern in found.values()
            ]
            table[f"{name}_tau_{each:.2f}"] = [one.log_evidence for one in known]
        # equal prior probabilities
        table[f"{name}_probability"] = softmax(table[f"{name}_tau_{DISCREPANCY:.2f}"])
    return table


def _seat6(
    found: dict[str, Pattern], expected: dict[str, Array], rng: np.random.Generator
) -> pd.DataFrame:
    rows = []
    for name, pattern in found.items():
        log, sd = (
            np.tile(each, (max(1, 4000 // len(each)), 1))
            for each in (pattern.log_spread, pattern.log_sd)
        )
        ratio = np.diff((log + sd * rng.normal(size=sd.shape))[:, SIXTH - 1 :], axis=1)
        drawn = expected[name][:, SIXTH]
        rows.append(
            {
                "cause": name,
                "ratio_probability": (
                    ratio >= np.log(MEASURED[SIXTH] / MEASURED[SIXTH - 1])
                ).mean(),
                "predicted_mm": np.median(drawn) / MM,
                "predicted_p975_mm": np.quantile(drawn, 0.975) / MM,
                "as_large_probability": (drawn >= MEASURED[SIXTH]).mean(),
            }
        )
    table = pd.DataFrame(rows).sort_values(
        "as_large_probability", ascending=False, ignore_index=True, kind="stable"
    )
    return table.assign(possible=table["as_large_probability"] >= POSSIBLE)


def by_contrast(found: dict[str, Pattern], marked: MarkedPart, seats: list[int]) -> Array:
    """Weight of each draw of DH errors with noise, from the contrasts at ``seats``: (draws,)."""
    of_dh = np.tile(found[DH].second[:, FIVE].mean(axis=1), len(NOISE_SIZES))
    share = 1.0 - of_dh / found[BOTH].second[:, FIVE].mean(axis=1)
    return marked.chance(share, seats)


def _noise_beside(both: Evidence) -> Array:
    """Posterior quantiles 2.5 %, 50 % and 97.5 % (3,) [rad] of the encoder noise with DH errors."""
    share = both.weights.reshape(len(NOISE_SIZES), -1).sum(axis=1)
    return np.asarray(
        np.exp(np.interp(INTERVAL, np.cumsum(share) - share / 2, np.log(NOISE_SIZES)))
    )


def held_out_seats(
    found: dict[str, Pattern], marked: MarkedPart, rng: np.random.Generator
) -> HeldOutSeats:
    """Hold out each of seats 1 to 5 in turn.

    The extended model weights its draws by the contrasts of the other seats.
    """
    measured = MEASURED[FIVE]
    table = pd.DataFrame({"seat": np.arange(1, SIXTH + 1), "measured_mm": measured / MM})
    table["nominal_mm"] = np.exp(np.median(found[DH].take(FIVE).log_spread, axis=0)) / MM
    for name, cause in LEARNT.items():
        predicted = []
        for seat in FIVE:
            others = [other for other in FIVE if other != seat]
            prior = by_contrast(found, marked, others) if name == "extended" else None
            known = evidence(found[cause].take(others), measured[others], prior=prior)
            predicted.append(
                np.quantile(known.predictive(found[cause].take([seat]), rng)[:, 0], INTERVAL)
            )
        table[[f"{name}_p025_mm", f"{name}_mm", f"{name}_p975_mm"]] = np.array(predicted) / MM
    off = {
        name: np.log(measured / MM / table[f"{name}_mm"].to_numpy())
        for name in ("nominal", *LEARNT)
    }
    resampled = rng.integers(0, SIXTH, size=(RESAMPLES, SIXTH))
    gain, interval = {}, {}
    for name in ("extended", "noise_alone"):
        gain[name] = float(1.0 - _rms(off[name]) / _rms(off["recalibrated"]))
        drawn = 1.0 - _rms(off[name][resampled]) / _rms(off["recalibrated"][resampled])
        interval[name] = (float(np.quantile(drawn, 0.025)), float(np.quantile(drawn, 0.975)))
    return HeldOutSeats(
        table, {name: float(100 * _rms(values)) for name, values in off.items()}, gain, interval
    )


def _rms(off: Array) -> Array:
    return np.asarray(np.sqrt(np.square(off).mean(axis=-1)))
