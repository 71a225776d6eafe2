"""Test report of an acceptance test on one sheet: test values, MPEs and verdicts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from importlib.metadata import version

import numpy as np

from aacmm_pin._support.file_problems import first_few
from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.units import MM, plain_mm
from aacmm_pin.measurements import is_workbook
from aacmm_pin.report.document import (
    MARK,
    Block,
    Document,
    Download,
    Figure,
    Folded,
    Notes,
    Paragraph,
    Table,
    document_of,
)
from aacmm_pin.report.formats.html import SHORT_TEXT
from aacmm_pin.report.procedure_page import ORIGIN
from aacmm_pin.verification import (
    AS_GIVEN,
    EDITIONS,
    GUARD_BAND_FACTOR,
    LEAST_CHECKS,
    LONGEST_PART,
    PER_MOVING_RANGE,
    RULE_OF,
    AcceptanceResult,
    History,
    brief,
    shown_verdict,
)

RULE_TEXT = (
    "If |value| + U ≤ MPE for each error, the verdict is conformity. If |value| - U > MPE for an "
    f"error, the verdict is nonconformity. The guard band U is {GUARD_BAND_FACTOR:g}u of the "
    f"calibrated length or diameter ({RULE_OF}). The default of ISO 14253-1:2017 is 1.65u."
)
CHART_CAPTION = (
    "The charts show the magnitude of each test value. The line is the mean of the earlier checks "
    f"that count. The dashed lines are limits, {PER_MOVING_RANGE} mean moving ranges from the "
    "mean."
)
CONDITION_LABELS = {
    "operator": ("operator", ""),
    "session": ("session", ""),
    "temperature_c": ("temperature", " °C"),
    "probe_diameter_mm": ("probe diameter", " mm"),
    "feature_diameter_mm": ("sphere diameter", " mm"),
    "length_mm": ("lengths", " mm"),
}
"""Label and unit of each column that describes the whole check."""
TITLE = "Test report"
DEFINED = "Definitions of the characteristics"
VALUES = ["figure", "verdict", "value_mm", "U_mm", "mpe_mm"]
HEADS = {
    "figure": "characteristic",
    "value_mm": "value [mm]",
    "U_mm": "U [mm]",
    "mpe_mm": "MPE [mm]",
    "had": "points or lengths",
}
"""Heads of columns; lengths in mm, as limits and charts."""
NUMBERS_LISTED = 6
"""Different numbers of a column to list; of more, only the smallest and largest."""


@dataclass(frozen=True)
class CheckDetails:
    """Details of a check for the test report: further lines ``about`` it by heads, and the
    ``history`` of earlier checks.
    """

    time: datetime
    instrument: str = ""
    about: Mapping[str, str] = field(default_factory=dict)
    history: History | None = None


@document_of.register
def acceptance_document(result: AcceptanceResult, details: CheckDetails | None = None) -> Document:
    """The result as a document; with ``details``, one sheet of A4 with the probed points."""
    if not result.figures:
        return Document(
            TITLE, ["The file has no probed points for a test of this standard."], result.path
        )
    table = result.to_frame()
    table["coordinates"] = table["coordinates"].map(partial(brief, most=SHORT_TEXT))
    table["standard"] = table["standard"].replace(EDITIONS)
    if details is not None:  # one column: a characteristic with a place lacks nothing
        missing = table.pop("missing")
        table["where"] = table["where"].where(missing == "", "missing: " + missing)
    definitions = table[["figure", "standard", "test", "definition"]].drop_duplicates()
    several = len(result.overall) > 1
    origin_columns = ["coordinates"] if several else ["standard"] if details is not None else []
    values = table.filter([*VALUES, *origin_columns, "had", "where", "missing"]).replace({"": None})
    marked_verdicts = {"non-conformity": f"{MARK} {shown_verdict('non-conformity')}"}
    values_table = Table(
        values.dropna(axis=1, how="all"),
        "Test values and MPEs (maximum permissible errors)",
        {"verdict": lambda verdict: marked_verdicts.get(verdict) or shown_verdict(verdict)},
        HEADS,
    )
    definitions_table = Table(definitions, DEFINED, heads=HEADS, detail=True)
    if details is None:
        verdict = Paragraph(f"{result}.", finding=True, head="Acceptance:")
        blocks: list[Block] = [
            ORIGIN,
            verdict,
            values_table,
            RULE_TEXT,
            Notes(result.notes),
            definitions_table,
        ]
        return Document(TITLE, blocks, result.path)
    points = "probed_points.xlsx" if is_workbook(result.data) else "probed_points.csv"
    numbers = json_text(result.summary()).encode()
    data: list[Block] = [
        definitions_table,
        Download("acceptance.json", "all numbers of this page", numbers),
        Download(points, "the probed points", result.data),
    ]
    mark = f"{MARK} " if result.failed else ""
    return Document(
        f"{TITLE}: {details.instrument}" if details.instrument else TITLE,
        [
            ORIGIN,
            Paragraph(_conditions(result, details), head="Conditions:"),
            Paragraph(f"{result}.", finding=True, head=f"{mark}Acceptance:"),
            values_table,
            RULE_TEXT,
            *(() if details.history is None else history_blocks(details.history)),
            Notes(result.notes),
            Folded(f"{DEFINED}, and the data", data),
        ],
        f"{details.time:%Y-%m-%d %H:%M} UTC, {result.path}, aacmm_pin {version('aacmm_pin')}",
        sheet=len(table),
    )


def history_blocks(history: History) -> Iterator[Block]:
    """Test values outside their control limits, and control charts."""
    from aacmm_pin.report.plots import plot_history

    charts = history.charts()
    several = len({chart.arm for chart in charts}) > 1
    outside = []
    for chart in charts:
        if chart.is_outside:  # the last value of the chart
            by = f" by {chart.arm}" if several else ""
            low, high = np.nan_to_num(chart.limits[0]) / MM, chart.limits[1] / MM
            value = f"{chart.values[-1] / MM:.4f} mm"
            outside.append(f"{chart.figure}{by} is {value} (limits {low:.4f} to {high:.4f} mm)")
    sentences = [f"{'; '.join(outside)}."] if outside else []
    without_limits = sum(not np.isfinite(chart.limits[1]) for chart in charts)
    if without_limits:
        sentences.append(
            f"{without_limits} of {len(charts)} characteristics have fewer than the {LEAST_CHECKS} "
            "earlier checks that control limits need."
        )
    head = "Outside the control limits:" if outside else "Control limits:"
    yield Paragraph(" ".join(sentences) or "No test value is outside its limits.", head=head)
    if any(len(chart.values) > 1 for chart in charts):
        yield Figure(
            lambda: plot_history(history), "Control charts of the test values", CHART_CAPTION
        )


def _conditions(result: AcceptanceResult, details: CheckDetails) -> str:
    origins = [
        "from the file" if arm == AS_GIVEN else f"from readings by {arm}" for arm in result.overall
    ]
    conditions = {"coordinates": ", ".join(origins)}
    for column, values in result.stated.items():
        if values:
            name, unit = CONDITION_LABELS[column]
            texts = [plain_mm(v * MM) if isinstance(v, float | int) else str(v) for v in values]
            text = first_few(texts, NUMBERS_LISTED)
            if len(values) > NUMBERS_LISTED and isinstance(values[0], float | int):
                text = f"{texts[0]} to {texts[-1]}"
            conditions[name] = text + unit
    if result.measuring_range is not None:
        long_enough = plain_mm(LONGEST_PART * result.measuring_range)
        conditions["measuring range"] = (
            f"{plain_mm(result.measuring_range)} mm, of which 66 % are {long_enough} mm"
        )
        for test, length in result.longest.items():
            conditions[f"longest length of {test}"] = f"{plain_mm(length)} mm"
    conditions |= details.about
    return "; ".join(f"{name} {text}" for name, text in conditions.items()) + "."
