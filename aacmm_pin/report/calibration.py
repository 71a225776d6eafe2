"""A calibration as a document: does it help, residuals, parameters, what the data do not determine, files."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.file import arm_text
from aacmm_pin.calibration import Calibration, HeldOut
from aacmm_pin.calibration.fit import MISFIT
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.effects.labels import in_words, values_in_words
from aacmm_pin.report import plots
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Download,
    Figure,
    Heading,
    Notes,
    Paragraph,
    SceneView,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.numbers import count, in_one_unit, length, lengths, percent, vector
from aacmm_pin.report.parameters import decimals, parameter_table, readable_parameters

WORTH = 0.05
"""A calibration whose held-out residuals fall by less than this part has not helped."""
MOST_EXCLUDED = 10
MOST_ROWS = 50
"""Excluded records that are listed, in short and on a page; the residuals' file has all."""
KINDS = {"records": "records", "seats": "seats", "sessions": "sessions", "blocks": "blocks of joint space"}
"""What is left out in turn."""


@document_of.register
def calibration_document(result: Calibration, summary: dict[str, Any] | None = None, when: str = "") -> Document:
    """The calibration as a document.

    Args:
        result: the calibration.
        summary: for a page with files: what ``calibrate --json`` writes; its ``data`` is the name of the measurement file.
        when: date of the page (UTC).
    """
    source = "" if summary is None else f" of {summary['data']}, {when} (UTC)"
    return Document(
        f"{result.model.arm.name}: calibration",
        [
            *_result(result),
            *_held_out(result),
            *_residuals(result),
            *_parameters(result),
            *_undetermined(result),
            *_excluded(result),
            *([] if summary is None else _files(result, summary, when)),
        ],
        count(int(result.fit.used.sum()), "record") + source,
    )


def verdict(result: Calibration) -> str:
    """One sentence: whether the calibration helps, by held-out records where there are some."""
    name = result.model.arm.name
    held_out = [size for held in result.held_out[-1:] for size in (held.rms_before, held.rms_after)]
    before, after, *others = lengths([result.rms_before, result.rms, *held_out])
    fitted = f"{before} before, {after} after"
    if not result.held_out:
        return f"{name}: residuals of the records used are {fitted} (RMS); nothing was held out, so this may be optimistic."
    held = result.held_out[-1]
    gain = 1.0 - held.rms_after / held.rms_before
    helps = f"helps {name}" if gain >= WORTH else f"does not help {name}"
    less = f", {percent(gain)} less" if gain >= WORTH else ""
    return (
        f"Calibration {helps}: residuals of held-out {KINDS[held.kind]} are {others[0]} before, "
        f"{others[1]} after (RMS){less}; of the records used, {fitted}."
    )


def fit_in_words(result: Calibration) -> str:
    """What χ² says about the model and the stated noise."""
    judged, p = result.fit.chi2_stated, result.p_value
    if judged is None or p is None:
        if result.fit.stated:
            return "There are no more numbers than parameters, so the fit cannot be judged."
        why = "The noise was not stated in full, so χ² cannot judge the model"
        if not result.fit.scatters:
            return f"{why}; what was stated is enough for these residuals."
        return (
            f"{why}: beyond what was stated the residuals show {length(result.fit.unmodelled)} per coordinate, noise and "
            "errors of the model together."
        )
    numbers = f"χ² = {judged[0]:.0f} with {judged[1]:.0f} degrees of freedom, p = {p:.2g}"
    if p < MISFIT:
        return (
            f"The residuals are larger than the stated noise explains: {numbers}. The model lacks a cause of error, or the "
            "noise is larger than stated; aacmm-pin diagnose looks for the cause."
        )
    if p > 1.0 - MISFIT:
        return f"The residuals are smaller than the stated noise: {numbers}. The noise is stated too large."
    return f"The stated noise explains the residuals: {numbers}."


def frame_in_words(result: Calibration) -> str:
    """Where the base is in the frame of the references; "" where the two are one."""
    if not result.fit.problem.external:
        return ""
    frame = result.fit.solution.point.frame
    x, y, z = (vector(axis, ".6f") for axis in frame.rotation.T)
    angle = np.arccos(np.clip((np.trace(frame.rotation) - 1) / 2, -1, 1)) / DEG
    return (
        f"The origin of the base is at {vector(frame.shift / MM, '.4f')} mm in the frame of the references; the axes of the "
        f"base in that frame are x {x}, y {y}, z {z}, turned by {angle:.4f}°."
    )


