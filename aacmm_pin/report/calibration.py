"""A calibration as a document: does it help, residuals, parameters, what the data do not determine,
files.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.calibration.shared_exclusions import Exclusions
from aacmm_pin.calibration.solver import MISFIT
from aacmm_pin.effects import ErrorModel, in_words, listed, slides, values_in_words, values_with_u
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
from aacmm_pin.report.numbers import count, length, lengths, p_equals, percent, vector
from aacmm_pin.report.parameters import decimals, parameter_table, readable_parameters
from aacmm_pin.report.plots.calibration import LEAST_IN_BIN

WORTH = 0.05
"""A calibration whose held-out residuals fall by less than this part has not helped."""
COLLINEAR = 0.01
"""Points whose distance from a straight line is less than this part of their extent along it are
called collinear.
"""
MOST_EXCLUDED = 10
"""Excluded records that are listed; the residuals' file has all."""
KINDS = {
    "records": "records",
    "seats": "seats",
    "sessions": "sessions",
    "blocks": "blocks of joint space",
}
"""What is left out in turn."""


@document_of.register
def calibration_document(
    result: Calibration, summary: dict[str, Any] | None = None, when: str = ""
) -> Document:
    """The calibration as a document.

    Args:
        result: the calibration.
        summary: for a page with files: what ``calibrate --json`` writes; its ``data`` is the name
            of the measurement file.
        when: date of the page (UTC).
    """
    source = "" if summary is None else f" of {summary['data']}, {when} (UTC)"
    return Document(
        f"{result.model.arm.name}: calibration",
        [
            *_result(result),
            *_residuals(result),
            *_parameters(result),
            *_undetermined(result),
            Heading("Excluded records"),
            *excluded_records(result.excluded),
            *([] if summary is None else _files(result, summary, when)),
        ],
        count(int(result.fit.used.sum()), "record") + source,
    )


def verdict(result: Calibration) -> str:
    """Whether the calibration helps, by held-out records where there are some; first, if that is
    so, that it rests on a part of the records, because what was excluded are no gross errors.
    """
    left = result.exclusions
    doubts = (
        f"{exclusions_in_words(left)} aacmm-pin diagnose looks for the cause. "
        if left.doubtful
        else ""
    )
    rest = f" on the other {count(left.used, 'record')}" if doubts else ""
    held = result.held_out[-1:]
    sizes = [
        result.rms_before,
        result.rms,
        *(size for h in held for size in (h.rms_before, h.rms_after)),
    ]
    before, after, *others = lengths(sizes)
    fitted = f"of the records used {before} before, {after} after (RMS)"
    if not held:
        unknown = "nothing was held out, so this may be optimistic"
        return f"{doubts}{result.model.arm.name}{rest}: residuals {fitted}; {unknown}."
    gain = 1.0 - held[0].rms_after / held[0].rms_before
    helps = "helps" if gain >= WORTH else "does not help"
    return (
        f"{doubts}Calibration{rest} {helps} {result.model.arm.name}: residuals of held-out "
        f"{KINDS[held[0].kind]} "
        f"{others[0]} before, {others[1]} after (gain {percent(gain)}); {fitted}."
    )


def exclusions_in_words(left: Exclusions) -> str:
    """Why excluded records are no gross errors."""
    why = ["too many for gross errors"] if left.too_many else []
    if left.shared is not None:
        many = "all" if left.shared.excluded == left.excluded else str(left.shared.excluded)
        why.append(f"{many} of them have {left.shared.where}")
    if left.narrowed:
        joints = listed([str(each.joint) for each in left.narrowed])
        why.append(
            f"the others move joint{'s' * (len(left.narrowed) > 1)} {joints} over a small part of "
            "the range"
        )
    excluded = f"{left.excluded} of {count(left.excluded + left.used, 'record')} were excluded"
    return f"{excluded}: {', and '.join(why)}."


def fit_in_words(result: Calibration) -> str:
    """What χ² says about the model and the stated noise."""
    judged, p = result.fit.chi2_stated, result.p_value
    if judged is None or p is None:
        if result.fit.stated:
            return "There are no more numbers than parameters, so the fit cannot be judged."
        return (
            "The noise was not stated in full, so χ² cannot judge the model; beyond what was "
            "stated the residuals show "
            f"{length(result.fit.unmodelled)} per coordinate."
        )
    numbers = f"χ² = {judged[0]:.0f} with {judged[1]:.0f} degrees of freedom, {p_equals(p)}"
    if p < MISFIT:
        return (
            f"The residuals are larger than the stated noise explains: {numbers}. The model lacks "
            "a cause of error, or the "
            "noise is larger than stated; aacmm-pin diagnose looks for the cause."
        )
    if p > 1.0 - MISFIT:
        return (
            f"The residuals are smaller than the stated noise: {numbers}. The noise is stated "
            "too large."
        )
    return f"The stated noise explains the residuals: {numbers}."


