"""The test report of an acceptance test: figures, limits and verdicts, on one sheet of paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from importlib.metadata import version

import numpy as np
import pandas as pd

from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.units import MM, plain_mm
from aacmm_pin.report.document import (
    MARK,
    Block,
    Document,
    Download,
    Figure,
    Folded,
    Format,
    Notes,
    Paragraph,
    Table,
    document_of,
)
from aacmm_pin.report.formats.html import SHORT_TEXT
from aacmm_pin.report.numbers import capital
from aacmm_pin.report.procedure import ORIGIN
from aacmm_pin.verification import (
    AS_GIVEN,
    EDITIONS,
    GUARD_BAND_FACTOR,
    LEAST_CHECKS,
    LONGEST_PART,
    PER_MOVING_RANGE,
    RULE_OF,
    AcceptanceResult,
    ControlChart,
    History,
    brief,
    shown_verdict,
)

RULE = (
    "Conformity: |value| + U ≤ MPE for each error; non-conformity: |value| - U > MPE for one; "
    f"{shown_verdict('neither')} in "
    f"between. Guard band: U = {GUARD_BAND_FACTOR:g}u of the calibrated length or diameter, as in "
    f"{RULE_OF}; the default of "
    "ISO 14253-1:2017 is 1.65u."
)
CHART = (
    "Individuals charts: the magnitude of the test value in each check, the mean of the earlier "
    f"checks that count, and limits at {PER_MOVING_RANGE} mean moving ranges from the mean, none "
    f"below zero, if {LEAST_CHECKS} or more checks count."
)
STATED_OF_CHECK = {
    "operator": ("operator", ""),
    "session": ("session", ""),
    "temperature_c": ("temperature", " °C"),
    "probe_diameter_mm": ("probe", " mm"),
    "feature_diameter_mm": ("spheres", " mm"),
    "length_mm": ("lengths", " mm"),
}
"""What is written of a column that tells of the check as a whole, and its unit."""
TITLE, DEFINED = "Test report", "What the figures are"
FIGURE_HEADS = {
    "value_mm": "value [mm]",
    "U_mm": "U [mm]",
    "mpe_mm": "MPE [mm]",
    "had": "touches or lengths",
}
"""All in mm, however small, as limits are stated and charts are drawn."""
NUMBERS_LISTED = 6
"""So many different numbers of a column stand one beside the other; of more, the smallest and the
largest.
"""


@dataclass(frozen=True)
class CheckDetails:
    """What a test report says beside the figures.

    Attributes:
        time: of the check.
        instrument: which arm was checked.
        about: further lines, by what they are called.
        history: of the checks of the arm.
    """

    time: datetime
    instrument: str = ""
    about: Mapping[str, str] = field(default_factory=dict)
    history: History | None = None


@document_of.register
def acceptance_document(result: AcceptanceResult, details: CheckDetails | None = None) -> Document:
    """The result as one page, which with ``details`` takes one sheet of A4 and holds the touches.

    Args:
        result: what was found.
        details: what else the sheet says.
    """
    if not result.figures:
        return Document(TITLE, ["No touches of a test of this standard."], result.path)
    table = _readable(result)
    if details is not None:  # one column, as a figure with a place has all that it needs
        missing = table.pop("missing")
        table["where"] = table["where"].where(missing == "", "missing: " + missing)
    named = table[["figure", "standard", "test", "definition"]].drop_duplicates()
    figures = table[_columns(table, len(result.overall) > 1, details is None)]
    forms: dict[str, Format] = {"verdict": _marked}
    blocks: list[Block] = [
        Table(figures, "Figures and their limits", forms, FIGURE_HEADS, spare="where"),
        Paragraph(RULE),
    ]
    if details is None:
        verdict = Paragraph(f"{result}.", finding=True, head="Acceptance:")
        what = Table(named, DEFINED, detail=True)
        return Document(TITLE, [ORIGIN, verdict, *blocks, Notes(result.notes), what], result.path)
    if details.history is not None:
        blocks += history_blocks(details.history)
    mark = f"{MARK} " if result.failed else ""
    opening: list[Block] = [
        Paragraph(ORIGIN),
        Paragraph(_conditions(result, details), head="Checked:"),
        Paragraph(f"{result}.", finding=True, head=f"{mark}Acceptance:"),
    ]
    title = f"{TITLE}: {details.instrument}" if details.instrument else TITLE
    made = f"{details.time:%Y-%m-%d %H:%M} UTC, {result.path}, aacmm_pin {version('aacmm_pin')}"
    closing: list[Block] = [Notes(result.notes), _data(result, named)]
    return Document(title, [*opening, *blocks, *closing], made, sheet=len(table))


def _readable(result: AcceptanceResult) -> pd.DataFrame:
    table = result.to_frame()
    table["coordinates"] = table["coordinates"].map(partial(brief, most=SHORT_TEXT))
    table["standard"] = table["standard"].replace(EDITIONS)
    return table


def _columns(table: pd.DataFrame, several: bool, plain: bool) -> list[str]:
    """Columns that state something: of ``several`` sets of coordinates also which one; a ``plain``
    document has the standard elsewhere.
    """
    columns = ["figure"]
    for name in ("verdict", "value_mm", "U_mm", "mpe_mm"):
        if name == "value_mm" or table[name].notna().any():
            columns.append(name)
    if several:
        columns.append("coordinates")
    elif not plain:
        columns.append("standard")
    columns.append("had")
    texts = [name for name in ("where", "missing") if name in table]
    return columns + [name for name in texts if (table[name] != "").any()]


def _data(result: AcceptanceResult, named: pd.DataFrame) -> Folded:
    summary = json_text(result.summary()).encode()
    return Folded(
        f"{DEFINED}, and the data",
        [
            Table(named, DEFINED),
            Download("acceptance.json", "the figures as JSON", summary),
            Download("touches.csv", "the touches", result.data),
        ],
    )


def history_blocks(history: History) -> list[Block]:
    """Whether figures have left their usual range, and the control charts."""
    from aacmm_pin.report.plots.history import charts_drawn, plot_history

    charts, drawn = history.charts(), charts_drawn(history)
    several = len({chart.arm for chart in charts}) > 1
    outside = [_departure(chart, several) for chart in charts if chart.left]
    few = [len(chart.usual) for chart in charts if not np.isfinite(chart.limits[1])]
    sentences = [f"{'; '.join(outside)}."] if outside else []
    if few:
        there_are = f"{min(few)} to {max(few)}" if max(few) > min(few) else min(few)
        sentences.append(
            f"{len(few)} of {len(charts)} figures have no limits yet, which need {LEAST_CHECKS} "
            f"earlier checks that count; there are {there_are}."
        )
    text = " ".join(sentences) or "no figure has left it."
    head = "Outside the usual range:" if outside else "Usual range:"
    said = Paragraph(capital(text), head=head)
    if not drawn:
        return [said]
    caption = CHART + _not_drawn(charts, drawn, several)
    return [said, Figure(lambda: plot_history(history), "Control charts of the figures", caption)]


def _departure(chart: ControlChart, several: bool) -> str:
    """The last value of a chart beside its usual range."""
    by = f" by {chart.arm}" if several else ""
    low, high = np.nan_to_num(chart.limits[0]) / MM, chart.limits[1] / MM
    return f"{chart.figure}{by} {chart.values[-1] / MM:.4f} mm, usually {low:.4f} to {high:.4f} mm"


def _not_drawn(charts: Sequence[ControlChart], drawn: Sequence[ControlChart], several: bool) -> str:
    """Charts with more than one value that the picture has no room for, by arm."""
    there = {(chart.arm, chart.figure) for chart in drawn}
    names = dict[str, list[str]]()
    for chart in charts:
        if len(chart.values) > 1 and (chart.arm, chart.figure) not in there:
            by = f" by {brief(chart.arm, SHORT_TEXT)}" if several else ""
            names.setdefault(by, []).append(chart.figure)
    if not names:
        return ""
    return f" Not drawn: {'; '.join(', '.join(some) + by for by, some in names.items())}."


def _marked(verdict: str) -> str:
    return f"{MARK} {verdict}" if verdict == "non-conformity" else shown_verdict(verdict)


def _conditions(result: AcceptanceResult, details: CheckDetails) -> str:
    arms = ["as in the file" if a == AS_GIVEN else f"of indications by {a}" for a in result.overall]
    lines = {"coordinates": ", ".join(arms)}
    for column, values in result.stated.items():
        if values:
            name, unit = STATED_OF_CHECK[column]
            lines[name] = _range(values) + unit
    if result.measuring_range is not None:
        part = plain_mm(LONGEST_PART * result.measuring_range)
        lines["range"] = f"{plain_mm(result.measuring_range)} mm, 66 % of it {part} mm"
        for test, length in result.longest.items():
            lines[f"longest of {test}"] = f"{plain_mm(length)} mm"
    lines |= details.about
    return "; ".join(f"{name}: {text}" for name, text in lines.items()) + "."


def _range(values: Sequence[object]) -> str:
    texts = [
        plain_mm(value * MM) if isinstance(value, float | int) else str(value) for value in values
    ]
    if len(values) > NUMBERS_LISTED and isinstance(values[0], float | int):
        return f"{texts[0]} to {texts[-1]}"
    shown = ", ".join(texts[:NUMBERS_LISTED])
    return shown + ", …" * (len(values) > NUMBERS_LISTED)
