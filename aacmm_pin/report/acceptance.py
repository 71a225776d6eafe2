"""The test report of an acceptance test: figures, limits and verdicts, on one sheet of paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from importlib.metadata import version

import numpy as np

from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.units import MM, plain_mm
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
from aacmm_pin.report.formats.html import SHORT
from aacmm_pin.report.numbers import capital
from aacmm_pin.report.procedure import ORIGIN
from aacmm_pin.verification import AcceptanceResult, History
from aacmm_pin.verification.accept import COVERAGE, LONGEST_PART, SHOWN_AS, shown_verdict
from aacmm_pin.verification.characteristics import EDITIONS, RULE_OF
from aacmm_pin.verification.history import LEAST_CHECKS, PER_MOVING_RANGE
from aacmm_pin.verification.probed_points import AS_GIVEN, brief

RULE = (
    "Conformity: |value| + U ≤ MPE for each error; non-conformity: |value| - U > MPE for one; "
    f"{SHOWN_AS['neither']} in "
    f"between. Guard band: U = {COVERAGE:g}u of the calibrated length or diameter, as in "
    f"{RULE_OF}; the default of "
    "ISO 14253-1:2017 is 1.65u."
)
CHART = (
    "Individuals charts: the magnitude of the figure in each check, the mean of the earlier ones "
    "that count, and limits "
    f"{PER_MOVING_RANGE} mean moving ranges away from it, none below zero, from {LEAST_CHECKS} of "
    "them on."
)
STATED = {
    "operator": ("operator", ""),
    "session": ("session", ""),
    "temperature_c": ("temperature", " °C"),
    "probe_diameter_mm": ("probe", " mm"),
    "feature_diameter_mm": ("spheres", " mm"),
    "length_mm": ("lengths", " mm"),
}
"""What is written of a column that tells of the check as a whole, and its unit."""
TITLE = "Test report"
HEADS = {
    "value_mm": "value [mm]",
    "U_mm": "U [mm]",
    "mpe_mm": "MPE [mm]",
    "had": "touches or lengths",
}
"""All in mm, however small, as limits are stated and charts are drawn."""
SHOWN = 6
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
    table = result.to_frame()
    several = len({f.source for f in result.figures}) > 1
    table["coordinates"] = table["coordinates"].map(partial(brief, most=SHORT))
    table["standard"] = table["standard"].replace(EDITIONS)
    said = [
        name
        for name in ("verdict", "value_mm", "U_mm", "mpe_mm")
        if table[name].notna().any() or name == "value_mm"
    ]
    shown = [
        "figure",
        *said,
        *["coordinates"] * several,
        *["standard"] * (details is not None and not several),
        "had",
    ]
    if details is not None:  # one column, as a figure with a place has all that it needs
        table["where"] = table["where"].where(
            table["missing"] == "", "missing: " + table["missing"]
        )
    shown += [
        name for name in ("where", "missing")[: 1 if details else 2] if (table[name] != "").any()
    ]
    named = table[["figure", "standard", "test", "definition"]].drop_duplicates()
    what = Table(named, "What the figures are")
    history = details.history if details is not None else None
    blocks: list[Block] = [
        Paragraph(
            f"{result}.",
            finding=True,
            head=f"{f'{MARK} ' * bool(details and result.failed)}Acceptance:",
        ),
        Table(table[shown], "Figures and their limits", {"verdict": _marked}, HEADS, spare="where"),
        Paragraph(RULE),
        *([] if history is None else history_blocks(history)),
        Notes(result.notes),
    ]
    if details is None:
        return Document(
            TITLE, [ORIGIN, *blocks, Table(named, "What the figures are", detail=True)], result.path
        )
    files = [
        Download("acceptance.json", "the figures as JSON", json_text(result.summary()).encode()),
        Download("touches.csv", "the touches", result.data),
    ]
    checked = Paragraph(_conditions(result, details), head="Checked:")
    return Document(
        f"{TITLE}{': ' * bool(details.instrument)}{details.instrument}",
        [
            ORIGIN,
            checked,
            *blocks,
            Folded("What the figures are, and the data", [what, *files]),
        ],
        f"{details.time:%Y-%m-%d %H:%M} UTC, {result.path}, aacmm_pin {version('aacmm_pin')}",
        sheet=len(table),
    )


def history_blocks(history: History) -> list[Block]:
    """Whether figures have left their usual range, and the control charts."""
    from aacmm_pin.report.plots.history import charts_drawn, plot_history

    charts, drawn = history.charts(), charts_drawn(history)
    several = len({chart.arm for chart in charts}) > 1
    left = [
        f"{chart.figure}{f' by {chart.arm}' * several} {chart.values[-1] / MM:.4f} mm, usually "
        f"{np.nan_to_num(chart.limits[0]) / MM:.4f} to {chart.limits[1] / MM:.4f} mm"
        for chart in charts
        if chart.left
    ]
    few = [len(chart.usual) for chart in charts if not np.isfinite(chart.limits[1])]
    text = f"{'; '.join(left)}." if left else "" if few else "no figure has left it."
    if few:
        text += (
            f"{' ' * bool(text)}{len(few)} of {len(charts)} figures have no limits yet, which "
            f"need {LEAST_CHECKS} earlier "
        )
        text += (
            "checks that count; there are "
            f"{min(few)}{f' to {max(few)}' if max(few) > min(few) else ''}."
        )
    said = Paragraph(capital(text), head="Outside the usual range:" if left else "Usual range:")
    there = {(chart.arm, chart.figure) for chart in drawn}
    left_out = dict[str, list[str]]()
    for chart in charts:
        if len(chart.values) > 1 and (chart.arm, chart.figure) not in there:
            left_out.setdefault(f" by {brief(chart.arm, SHORT)}" * several, []).append(chart.figure)
    more = (
        f" Not drawn: {'; '.join(', '.join(names) + arm for arm, names in left_out.items())}."
        if left_out
        else ""
    )
    figure = Figure(lambda: plot_history(history), "Control charts of the figures", CHART + more)
    return [said, figure] if drawn else [said]


def _marked(verdict: str) -> str:
    return f"{MARK} {verdict}" if verdict == "non-conformity" else shown_verdict(verdict)


def _conditions(result: AcceptanceResult, details: CheckDetails) -> str:
    stated = {
        STATED[name][0]: _range(values) + STATED[name][1]
        for name, values in result.stated.items()
        if values
    }
    arms = [
        "as in the file" if arm == AS_GIVEN else f"of indications by {arm}"
        for arm in result.overall
    ]
    if result.measuring_range is not None:
        stated["range"] = (
            f"{plain_mm(result.measuring_range)} mm, 66 % of it "
            f"{plain_mm(LONGEST_PART * result.measuring_range)} mm"
        )
        stated |= {
            f"longest of {test}": f"{plain_mm(length)} mm"
            for test, length in result.longest.items()
        }
    lines = {"coordinates": ", ".join(arms)} | stated | dict(details.about)
    return "; ".join(f"{name}: {text}" for name, text in lines.items()) + "."


def _range(values: Sequence[object]) -> str:
    texts = [
        plain_mm(value * MM) if isinstance(value, float | int) else str(value) for value in values
    ]
    if len(values) > SHOWN and isinstance(values[0], float | int):
        return f"{texts[0]} to {texts[-1]}"
    shown = ", ".join(texts[:SHOWN])
    return shown + ", …" * (len(values) > SHOWN)