def causes_in_words(result: Calibration) -> list[str]:
    """Estimated causes of error with their values, amplitude and phase of a wave such as, ± U (k = 2)."""
    found, vector = [], result.fit.problem.vector
    for effect, own in zip(result.fit.solution.effects, vector.slices, strict=True):
        if vector.of_arm[own.start] is not None:
            continue
        jacobian = effect.described_jacobian()
        u = np.sqrt(np.diag(jacobian @ result.covariance[own, own] @ jacobian.T))
        values = {key: (value, float(s)) for (key, value), s in zip(effect.described().items(), u, strict=True)}
        found.append(f"{in_words(effect)}: {values_in_words(effect, values)}")
    return found


def comment(result: Calibration, data: str, when: str) -> str:
    """The lines in front of a calibrated arm file: from which data, when, how good, and how to read what follows.

    Args:
        result: the calibration.
        data: the file that was used, as the user named it.
        when: date (UTC).
    """
    used, left = count(int(result.fit.used.sum()), "record"), int(result.fit.excluded.sum())
    held = "".join(f", {h.rms_after / MM:.4f} mm on held-out {KINDS[h.kind]}" for h in result.held_out)
    lines = [
        f"Calibrated by aacmm-pin on {when} (UTC) from {data}: {used} used, {left} excluded.",
        f"RMS distance of tip and target: {result.rms_before / MM:.4f} mm before, {result.rms / MM:.4f} mm after{held}.",
        fit_in_words(result),
        *(f"Note: {line}." for line in result.notes),
        *(f"Not determined by these data: {line}." for line in result.undetermined),
        "",
        "How to read it: values are those after calibration. [covariance] holds the standard uncertainties (SI: m, rad)",
        "of the parameters it names, and their correlations: row i is that of parameter i with those before it. It",
        "overrides [joints.uncertainty], the half-widths from before, which stay for parameters that it does not name.",
    ]
    return "\n".join(lines)


def calibration_summary(result: Calibration, data: str, seed: int) -> dict[str, Any]:
    """Schema ``aacmm-pin/calibration/1`` of :meth:`Calibration.summary`, with what it was made from.

    Args:
        result: the calibration.
        data: the measurement file.
        seed: of the generator that chose the held-out records.
    """
    table, summary = parameter_table(result), result.summary()
    for row, width, beyond in zip(summary["parameters"], table["stated"], table["beyond"], strict=True):
        row |= {"stated": None if np.isnan(width) else float(width), "beyond_stated": bool(beyond)}
    frame = result.fit.solution.point.frame
    placement = {"origin_mm": (frame.shift / MM).tolist(), "rotation": frame.rotation.tolist()}
    return summary | {
        "data": data,
        "seed": seed,
        "verdict": verdict(result),
        "base_in_reference_frame": placement if result.fit.problem.external else None,
    }


def _result(result: Calibration) -> list[Block]:
    rows = [("used in the fit", result.rms_before, result.rms)]
    rows += [(f"held-out {KINDS[held.kind]}", held.rms_before, held.rms_after) for held in result.held_out]
    sizes, formats = in_one_unit(pd.DataFrame(rows, columns=["records", "before", "after"]), ["before", "after"])
    return [
        Heading("Result"),
        Paragraph(verdict(result), finding=True),
        fit_in_words(result),
        frame_in_words(result),
        Bullets(causes_in_words(result), "Causes of error, ± U (k = 2):"),
        Table(
            sizes,
            "RMS distance of tip and target",
            formats,
            explained="Before: the arm as it was, only the set-up fitted. The target of a record is its reference; of a "
            "seat, where all its records and its reference together put it. Held-out records are compared with their own "
            f"reference, whose noise they have in full. The noise alone would give {length(result.noise)}.",
        ),
        Notes(result.notes),
    ]