def frame_in_words(result: Calibration) -> str:
    """Where the base is in the frame of the references; "" where the two are one, or the records do
    not determine it.
    """
    if result.base_u is None:
        return ""
    frame, (shift, turn) = result.fit.point.frame, result.base_u
    x, y, z = (vector(axis, ".6f") for axis in frame.rotation.T)
    angle = np.arccos(np.clip((np.trace(frame.rotation) - 1) / 2, -1, 1)) / DEG
    held = ", ".join(result.fit.undetermined.tied_to_frame)
    expanded = (
        f"{vector(COVERAGE_FACTOR * shift / MM, '.3g')} mm and "
        f"{vector(COVERAGE_FACTOR * turn / UM, '.3g')} µrad"
    )
    return (
        f"The origin of the base is at {vector(frame.shift / MM, '.4f')} mm in the frame of the "
        "references. The axes of the "
        f"base in that frame are x {x}, y {y}, z {z}, rotated by {angle:.4f}°. U (k = 2) of "
        "origin and rotation along the "
        f"axes of the references: {expanded}{f', with {held} as the arm has them' if held else ''}."
    )


def open_in_words(result: Calibration) -> str:
    """What these records leave open that matters at other postures; "" where they determine all of
    that.
    """
    combinations = result.fit.undetermined.target_directions.shape[1]
    if not (combinations or result.base_is_open):
        return ""
    words = (
        "These records do not determine where the base is in the frame of the references."
        if result.base_is_open
        else f"These records leave {count(combinations, 'combination')} of parameters open that "
        "other postures need."
    )
    records = result.fit.problem.measurements
    across, along = _extents(records.reference[result.fit.used & records.known])
    if result.base_is_open and across < COLLINEAR * along:
        words += (
            f" The references lie on one straight line: RMS {length(across)} from it, "
            f"{length(along)} along it."
        )
    return words


def _extents(points: Array) -> tuple[float, float]:
    """RMS distance of points (n, 3) from the straight line that fits them best, and RMS extent
    along it [m].
    """
    if not len(points):
        return 0.0, 0.0
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    return float(np.linalg.norm(sizes[1:])), float(sizes[0])


def estimated_causes(result: Calibration) -> pd.DataFrame:
    """Estimated causes of error with their values, amplitude and phase of a wave such as, ± U
    (k = 2) where there is one.
    """
    vector, together = result.fit.problem.vector, result.parameters["known"] == "in combination"
    rows = [
        {
            "cause": in_words(effect, result.model.arm),
            "value ± U (k = 2)": "known in combination with others only"
            if together[own].any()
            else values_in_words(
                effect,
                values_with_u(effect, result.covariance[own, own]),
                slides(effect, result.model.arm),
            ),
        }
        for effect, own in zip(result.fit.effects, vector.slices, strict=True)
        if vector.of_arm[own.start] is None
    ]
    return pd.DataFrame(rows)


def comment(result: Calibration, data: str, when: str) -> str:
    """The lines in front of a calibrated arm file: from which data, when, how good, and how to read
    what follows.

    Args:
        result: the calibration.
        data: the file that was used, as the user named it.
        when: date (UTC).
    """
    lines = [
        f"Calibrated by aacmm-pin on {when} (UTC) from {data}: {result}",
        fit_in_words(result),
        *(f"Note: {line}." for line in result.notes),
        *(f"Not determined by these data: {line}." for line in result.undetermined),
        "",
        "How to read it: values are those after calibration. [covariance] holds the standard "
        "uncertainties (SI: m, rad)",
        "of the parameters it names, and their correlations: row i is that of parameter i with "
        "those before it. It",
        "overrides [joints.uncertainty], the half-widths from before, which stay for parameters "
        "that it does not name.",
    ]
    return "\n".join(lines)


def calibration_summary(result: Calibration, data: str, seed: int) -> dict[str, Any]:
    """Schema ``aacmm-pin/calibration/1`` of :meth:`Calibration.summary`, with what it was made
    from.

    Args:
        result: the calibration.
        data: the measurement file.
        seed: of the generator that chose the held-out records.
    """
    table, summary = parameter_table(result), result.summary()
    for row, width, beyond in zip(
        summary["parameters"], table["stated"], table["beyond"], strict=True
    ):
        row |= {"stated": None if np.isnan(width) else float(width), "beyond_stated": bool(beyond)}
    frame = result.fit.point.frame
    return summary | {
        "data": data,
        "seed": seed,
        "verdict": verdict(result),
        "base_in_reference_frame": _placement(result),
        "left_open": open_in_words(result),
        "targets": [
            {"marker": label, "rotation": rotation.tolist()}
            for label, rotation in zip(result.fit.problem.targets, frame.targets, strict=True)
        ],
    }


