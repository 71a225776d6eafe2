"""What the page says about the paper that the arm comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.units import MM, UM
from aacmm_pin.papers.sino6 import Table2, Table3, configurations_at_swivel, misprints, sino6_nominal
from aacmm_pin.papers.sino6.figures import draw_table2, draw_table3
from aacmm_pin.report.demo.picture import new_axes, picture
from aacmm_pin.report.demo.study import SEED, Study
from aacmm_pin.report.html import Paragraph, Part, Section, Table

SWIVELS = 72
"""Swivel angles at which the elbow's path is followed."""

SYMBOLS = (
    ("O, E, C, P, K", "shoulder; elbow; end of the upper tube; working point; where joint axis 3 meets joint axis 1"),
    ("l2, l3, d3, d5", "magnitudes of a2, a3, d3 and d5 of Table 1: the two offsets and the two tubes"),
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
PAPER = "Xu You et al., Chinese Journal of Scientific Instrument 40 (2019), doi:10.19650/j.cnki.cjsi.J1905059"


def paper_sections(study: Study, out: Path) -> list[Section]:
    """Three sections; none for another arm than the paper's."""
    if study.table2 is None or study.table3 is None:
        return []
    return [
        Section("The paper beside us: its equations", _about_misprints()),
        Section("The paper beside us: flexibility (its Table 2)", _about_table2(study.table2, out)),
        Section("The paper beside us: measurements (its Table 3)", _about_table3(study, study.table3, out)),
    ]


def _about_misprints() -> list[Part]:
    table = misprints(np.random.default_rng(SEED))
    shown = pd.DataFrame(
        {
            "equation": "(" + table["equation"] + ")",
            "printed": table["printed"],
            "right": table["corrected"],
            "effect of this slip alone": [_effect(row) for row in table.to_dict("records")],
        }
    )
    return [
        f"The arm and the idea come from {PAPER}. Some of its printed equations do not give the configurations that they "
        "are meant to give. Each row below is one slip, with everything else right, on the same 20 000 random "
        f"configurations within the limits (seed {SEED}).",
        Table(shown, "Equations (3) to (13) as printed and as they should read"),
        Table(pd.DataFrame(SYMBOLS, columns=["symbol", "meaning"]), "The paper's symbols in this table"),
        "Making the paper's Table 2 again (next section) uses (7) and (10) to (13) only. Two of their rows are put to the "
        "test by it, the sign in ken and the sign of Vk: with either as printed the counts do not come out, so these are "
        "slips of the print and not of the authors' program. The condition of (7), l2 in (11), |Uk| in (12) and the "
        "condition of (13) hardly change the counts, which decide nothing about them. Rows (3), (5) and (9) have no part in "
        "it: there only geometry speaks. The single root of (11) and the range of θ2 in (10) are used as printed, for that "
        "is how the counts come out.",
    ]


def _effect(row: dict[Any, Any]) -> str:
    """The measured size of a misprint in words."""
    known = {name: float(value) for name, value in row.items() if isinstance(value, float) and np.isfinite(value)}
    parts = []
    if "cosine" in known:
        return f"the cosine would be {known['cosine']:.2f}: no angle"
    if "median_angle_error_deg" in known:
        parts.append(f"median error {known['median_angle_error_deg']:.1f}° where wrong")
    if "median_length_error_mm" in known:
        parts.append(f"median error {known['median_length_error_mm']:.1f} mm")
    if known.get("affected_share", 1.0) == 0.0 and not known.get("false_share"):
        return "no case among these configurations"
    if "affected_share" in known:
        share = known["affected_share"]
        parts.append(f"{'all' if share == 1 else f'{100 * share:.1f} % of'} configurations wrong or missing")
    if known.get("no_answer_share"):
        parts.append(f"{100 * known['no_answer_share']:.2g} % without a real answer")
    if known.get("false_share"):
        parts.append(f"{100 * known['false_share']:.0f} % of impossible cases accepted")
    return "; ".join(parts)


def _about_table2(result: Table2, out: Path) -> list[Part]:
    mean, cells = result.mean_flexibility, result.cells
    counts = result.counts[(result.counts.drop(columns="working_sectors") > 0).any(axis=1)]
    heads = {"working_sectors": "working sectors", "paper_cells": "printed", "reproduced_cells": "reproduced"}
    return [
        "The paper counts working regions by their flexibility. Its text does not say how the regions lie or how they are "
        "judged. The following reading gives its numbers. The 48 × 48 regions are a grid in joint space, not in space: "
        "θ1 = θ3 = 0, θ2 and θ4 at -180° + i · 180°/49 with i = 1 to 48; the point of a cell is where this posture puts the "
        "wrist. The circle of the point is walked at seven equally spaced values of θ2, from the highest "
        "configuration to the lowest. The ends stand for one sector each, the five steps between for two, a mirror-image "
        "pair (1 + 5 × 2 + 1 = 12). A step counts if θ2 is not below -180° and (11), first root, and (13) have an answer; "
        "θ4 of the pair is not checked. Where the triangle of the lowest configuration does not close, its angle is taken "
        "as zero, and that end does not count.",
        "This reading was found by looking for one that gives the printed counts; no number in it was tuned, but its rules "
        "were chosen with those counts in sight. That they agree speaks for the reading and is not an independent test of "
        "it.",
        Paragraph(
            "The paper prints a histogram, not the cells, so only histograms can be compared. The total variation distance "
            "(half the summed differences of the shares) from the printed one is "
            f"{100 * result.total_variation:.1f} % for the reproduced and {100 * result.exact_total_variation:.0f} % for "
            f"the exact one. Mean flexibility: {mean['paper']:.3f} printed, {mean['reproduced']:.3f} reproduced, "
            f"{mean['exact']:.3f} exact.",
            finding=True,
        ),
        Table(counts, "Cells of 48 × 48 by working sectors", heads=heads | {"exact_cells": "exact geometry"}),
        picture(
            draw_table2(result, new_axes(8.0, 4.2)),
            out,
            "table2",
            "Bars of the number of cells by working sectors: printed, reproduced, exact",
            "Table 2 as printed, made again, and by exact geometry on the same cells.",
        ),
        *_about_lowest_class(cells[cells["reproduced_sectors"] == cells["reproduced_sectors"].min()]),
        "All this holds for the nominal geometry and for this reading of how the counts were made. The map above uses other "
        "cells, equal ones in space, and the calibrated geometry; its numbers are not those of this table.",
    ]


def _about_lowest_class(low: pd.DataFrame) -> list[Part]:
    """Why the cells with the fewest sectors have so few."""
    behind, rest = low[low["behind_axis"]], low[~low["behind_axis"]]
    return [
        f"Of the {len(low)} cells that come out with {int(low['reproduced_sectors'].iloc[0])} working sector of 12, exact "
        f"geometry gives the full circle to {_all_or(int((low['exact_sectors'] == 12).sum()), len(low))}. "
        f"{len(behind)} of them enclose the vertical: the elbow of the cell's own posture is in front of the base axis and "
        "the point behind it. There θ2 does not run from one end of the circle to the other, so steps in θ2 fall outside "
        "the circle and count as lost, while the true postures, with the base turned round, are not looked at.",
        f"The other {len(rest)} are not explained that way: their points lie in front of the axis, by "
        f"{rest['x_mm'].min():.0f} mm to {rest['x_mm'].max():.0f} mm. What the data show is that "
        f"{_range(rest['steps_past_limit'])} of their seven steps pass -180° and "
        f"{_range(rest['steps_without_configuration'])} have no answer (a step may be both); between them they leave only "
        "the first. By exact geometry the elbow goes round the base axis in "
        f"{_all_or(int(elbow_goes_round(rest).sum()), len(rest))} as well. In either group postures within the limits exist "
        "in every sector, and the walk in θ2 does not find them.",
    ]


def _range(numbers: pd.Series[Any]) -> str:
    return f"{int(numbers.min())} to {int(numbers.max())}"


def elbow_goes_round(cells: pd.DataFrame) -> NDArray[np.bool_]:
    """Whether the elbow's path, over all swivel angles, goes round joint axis 1: (n,).

    For cells of :attr:`Table2.cells` with the full circle and one posture at each swivel angle.
    """
    arm = sino6_nominal()
    points = np.column_stack([cells["x_mm"], np.zeros(len(cells)), cells["z_mm"]]) * MM
    found = configurations_at_swivel(arm, points, (np.arange(SWIVELS) + 0.5) * 2 * np.pi / SWIVELS)
    works = ((found.q[:, [1, 3]] <= 0.0) & (found.q[:, [1, 3]] >= -np.pi)).all(axis=1)
    q, point, swivel = found.q[works], found.point[works], found.swivel[works]
    elbow = arm.dh.positions(np.column_stack([q, np.zeros(len(q))]), 3)
    azimuth = np.full((len(cells), SWIVELS), np.nan)
    azimuth[point, swivel] = np.arctan2(elbow[:, 1], elbow[:, 0])
    steps = wrapped(np.diff(azimuth, axis=1, append=azimuth[:, :1]))
    return np.asarray(np.abs(steps.sum(axis=1)) > np.pi)


def _about_table3(study: Study, result: Table3, out: Path) -> list[Part]:
    points = result.points
    together = float(result.correlation[np.triu_indices(len(points), 1)].min())
    draws = len(result.spreads)
    by_noise = points["angle_noise_mm"] / points["measured_mm"] - 1
    columns = {
        "point": "seat",
        "measured_mm": "measured [mm]",
        "dh_p05_mm": "DH errors, 5 % [mm]",
        "dh_median_mm": "median [mm]",
        "dh_p95_mm": "95 % [mm]",
        "measured_quantile": "share of arms below measured",
        "angle_noise_mm": "angle noise 5″ [mm]",
    }
    formats = dict.fromkeys(list(columns)[1:], ".4f") | {"measured_quantile": ".2f"}
    quantile = points["measured_quantile"]
    return [
        "The paper measured six seats in fifty postures each, the stylus vertical, and prints how far the fifty positions "
        "spread about their own mean; the true position does not enter. The printed coordinates are read here as the "
        "working point of the paper's equations, the wrist; the stylus and the joints behind it are left out. The table "
        f"puts the printed spreads beside those of {draws} drawn arms whose DH values lie within the half-widths of Table 1 "
        f"(uniform, seed {SEED}), and beside white noise of 5″ on every joint angle. The postures are not printed; fifty, "
        "evenly round the full circle of θ3, are assumed.",
        Table(points[list(columns)], "Spread of fifty positions about their mean at each seat (eq. 16)", formats, columns),
        picture(
            draw_table3(result, new_axes(6.8, 4.4)),
            out,
            "table3",
            "Measured spread of six seats over the band that DH errors predict",
            "Measured spreads, the band of DH errors alone, and white angle noise.",
        ),
        Paragraph(
            "Seat by seat, errors of the DH values alone would do: each measured spread is above that of "
            f"{100 * quantile.min():.0f} % to {100 * quantile.max():.0f} % of the drawn arms. Together they do not: one arm "
            f"has one set of errors, so the seats rise and fall together (correlation at least {together:.2f}), and "
            f"{ratio_text(result, draws)} spreads {result.measured_ratio:.2f} times as much at seat 6 as at seat 5, which "
            "is what was measured.",
            finding=True,
        ),
        f"Angle noise of 5″, a round number that was tried and not derived, comes within "
        f"{100 * by_noise[:-1].abs().max():.0f} % of seats 1 to 5 and misses seat 6 by {100 * abs(by_noise.iloc[-1]):.0f} "
        "%. That it fits five seats does not prove that it is the cause; other small random errors would look alike. "
        "Whatever made seat 6 spread, neither explanation has it.",
        *_other_reading(study, columns, formats),
        _not_the_same(study, result),
        _counts_text(result),
    ]


def _other_reading(study: Study, columns: dict[str, str], formats: dict[str, str]) -> list[Part]:
    """The same with the tip in the seat."""
    result = study.table3_tip
    if result is None:
        return []
    by_noise = result.points["angle_noise_mm"] / result.points["measured_mm"] - 1
    return [
        "The other reading of the coordinates: the tip is in the seat, the stylus points straight down as assumed for this "
        "arm, all six joints move, and the elbow goes evenly round its circle. The conclusions stay: correlation at least "
        f"{float(result.correlation.min()):.2f}, {ratio_text(result, len(result.spreads))} spreads as much more at seat 6 "
        f"than at seat 5 as measured, and 5″ of angle noise comes within {100 * by_noise[:-1].abs().max():.0f} % of seats 1 "
        "to 5.",
        Table(result.points[list(columns)], "The same spreads with the tip in the seat", formats, columns),
    ]


def _not_the_same(study: Study, result: Table3) -> str:
    """Why the predicted u and the measured spreads are two things."""
    u, measured = study.accuracy.u / UM, result.points["measured_mm"] * MM / UM
    return (
        f"The predicted u of section 4 ({u.min():.0f} µm to {u.max():.0f} µm, at seat 1) and the measured spreads "
        f"({measured.min():.0f} µm to {measured.max():.0f} µm) are not the same thing, near as the numbers are. u is how "
        "far one position may be off the true one when the DH values are off; these errors are systematic, shared by all "
        "records of one arm. What they do alike in every posture at a seat moves the mean of the fifty and leaves the "
        "spread alone; only what changes with the posture spreads. The measured spread is a repeatability over postures, "
        "and random errors of each record, which u leaves out, are in it. Neither checks the other."
    )


def ratio_text(result: Table3, draws: int) -> str:
    """How many of the drawn arms spread as unevenly as measured, in words."""
    share = result.ratio_probability
    return f"none of the {draws} drawn arms" if share == 0 else f"only {100 * share:.2g} % of the drawn arms"


def _counts_text(result: Table3) -> str:
    bad = result.marked[~result.marked["whole"]]
    if bad.empty:
        return (
            "The three printed spreads of every seat fit together: they imply a whole number of records in the marked part."
        )
    seats = ", ".join(
        f"seat {row.point} (between {row.marked_count_low:.2f} and {row.marked_count_high:.2f})" for row in bad.itertuples()
    )
    return (
        "The three printed spreads of a seat share one sum of squares, so they imply how many of the fifty records are in "
        f"the marked part. That number is whole within the printed digits for all seats but {seats}: there the three "
        "printed numbers cannot all be right, if there are fifty records."
    )


def _all_or(number: int, of: int) -> str:
    return "all of them" if number == of else str(number)
