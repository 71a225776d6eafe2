"""The diagnosis of Table 3 in words; every number is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from aacmm_pin._support.units import ARCSEC, MM
from aacmm_pin.papers.table3.causes import DH, ECCENTRICITY, GRAVITY, NOISE, ODD

if TYPE_CHECKING:
    from aacmm_pin.papers.table3.result import Table3Diagnosis

NEAR = 10.0
"""Descriptions whose evidence is within this factor are not told apart."""


def sentences(found: Table3Diagnosis) -> tuple[str, ...]:
    """One for each duty, and one for what stays open."""
    return (
        show(found),
        name(found),
        of_seat6(found),
        of_contrast(found),
        of_strict_pick(found),
        extend(found),
        gain(found),
        limits(found),
    )


def show(found: Table3Diagnosis) -> str:
    """What DH errors alone predict, and how it fails."""
    chance = float(found.seat6.loc[found.seat6["cause"] == DH, "ratio_probability"].iloc[0])
    quantile = found.shown["measured_quantile"]
    return (
        f"DH errors within the half-widths of Table 1 would spread each seat as much as measured (above "
        f"{100 * quantile.min():.0f} % to {100 * quantile.max():.0f} % of the drawn arms), but the six spreads "
        "of one arm are "
        f"worth {found.effective_numbers:.2f} numbers: they rise and fall together, and "
        f"{often(chance)} does seat 6 spread as much more than seat 5 as it did."
    )


def name(found: Table3Diagnosis) -> str:
    """What describes seats 1 to 5."""
    low, middle, high = found.noise / ARCSEC
    rest = found.evidences.sort_values("five_probability", ascending=False)
    near = rest["five_probability"] > rest["five_probability"].max() / 3
    others = [str(cause) for cause in rest.loc[near, "cause"] if cause != NOISE]
    return (
        f"Equal noise of {middle:.1f}″ ({low:.1f}″ to {high:.1f}″) on every encoder gives seats 1 to 5 within "
        f"{found.fit_percent:.1f} %, closer than the sampling error of "
        f"{found.shown['sampling_percent'].min():.0f} % to {found.shown['sampling_percent'].max():.0f} % lets "
        "expect (chance "
        f"{100 * found.fit_p_value:.1g} %), so the closeness is luck in part; {len(others)} other descriptions "
        f"are at least a third as probable: {', '.join(others)}."
    )


def of_seat6(found: Table3Diagnosis) -> str:
    """What could have made seat 6."""
    table = found.seat6
    can = table[table["possible"]]["cause"].tolist()
    best = str(found.of_the_arm.sort_values("six_probability").iloc[-1]["cause"])
    factor, worse = (found.log_bayes_factor(ODD, best, "six", tau) for tau in (found.tau, 0.30))
    noise = table.set_index("cause").loc[NOISE]
    return (
        f"Seat 6 needs a cause of its own: encoder noise that fits the others predicts "
        f"{noise['predicted_mm']:.4f} mm (97.5 % "
        f"below {noise['predicted_p975_mm']:.4f} mm) against {found.shown['measured_mm'].iloc[-1]:.4f} mm; of the causes "
        f"weighed {'only ' + ' and '.join(can) if can else 'none'} could have made it, with "
        f"{found.local_noise / MM:.3f} mm in each coordinate added there. Against it the best cause of the arm, "
        f"{best}, has a Bayes factor of 1 : {ratio(factor)} if predictions are right to {100 * found.tau:.0f} "
        f"%, and of 1 : {ratio(worse)} if only to 30 %."
    )


def of_contrast(found: Table3Diagnosis) -> str:
    """What the marked part shows."""
    table = found.contrast.summary
    mean = table["mean_ratio"].to_dict()
    after = table.loc["after_noise"]
    seats = found.contrast.seats
    milder = [str(seat) for seat in seats.loc[seats["measured_ratio"] > seats["after_noise_p95"], "seat"]]
    above = f", those of {', '.join(milder)} above it, milder than a strict pick" if milder else ""
    before = table.loc[["before_dh", "before_noise"], "mean_as_small"].max()
    return (
        f"The marked part spreads {found.contrast.measured_mean_ratio:.2f} times as much as the rest (geometric mean). "
        f"Postures with the smallest predicted volume would give {mean['before_dh']:.2f} under DH errors "
        f"and {mean['before_noise']:.2f} under encoder noise, as little as printed "
        f"{often(float(before))}; the smallest deviations picked after measuring give {after['mean_ratio']:.2f}, and "
        f"{after['inside']} of the 6 printed ratios are in its 5–95 % band{above}. A contrast of this size is "
        f"what picking after measuring makes; it is no evidence that a predicted volume told the postures apart."
    )


def of_strict_pick(found: Table3Diagnosis) -> str:
    """What the contrast says however the part was chosen."""
    pick = found.strict_pick
    reached = pick.causes.set_index("cause")["reached"].to_dict()
    ratio_of = pick.causes.set_index("cause")["ratio_median"].to_dict()
    share = pick.least_random_share
    return (
        f"However the part was chosen, it cannot spread less than the records nearest the mean. If the postures went round "
        f"the full circle, DH errors alone would spread these {ratio_of[DH]:.2f} times as much as the rest, and "
        f"as little as printed {often(reached[DH])}; beside them at least {100 * share:.0f} % of the variance "
        "of seats 1 to 5 has to "
        f"scatter, {np.sqrt(share) * found.noise[1] / ARCSEC:.1f}″ if that is encoder noise. Eccentricity of all encoders "
        f"reaches the printed contrast {often(reached[ECCENTRICITY])}, gravity {often(reached[GRAVITY])}."
    )


def extend(found: Table3Diagnosis) -> str:
    """The extended model."""
    low, middle, high = found.noise_beside_dh
    below = found.noise_by_spreads_alone[2]
    return (
        f"The extended arm states encoder_noise_rad = {middle:.3g}, that is {middle / ARCSEC:.1f}″ ({low / ARCSEC:.1f}″ to "
        f"{high / ARCSEC:.1f}″) with DH errors within their half-widths beside it, by spreads and contrasts of "
        "seats 1 to 5; the spreads alone would only say below "
        f"{below / ARCSEC:.1f}″. What happened at seat 6 is not the arm's and is not in it."
    )


def gain(found: Table3Diagnosis) -> str:
    """What it is worth on a seat left out."""
    five, six = found.held_out_five, found.held_out_six
    size = five.rms_percent
    return (
        f"Predicted from the other four, a seat of the first five is off by {size['recalibrated']:.0f} % by DH "
        f"errors alone and by {size['extended']:.0f} % with encoder noise beside them: gain {five.gain['extended']:.2f} "
        f"({_between(five.interval['extended'])}); {five.gain['by_spreads']:.2f} "
        f"({_between(five.interval['by_spreads'])}) if the contrasts of the four are not used, and "
        f"{five.gain['noise_alone']:.2f} "
        f"({_between(five.interval['noise_alone'])}) by noise without DH errors. The intervals rest on five numbers, each "
        f"itself uncertain by {found.shown['sampling_percent'].mean():.0f} %. With seat 6 among them the gain is "
        f"{six.gain['extended']:.2f} ({_between(six.interval['extended'])}): neither model has it."
    )


def _between(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.2f} to {interval[1]:.2f}"


def limits(found: Table3Diagnosis) -> str:
    """How far six numbers discriminate."""
    near = {}
    for key in (f"five_tau_{found.tau:.2f}", f"six_tau_{found.tau:.2f}", "six_tau_0.30"):
        column = found.evidences[key]
        near[key] = int((column > column.max() - np.log(NEAR)).sum())
    five, six, doubtful = near.values()
    return (
        f"Of {len(found.evidences)} descriptions {five} are within a Bayes factor of {NEAR:.0f} of the best by "
        f"seats 1 to 5, {six} by all six, and {doubtful} by all six if predictions are right to 30 % only: six "
        f"aggregate numbers say that seat 6 is special, and hardly more."
    )


def of_records(table: pd.DataFrame) -> str:
    """What the records themselves would tell, by :func:`aacmm_pin.papers.table3.expected_of_records`."""
    values = table.to_numpy(copy=True)
    np.fill_diagonal(values, np.nan)
    true, taken = divmod(int(np.nanargmin(values)), values.shape[1])
    return (
        f"The records themselves, angles and touched seat, would settle it: {len(table)} causes of the sizes that Table 3 "
        f"gives them would be told apart by an expected logarithm of the Bayes factor of {values[true, taken]:.0f} in the "
        f"closest pair ({table.index[true]}, taken for {table.columns[taken]}) and of "
        f"{np.nanmedian(values):.0f} in the median pair. "
        "A column that says from which side each joint came would tell hysteresis from noise, and the time of each record a "
        "drift."
    )


def ratio(log: float) -> str:
    """A Bayes factor from its logarithm, with the one digit that its draws allow."""
    return f"{float(f'{np.exp(min(log, 20.0)):.1g}'):g}"


def often(probability: float) -> str:
    """How often, in words."""
    if probability == 0.0:
        return "in none of the draws"
    return f"in {100 * probability:.2g} % of the draws"
