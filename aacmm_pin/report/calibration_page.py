"""A calibration as one self-contained HTML page."""

from __future__ import annotations

import json
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from aacmm_pin._support.units import MM
from aacmm_pin.arm.text import arm_text
from aacmm_pin.calibration import Calibration
from aacmm_pin.report import plots
from aacmm_pin.report.calibration_findings import (
    causes_in_words,
    comment,
    decimals,
    fit_in_words,
    frame_in_words,
    readable_parameters,
    verdict,
)
from aacmm_pin.report.html import (
    Bullets,
    Download,
    Paragraph,
    Part,
    Picture,
    SceneView,
    Section,
    Table,
    blank_axes,
    render_report,
)
from aacmm_pin.report.scenes import calibration_scene

MOST_ROWS = 50
"""Excluded records that the page lists; the residuals' file has all."""

KINDS = {
    "records": "records at random",
    "seats": "whole seats",
    "sessions": "whole sessions",
    "blocks": "blocks of joint space",
}
"""What is left out in turn, in words."""


def calibration_page(result: Calibration, summary: dict[str, Any], when: str) -> str:
    """The page as HTML: verdict, numbers, residuals, parameters, what the data cannot tell, what was left out, files.

    Args:
        result: the calibration.
        summary: what ``calibrate --json`` writes; its ``data`` is the name of the measurement file.
        when: date (UTC).
    """
    sections = [
        Section("What came out", _verdict(result)),
        Section("On records it never saw", _held_out(result)),
        Section("Residuals", _residuals(result)),
        Section("Parameters", _parameters(result)),
        Section("What these data cannot tell", _undetermined(result)),
        Section("Records left out", _excluded(result)),
        Section("Files", _files(result, summary, when)),
    ]
    subtitle = f"{int(result.fit.used.sum())} records of {summary['data']}, {when} (UTC)"
    return render_report(f"{result.model.arm.name}: calibration", subtitle, sections)


def _verdict(result: Calibration) -> list[Part]:
    rows = [
        ("by the arm as it was", result.rms_before / MM),
        ("by the calibrated arm", result.rms / MM),
        ("what the noise alone would give", result.noise / MM),
    ]
    parts: list[Part] = [
        Paragraph(verdict(result), finding=True),
        fit_in_words(result),
        Table(
            pd.DataFrame(rows, columns=["what", "RMS distance of tip and target [mm]"]),
            "Residuals of the records that the arm was fitted to. The target of a record is its reference; of a seat, where "
            "all records and the reference of that seat together put it.",
            {"RMS distance of tip and target [mm]": ".4f"},
        ),
    ]
    frame = frame_in_words(result)
    notes = [*([frame] if frame else []), *(f"{line[:1].upper()}{line[1:]}." for line in result.notes)]
    if notes:
        parts += ["What was found or assumed beside:", Bullets(notes)]
    return parts


def _held_out(result: Calibration) -> list[Part]:
    if not result.held_out:
        return ["Nothing was held out, so that nothing is known of how the arm does on other records than these."]
    rows = [
        (KINDS[h.kind], h.groups, h.rms_before / MM, h.rms_after / MM, 1 - h.rms_after / h.rms_before)
        for h in result.held_out
    ]
    heads = ["left out", "parts", "before [mm]", "after [mm]", "gain"]
    return [
        "Every record was predicted once by a calibration that did not use it. Records left out at random have neighbours "
        "that stay in, which flatters; whole groups are the harder test, and the number to go by. "
        "A record that is held out is compared with its own reference, whose noise it has in full; the residuals of section "
        "1 may be smaller for that reason alone.",
        Table(
            pd.DataFrame(rows, columns=heads),
            "RMS distance of tip and target of records that were left out in turn, in so many parts. Before: the arm as it "
            "was, only the set-up fitted.",
            {"before [mm]": ".4f", "after [mm]": ".4f", "gain": ".0%"},
        ),
    ]


