"""Table 3 diagnosed: what DH errors alone get wrong, what could be behind it, the extended arm, and the gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.distributions import chi2_cdf
from aacmm_pin._support.shown import Shown, drawn
from aacmm_pin._support.units import ARCSEC, MM
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.papers.spread import Evidence, Pattern, TouchedSeats, evidence, probabilities
from aacmm_pin.papers.spread.evidence import DISCREPANCY
from aacmm_pin.papers.table3.causes import BOTH, DH, NOISE, OF_SEATS, patterns, with_stated_uncertainty
from aacmm_pin.papers.table3.contrast import Contrast, contrast
from aacmm_pin.papers.table3.extended import HeldOutSeats, by_contrast, held_out_seats, noise_beside, with_encoder_noise
from aacmm_pin.papers.table3.postures import MEASURED, SIXTH, Reading, touched_seats
from aacmm_pin.papers.table3.seat6 import local_noise_needed, seat6, stand_by_power
from aacmm_pin.papers.table3.sentences import sentences
from aacmm_pin.papers.table3.strict_pick import StrictPick, strict_pick

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCHEMA = "aacmm-pin/table3-diagnosis/1"
TAUS = (0.05, 0.15, 0.30)
"""Model discrepancies for which evidence is given."""
SETTLED = 0.95
"""A cause at least this probable among all is named without doubt."""
Verdict = Literal["explained", "ambiguous"]


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
        noise: encoder noise by seats 1 to 5, 2.5 %, 50 %, 97.5 % (3,) [rad], without
            DH errors.
        noise_by_spreads_alone: encoder noise with DH errors beside it, by the spreads of seats 1 to 5 (3,) [rad].
        noise_beside_dh: the same by their contrasts of part and rest too.
        fit_percent, fit_p_value: RMS by which encoder noise misses seats 1 to 5, and the chance of as close a fit when it is
            right, by the sampling error of a spread alone.
        evidences: one row a cause: log-evidence for every τ with six seats and with five (``six_tau_0.15`` …), and its
            probability among all, ``five_probability``, ``six_probability``, at
            :attr:`tau`, with the number of draws on which it rests, ``five_effective_draws``, ``six_effective_draws``.
        predicted: one row a cause: median spread of each seat, seat1_mm …, when seats 1 to 5 give the size.
        seat6: what could have made seat 6, see :func:`aacmm_pin.papers.table3.seat6.seat6`.
        stand: a stand that yields with height, as soft as seat 6 needs.
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
    def verdict(self) -> Verdict:
        """``explained`` if one cause stands out at seats 1 to 5, else ``ambiguous``."""
        return "explained" if self.evidences["five_probability"].max() >= SETTLED else "ambiguous"

    def log_bayes_factor(self, cause: str, other: str, seats: Literal["five", "six"], tau: float | None = None) -> float:
        """Logarithm of the Bayes factor of ``cause`` against ``other``; τ is one of those of :attr:`evidences`."""
        column = self.evidences.set_index("cause")[f"{seats}_tau_{self.tau if tau is None else tau:.2f}"]
        return float(column[cause] - column[other])

    @property
    def of_the_arm(self) -> pd.DataFrame:
        """Rows of :attr:`evidences` of causes that are the arm's."""
        return self.evidences[~self.evidences["cause"].isin(OF_SEATS)]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What was found, one sentence each."""
        return sentences(self)

    def summary(self) -> dict[str, Any]:
        """Schema ``aacmm-pin/table3-diagnosis/1``: everything but the draws."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "reading": self.reading,
            "tau": self.tau,
            "effective_numbers": self.effective_numbers,
            "encoder_noise_arcsec": dict(zip(("p025", "median", "p975"), map(float, self.noise / ARCSEC), strict=True)),
            "encoder_noise_beside_dh_arcsec": dict(
                zip(("p025", "median", "p975"), map(float, self.noise_beside_dh / ARCSEC), strict=True)
            ),
            "fit_percent": self.fit_percent,
            "fit_p_value": self.fit_p_value,
            "shown": self.shown.to_dict("records"),
            "evidences": self.evidences.to_dict("records"),
            "predicted": self.predicted.reset_index().to_dict("records"),
            "seat6": self.seat6.to_dict("records"),
            "stand": self.stand.to_dict("records"),
            "local_noise_of_seat6_mm": self.local_noise / MM,
            "contrast": {
                "seats": self.contrast.seats.to_dict("records"),
                "strict_pick": self.strict_pick.causes.to_dict("records"),
                "strict_pick_by_random_share": self.strict_pick.shares.to_dict("records"),
                "least_random_share": self.strict_pick.least_random_share,
                "hypotheses": self.contrast.summary.to_dict("records"),
            },
            "held_out": {"five": _gain(self.held_out_five), "six": _gain(self.held_out_six)},
        }

    def __str__(self) -> str:
        return f"{self.verdict}: " + " ".join(self.sentences)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Measured spreads over what each cause predicts when seats 1 to 5 have given it its size.

        Args:
            ax: axes; without them a new pyplot figure is made.
        """
        return drawn("plot_spreads", self, ax)


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
    all_patterns = patterns(seats, rng, draws, progress)
    evidences, five = _evidences(all_patterns, tau)
    predicted = {cause: _predicted(all_patterns[cause], known, rng) for cause, known in five.items()}
    noise = five[NOISE].size(rng) * ARCSEC
    pick = strict_pick(seats, rng)
    sizes = with_stated_uncertainty(all_patterns[DH], all_patterns[NOISE])[1]
    weights = by_contrast(all_patterns, pick, range(SIXTH))
    both = evidence(all_patterns[BOTH].take(list(range(SIXTH))), MEASURED[:SIXTH], tau, weights)
    beside = noise_beside(both, sizes)
    shown, effective = _shown(all_patterns, float(noise[1]))
    fit, p_value = _closeness(all_patterns[NOISE])
    by_noise = shown["noise_mm"].to_numpy() * MM
    return Table3Diagnosis(
        seats=seats,
        reading=reading,
        tau=tau,
        patterns=all_patterns,
        shown=shown,
        effective_numbers=effective,
        noise=noise,
        noise_by_spreads_alone=noise_beside(five[BOTH], sizes),
        noise_beside_dh=beside,
        fit_percent=fit,
        fit_p_value=p_value,
        evidences=evidences,
        predicted=pd.DataFrame(predicted, index=[f"seat{k}_mm" for k in range(1, len(MEASURED) + 1)]).T.rename_axis("cause"),
        seat6=seat6(all_patterns, tau, rng),
        stand=stand_by_power(by_noise),
        local_noise=local_noise_needed(by_noise),
        contrast=contrast(seats, rng),
        strict_pick=pick,
        model=with_encoder_noise(seats.model, float(beside[1])),
        held_out_five=held_out_seats(all_patterns, MEASURED[:SIXTH], tau, rng, pick, progress),
        held_out_six=held_out_seats(all_patterns, MEASURED, tau, rng, pick, progress),
    )


def _evidences(found: dict[str, Pattern], tau: float) -> tuple[pd.DataFrame, dict[str, Evidence]]:
    """The table of log-evidences, and the evidence of each cause from five seats at ``tau``."""
    five = list(range(SIXTH))
    table = pd.DataFrame({"cause": list(found)})
    at_tau: dict[str, dict[str, Evidence]] = {}
    for name, seats in (("six", [*five, SIXTH]), ("five", five)):
        for each in TAUS:
            of_cause = {cause: evidence(pattern.take(seats), MEASURED[seats], each) for cause, pattern in found.items()}
            table[f"{name}_tau_{each:.2f}"] = [one.log_evidence for one in of_cause.values()]
            if each == tau:
                at_tau[name] = of_cause
        table[f"{name}_probability"] = probabilities(list(at_tau[name].values()))
        table[f"{name}_effective_draws"] = [one.effective_draws for one in at_tau[name].values()]
    return table, at_tau["five"]


def _predicted(pattern: Pattern, known: Evidence, rng: np.random.Generator) -> Array:
    """Median spread of every seat (6,) [mm]."""
    which, u = known.sampled(rng)
    return np.asarray(np.median(np.exp(u[:, None] + pattern.log_spread[which]), axis=0) / MM)


def _shown(found: dict[str, Pattern], noise: float) -> tuple[pd.DataFrame, float]:
    log = found[DH].log_spread
    low, middle, high = np.exp(np.quantile(log, [0.05, 0.5, 0.95], axis=0)) / MM
    table = pd.DataFrame(
        {
            "seat": np.arange(1, len(MEASURED) + 1),
            "measured_mm": MEASURED / MM,
            "dh_p05_mm": low,
            "dh_median_mm": middle,
            "dh_p95_mm": high,
            "measured_quantile": (log < np.log(MEASURED)).mean(axis=0),
            "noise_mm": noise * np.sqrt(found[NOISE].second[0]) / MM,
            "sampling_percent": 100 * found[NOISE].log_sd[0],
        }
    )
    values = np.linalg.eigvalsh(np.cov(log.T))
    return table, float(values.sum() ** 2 / np.square(values).sum())


def _closeness(noise: Pattern) -> tuple[float, float]:
    """RMS misfit of seats 1 to 5 at the best size [%], and the chance of one at most as large."""
    residual = np.log(MEASURED[:SIXTH]) - noise.log_spread[0, :SIXTH]
    sd = noise.log_sd[0, :SIXTH]
    off = residual - np.average(residual, weights=1.0 / sd**2)
    p_value = chi2_cdf(np.square(off / sd).sum(), SIXTH - 1)
    return float(100 * np.sqrt(np.square(off).mean())), float(p_value)


def _gain(held_out: HeldOutSeats) -> dict[str, Any]:
    return {
        "seats": held_out.seats.to_dict("records"),
        "rms_percent": held_out.rms_percent,
        "gain": held_out.gain,
        "gain_ci95": {name: list(interval) for name, interval in held_out.interval.items()},
        "better": held_out.better,
    }