def _held_out(result: Calibration) -> list[Block]:
    if not result.held_out:
        return [Heading("Held-out validation"), Paragraph("Nothing was held out.", detail=True)]
    gains = pd.DataFrame([(KINDS[h.kind], h.groups, 1 - h.rms_after / h.rms_before) for h in result.held_out])
    return [
        Heading("Held-out validation"),
        Paragraph(
            "Every record was predicted once by a calibration that did not use it. Single records, left out at random, have "
            "neighbours that stay in, so their residuals are optimistic; those of whole groups are the ones to rely on.",
            detail=True,
        ),
        Table(
            gains.set_axis(["held out", "parts", "gain"], axis=1),
            "Gain on held-out records",
            {"gain": percent},
            explained="1 - RMS after / RMS before; the records were left out in so many parts, in turn.",
            detail=True,
        ),
    ]


def _residuals(result: Calibration) -> list[Block]:
    from aacmm_pin.report.scenes import calibration_scene  # loads meshcat

    seats = Figure(
        lambda: plots.plot_residuals_by_seat(result, blank_axes(8.0, 3.4)),
        "Residuals by seat",
        "Residuals by seat. A seat that stands out after calibration may not be where it is said to be.",
    )
    return [
        Heading("Residuals"),
        Figure(
            lambda: plots.plot_residual_sizes(result, blank_axes(6.4, 3.4)),
            "Histogram of residuals before and after",
            "Size of the residuals of the records used, before and after calibration; the scale is logarithmic.",
        ),
        Figure(
            lambda: plots.plot_residual_views(result, blank_axes(8.6, 8.0)),
            "Residual vectors in space, before and after",
            "Residuals in space, from each target towards the tip: left before calibration, right after; above in plan, "
            "below from the side; magnified by the factors in the titles, which differ. Grey: the arm in some of its "
            "postures. Neighbours that point the same way show what the model still lacks.",
        ),
        SceneView(
            lambda: calibration_scene(result),
            "Residuals after calibration, to turn: drag to look from elsewhere; the slider goes from the largest residual "
            "to the smallest, with the arm in its posture.",
        ),
        Figure(
            lambda: plots.plot_residuals_over_joints(result, ax=blank_axes(10.5, 0.3 - 2.5 * (-result.model.arm.nq // 3))),
            "Residuals over the angle of each joint",
            "Residuals after calibration, along the direction in which each joint moves the tip, over the angle of that "
            "joint. The line is the mean in parts of the range with its standard uncertainty: a wave in it is an error of "
            "the encoder or the joint.",
        ),
        *([seats] if result.fit.problem.measurements.seats() else []),
        Figure(
            lambda: plots.plot_normalised_residuals(result, blank_axes(6.4, 3.4)),
            "Histogram of normalised residuals against the χ distribution",
            "Residuals over what the noise of each record allows, with the distribution that normal noise has.",
        ),
    ]


def _parameters(result: Calibration) -> list[Block]:
    rows, number = readable_parameters(result), len(result.fit.problem.vector.parameters)
    if not number:
        none = "No parameter was estimated: the arm states all of them to be exact; --no-prior estimates them all the same."
        return [Heading("Parameters"), none]
    beyond, form = rows["beyond"], decimals(rows)
    rows["change"] = [f"{'* ' * b}{change:{form}}" for b, change in zip(beyond, rows["change"], strict=True)]
    moved = "No parameter moved farther than its stated and new uncertainties together allow."
    if rows["stated"].isna().all():
        moved = "No uncertainty was stated for these parameters."
    elif beyond.any():
        moved = (
            f"* moved farther than its stated and new uncertainties together allow: {', '.join(rows['parameter'][beyond])}"
        )
    return [
        Heading("Parameters"),
        Table(
            rows[["parameter", "value", "change", "U", "stated", "in", "known"]],
            "Parameters",
            dict.fromkeys(("stated", "U"), form),
            {"stated": "stated ±", "U": "U (k = 2)"},
            explained="Changes and uncertainties are in the unit of the column in. Known: measured by these data, as stated "
            "(they add nothing to what was known), or in combination with others (next section).",
        ),
        Paragraph(moved, finding=bool(beyond.any()), detail=not beyond.any()),
        Figure(
            lambda: plots.plot_parameter_changes(result, blank_axes(7.0, 1.2 + 0.24 * number)),
            "Change of each parameter over its stated uncertainty",
            "Change of each parameter with its new expanded uncertainty, over its stated uncertainty where there is one.",
        ),
        Figure(
            lambda: plots.plot_correlation(result, blank_axes(min(9.0, 3.0 + 0.22 * number), min(8.2, 2.2 + 0.22 * number))),
            "Heat map of the correlation of the parameters",
            "Correlation of the parameters. Two that are strongly correlated are known together better than each by itself.",
        ),
    ]


def _undetermined(result: Calibration) -> list[Block]:
    observed, names = result.observability, ["o1", "o2", "o3", "o4", "o5"]
    every = Paragraph("These data, or what was stated, determine every parameter.", detail=True)
    return [
        Heading("What these data do not determine"),
        Bullets(result.undetermined, "Not determined by these data or by stated uncertainties, and left as it was:"),
        Paragraph("More records of the same kind do not help; other postures, references or targets may.", detail=True)
        if result.undetermined
        else every,
        Table(
            pd.DataFrame([{name.upper(): getattr(observed, name) for name in names}]),
            "Observability indices",
            {name.upper(): ".3g" for name in names},
            explained=f"Sun, Hollerbach 2008; of the {observed.directions} combinations that the data determine. Larger is "
            "better; they compare one set of postures with another.",
            detail=True,
        ),
    ]


def _excluded(result: Calibration) -> list[Block]:
    silent = int((~result.fit.used & ~result.fit.excluded).sum())
    unused = f"{count(silent, 'record')} not used: no coordinates, and no seat with other records." if silent else ""
    return [Heading("Excluded records"), *excluded_records(result.excluded), unused]


def excluded_records(excluded: pd.DataFrame) -> list[Block]:
    """The table of excluded records, or that there are none."""
    if not len(excluded):
        return [Paragraph("No record was excluded.", detail=True)]
    return [
        Paragraph(
            "A record is excluded where its residual is larger than its noise allows, by a bound that excludes a good "
            "record in one file of a hundred. Possible reasons: a slip of the hand, a wrong seat, a cause that is not in "
            "the model.",
            detail=True,
        ),
        Table(
            excluded.astype({"row": str}),
            f"Excluded records ({len(excluded)})",
            {"residual_mm": ".3f"},
            {"residual_mm": "residual [mm]", "row": "row of the file"},
            most=MOST_EXCLUDED,
            most_on_page=MOST_ROWS,
        ),
    ]


def _files(result: Calibration, summary: dict[str, Any], when: str) -> list[Block]:
    text = "" if result.model.arm.dh is None else arm_text(result.model.file(), comment(result, summary["data"], when))
    return [
        *files(summary, "calibration.json", result.residuals),
        *(
            [Download("calibrated.toml", text.encode(), "application/toml", "the calibrated arm with its covariance")]
            * bool(text)
        ),
    ]


def files(summary: dict[str, Any], name: str, residuals: pd.DataFrame) -> list[Block]:
    """The section of a page that holds its numbers as files."""
    content = json.dumps(summary, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    table = residuals.to_csv(index=False)
    return [
        Heading("Files"),
        "The numbers behind this page are inside it; on screen each name below saves a file.",
        Download(name, content.encode(), "application/json", "all numbers of this page"),
        Download("residuals.csv", table.encode(), "text/csv", "every record with its residuals"),
    ]


@document_of.register
def held_out_document(held: HeldOut) -> Document:
    """Residuals of records held out of one calibration."""
    row = pd.DataFrame({"before": [held.rms_before], "after": [held.rms_after]})
    frame, formats = in_one_unit(row, ["before", "after"])
    words = f"{KINDS[held.kind]}, left out in {count(held.groups, 'part')}"
    return Document(
        "Held out", [Paragraph(words, head="Held out:"), Table(frame, "RMS distance of tip and target", formats)]
    )


@document_of.register
def observability_document(indices: Observability) -> Document:
    """The five indices with their definitions."""
    of = ("(Πσ)^(1/m)/√n [m]", "σ_min/σ_max [1]", "σ_min [m]", "σ_min²/σ_max [m]", "1/Σ(1/σ) [m]")
    values = (indices.o1, indices.o2, indices.o3, indices.o4, indices.o5)
    rows = [
        {"index": f"O{k}", "of the singular values σ": what, "value": value}
        for k, (what, value) in enumerate(zip(of, values, strict=True), 1)
    ]
    words = f"of {count(indices.directions, 'direction')} that the data determine; larger is better"
    return Document(
        "Observability", [Paragraph(words, head="Observability"), Table(pd.DataFrame(rows), "", {"value": ".4g"})]
    )