def _placement(result: Calibration) -> dict[str, Any] | None:
    """Where the base is, with u; None where that is known without, or not determined."""
    if result.base_u is None:
        return None
    frame, (shift, turn) = result.fit.point.frame, result.base_u
    return {
        "origin_mm": (frame.shift / MM).tolist(),
        "rotation": frame.rotation.tolist(),
        "u_origin_mm": (shift / MM).tolist(),
        "u_rotation_rad": turn.tolist(),
        "as_stated": list(result.fit.undetermined.tied_to_frame),
    }


def _result(result: Calibration) -> list[Block]:
    rows = [("used in the fit", result.rms_before, result.rms)]
    rows += [
        (f"held-out {KINDS[h.kind]}, in {h.groups} parts", h.rms_before, h.rms_after)
        for h in result.held_out
    ]
    sizes = pd.DataFrame(rows, columns=["records", "before_mm", "after_mm"])
    sizes["gain"] = 1.0 - sizes["after_mm"] / sizes["before_mm"]
    turned = [("used in the fit", t["simulation"], t["calibrated"])] if (t := result.turns) else []
    turned += [
        (f"held-out {KINDS[h.kind]}", rms(h.turn_before), rms(h.turn_after))
        for h in result.held_out
        if h.turned
    ]
    turns = pd.DataFrame(turned, columns=["records", "before [µrad]", "after [µrad]"])
    turns.iloc[:, 1:] /= UM
    silent = int((~result.fit.used & ~result.fit.excluded).sum())
    noise = (
        "The stated noise, and the scatter found beside it,"
        if result.fit.scatters
        else "The noise alone"
    )
    return [
        Heading("Result"),
        Paragraph(verdict(result), finding=True),
        Paragraph(open_in_words(result), finding=True),
        fit_in_words(result),
        frame_in_words(result),
        Table(estimated_causes(result), "Causes of error"),
        Table(
            sizes.assign(before_mm=sizes["before_mm"] / MM, after_mm=sizes["after_mm"] / MM),
            "RMS distance of tip and target",
            {"gain": percent},
            explained="Before: the arm as it was, only the set-up fitted. The target of a record "
            "is its reference; of a "
            "seat, where all its records and its reference together put it. Held-out records were "
            "predicted by calibrations "
            "that did not use them, and are compared with their own reference. Single records "
            "have neighbours that stay in; "
            f"rely on whole groups. {noise} would give {length(result.noise)}.",
        ),
        Table(
            turns,
            "RMS turn from the stated orientation",
            dict.fromkeys(turns.columns[1:], ".1f"),
            explained=f"{noise} would give {t['noise'] / UM:.1f} µrad." if t else "",
        ),
        f"{count(silent, 'record')} not used: no coordinates, and no seat with other records."
        if silent
        else "",
        Notes(result.notes),
    ]


