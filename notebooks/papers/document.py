"""Documents that compare the two source papers with computed results.

The package computes every number when it makes the page. The sentences around them are fixed.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import ARCSEC, MM
from aacmm_pin.report.document import (
    Block,
    Document,
    Figure,
    Format,
    Heading,
    Paragraph,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.numbers import percent
from papers import plots, zero_offset
from papers.sino6.misprints import misprints
from papers.sino6.table2 import Table2
from papers.sino6_table3.diagnosis import Table3Diagnosis
from papers.sino6_table3.evidence import DISCREPANCY
from papers.sino6_table3.patterns import DH, ECCENTRICITY, GRAVITY, NOISE, ODD, OF_SEATS
from papers.sino6_table3.selection_bias import FIVE, MEASURED_LOGS, band, implied_counts

PAPER = (
    "Xu You et al., Chinese Journal of Scientific Instrument 40 (2019), "
    "doi:10.19650/j.cnki.cjsi.J1905059"
)
NEAR = 10.0
"""The spreads do not distinguish descriptions whose evidence is within this factor."""
SYMBOLS = (
    ("O, E, P", "shoulder; elbow; working point"),
    ("C, K", "end of the upper tube; intersection of the axes of joints 3 and 1"),
    ("l2, l3", "magnitudes of a2 and a3 in Table 1, the two offsets"),
    ("d3, d5", "magnitudes of d3 and d5 in Table 1, the two tubes"),
    ("Z", "height in the figures of the paper, opposite to z of the DH base"),
    ("len, den, ken", "distances O to C, O to P, C to P"),
    ("QD, gen", "distance O to E in the highest and in the lowest posture"),
    ("dk, qdk", "distances K to C and K to E"),
    ("the1, the2, the3", "angles at O; their sum is θ2 of the highest posture (θ2max)"),
    ("∠k, ∠q", "angles at E from O to C and from O to P"),
    ("thek", "rotation of θ2 from the highest posture to the lowest (θ2min)"),
    ("uck", "|θ2| + arctan(d3/l2)"),
    ("Uk", "distance of C from joint axis 1, with its sign"),
    ("Vk, Qk", "height of C; distance of P from joint axis 1"),
    ("Dq, Rq", "value that equation (13) uses for Uk; horizontal distance C to P"),
)
"""Symbols of the printed equations."""
MISPRINTS = {
    "corrected": "correct",
    "median_angle_error_deg": "angle error [°]",
    "median_length_error_mm": "length error [mm]",
    "affected_share": "wrong or missing",
    "no_answer_share": "no real solution",
    "false_share": "falsely accepted",
}
TABLE_2 = {
    "working_sectors": "working sectors",
    "paper_cells": "printed",
    "reproduced_cells": "reproduced",
    "exact_cells": "exact geometry",
}
SPREADS = {
    "seat": "seat",
    "measured_mm": "measured [mm]",
    "dh_p05_mm": "DH errors, 5 % [mm]",
    "dh_median_mm": "DH errors, median [mm]",
    "dh_p95_mm": "DH errors, 95 % [mm]",
    "measured_quantile": "arms below measured [1]",
    "noise_mm": "encoder noise [mm]",
}
EVIDENCE = {
    "cause": "description",
    "five_tau_0.15": "seats 1–5, τ = 15 %",
    "five_tau_0.30": "seats 1–5, τ = 30 %",
    "six_tau_0.15": "six seats, τ = 15 %",
    "six_tau_0.30": "six seats, τ = 30 %",
}
SEAT6 = {
    "cause": "description",
    "ratio_probability": "ratio to seat 5 reached [1]",
    "predicted_mm": "seat 6, median [mm]",
    "predicted_p975_mm": "seat 6, 97.5 % [mm]",
    "as_large_probability": "measured value reached [1]",
}
HELD_OUT = {
    "seat": "seat",
    "measured_mm": "measured [mm]",
    "nominal_mm": "DH errors, nominal arm [mm]",
    "recalibrated_mm": "DH errors, recalibrated [mm]",
    "extended_mm": "DH errors and noise [mm]",
    "noise_alone_mm": "noise alone [mm]",
}


def papers_document(table2: Table2, table3: Table3Diagnosis, seed: int) -> Document:
    """The page of both papers; ``seed`` determines all random numbers."""
    return Document(
        "The two source papers, reproduced",
        [
            f"SINO6 and its configuration circle come from {PAPER}. The arm zero6 comes from a "
            "paper of 2010 about the calibration of zero offsets. This page compares the "
            "equations and tables of both papers with exact geometry, stated uncertainties and "
            f"a diagnosis. The seed of the random generator is {seed}.",
            *_about_misprints(seed),
            *table2_document(table2).blocks,
            *table3_document(table3).blocks,
            *_about_zero_offsets(),
        ],
        "Xu You et al. 2019 (SINO6) and the zero-offset calibration of 2010",
    )


def _about_misprints(seed: int) -> list[Block]:
    table = misprints(np.random.default_rng(seed))
    table["equation"] = "(" + table["equation"] + ")"
    formats: dict[str, Format] = {
        "cosine": ".2f",
        "median_angle_error_deg": ".1f",
        "median_length_error_mm": ".1f",
    }
    formats |= dict.fromkeys(
        [name for name in MISPRINTS if name.endswith("share")], lambda share: percent(share, 2)
    )
    return [
        Heading("The equations of the SINO6 paper"),
        "Some printed equations give wrong postures. Each row of the table has one misprint, with "
        "everything else correct, on the same 20 000 random postures within the limits. Errors "
        "are medians over the postures with a wrong answer. A cosine above 1 belongs to no angle.",
        Table(table, "Equations (3) to (13) as printed and corrected", formats, MISPRINTS),
        Table(
            pd.DataFrame(SYMBOLS, columns=["symbol", "meaning"]),
            "Symbols of the paper in this table",
        ),
        "With the printed sign of ken or of Vk, Table 2 of the paper does not result. These two "
        "errors are therefore misprints, and no errors of the authors' program. The condition "
        "of (7), l2 in (11), |Uk| in (12) and the condition of (13) hardly change the counts of "
        "Table 2. Equations (3), (5) and (9) have no effect on the counts.",
    ]


@document_of.register
def table2_document(result: Table2) -> Document:
    """Table 2, reproduced."""
    mean, cells, distance = result.mean_flexibility, result.cells, result.total_variation
    counts = result.counts[(result.counts.drop(columns="working_sectors") > 0).any(axis=1)]
    low = cells[cells["reproduced_sectors"] == cells["reproduced_sectors"].min()]
    rest = low[~low["behind_axis"]]
    reading = (
        "The paper counts working regions by their flexibility. Its text does not define the "
        "regions, and does not state when a sector counts as working. We looked for an "
        "interpretation that gives the printed counts. The 48 × 48 regions are a grid of joint "
        "angles: θ1 = θ3 = 0, and θ2 and θ4 at -180° + i · 180°/49. The paper evaluates the "
        "circle of a cell at seven equally spaced values of θ2, from the highest posture to the "
        "lowest. Each end represents one sector, and each of the five other steps represents "
        "two symmetrical sectors. A step counts if θ2 is not below -180°, and if the first root "
        "of (11) and (13) have a solution."
    )
    lost = (
        f"{len(low)} cells have {int(low['reproduced_sectors'].iloc[0])} of 12 working sectors. "
        f"Exact geometry gives {int((low['exact_sectors'] == 12).sum())} of these cells all "
        f"sectors. In {int(low['behind_axis'].sum())} of the cells the circle of the elbow "
        "encloses the vertical through the shoulder. θ2 then reaches its extreme value before "
        "the end of the circle. Steps of θ2 beyond this value are no postures, and the paper "
        "does not evaluate the true postures, in which the base faces away. In the "
        f"other {len(rest)} cells the point lies in front of the axis, so they have another reason."
    )
    return Document(
        "Table 2",
        [
            Heading("Flexibility (Table 2)"),
            Paragraph(reading, detail=True),
            Paragraph(
                "The total variation distance to the printed histogram is "
                f"{100 * distance['reproduced']:.1f} % for the reproduced histogram, and "
                f"{100 * distance['exact']:.0f} % for exact geometry. The mean flexibility is "
                f"{mean['paper']:.3f} (printed), {mean['reproduced']:.3f} (reproduced) and "
                f"{mean['exact']:.3f} (exact).",
                finding=True,
            ),
            Table(counts, "Number of cells by number of working sectors", heads=TABLE_2),
            Figure(
                lambda: plots.plot_table2(result, blank_axes(8.0, 4.2)),
                "Bars of the number of cells by working sectors: printed, reproduced, exact",
                "Table 2 as printed, as reproduced, and by exact geometry for the same cells.",
            ),
            Paragraph(lost, detail=True),
        ],
    )


@document_of.register
def table3_document(found: Table3Diagnosis) -> Document:
    """The diagnosis of Table 3."""
    of_causes = found.evidences.sort_values("five_tau_0.15", ascending=False)[list(EVIDENCE)]
    numbers = list(EVIDENCE)[1:]
    of_causes[numbers] = (of_causes[numbers] - of_causes[numbers].max()).round(
        1
    ) + 0.0  # + 0.0: no minus zero
    bad = implied_counts().query("not whole")
    odd = ", ".join(
        f"seat {r.point} ({r.marked_count_low:.2f} to {r.marked_count_high:.2f})"
        for r in bad.itertuples()
    )
    method = (
        "The paper measured six seats in fifty postures each. It prints the spread of the fifty "
        "positions about their mean. The true positions have no effect on the spread. Each cause "
        "gives a pattern of six spreads. The size of the pattern is free within a factor of ten "
        "of the typical size. Only the DH errors have a known size, the half-widths of Table 1. "
        f"The printed coordinates are interpreted as {found.seats.reading}, with postures evenly "
        "round the circle. The model discrepancy τ of a prediction is assumed to be "
        f"{100 * DISCREPANCY:.0f} %, because postures, contact and masses are assumed. The "
        "tables also state results for τ = 30 %. A spread of fifty records also has a sampling "
        "error."
    )
    counts = (
        "The three printed spreads of a seat share one sum of squares. They therefore determine "
        "the number of records in the marked part. This number is an integer within the printed "
        f"digits, except at {odd}. If there are fifty records, the printed numbers of this seat "
        "cannot all be correct."
    )
    settle = (
        "The records themselves, with angles and seats, would distinguish causes that have the "
        "same spreads. A column with the direction of approach of each joint would distinguish "
        "hysteresis from noise. The time of each record would show a drift."
    )
    return Document(
        "Table 3",
        [
            Heading("Measurements (Table 3)"),
            Paragraph(method, detail=True),
            Paragraph(_what_is_wrong(found), True, f"Errors of the nominal arm ({found.verdict}):"),
            _table(
                found.shown,
                SPREADS,
                "Spread of fifty positions about their mean at each seat (eq. 16)",
            ),
            Figure(
                lambda: plots.plot_spreads(found, blank_axes(7.2, 4.4)),
                "Measured spreads of six seats and predictions of five causes",
                "Spreads by cause. The band shows DH errors within their half-widths. The marks "
                "show causes with the size that fits seats 1 to 5.",
            ),
            Paragraph(_cause(found), True, "The cause:"),
            _table(
                of_causes,
                EVIDENCE,
                "Natural logarithm of the Bayes factor relative to the best of the column",
                ".1f",
            ),
            Figure(
                lambda: plots.plot_bayes_factors(found, blank_axes(7.6, 5.4)),
                "Bars of the logarithm of the Bayes factor of each description",
                "Logarithms of the Bayes factors as bars. Left of the dotted line, a description "
                "has less than a tenth of the best evidence.",
            ),
            Paragraph(_seat6(found), True, "Seat 6:"),
            _table(
                found.seat6,
                SEAT6,
                "Spread of seat 6 by each description. The ratio to seat 5 uses no measurement. "
                "The other columns use seats 1 to 5.",
            ),
            Paragraph(counts, detail=True),
            Paragraph(_marked_part(found), True, "The marked part:"),
            Figure(
                lambda: plots.plot_part_and_rest(found, blank_axes(7.2, 4.2)),
                "Spread of the marked part divided by the spread of the rest, for six seats and "
                "four selections of the part",
                "Spread of the marked part divided by the spread of the rest. The lines show the "
                "printed ratios, the bars medians and 5–95 % bands of simulated measurements.",
            ),
            Paragraph(_extended(found), True, "The extended model and its gain:"),
            _table(
                found.held_out.seats, HELD_OUT, "Seats 1 to 5, each predicted from the four others"
            ),
            Paragraph(settle, detail=True),
        ],
    )


def _table(frame: pd.DataFrame, heads: dict[str, str], caption: str, form: str = ".4f") -> Table:
    """The columns of ``heads``; ``form`` is the format of numbers with decimals."""
    fractions = [name for name in heads if pd.api.types.is_float_dtype(frame[name])]
    return Table(frame[list(heads)], caption, dict.fromkeys(fractions, form), heads)


def _about_zero_offsets() -> list[Block]:
    counts = (
        zero_offset.comparison()
        .groupby("kind")["verdict"]
        .value_counts()
        .unstack(fill_value=0)
        .reset_index()
    )
    return [
        Heading("The zero-offset paper"),
        "The paper prints each iteration of three simulated calibrations. The same computation "
        "reproduces the numbers if it rounds each increment to 1 mrad.",
        Table(counts, "Number of printed values of Table 2 by kind and result"),
        Figure(
            lambda: plots.plot_iterations(blank_axes(6.8, 4.2)),
            "Largest position error after each iteration of three runs",
            "With rounding, the errors stay at the printed values. Without rounding, they fall to "
            "the rounding of the computer. The last errors of the paper and its 0.02° are effects "
            "of the rounding to 1 mrad, and no properties of the method or the arm.",
        ),
    ]


# Sentences about the diagnosis of Table 3.


def _what_is_wrong(found: Table3Diagnosis) -> str:
    quantile = found.shown["measured_quantile"]
    return (
        "DH errors within the half-widths of Table 1 explain the spread of each single seat: "
        f"the measured spread is above {100 * quantile.min():.0f} % to "
        f"{100 * quantile.max():.0f} % of the simulated arms. They do not explain all six "
        "spreads, because the spreads of one arm rise and fall together. The ratio of seat 6 to "
        f"seat 5 is as large as measured {_often_above_seat_5(found)}."
    )


def _often_above_seat_5(found: Table3Diagnosis) -> str:
    return often(found.seat6.set_index("cause")["ratio_probability"][DH])


def _cause(found: Table3Diagnosis) -> str:
    sampling, table = found.shown["sampling_percent"], found.evidences
    low, middle, high = found.noise / ARCSEC
    likely = table.sort_values("five_probability", ascending=False).query("cause != @NOISE")
    others = likely.loc[likely["five_probability"] > table["five_probability"].max() / 3, "cause"]
    five, _, six, doubtful = (
        (table[name] > table[name].max() - np.log(NEAR)).sum() for name in list(EVIDENCE)[1:]
    )
    return (
        f"Equal noise of {middle:.1f}″ ({low:.1f}″ to {high:.1f}″) of every encoder describes "
        f"seats 1 to 5 with an RMS misfit of {found.fit[0]:.1f} %. The sampling error of a "
        f"spread is {sampling.min():.0f} % to {sampling.max():.0f} %, so a part of the agreement "
        f"is chance (probability of a closer fit {100 * found.fit[1]:.1g} %). "
        f"{len(others)} other descriptions have at least a third of the best probability: "
        f"{', '.join(others)}. "
        f"By seats 1 to 5, {five} of {len(table)} descriptions are within a Bayes factor of "
        f"{NEAR:.0f} of the best description. By all six seats, {six} is, or {doubtful} if τ is "
        "30 %. Six spreads therefore determine little more than that seat 6 is special."
    )


def _seat6(found: Table3Diagnosis) -> str:
    can = found.seat6.loc[found.seat6["possible"], "cause"].tolist()
    of_the_arm = found.evidences[~found.evidences["cause"].isin(OF_SEATS)]
    best = str(of_the_arm.sort_values("six_probability").iloc[-1]["cause"])
    factor, worse = (found.log_bayes_factor(ODD, best, "six", tau) for tau in (DISCREPANCY, 0.30))
    noise = found.seat6.set_index("cause").loc[NOISE]
    return (
        "Seat 6 needs a cause of its own. Encoder noise that fits seats 1 to 5 predicts "
        f"{noise['predicted_mm']:.4f} mm, with 97.5 % of the draws below "
        f"{noise['predicted_p975_mm']:.4f} mm. The paper measured "
        f"{found.shown['measured_mm'].iloc[-1]:.4f} mm. Of the compared causes "
        f"{'only ' + ' and '.join(can) if can else 'none'} can explain seat 6, with an additional "
        f"{found.local_noise / MM:.3f} mm in each coordinate. The best cause of the arm, {best}, "
        f"has a Bayes factor of 1 : {bayes_factor(factor)} against this cause. If τ is 30 %, the "
        f"factor is 1 : {bayes_factor(worse)}."
    )


def _marked_part(found: Table3Diagnosis) -> str:
    causes, share = found.marked.causes, found.marked.least_random_share
    ratio, reached, middle = causes["after_ratio"], causes["after_reached"], found.noise[1] / ARCSEC
    low, _, high = band(found.marked.after[NOISE])
    measured = np.exp(MEASURED_LOGS)
    inside = ((low <= measured) & (measured <= high)).sum()
    return (
        "At seats 1 to 5 the spread of the marked part is "
        f"{np.exp(MEASURED_LOGS[FIVE].mean()):.2f} times the spread of the rest (geometric mean). "
        f"Postures with the smallest predicted volume would give {causes['before_ratio'][DH]:.2f} "
        f"with DH errors, and {causes['before_ratio'][NOISE]:.2f} with encoder noise. They reach "
        f"the printed contrast {often(causes['before_reached'].max())}. The records nearest the "
        f"mean, selected after the measurement, give {ratio[NOISE]:.2f} with encoder noise; "
        f"{inside} of the 6 printed ratios are in the 5–95 % band of this selection. The printed "
        "contrast is therefore no evidence that the predicted volume distinguishes postures. "
        "No selection spreads less than the records nearest the mean. If the postures cover the "
        f"full circle, DH errors alone would give {ratio[DH]:.2f} for these records, and reach "
        f"the printed contrast {often(reached[DH])}. At least {100 * share:.0f} % of the variance "
        f"of seats 1 to 5 is therefore random, which is {np.sqrt(share) * middle:.1f}″ of encoder "
        "noise. Eccentricity of all encoders reaches the printed contrast "
        f"{often(reached[ECCENTRICITY])}, and gravity {often(reached[GRAVITY])}."
    )


def _extended(found: Table3Diagnosis) -> str:
    lower, extended, upper = found.noise_beside_dh / ARCSEC
    held = found.held_out
    gains = {
        name: f"{held.gain[name]:.2f} ({low:.2f} to {high:.2f})"
        for name, (low, high) in held.interval.items()
    }
    return (
        "The extended arm has DH errors within their half-widths, and encoder_noise_rad = "
        f"{found.noise_beside_dh[1]:.3g}. This noise is {extended:.1f}″ ({lower:.1f}″ to "
        f"{upper:.1f}″), from spreads and contrasts of seats 1 to 5. The cause of seat 6 is no "
        "cause of the arm, and the extended arm does not contain it. DH errors alone predict a "
        f"seat from the four others with an RMS error of {held.rms_percent['recalibrated']:.0f} %. "
        f"With encoder noise the RMS error is {held.rms_percent['extended']:.0f} %, a gain of "
        f"{gains['extended']}. Noise without DH errors gives {gains['noise_alone']}. These "
        "intervals depend on five numbers, each with a standard uncertainty of "
        f"{found.shown['sampling_percent'].mean():.0f} %."
    )


def bayes_factor(log: float) -> str:
    """A Bayes factor from its logarithm, with the one digit that does not depend on the draws."""
    return f"{float(f'{np.exp(min(log, 20.0)):.1g}'):g}"


def often(probability: float) -> str:
    """A probability as a part of the draws."""
    return (
        "in none of the draws"
        if probability == 0.0
        else f"in {100 * probability:.2g} % of the draws"
    )