def _residuals(result: Calibration) -> list[Part]:
    name = result.model.arm.name
    parts: list[Part] = [
        Picture.of(
            plots.plot_residual_sizes(result, blank_axes(6.4, 3.4)),
            "Histogram of residuals before and after",
            "How far off the records are, before and after calibration; the scale is logarithmic.",
        ),
        Picture.of(
            _both_vectors(result),
            "Residual vectors in space, before and after",
            "Residuals in space, from each target towards the tip, seen along z. The two pictures are magnified by the "
            "factors in their titles, which differ; neighbours that point the same way show what the model still lacks.",
        ),
        SceneView(
            calibration_scene(result),
            "What is left, to turn: drag to look from elsewhere; the slider goes from the largest residual "
            "to the smallest, with the arm as it stood.",
        ),
        Picture.of(
            plots.plot_residuals_over_joints(result, ax=blank_axes(10.5, 0.3 - 2.5 * (-result.model.arm.nq // 3)))[0],
            "Residuals over the angle of each joint",
            "What is left, along the way that each joint moves the tip, over the angle of that joint. The line is the mean "
            "in parts of the range with its standard uncertainty: a wave in it is an encoder's or a joint's.",
        ),
    ]
    if result.fit.problem.measurements.seats():
        parts.append(
            Picture.of(
                plots.plot_residuals_by_seat(result, blank_axes(8.0, 3.4)),
                "Residuals by seat",
                "Residuals by seat. A seat that stands out after calibration may not be where it is said to be.",
            )
        )
    parts.append(
        Picture.of(
            plots.plot_normalised_residuals(result, blank_axes(6.4, 3.4)),
            "Histogram of normalised residuals against the χ distribution",
            f"Residuals of {name} over what the noise of each record allows, with the distribution that normal noise has.",
        )
    )
    return parts


def _parameters(result: Calibration) -> list[Part]:
    table, count = readable_parameters(result), len(result.fit.problem.parameters)
    if not count:
        return ["No parameter was estimated: the arm states all of them to be exact."]
    beyond = table.loc[table["beyond"], "parameter"]
    names = ["change", "stated", "u", "U"]
    moved = (
        "Nobody stated how far off these parameters may be."
        if table["stated"].isna().all()
        else f"Moved farther than their stated and new uncertainties together allow: {', '.join(beyond)}."
        if len(beyond)
        else "No parameter moved farther than its stated and new uncertainties together allow."
    )
    sizes = blank_axes(7.0, 1.2 + 0.24 * count)
    heat = blank_axes(min(9.0, 3.0 + 0.22 * count), min(8.2, 2.2 + 0.22 * count))
    causes = causes_in_words(result)
    parts: list[Part] = [Paragraph(moved, finding=bool(len(beyond)))]
    if causes := causes_in_words(result):
        parts += ["Causes of error, ± U (k = 2):", Bullets(causes)]
    return [
        *parts,
        Picture.of(
            plots.plot_parameter_changes(result, sizes),
            "Change of each parameter over its stated uncertainty",
            "How far each parameter moved, with its new expanded uncertainty; in units of how far off it was said to be, "
            "where that was said.",
        ),
        Table(
            table[["parameter", "value", *names, "in", "known"]],
            "Parameters. Changes and uncertainties are in the small unit of the column in; known: measured by these data, "
            "as stated (they add nothing to what was known), or in combination with others (section 5).",
            dict.fromkeys(names, decimals(table)),
            {"stated": "stated ±", "U": "U (k = 2)"},
        ),
        Picture.of(
            plots.plot_correlation(result, heat),
            "Heat map of the correlation of the parameters",
            "Correlation of the parameters. Two that are strongly correlated are known together better than each by itself.",
        ),
    ]


def _undetermined(result: Calibration) -> list[Part]:
    observed = result.observability
    names = ["o1", "o2", "o3", "o4", "o5"]
    indices = Table(
        pd.DataFrame([{name.upper(): getattr(observed, name) for name in names}]),
        f"Observability indices (Sun, Hollerbach 2008) of the {observed.directions} combinations that the data tell. Larger "
        "is better; they compare one set of postures with another.",
        {name.upper(): ".3g" for name in names},
    )
    if not result.undetermined:
        return ["Every parameter is told by these data or by what was stated of it.", indices]
    return [
        "Neither these data nor a stated uncertainty tell the following combinations; they stay as they were. More records "
        "of the same kind do not help: other postures, references or targets may.",
        Bullets([f"{line}." for line in result.undetermined]),
        indices,
    ]


def _excluded(result: Calibration) -> list[Part]:
    excluded = result.excluded
    silent = int((~result.fit.used & ~result.fit.excluded).sum())
    parts: list[Part] = (
        [f"{silent} records say nothing: they have no coordinates, and no seat that holds them to one place."]
        if silent
        else []
    )
    if not len(excluded):
        return ["No record was excluded.", *parts]
    caption = f"{len(excluded)} records that cannot belong" + (
        f", the first {MOST_ROWS}" if len(excluded) > MOST_ROWS else ""
    )
    table = excluded.head(MOST_ROWS).astype({"row": str}).reset_index(drop=True)
    return [
        "A record is excluded where it is farther off than its noise can put it, by a bound that excludes a good record in "
        "one file of a hundred. Look at them: a slip of the hand, a wrong seat, or something that the model lacks.",
        Table(table, caption, {"residual_mm": ".3f"}, {"residual_mm": "residual [mm]", "row": "row of the file"}),
        *parts,
    ]


def _files(result: Calibration, summary: dict[str, Any], when: str) -> list[Part]:
    content = json.dumps(summary, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    residuals = result.residuals.to_csv(index=False)
    files: list[Part] = [
        Download("calibration.json", content.encode(), "application/json", "all numbers of this page"),
        Download("residuals.csv", residuals.encode(), "text/csv", "every record with its residuals"),
    ]
    if result.model.arm.dh is not None:
        text = arm_text(result.model.file(), comment(result, summary["data"], when))
        files.append(
            Download("calibrated.toml", text.encode(), "application/toml", "the calibrated arm with its covariance")
        )
    return ["The numbers behind this page are inside it; on screen each name below saves a file.", *files]


def _both_vectors(result: Calibration) -> Figure:
    figure = Figure(figsize=(10.0, 5.4), layout="constrained")
    for when, ax in zip(("before", "after"), figure.subplots(1, 2), strict=True):
        plots.plot_residual_vectors(result, "after" if when == "after" else "before", ax=ax)
    return figure
