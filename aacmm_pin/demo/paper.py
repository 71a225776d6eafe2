"""What the page says about the paper that the arm comes from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin.demo.picture import new_axes, picture
from aacmm_pin.demo.study import SEED, Study
from aacmm_pin.report import Paragraph, Part, Section, Table
from aacmm_pin.sino6_paper import Table2, Table3, misprints
from aacmm_pin.sino6_paper.figures import draw_table2, draw_table3

PAPER = "Xu You et al., Chinese Journal of Scientific Instrument 40 (2019), doi:10.19650/j.cnki.cjsi.J1905059"


def paper_sections(study: Study, out: Path) -> list[Section]:
    """Three sections; none for another arm than the paper's."""
    if study.table2 is None or study.table3 is None:
        return []
    return [
        Section("The paper beside us: its equations", _about_misprints()),
        Section("The paper beside us: flexibility (its Table 2)", _about_table2(study.table2, out)),
        Section("The paper beside us: measurements (its Table 3)", _about_table3(study.table3, out)),
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
        "Most of these are slips of the print, because the corrected forms make the paper's own Table 2 again (next "
        "section). The range of θ2 in (10) and the single roots are not: they belong to the way in which that table was "
        "made.",
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
    low = cells[cells["reproduced_sectors"] == cells["reproduced_sectors"].min()]
    counts = result.counts[(result.counts.drop(columns="working_sectors") > 0).any(axis=1)]
    heads = {"working_sectors": "working sectors", "paper_cells": "printed", "reproduced_cells": "reproduced"}
    return [
        "The paper counts working regions by their flexibility. Its text does not say how the regions lie; a grid in joint "
        "angles 2 and 4, and a walk over each circle in equal steps of θ2, make its numbers again. Nothing in this "
        "assumption was adjusted to fit.",
        Paragraph(
            f"Printed and reproduced counts differ by {100 * result.total_variation:.1f} % of the cells; printed and exact "
            f"ones by {100 * result.exact_total_variation:.0f} %. Mean flexibility: {mean['paper']:.3f} printed, "
            f"{mean['reproduced']:.3f} reproduced, {mean['exact']:.3f} exact.",
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
        f"Of the {len(low)} cells that come out with {int(low['reproduced_sectors'].iloc[0])} working sector of 12, exact "
        f"geometry gives the full circle to {_all_or(int((low['exact_sectors'] == 12).sum()), len(low))}; "
        f"{int(low['encloses_vertical'].sum())} of them lie where the circle of the elbow goes round the base axis. There "
        "θ2 does not run from one end of the circle to the other, so steps in θ2 fall outside the circle and count as lost. "
        "The low flexibility near the axis is a matter of the parameter that was stepped, not of the joint limits. This "
        "holds for the nominal geometry and for our reading of how the counts were made. The map above uses other cells, "
        "equal ones in space, and the calibrated geometry; its numbers are not those of this table.",
    ]


def _about_table3(result: Table3, out: Path) -> list[Part]:
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
        f"The paper measured six seats in fifty postures each. The table puts the printed spreads beside those of {draws} "
        f"drawn arms whose DH values lie within the half-widths of Table 1 (uniform, seed {SEED}), and beside white noise "
        "of 5″ on every joint angle. The postures are not printed; fifty, evenly round the full circle of θ3, are assumed.",
        Table(points[list(columns)], "Spread of the measured position at each seat (eq. 16)", formats, columns),
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
        f"{_counts_text(result)}",
    ]


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
