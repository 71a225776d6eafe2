"""What the page says of the paper's measured table by the four duties of a diagnosis: show, name, extend, measure."""

from __future__ import annotations

from pathlib import Path

from aacmm_pin.papers.table3 import Table3Diagnosis
from aacmm_pin.papers.table3 import sentences as say
from aacmm_pin.report import plots
from aacmm_pin.report.demo.picture import new_axes, picture
from aacmm_pin.report.demo.study import SEED, Study
from aacmm_pin.report.html import Paragraph, Part, Section, Table

EVIDENCE = {
    "cause": "description",
    "five_tau_0.15": "seats 1–5, 15 %",
    "five_tau_0.30": "seats 1–5, 30 %",
    "six_tau_0.15": "six seats, 15 %",
    "six_tau_0.30": "six seats, 30 %",
}
SEAT6 = {
    "cause": "description",
    "ratio_median": "seat 6 / seat 5, median",
    "ratio_probability": "share at least as measured",
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
    "by_spreads_mm": "the same by spreads only [mm]",
    "noise_alone_mm": "noise alone [mm]",
}


def diagnosed_sections(study: Study, out: Path) -> list[Section]:
    """One section; none for another arm than the paper's."""
    found = study.diagnosed
    if found is None or study.of_records is None:
        return []
    parts = [_introduction(found), *_shown(found, out), *_named(found, out), *_of_seat6(found), *_chosen(found, out)]
    parts += [*_extended(found), *_of_records(study, out)]
    return [Section("The paper's measurements, diagnosed", parts)]


def _introduction(found: Table3Diagnosis) -> Part:
    return (
        "Of three hundred records the paper prints six spreads, and two parts of each. What can be diagnosed "
        "from that? Each "
        "cause gives a pattern over the seats; its size is free, within a factor of ten of what is usual, but "
        "for DH errors, "
        "which keep the half-widths of Table 1. The tip is taken to be in the seat with the stylus straight "
        "down and the elbow "
        f"evenly round its circle. A prediction is taken to be right to {100 * found.tau:.0f} % (model discrepancy), for "
        "neither postures nor contact are known, beside the sampling error of a spread of fifty records; the answers for "
        f"30 % stand beside. Seed {SEED}."
    )


def _shown(found: Table3Diagnosis, out: Path) -> list[Part]:
    return [
        Paragraph(f"What the simulation gets wrong. {say.show(found)}", finding=True),
        picture(
            plots.plot_spreads(found, new_axes(7.2, 4.4)),
            out,
            "spreads",
            "Measured spread of six seats and what each of five causes predicts",
            "Spreads by cause. DH errors before and after seats 1 to 5 are known; the other causes with the size that these "
            "seats give them.",
        ),
    ]


def _named(found: Table3Diagnosis, out: Path) -> list[Part]:
    table = found.evidences.sort_values("five_tau_0.15", ascending=False)[list(EVIDENCE)]
    numbers = [column for column in EVIDENCE if column != "cause"]
    table[numbers] = (table[numbers] - table[numbers].max()).round(1) + 0.0  # + 0.0: no minus zero
    return [
        Paragraph(f"The cause. {say.name(found)} {say.limits(found)}", finding=True),
        Table(
            table,
            "Natural logarithm of the Bayes factor of each description against the best of the column",
            dict.fromkeys(numbers, ".1f"),
            EVIDENCE,
        ),
        picture(
            plots.plot_bayes_factors(found, new_axes(7.6, 5.4)),
            out,
            "bayes_factors",
            "Bars of the logarithm of the Bayes factor of each description",
            "The same as bars. Left of the dotted line a description is ten times less probable than the best.",
        ),
        "Masses are assumed, so gravity is only as good as they are. Hysteresis with directions of approach "
        "that change from record to record is the same law as encoder noise, and no spread can tell them apart.",
    ]


def _of_seat6(found: Table3Diagnosis) -> list[Part]:
    stand = found.stand
    return [
        Paragraph(say.of_seat6(found), finding=True),
        Table(
            found.seat6[list(SEAT6)],
            "Seat 6 by each description, before any measurement and when seats 1 to 5 are known",
            {"ratio_median": ".2f", "ratio_probability": ".4f", "as_large_probability": ".4f"}
            | dict.fromkeys(["predicted_mm", "predicted_p975_mm"], ".4f"),
            SEAT6,
        ),
        "A stand that yields with the height above the lowest seat, soft enough for seat 6, would have given "
        "seat 5, which is "
        f"nearly as high, {stand['seat5_mm'].min():.3f} mm to {stand['seat5_mm'].max():.3f} mm by powers of the height from "
        f"{stand['power'].min():g} to {stand['power'].max():g}, against "
        f"{stand['seat5_measured_mm'].iloc[0]:.4f} mm measured. "
        "What is left is local: a loose seat, a stylus that did not sit, a bad batch, a slip of the print. The "
        f"numbers printed for seat 6 do not fit each other either, see the section before.",
    ]


def _chosen(found: Table3Diagnosis, out: Path) -> list[Part]:
    return [
        Paragraph(say.of_contrast(found), finding=True),
        picture(
            plots.plot_part_and_rest(found, new_axes(7.2, 4.2)),
            out,
            "part_and_rest",
            "Spread of the marked part over the rest at six seats, printed and by four ways to choose the part",
            "Marked part over rest: medians and 5–95 % bands of simulated measurements, and the printed ratios.",
        ),
        Paragraph(say.of_strict_pick(found), finding=True),
        Table(
            found.strict_pick.causes,
            "The records nearest the mean over the rest, geometric mean of seats 1 to 5, by each cause alone",
            {"ratio_median": ".2f", "reached": ".3f"},
            {"cause": "cause", "ratio_median": "ratio, median", "reached": "share of draws at most as printed"},
        ),
        "The paper draws its figures over all of sin θ3, but does not say how the postures lay. On a part of the circle a "
        "systematic cause may have near records too, so this bound, and the lower end of the noise below, stand on the full "
        "circle; the level of the noise and what is said of seat 6 do not.",
    ]


def _extended(found: Table3Diagnosis) -> list[Part]:
    return [
        Paragraph(f"The extended model. {say.extend(found)}", finding=True),
        Paragraph(f"The gain. {say.gain(found)}", finding=True),
        Table(
            found.held_out_five.seats[list(HELD_OUT)],
            "Seats 1 to 5, each predicted from the other four",
            dict.fromkeys([name for name in HELD_OUT if name != "seat"], ".4f"),
            HELD_OUT,
        ),
    ]


def _of_records(study: Study, out: Path) -> list[Part]:
    table = study.of_records
    assert table is not None
    return [
        Paragraph(f"What would settle it. {say.of_records(table)}", finding=True),
        picture(
            plots.plot_expected_of_records(table, new_axes(7.8, 5.2)),
            out,
            "records",
            "Table of the expected logarithm of the Bayes factor between causes from the records themselves",
            "Expected logarithm of the Bayes factor of the true cause against the one assumed, from angles and "
            "touched seat of all records; places of the seats unknown, level of the scatter refitted.",
        ),
    ]
