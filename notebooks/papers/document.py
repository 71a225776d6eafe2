"""The two source papers beside what is computed here, as a page and as cards of the results.

Every number is computed when the page is made; the sentences around them are fixed.
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
"""Descriptions whose evidence is within this factor are not told apart."""
SYMBOLS = (
    (
        "O, E, C, P, K",
        "shoulder; elbow; end of the upper tube; working point; where joint axis 3 meets "
        "joint axis 1",
    ),
    (
        "l2, l3, d3, d5",
        "magnitudes of a2, a3, d3 and d5 of Table 1: the two offsets and the two tubes",
    ),
    ("Z", "height in the paper's figures, against z of the DH base"),
    ("len, den, ken", "distances O to C, O to P, C to P"),
    ("QD, gen", "distance O to E in the highest and in the lowest configuration"),
    ("dk, qdk", "distances K to C and K to E"),
    ("the1, the2, the3", "angles at O that add up to θ2 of the highest configuration (θ2max)"),
    ("∠k, ∠q", "angles at E, from O to C and from O to P"),
    ("thek", "turn of θ2 from the highest configuration to the lowest (θ2min)"),
    ("uck", "|θ2| + arctan(d3/l2)"),
    ("Uk, Vk, Qk", "C from joint axis 1, with sign; height of C; P from joint axis 1"),
    ("Dq, Rq", "what (13) takes for Uk; horizontal distance C to P"),
)
"""What the printed equations call things."""
MISPRINTS = {
    "corrected": "right",
    "median_angle_error_deg": "angle off by [°]",
    "median_length_error_mm": "length off by [mm]",
    "affected_share": "wrong or missing",
    "no_answer_share": "no real answer",
    "false_share": "impossible but accepted",
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
    "dh_median_mm": "median [mm]",
    "dh_p95_mm": "95 % [mm]",
    "measured_quantile": "share of arms below measured",
    "noise_mm": "encoder noise, size by seats 1–5 [mm]",
}
EVIDENCE = {
    "cause": "description",
    "five_tau_0.15": "seats 1–5, 15 %",
    "five_tau_0.30": "seats 1–5, 30 %",
    "six_tau_0.15": "six seats, 15 %",
    "six_tau_0.30": "six seats, 30 %",
}
SEAT6 = {
    "cause": "description",
    "ratio_probability": "as much above seat 5 as measured, share",
    "predicted_mm": "seat 6 from the others [mm]",
    "predicted_p975_mm": "97.5 % below [mm]",
    "as_large_probability": "share at least as measured, others known",
}
HELD_OUT = {
    "seat": "seat",
    "measured_mm": "measured [mm]",
    "simulation_mm": "DH errors, nothing learnt [mm]",
    "recalibrated_mm": "DH errors [mm]",
    "extended_mm": "DH errors and noise [mm]",
    "noise_alone_mm": "noise alone [mm]",
}


def papers_document(table2: Table2, table3: Table3Diagnosis, seed: int) -> Document:
    """The page of both papers; ``seed`` is of all that is drawn for it."""
    return Document(
        "The two source papers, reproduced",
        [
            f"SINO6 and the idea of its configuration circle come from {PAPER}; the arm zero6 "
            "from a paper of 2010 on the "
            "calibration of zero offsets. Their equations and tables stand here beside what exact "
            "geometry, the stated "
            f"uncertainties and a diagnosis give. Seed {seed}.",
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
        "Some printed equations do not give the configurations that they are meant to give. Each "
        "row is one slip, with "
        "everything else right, on the same 20 000 random configurations within the limits. A "
        "cosine beyond 1 is of no "
        "angle; errors are medians over the configurations with a wrong answer.",
        Table(
            table, "Equations (3) to (13) as printed and as they should read", formats, MISPRINTS
        ),
        Table(
            pd.DataFrame(SYMBOLS, columns=["symbol", "meaning"]),
            "The paper's symbols in this table",
        ),
        "With the sign of ken or of Vk as printed the paper's own Table 2 does not come out, so "
        "these two are slips of the "
        "print and not of the authors' program. The condition of (7), l2 in (11), |Uk| in (12) "
        "and the condition of (13) "
        "hardly change its counts; (3), (5) and (9) have no part in them.",
    ]


@document_of.register
def table2_document(result: Table2) -> Document:
    """Table 2 made again."""
    mean, cells, distance = result.mean_flexibility, result.cells, result.total_variation
    counts = result.counts[(result.counts.drop(columns="working_sectors") > 0).any(axis=1)]
    low = cells[cells["reproduced_sectors"] == cells["reproduced_sectors"].min()]
    rest = low[~low["behind_axis"]]
    reading = (
        "The paper counts working regions by their flexibility; its text does not say how the "
        "regions lie or how they are "
        "judged. The following reading, found by looking for one that gives the printed counts, "
        "gives its numbers: the "
        "48 × 48 regions are a grid in joint space, θ1 = θ3 = 0, θ2 and θ4 at -180° + i · "
        "180°/49. The circle of a cell is "
        "walked at seven equally spaced values of θ2, from the highest configuration to the "
        "lowest; the ends stand for one "
        "sector each, the five steps between for a mirror-image pair. A step counts if θ2 is not "
        "below -180° and (11), "
        "first root, and (13) have an answer."
    )
    lost = (
        f"Of the {len(low)} cells that come out with {int(low['reproduced_sectors'].iloc[0])} "
        "working sector of 12, exact "
        f"geometry gives the full circle to {int((low['exact_sectors'] == 12).sum())}. "
        f"{int(low['behind_axis'].sum())} of "
        "them enclose the vertical: there θ2 does not run from one end of the circle to the "
        "other, so steps in θ2 fall "
        "outside the circle and count as lost, while the true postures, with the base turned "
        "round, are not looked at. The "
        f"other {len(rest)} are not explained that way: their points lie in front of the axis."
    )
    return Document(
        "Table 2",
        [
            Heading("Flexibility (Table 2)"),
            Paragraph(reading, detail=True),
            Paragraph(
                "The total variation distance from the printed histogram is "
                f"{100 * distance['reproduced']:.1f} % for the "
                f"reproduced and {100 * distance['exact']:.0f} % for the exact one. Mean "
                f"flexibility: {mean['paper']:.3f} "
                f"printed, {mean['reproduced']:.3f} reproduced, {mean['exact']:.3f} exact.",
                finding=True,
            ),
            Table(counts, "Cells by working sectors", heads=TABLE_2),
            Figure(
                lambda: plots.plot_table2(result, blank_axes(8.0, 4.2)),
                "Bars of the number of cells by working sectors: printed, reproduced, exact",
                "Table 2 as printed, made again, and by exact geometry on the same cells.",
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
        "The paper measured six seats in fifty postures each and prints how far the fifty "
        "positions spread about their own "
        "mean; the true position does not enter. Each cause gives a pattern over the seats; its "
        "size is free, within a "
        "factor of ten of what is usual, but for DH errors, which keep the half-widths of Table "
        "1. The printed coordinates "
        f"are read as {found.seats.reading}, the circle evenly covered. A prediction is taken to "
        "be right to "
        f"{100 * DISCREPANCY:.0f} % (model discrepancy), for neither postures nor contact are "
        "known, beside the sampling "
        "error of a spread of fifty records; the answers for 30 % stand beside. Masses are assumed."
    )
    counts = (
        "The three printed spreads of a seat share one sum of squares, so they imply how many of "
        "the fifty records are in "
        "the marked part. That number is whole within the printed digits for all seats but "
        f"{odd}: there the three printed "
        "numbers cannot all be right, if there are fifty records."
    )
    settle = (
        "The records themselves, angles and touched seat, would settle it: by them causes are "
        "told apart that leave the "
        "same spreads. A column that says from which side each joint came would tell hysteresis "
        "from noise, and the time "
        "of each record a drift."
    )
    return Document(
        "Table 3",
        [
            Heading("Measurements (Table 3)"),
            Paragraph(method, detail=True),
            Paragraph(
                _what_is_wrong(found), True, f"What the simulation gets wrong ({found.verdict}):"
            ),
            _table(
                found.shown,
                SPREADS,
                "Spread of fifty positions about their mean at each seat (eq. 16)",
            ),
            Figure(
                lambda: plots.plot_spreads(found, blank_axes(7.2, 4.4)),
                "Measured spread of six seats and what each of five causes predicts",
                "Spreads by cause. DH errors before and after seats 1 to 5 are known; the other "
                "causes with the size that "
                "these seats give them.",
            ),
            Paragraph(_cause(found), True, "The cause:"),
            _table(
                of_causes,
                EVIDENCE,
                "Natural logarithm of the Bayes factor against the best of the column",
                ".1f",
            ),
            Figure(
                lambda: plots.plot_bayes_factors(found, blank_axes(7.6, 5.4)),
                "Bars of the logarithm of the Bayes factor of each description",
                "The same as bars. Left of the dotted line a description is ten times less "
                "probable than the best.",
            ),
            Paragraph(_seat6(found), True, "Seat 6:"),
            _table(
                found.seat6,
                SEAT6,
                "Seat 6 by each description, before any measurement and with seats 1 to 5 known",
            ),
            Paragraph(counts, detail=True),
            Paragraph(_marked_part(found), True, "The marked part:"),
            Figure(
                lambda: plots.plot_part_and_rest(found, blank_axes(7.2, 4.2)),
                "Spread of the marked part over the rest at six seats, printed and by four ways "
                "to choose the part",
                "Marked part over rest: medians and 5–95 % bands of simulated measurements, and "
                "the printed ratios.",
            ),
            Paragraph(_extended(found), True, "The extended model and its gain:"),
            _table(
                found.held_out.seats, HELD_OUT, "Seats 1 to 5, each predicted from the other four"
            ),
            Paragraph(settle, detail=True),
        ],
    )


def _table(frame: pd.DataFrame, heads: dict[str, str], caption: str, form: str = ".4f") -> Table:
    """The columns with ``heads``; numbers with a fraction are written with ``form``."""
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
        "Three runs of a simulated calibration, printed iteration by iteration, and made again "
        "with increments rounded to "
        "1 mrad, as the paper must have done.",
        Table(counts, "Printed numbers of its Table 2 by what becomes of them"),
        Figure(
            lambda: plots.plot_iterations(blank_axes(6.8, 4.2)),
            "Largest position error after each iteration of three runs",
            "With the rounding the error stays where the paper has it; without it, it falls to "
            "the computer's own rounding. "
            "The paper's last errors and its 0.02° follow from rounding to 1 mrad; they are no "
            "property of method or arm.",
        ),
    ]


# The diagnosis of Table 3 in
# words ------------------------------------------------------------


def _what_is_wrong(found: Table3Diagnosis) -> str:
    quantile = found.shown["measured_quantile"]
    return (
        "DH errors within the half-widths of Table 1 would spread each seat as much as "
        "measured (above "
        f"{100 * quantile.min():.0f} % to {100 * quantile.max():.0f} % of the drawn arms), but "
        "the six spreads of one arm "
        f"rise and fall together, and {_often_above_seat_5(found)} does seat 6 spread as much "
        "more than seat 5 as it did."
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
        f"Equal noise of {middle:.1f}″ ({low:.1f}″ to {high:.1f}″) on every encoder gives seats 1 "
        "to 5 within "
        f"{found.fit[0]:.1f} %, closer than the sampling error of {sampling.min():.0f} % to "
        f"{sampling.max():.0f} % "
        f"lets expect (chance {100 * found.fit[1]:.1g} %), so the closeness is luck in part; "
        f"{len(others)} other "
        f"descriptions are at least a third as probable: {', '.join(others)}. "
        f"Of {len(table)} descriptions {five} are within a Bayes factor of {NEAR:.0f} of the "
        "best by "
        f"seats 1 to 5, {six} by all six, and {doubtful} by all six if predictions are right to "
        "30 % only: six "
        "aggregate numbers say that seat 6 is special, and hardly more."
    )


def _seat6(found: Table3Diagnosis) -> str:
    can = found.seat6.loc[found.seat6["possible"], "cause"].tolist()
    of_the_arm = found.evidences[~found.evidences["cause"].isin(OF_SEATS)]
    best = str(of_the_arm.sort_values("six_probability").iloc[-1]["cause"])
    factor, worse = (found.log_bayes_factor(ODD, best, "six", tau) for tau in (DISCREPANCY, 0.30))
    noise = found.seat6.set_index("cause").loc[NOISE]
    return (
        "It needs a cause of its own: encoder noise that fits the others predicts "
        f"{noise['predicted_mm']:.4f} mm "
        f"(97.5 % below {noise['predicted_p975_mm']:.4f} mm) against "
        f"{found.shown['measured_mm'].iloc[-1]:.4f} mm; of the "
        f"causes weighed {'only ' + ' and '.join(can) if can else 'none'} could have made it, with "
        f"{found.local_noise / MM:.3f} mm in each coordinate added there. Against it the best "
        f"cause of the arm, {best}, has "
        f"a Bayes factor of 1 : {bayes_factor(factor)} if predictions are right to "
        f"{100 * DISCREPANCY:.0f} %, and of 1 : "
        f"{bayes_factor(worse)} if only to 30 %."
    )


def _marked_part(found: Table3Diagnosis) -> str:
    causes, share = found.marked.causes, found.marked.least_random_share
    ratio, reached, middle = causes["after_ratio"], causes["after_reached"], found.noise[1] / ARCSEC
    low, _, high = band(found.marked.after[NOISE])
    measured = np.exp(MEASURED_LOGS)
    inside = ((low <= measured) & (measured <= high)).sum()
    return (
        f"At seats 1 to 5 it spreads {np.exp(MEASURED_LOGS[FIVE].mean()):.2f} times as much as "
        "the rest (geometric mean). "
        f"Postures with the smallest predicted volume would give {causes['before_ratio'][DH]:.2f} "
        "under DH errors and "
        f"{causes['before_ratio'][NOISE]:.2f} under encoder noise, as little as printed "
        f"{often(causes['before_reached'].max())}; the smallest deviations picked after measuring "
        f"give {ratio[NOISE]:.2f}, "
        f"and {inside} of the 6 printed ratios are in its 5–95 % band. A contrast of this size is "
        "what picking after "
        "measuring makes; it is no evidence that a predicted volume told the postures apart. "
        "However the part was chosen, "
        "it cannot spread less than the records nearest the mean. If the postures went round the "
        "full circle, DH errors "
        f"alone would spread these {ratio[DH]:.2f} times as much as the rest, and as little as "
        f"printed {often(reached[DH])}"
        f"; beside them at least {100 * share:.0f} % of the variance of seats 1 to 5 has to "
        "scatter, "
        f"{np.sqrt(share) * middle:.1f}″ if that is encoder noise. Eccentricity of all encoders "
        "reaches the printed "
        f"contrast {often(reached[ECCENTRICITY])}, gravity {often(reached[GRAVITY])}."
    )


def _extended(found: Table3Diagnosis) -> str:
    lower, extended, upper = found.noise_beside_dh / ARCSEC
    held = found.held_out
    gains = {
        name: f"{held.gain[name]:.2f} ({low:.2f} to {high:.2f})"
        for name, (low, high) in held.interval.items()
    }
    return (
        f"The extended arm states encoder_noise_rad = {found.noise_beside_dh[1]:.3g}, that is "
        f"{extended:.1f}″ "
        f"({lower:.1f}″ to {upper:.1f}″) with DH errors within their half-widths beside it, by "
        "spreads and contrasts of "
        "seats 1 to 5. What happened at seat 6 is not the arm's and is not in it. Predicted from "
        "the other four, a seat of "
        f"the first five is off by {held.rms_percent['recalibrated']:.0f} % by DH errors "
        "alone and by "
        f"{held.rms_percent['extended']:.0f} % with encoder noise beside them: gain "
        f"{gains['extended']}; "
        f"{gains['noise_alone']} by noise without DH errors. The intervals rest on five numbers, "
        "each itself uncertain by "
        f"{found.shown['sampling_percent'].mean():.0f} %."
    )


def bayes_factor(log: float) -> str:
    """A Bayes factor from its logarithm, with the one digit that its draws allow."""
    return f"{float(f'{np.exp(min(log, 20.0)):.1g}'):g}"


def often(probability: float) -> str:
    """How often, in words."""
    return (
        "in none of the draws"
        if probability == 0.0
        else f"in {100 * probability:.2g} % of the draws"
    )