def _residuals(result: Calibration) -> list[Block]:
    from aacmm_pin.report.scenes import residual_scene  # loads meshcat

    seats = Figure(
        lambda: plots.plot_residuals_by_seat(result, blank_axes(8.0, 3.4)),
        "Residuals by seat",
        "Residuals by seat. A seat that stands out after calibration may not be where it is "
        "said to be.",
    )
    return [
        Heading("Residuals"),
        Figure(
            lambda: plots.plot_residual_views(result, blank_axes(8.6, 8.0)),
            "Residual vectors in space, before and after",
            "Residuals from each target towards the tip: left before calibration, right after; "
            "above in plan, below from "
            "the side; all magnified alike. Grey: the arm in some postures. Neighbours that point "
            "the same way show what "
            "the model still lacks.",
        ),
        SceneView(
            lambda: residual_scene(result),
            "Residuals after calibration, to turn: drag to look from elsewhere; the slider goes "
            "from the largest residual "
            "to the smallest, with the arm in its posture.",
        ),
        Figure(
            lambda: plots.plot_residuals_over_joints(
                result, ax=blank_axes(10.5, 0.3 - 2.5 * (-result.model.arm.nq // 3))
            ),
            "Residuals over the angle of each joint",
            "Residuals after calibration, along the direction in which each joint moves the tip, "
            "over its angle; the line "
            f"joins means of {LEAST_IN_BIN} or more with u. A wave in it is an error of the "
            "encoder or the joint.",
        ),
        *([seats] if result.fit.problem.measurements.seats() else []),
        Figure(
            lambda: plots.plot_normalised_residuals(result, blank_axes(6.4, 3.4)),
            "Histogram of normalised residuals against the χ distribution",
            "Residuals over what the noise of each record allows, with the distribution that "
            "normal noise has.",
        ),
    ]


def _parameters(result: Calibration) -> list[Block]:
    rows, number = readable_parameters(result), len(result.fit.problem.vector.parameters)
    if not number:
        none = (
            "No parameter was estimated: the arm states all of them to be exact; --no-prior "
            "estimates them all the same."
        )
        return [Heading("Parameters"), none]
    form = decimals(rows)
    tallest = number if rows["stated"].notna().any() else rows["in"].str[1:].value_counts().max()
    rows["change"] = [
        "–" if np.isnan(change) else f"{'* ' * beyond}{change:{form}}"
        for beyond, change in zip(rows["beyond"], rows["change"], strict=True)
    ]
    beyond = ", ".join(rows["parameter"][rows["beyond"]])
    in_order = rows.sort_values("known", key=lambda known: known == "in combination", kind="stable")
    return [
        Heading("Parameters"),
        Table(
            in_order[["parameter", "value", "change", "U", "stated", "in", "known"]],
            "Parameters",
            dict.fromkeys(("stated", "U"), form),
            {"stated": "stated ±", "U": "U (k = 2)"},
            explained="Changes and uncertainties are in the unit of the column in. Known: "
            "measured by these data, as stated "
            "(they add nothing to what was known), or in combination with others (next section). "
            "A parameter known in "
            "combination has no value by itself; the arm file holds one that fits the others.",
        ),
        f"* moved farther than stated ± and U together: {beyond}" if beyond else "",
        Figure(
            lambda: plots.plot_parameter_changes(result, blank_axes(8.2, 1.2 + 0.24 * tallest)),
            "Change of each parameter over its stated uncertainty",
            "Change of each parameter with its new expanded uncertainty, over its stated "
            "uncertainty where there is one.",
        ),
        Figure(
            lambda: plots.plot_correlation(
                result, blank_axes(min(9.0, 3.0 + 0.22 * number), min(8.2, 2.2 + 0.22 * number))
            ),
            "Heat map of the correlation of the parameters",
            "Correlation of the parameters. Two that are strongly correlated are known together "
            "better than each by itself.",
        ),
    ]


def _undetermined(result: Calibration) -> list[Block]:
    indices = pd.DataFrame([vars(result.observability)]).rename(columns=str.upper)
    return [
        Heading("What these data do not determine"),
        Bullets(
            result.undetermined,
            "Not determined by these data or by stated uncertainties, and left as it was; other "
            "postures, references or "
            "targets may determine it, more records of the same kind do not:",
        ),
        Table(
            indices.drop(columns="DIRECTIONS"),
            "Observability indices",
            explained=f"Sun, Hollerbach 2008; of {result.observability.directions} combinations "
            "that the data determine. "
            "Larger is better.",
            detail=True,
        ),
    ]


def excluded_records(excluded: pd.DataFrame) -> list[Block]:
    """The table of excluded records, or that there are none."""
    return [
        Paragraph("" if len(excluded) else "No record was excluded.", detail=True),
        Table(
            excluded.astype({"row": str}),
            f"Excluded records ({len(excluded)})",
            heads={"row": "row of the file"},
            explained="A record is excluded where its residual is larger than its noise allows, "
            "by a bound that excludes a "
            "good record in one file of a hundred. Possible reasons: a slip of the hand, a wrong "
            "seat, a cause that is not "
            "in the model.",
            most=MOST_EXCLUDED,
        ),
    ]


def _files(result: Calibration, summary: dict[str, Any], when: str) -> list[Block]:
    note = comment(result, summary["data"], when)
    return files(
        summary, result.residuals, result.model, ("calibration.json", "calibrated.toml"), note
    )


def files(
    summary: dict[str, Any],
    residuals: pd.DataFrame,
    model: ErrorModel,
    names: tuple[str, str],
    note: str,
) -> list[Block]:
    """The section of a page that holds its numbers as files.

    Args:
        summary: what the command writes as JSON.
        residuals: of every record.
        model: the arm as found.
        names: of the JSON and of the arm file.
        note: the lines in front of the arm file.
    """
    blocks: list[Block] = [
        Heading("Files"),
        Paragraph(
            "The numbers behind this page are inside it; on screen each name below saves a file."
        ),
        Download(names[0], "all numbers of this page", json_text(summary).encode()),
        Download("residuals.csv", "every record with its residuals", csv_text(residuals).encode()),
    ]
    if model.arm.dh is not None or model.arm.urdf_file.urdf.file:
        beside = "" if model.arm.dh is not None else ", to be kept beside its URDF"
        blocks.append(
            Download(
                names[1],
                f"the arm as found, with its covariance{beside}",
                model.text(note).encode(),
            )
        )
    return blocks
