"""Cards of the papers beside us: their tables made again, and their measurements diagnosed."""

from __future__ import annotations

import pandas as pd

from aacmm_pin._support.units import MM
from aacmm_pin.papers.sino6 import NominalArm, Table2, Table3
from aacmm_pin.papers.table3 import Table3Diagnosis
from aacmm_pin.papers.table3.contrast import Contrast
from aacmm_pin.papers.table3.extended import HeldOutSeats
from aacmm_pin.papers.table3.strict_pick import StrictPick
from aacmm_pin.report.cards.card import bullets, html_of, paragraph, table

FORMAT = ".4g"


def _numbers(frame: pd.DataFrame) -> dict[str, str]:
    """Four digits for every column of numbers with a fraction."""
    return {str(name): FORMAT for name in frame if pd.api.types.is_float_dtype(frame[name])}


def _plain(frame: pd.DataFrame, head: str = "") -> str:
    return table(frame, _numbers(frame), head)


@html_of.register
def _table2(result: Table2) -> str:
    flexibility = ", ".join(f"{name} {value:.3f}" for name, value in result.mean_flexibility.items())
    words = (
        f"mean flexibility {flexibility}; total variation from the print {result.total_variation:.4f} reproduced, "
        f"{result.exact_total_variation:.4f} exact"
    )
    return paragraph(words, "Table 2:") + _plain(result.counts)


@html_of.register
def _table3(result: Table3) -> str:
    words = (
        f"printed coordinates read as those of the {result.reading}. Seat 6 spreads {result.measured_ratio:.2f} times as "
        f"much as seat 5, which {result.ratio_probability:.1%} of the arms within the half-widths do."
    )
    return paragraph(words, "Table 3:") + _plain(result.points)


@html_of.register
def _nominal(arm: NominalArm) -> str:
    lengths = {f"{name} [mm]": [getattr(arm, name) / MM] for name in ("l2", "l3", "d3", "d5")}
    return paragraph("", "Nominal offset-orthogonal arm") + table(pd.DataFrame(lengths), dict.fromkeys(lengths, ".5g"))


@html_of.register
def _table3_diagnosis(found: Table3Diagnosis) -> str:
    weighed = found.evidences[["cause", "five_probability", "six_probability"]]
    weighed = weighed.sort_values("five_probability", ascending=False)
    return (
        paragraph(f"printed coordinates read as {found.reading}", f"Table 3, {found.verdict}:")
        + bullets(found.sentences)
        + _plain(found.shown, "Measured spreads, beside those of DH errors and of encoder noise:")
        + table(
            weighed, dict.fromkeys(weighed.columns[1:], ".3f"), "Probability of each cause among all, by five seats and six:"
        )
        + html_of(found.held_out_five)
    )


@html_of.register
def _contrast(found: Contrast) -> str:
    words = f"mean ratio of their spreads {found.measured_mean_ratio:.3f} as printed"
    return paragraph(words, "Marked part and rest:") + _plain(found.summary)


@html_of.register
def _strict_pick(found: StrictPick) -> str:
    words = f"at least {found.least_random_share:.0%} of the variance is random, however the part was chosen"
    return paragraph(words, "Marked part and rest:") + _plain(found.causes) + _plain(found.shares)


@html_of.register
def _held_out(found: HeldOutSeats) -> str:
    rows = [
        {"model": name.replace("_", " "), "gain": gain, "from": found.interval[name][0], "to": found.interval[name][1]}
        | {"better at seats": f"{found.better[name]} of {len(found.seats)}"}
        for name, gain in found.gain.items()
    ]
    shown = pd.DataFrame(rows)
    head = "Each seat predicted by the others; gain over DH errors recalibrated, with its 95 % interval:"
    return _plain(found.seats, head) + table(shown, dict.fromkeys(("gain", "from", "to"), "z.2f"))
