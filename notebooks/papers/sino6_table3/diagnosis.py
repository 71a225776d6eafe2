"""Table 3 diagnosed: what DH errors alone get wrong, what could be behind it, the extended arm, and
the gain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from scipy.special import softmax

from aacmm_pin._support.checks import Array
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
"""Model discrepancies for which evidence is given."""
SETTLED = 0.95
"""A cause at least this probable among all is named without doubt."""
POSSIBLE = 0.025
"""A cause could have made seat 6 if it spreads it as much as measured at least this often."""
RESAMPLES = 4000
SIX = range(len(MEASURED))
LEARNT = {"recalibrated": DH, "extended": BOTH, "noise_alone": NOISE}
"""Models that know the seats that are not left out."""


@dataclass(frozen=True, eq=False)
class HeldOutSeats:
    """Each of seats 1 to 5 predicted by models that know the other four only.

    Attributes:
        seats: one row a seat: seat, measured_mm, and what four models predict: nominal_mm
            (median of DH errors within their half-widths, nothing learnt), recalibrated_mm (DH
            errors, the other seats known), extended_mm (DH errors and encoder noise, the other
            seats known by spreads and contrasts) and noise_alone_mm (encoder noise without DH
            errors, the other seats known); the last three with 95 % intervals, extended_p025_mm,
            extended_p975_mm, ….
        rms_percent: RMS of the logarithm of measured over predicted by each model.
        gain: of the extended model, and of noise alone: 1 - RMS/RMS(recalibrated) of those
            logarithms.
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
        seats: seats and postures.
        patterns: every cause that was weighed.
        noise: encoder noise by seats 1 to 5, 2.5 %, 50 %, 97.5 % (3,) [rad], without DH errors.
        noise_beside_dh: the same with DH errors beside it, by the contrasts of part and rest too.
        evidences: one row a cause: log-evidence for every model discrepancy τ with six seats and
            with five (``six_tau_0.15`` …), and at τ = 0.15 its probability among all,
            ``five_probability``, ``six_probability``.
        predicted: one row a cause: median spread of each seat, seat1_mm …, when seats 1 to 5 give
            the size.
        seat6: what could have made seat 6, one row a cause, the likeliest first: ratio_probability,
            how often its spread over that at seat 5 is at least that measured, before any
            measurement, with the sampling error of a spread; predicted_mm, predicted_p975_mm of
            seat 6 when seats 1 to 5 are known and as_large_probability, how often it is at least
            that measured, with the model discrepancy; possible, whether that is often enough.
        marked: the marked part and the rest.
        held_out: gain on a seat left out, of seats 1 to 5.
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
        """``explained`` if one cause stands out at seats 1 to 5, else ``ambiguous``."""
        return "explained" if self.evidences["five_probability"].max() >= SETTLED else "ambiguous"

    @property
    def shown(self) -> pd.DataFrame:
        """One row a seat: seat, measured_mm, dh_p05_mm, dh_median_mm, dh_p95_mm, measured_quantile
        among DH draws, noise_mm by encoder noise of the size that seats 1 to 5 give it,
        sampling_percent of a spread of 50 records.
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
        """RMS by which encoder noise of the best size misses seats 1 to 5 [%], and the chance of as
        close a fit when it is right, by the sampling error of a spread alone.
        """
        noise = self.patterns[NOISE].take(FIVE)
        residual, sd = np.log(MEASURED[FIVE]) - noise.log_spread[0], noise.log_sd[0]
        off = residual - np.average(residual, weights=1.0 / sd**2)
        return float(100 * np.sqrt(np.square(off).mean())), float(
            chi2_cdf(np.square(off / sd).sum(), SIXTH - 1)
        )

    @property
    def local_noise(self) -> float:
        """Standard deviation of each coordinate that seat 6 needs of its own [m]."""
        return float(
            np.sqrt(
                (MEASURED[SIXTH] ** 2 - self.noise[1] ** 2 * self.patterns[NOISE].second[0, SIXTH])
                / 3.0
            )
        )

    @property
    def model(self) -> ErrorModel:
        """The extended model: the arm whose file states :attr:`noise_beside_dh` for every
        encoder.
        """
        noise = np.full(self.seats.model.arm.nq, self.noise_beside_dh[1])
        return replace(self.seats.model, arm=self.seats.model.arm.with_encoder_noise(noise))

    def log_bayes_factor(
        self, cause: str, other: str, seats: Literal["five", "six"], tau: float = DISCREPANCY
    ) -> float:
        """Logarithm of the Bayes factor of ``cause`` against ``other``; τ is one of those of
        :attr:`evidences`.
        """
        column = self.evidences.set_index("cause")[f"{seats}_tau_{tau:.2f}"]
        return float(column[cause] - column[other])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Measured spreads over what each cause predicts when seats 1 to 5 have given it
        its size.
        """
        from papers.plots import plot_spreads

        return plot_spreads(self, ax)


def diagnose_table3(
    rng: np.random.Generator, seats: TouchedSeats | None = None, *, draws: int = 6000
) -> Table3Diagnosis:
    """Diagnose the printed Table 3, by ``draws`` arms with DH errors; ``seats`` are by default
    :func:`touched_seats`.
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
        # Equally probable before.
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
    """Weight of each draw of DH errors and noise together by the contrasts of part and rest at
    ``seats``: (draws,).
    """
    of_dh = np.tile(found[DH].second[:, FIVE].mean(axis=1), len(NOISE_SIZES))
    share = 1.0 - of_dh / found[BOTH].second[:, FIVE].mean(axis=1)
    return marked.chance(share, seats)


def _noise_beside(both: Evidence) -> Array:
    """Posterior 2.5 %, 50 % and 97.5 % (3,) [rad] of the encoder noise beside DH errors, by their
    mixture.
    """
    share = both.weights.reshape(len(NOISE_SIZES), -1).sum(axis=1)
    return np.asarray(
        np.exp(np.interp(INTERVAL, np.cumsum(share) - share / 2, np.log(NOISE_SIZES)))
    )


def held_out_seats(
    found: dict[str, Pattern], marked: MarkedPart, rng: np.random.Generator
) -> HeldOutSeats:
    """Leave each of seats 1 to 5 out in turn. The extended model weighs its draws by the contrasts
    of the others.
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
