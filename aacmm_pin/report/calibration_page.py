"""A calibration as a document: gain, residuals, parameters, files."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, MM, UM, count
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import (
    MISFIT,
    Calibration,
    Exclusions,
    Fit,
    base_is_open,
    base_placements,
    is_of_setup,
    rms,
)
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.effects import (
    ErrorModel,
    in_words,
    listed,
    slides,
    values_in_words,
    values_with_u,
)
from aacmm_pin.report import plots
from aacmm_pin.report.document import (
    NO_NUMBER,
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
from aacmm_pin.report.numbers import (
    length,
    lengths,
    mistakes_in_words,
    other_notes,
    p_equals,
    percent,
    quantity,
    small,
    vector,
)
from aacmm_pin.report.plots.calibration_plots import LEAST_IN_BIN, parameter_table
from aacmm_pin.report.repeated_postures import repeatability_in_json, repeatability_in_words

IN_COMBINATION = "in combination"
"""What the records know of a parameter that they do not determine alone."""
PARAMETER_HEADS = ["parameter", "value", "change ± U (k = 2)", "stated half-width or 2u", "known"]
"""Heads of the table of parameters."""
WORTH = 0.05
"""Least reduction of held-out residuals by a useful calibration."""
EXCLUDED_LISTED = 10
"""Excluded records to list; the file of residuals has all."""
HELD_OUT_KINDS = {
    "records": "records",
    "seats": "seats",
    "sessions": "sessions",
    "blocks": "blocks of joint space",
}
"""Held-out groups in words."""
HOW_TO_READ = (
    "The values in this file are those after calibration.",
    "[covariance] states the standard uncertainties (m or rad) of the parameters that it names,",
    "and their correlations. Row i of these relates parameter i to the parameters before it.",
    "For these parameters, [covariance] replaces the half-widths in [joints.uncertainty].",
)
"""Comment at the beginning of a calibrated arm file."""
COMPARED = (
    "For the residuals before calibration, the fit estimates only an unknown frame or target of "
    "the nominal arm. The target of a record is the reference of the record. If the record is of a "
    "seat, the target is the estimated position of the seat. Calibrations without the held-out "
    "records predict the held-out records. The gain is the reduction of the RMS distance. Prefer "
    "the last row, because single held-out records have neighbours in the fit."
)
NOTHING_ESTIMATED = (
    "The calibration estimated no parameter, because the arm file states all parameters as exact; "
    "to estimate them, use --no-prior."
)
KNOWN = (
    "U is the expanded uncertainty after calibration. If the model lacks a cause of error, U is "
    "too small. The stated half-width is the bound in the arm file. If the arm file states a "
    "standard uncertainty u, the stated half-width is 2u. In the column 'known', 'measured' means "
    "that the records determine the value. 'hardly' means that the arm file determines the value "
    "better than the records. 'as stated' means that the records do not reduce the stated "
    "uncertainty. 'in combination' means that the records determine only a combination with other "
    "parameters (next section)."
)
UNDETERMINED = (
    "These records and the stated uncertainties do not determine the following parameters "
    "separately. The calibrated arm keeps the values of the arm file for the undetermined "
    "combinations. Other postures, references or targets may determine the parameters, but more "
    "records of the same kind do not"
)
EXCLUDED = (
    "The fit excludes a record if its residual exceeds a bound. This bound excludes a good record "
    "in only one of a hundred files. Possible reasons are a faulty contact, a wrong seat label, "
    "and a cause of error that the model lacks."
)


HOW_TO_SEE = (
    "Drag to rotate the view. The slider shows the arm in the posture of each residual, from the "
    "largest residual to the smallest. If neighbouring residuals have the same direction, the "
    "model lacks a cause of error."
)
"""How to read a scene of residuals."""


@document_of.register
def calibration_document(
    result: Calibration, summary: dict[str, Any] | None = None, when: str = ""
) -> Document:
    """The calibration as a document; with the content of ``calibrate --json`` a page with files of
    the date ``when`` (UTC).
    """
    names_frame = any("frame." in line for line in result.undetermined)
    of_frame = ". frame.x to frame.rz are the placement of the base" if names_frame else ""
    blocks = [
        *_result_section(result),
        *_residuals_section(result),
        *_parameters_section(result),
        Heading("What these records do not determine"),
        Bullets(result.undetermined, f"{UNDETERMINED}{of_frame}:"),
        Heading("Excluded records"),
        *excluded_records(result.excluded),
    ]
    subtitle = count(int(result.fit.used.sum()), "record")
    if summary is not None:
        names = ("calibration.json", "calibrated.toml")
        note = comment(result, summary["data"], when)
        blocks += files_section(summary, result.residuals, result.model, names, note)
        subtitle += f" of {summary['data']}, {when} (UTC)"
    return Document(f"{result.model.arm.name}: calibration", blocks, subtitle)


def verdict(result: Calibration) -> str:
    """Whether the calibration helps, by held-out records if possible; doubts first."""
    exclusions, name = result.exclusions, result.model.arm.name
    doubts, on_others = mistakes_in_words(result.notes), ""
    if exclusions.doubtful:
        doubts += f"{exclusions_in_words(exclusions)} Run aacmm-pin diagnose to find the cause. "
        on_others = f" on the other {count(exclusions.used, 'record')}"
    held_out = result.held_out[-1] if result.held_out else None
    if held_out is None:
        before, after = lengths([result.rms_before, result.rms])
        return (
            f"{doubts}For {name}{on_others}, the RMS residual of the used records is {before} "
            f"before and {after} after calibration. No records were held out, and new records may "
            "have larger residuals."
        )
    sizes = [result.rms_before, result.rms, held_out.rms_before, held_out.rms_after]
    before, after, held_before, held_after = lengths(sizes)
    gain = 1.0 - held_out.rms_after / held_out.rms_before
    makes = "makes" if gain >= WORTH else "does not make"
    return (
        f"{doubts}Calibration{on_others} {makes} {name} more accurate: the RMS residual of "
        f"held-out {HELD_OUT_KINDS[held_out.kind]} is {held_before} before and {held_after} after "
        f"calibration (gain {percent(gain)}). The RMS residual of the used records is {before} "
        f"before and {after} after calibration."
    )


def exclusions_in_words(exclusions: Exclusions) -> str:
    """How many records the fit excluded, and why they are no gross errors."""
    records = count(exclusions.excluded + exclusions.used, "record")
    why = "too many for gross errors" if exclusions.too_many else "probably for a common cause"
    return f"The fit excluded {exclusions.excluded} of {records}, {why}."


def fit_in_words(result: Calibration) -> str:
    """Test of the model and the stated noise by χ²."""
    chi2_and_dof, p = result.fit.chi2_stated, result.p_value
    if chi2_and_dof is None or p is None:
        if result.fit.noise_is_stated:
            return (
                "χ² cannot test the fit, because the records have no more measured values than the "
                "model has parameters."
            )
        return (
            "χ² cannot test the model, because you did not state all noise. The fit estimated a "
            f"scatter of {length(result.fit.scatter)} per coordinate."
        )
    numbers = (
        f"(χ² = {chi2_and_dof[0]:.0f} with {chi2_and_dof[1]:.0f} degrees of freedom, {p_equals(p)})"
    )
    if p < MISFIT:
        return (
            f"The residuals exceed the stated noise {numbers}. The model lacks a cause of error, "
            "or the noise is larger than stated; run aacmm-pin diagnose to find the cause."
        )
    if p > 1.0 - MISFIT:
        return (
            f"The residuals are smaller than the stated noise {numbers}. The stated noise is too "
            "large; check its value and unit."
        )
    return f"The stated noise explains the residuals {numbers}."


def frame_in_words(fit: Fit) -> str:
    """Base in the frame of the references or of each session: origin, axes and U; "" if the
    references are in the base, or if the records leave it open.
    """
    assumed = ", ".join(fit.undetermined.tied_to_frame)
    assumption = f" U assumes the values of {assumed} in the arm file." if assumed else ""
    sentences = []
    for base in base_placements(fit):
        x, y, z = (vector(axis, "z.6f") for axis in base.rotation.T)
        angle = Rotation.from_matrix(base.rotation).magnitude() / DEG
        u_origin = vector(COVERAGE_FACTOR * base.u_shift / MM, ".3g")
        u_rotation = vector(COVERAGE_FACTOR * base.u_rotation / UM, ".3g")
        session = f" of session {base.session}" if base.session else ""
        sentences.append(
            f"The origin of the base is at {vector(base.shift / MM, 'z.4f')} mm in the frame of "
            f"the references{session}. In this frame, the axes of the base are x {x}, y {y} and z "
            f"{z}, which is a rotation by {angle:.4f}°. Along and about the axes of the "
            f"references, U (k = 2) is {u_origin} mm for the origin and {u_rotation} µrad for the "
            f"rotation.{assumption}"
        )
    return " ".join(sentences)


def open_in_words(result: Calibration) -> str:
    """What these records do not determine although other postures need it; else ""."""
    combinations = result.fit.undetermined.target_directions.shape[1]
    if not base_is_open(result.fit):
        if not combinations:
            return ""
        several = count(combinations, "combination")
        return f"These records do not determine {several} of parameters that other postures need."
    return (
        "These records do not determine the position of the base in the frame of the references; "
        "use references that are not close to a straight line."
    )


def estimated_causes(result: Calibration) -> pd.DataFrame:
    """Estimated causes of error with their values ± U (k = 2)."""
    vector, arm = result.fit.problem.vector, result.model.arm
    in_combination = result.parameters["known"] == IN_COMBINATION
    rows = []
    for effect, entries in zip(result.fit.effects, vector.slices, strict=True):
        if vector.arm_parameters[entries.start] is None and not is_of_setup(effect):
            values = values_with_u(effect, result.covariance[entries, entries])
            estimate = values_in_words(effect, values, slides(effect, arm))
            if in_combination[entries].any():
                estimate = "determined only in combination with other parameters"
            rows.append({"cause": in_words(effect, arm), "value ± U (k = 2)": estimate})
    return pd.DataFrame(rows)


def comment(result: Calibration, data: str, when: str) -> str:
    """The first comment of a calibrated arm file; ``when`` is a date (UTC)."""
    lines = [f"aacmm-pin wrote this file on {when} (UTC) from {data}.", f"{result}."]
    lines.append(fit_in_words(result))
    lines += [f"Note: {line}." for line in result.notes]
    lines += [f"In these records, {line}." for line in result.undetermined]
    return "\n".join([*lines, "", *HOW_TO_READ])


def calibration_summary(result: Calibration, data: str, seed: int) -> dict[str, Any]:
    """Schema ``aacmm-pin/calibration/1`` of :meth:`Calibration.summary`, with data file and
    seed.
    """
    table = parameter_table(result).rename(columns={"beyond": "beyond_stated"})
    targets = zip(result.fit.problem.targets, result.fit.point.frame.targets, strict=True)
    made_from = {
        "parameters": table,
        "data": data,
        "seed": seed,
        "verdict": verdict(result),
        **bases_in_json(result.fit),
        "left_open": open_in_words(result),
        "repeatability": repeatability_in_json(result.repeatability),
        "targets": [{"marker": label, "rotation": rotation} for label, rotation in targets],
    }
    return result.summary() | dict(plain(made_from))


def bases_in_json(fit: Fit) -> dict[str, Any]:
    """Placement of the base in the references' frame of the first session, and of each other one;
    None and [] if the references are in the base, or if the records do not determine it.
    """
    bases = [
        {
            "session": base.session,
            "origin_mm": base.shift / MM,
            "rotation": base.rotation,
            "u_origin_mm": base.u_shift / MM,
            "u_rotation_rad": base.u_rotation,
        }
        for base in base_placements(fit)
    ]
    for base in bases[:1]:
        base["as_stated"] = fit.undetermined.tied_to_frame
    first = bases[0] if bases else None
    return {"base_in_reference_frame": first, "base_in_other_sessions": bases[1:]}


def _result_section(result: Calibration) -> Iterator[Block]:
    yield Heading("Result")
    yield Paragraph(verdict(result), finding=True)
    yield Paragraph(open_in_words(result), finding=True)
    yield fit_in_words(result)
    yield frame_in_words(result.fit)
    yield Table(estimated_causes(result), "Causes of error")
    noise = "The noise alone"
    if result.fit.has_scatter:
        noise = "The stated noise and the estimated scatter"
    rotations = ("rotation before [µrad]", "rotation after [µrad]")
    sizes = {"records used in the fit": (result.rms_before, result.rms)}
    turns = [(result.turns["nominal"], result.turns["calibrated"])] if result.turns else []
    for held_out in result.held_out:
        name = f"held-out {HELD_OUT_KINDS[held_out.kind]} ({held_out.groups} parts)"
        sizes[name] = (held_out.rms_before, held_out.rms_after)
        if held_out.turned:
            turns.append((rms(held_out.turn_before), rms(held_out.turn_after)))
    table = pd.DataFrame(sizes.values(), columns=["before_mm", "after_mm"]) / MM
    table["gain"] = 1.0 - table["after_mm"] / table["before_mm"]
    table.insert(0, "records", [*sizes])
    if result.turns is not None:
        table[[*rotations]] = np.array(turns) / UM
    of_noise = length(result.noise)
    if result.turns is not None:
        of_noise += f" and {result.turns['noise'] / UM:.1f} µrad"
    yield Table(
        table,
        "RMS distance between tip and target, before and after calibration",
        {"gain": percent, **dict.fromkeys(rotations, ".1f")},
        explained=f"{COMPARED} {noise} would give {of_noise}.",
    )
    yield Notes(other_notes(result.notes))


def _residuals_section(result: Calibration) -> Iterator[Block]:
    yield Heading("Residuals")
    yield scene_of_residuals(result, "after")
    height = 0.3 - 2.5 * (-result.model.arm.nq // 3)
    yield Figure(
        lambda: plots.plot_residuals_over_joints(result, ax=blank_axes(10.5, height)),
        "Residuals over the angle of each joint",
        "Each panel shows residuals after calibration against the angle of one joint, in the "
        "direction in which the joint moves the tip. The line connects means of "
        f"{LEAST_IN_BIN} or more residuals, and the bars show the standard uncertainty u of the "
        "means. A wave indicates an error of the encoder or the joint.",
    )
    if result.fit.problem.measurements.seats():
        yield Figure(
            lambda: plots.plot_residuals_by_seat(result, blank_axes(8.0, 3.4)),
            "Residuals by seat",
            "The dots show the residuals of each seat. If the residuals of a seat are larger after "
            "calibration, the stated coordinates of this seat may be wrong.",
        )
    yield repeatability_in_words(result.repeatability)


def _parameters_section(result: Calibration) -> Iterator[Block]:
    yield Heading("Parameters")
    table = parameter_table(result)
    if not len(table):
        yield NOTHING_ESTIMATED
        return
    rows = []
    in_combination = table["known"] == IN_COMBINATION
    for row in pd.concat([table[~in_combination], table[in_combination]]).to_dict("records"):
        value = quantity(row["after"], row["unit"])
        change = small(row["change"], row["unit"], row["U"])
        if row["known"] == IN_COMBINATION:
            value = change = NO_NUMBER
        stated = small(row["stated"], row["unit"]) if row["stated"] > 0.0 else NO_NUMBER
        change = f"* {change}" if row["beyond"] else change
        rows.append((row["parameter"], value, change, stated, row["known"]))
    yield Table(pd.DataFrame(rows, columns=PARAMETER_HEADS), "Parameters", explained=KNOWN)
    beyond = listed([*table["parameter"][table["beyond"]]])
    if beyond:
        yield Paragraph(
            f"The change of {beyond} (marked *) exceeds the stated half-width plus U. The model "
            "may lack a cause of error; run aacmm-pin diagnose."
        )
    yield Figure(
        lambda: plots.plot_parameter_changes(result, blank_axes(8.2, 1.2 + 0.24 * len(table))),
        "Change of each parameter over its stated uncertainty",
        "The dots show the change of each parameter, and the bars show U (k = 2) after "
        "calibration. The grey band shows the half-widths in the arm file, or U if the arm file "
        "states no half-widths.",
    )


def scene_of_residuals(result: Calibration | Diagnosis, model: str) -> SceneView:
    """The residuals of one model in 3D, see :func:`aacmm_pin.report.scenes.residual_scene`."""
    from aacmm_pin.report.scenes import residual_scene  # loads meshcat

    words = f"The scene shows the residuals ({model})."
    return SceneView(lambda: residual_scene(result, model), f"{words} {HOW_TO_SEE}")


def excluded_records(excluded: pd.DataFrame) -> Iterator[Block]:
    """The table of excluded records, or that there are none."""
    if excluded.empty:
        yield Paragraph("The fit excluded no records.", detail=True)
    yield Table(
        excluded.drop(columns="reason").astype({"row": str}),
        f"Excluded records ({len(excluded)})",
        heads={"row": "file row"},
        explained=EXCLUDED,
        most=EXCLUDED_LISTED,
    )


def files_section(
    summary: dict[str, Any],
    residuals: pd.DataFrame,
    model: ErrorModel,
    names: tuple[str, str],
    note: str,
) -> Iterator[Block]:
    """The section with the files of a page: ``names`` of the JSON and of the arm file, whose
    comment is ``note``.
    """
    of_json, of_arm = names
    yield Heading("Files in this page")
    yield Download(of_json, "all numbers of this page", json_text(summary).encode())
    yield Download("residuals.csv", "residuals of every record", csv_text(residuals).encode())
    from_table = model.arm.dh is not None
    if from_table or model.arm.urdf_file.urdf.file:
        where_to_keep = "" if from_table else "; keep this file in the folder of its URDF"
        words = f"the new arm with its covariance{where_to_keep}"
        yield Download(of_arm, words, model.text(note).encode())
