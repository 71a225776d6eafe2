"""A diagnosis as one self-contained HTML page."""

from __future__ import annotations

import json
from typing import Any

from aacmm_pin._support.units import UM
from aacmm_pin.arm.text import arm_text
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import EncoderSlip, SeatError
from aacmm_pin.report import plots
from aacmm_pin.report.diagnosis_findings import (
    BEYOND,
    LEFT_OUT_SEATS,
    PARTS,
    gain_in_words,
    geometric,
    group_in_words,
    in_words,
    label_in_words,
    labels_in_words,
    line_to_remember,
    listed,
    most_off_in_words,
    noise_in_words,
    parameters_in_words,
    seats_in_words,
    slip_in_words,
    unexplained_in_words,
    verdict_in_words,
)
from aacmm_pin.report.diagnosis_tables import look_alikes, ranking, residuals_table, tip_motion
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
from aacmm_pin.report.plots.diagnosis import shown_models
from aacmm_pin.report.plots.groups import held_out_parts, place_in_words, residuals_by_group
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.scenes import diagnosis_scene

MOST_ROWS = 50
"""Excluded records that the page lists; the residuals' file has all."""
WORST = 8
"""Groups that the table names; the figure has all."""


def diagnosis_page(result: Diagnosis, summary: dict[str, Any], when: str) -> str:
    """The page as HTML: verdict, what is wrong, the causes, how sure they are, the arm, the gain, what stays open, files.

    Args:
        result: the diagnosis.
        summary: what ``diagnose --json`` writes; its ``source`` is the name of the measurement file.
        when: date (UTC).
    """
    sections = [
        Section("What came out", _verdict(result)),
        Section("What the simulation gets wrong", _wrong(result)),
        Section("The causes", _causes(result)),
        Section("How sure the causes are", _ranking(result)),
        Section("Residuals on the arm", _on_the_arm(result)),
        Section("On records it never saw", _held_out(result)),
        Section("What no cause explains, and records left out", _unexplained(result)),
        Section("What to measure next", _next(result)),
        Section("Files", _files(result, summary, when)),
    ]
    subtitle = f"{int(result.extended.used.sum())} records of {summary['source']}, {when} (UTC)"
    return render_report(f"{result.model.arm.name}: diagnosis", subtitle, sections)


def _verdict(result: Diagnosis) -> list[Part]:
    return [
        Paragraph(verdict_in_words(result), finding=True),
        Paragraph(line_to_remember(result), finding=True),
        Picture.of(
            plots.plot_rms(result, blank_axes(6.8, 2.0)),
            "RMS of the residuals by the three models",
            "Residuals of the records, set-up fitted: by the arm as it was simulated; with its geometry recalibrated; and "
            "extended by the causes found. The dashed line is what the noise of readings and references gives by itself.",
        ),
        *filter(None, [noise_in_words(result), seats_in_words(result)]),
    ]


def _wrong(result: Diagnosis) -> list[Part]:
    table = residuals_by_group(result)
    table["where"] = [place_in_words(by, group) for by, group in zip(table["by"], table["group"], strict=True)]
    worst = table.sort_values("times_predicted", ascending=False).head(WORST).reset_index(drop=True)
    names = ["where", "records", "simulation_mm", "predicted_mm", "times_predicted", "recalibrated_mm", "extended_mm"]
    heads = {name: f"{name.removesuffix('_mm')} [mm]" for name in [*names, "noise_mm"] if name.endswith("_mm")}
    return [
        Paragraph(most_off_in_words(result, table), finding=bool((table["times_predicted"] > BEYOND).any())),
        Picture.of(
            plots.plot_groups(result, blank_axes(9.3, 0.5 - 2.2 * (-table["by"].nunique() // 3)))[0],
            "RMS of the residuals by joint range, time, temperature and seat, by the three models",
            "RMS of the residuals in parts of all that is known of the records. Black: the simulation, to be compared with "
            "the dashed line, what its stated uncertainties and the noise predict. Grey and blue: recalibrated and "
            "extended, to be compared with the dotted line, the noise alone. What stays above it there is not explained.",
        ),
        Table(
            worst[[*names, "noise_mm"]],
            f"The {len(worst)} parts where the simulation is farthest off, in times what was predicted of it.",
            dict.fromkeys(heads, ".4f") | {"times_predicted": ".1f"},
            heads | {"times_predicted": "times predicted"},
        ),
    ]


def _causes(result: Diagnosis) -> list[Part]:
    if not result.findings:
        return ["No cause of the library is in these records beyond doubt, and none was added to the model."]
    state = state_of(result.extended)
    parts: list[Part] = []
    for finding in result.findings:
        words = in_words(finding.effect)
        if geometric(result, finding):
            continue
        if not isinstance(finding.effect, SeatError) and is_constant(finding.effect, state):
            parts.append(f"{_capital(words)}: {parameters_in_words(finding)}. {_moves(result, finding)}")
            continue
        drawn = plots.plot_cause(result, finding, blank_axes(7.4, 4.0))
        caption = f"{_capital(words)}: {parameters_in_words(finding)}. {_moves(result, finding)}"
        if isinstance(finding.effect, EncoderSlip):
            caption += f" {slip_in_words(result, finding.effect)}"
        parts.append(Picture.of(drawn, f"{_capital(words)}, from the records", caption))
    if any(isinstance(part, Picture) for part in parts):
        parts.insert(
            0,
            "Dots are records: what each says of the cause by itself, once everything else in the extended model is as "
            "fitted (partial residuals). Circles are their weighted means with standard uncertainties, and the line is the "
            "cause as fitted. Circles that follow the line are the evidence; circles that leave it are something else. "
            "Values stand with U (k = 2).",
        )
    if count := sum(geometric(result, f) for f in result.findings):
        drawn = plots.plot_geometry(result, blank_axes(7.4, 1.4 + 0.45 * count))
        caption = (
            "Geometric values that these records move farther than was stated of them. Recalibration mends them, and the "
            "extended model has them."
        )
        parts.append(Picture.of(drawn, "Geometric values beyond their stated uncertainty", caption))
    return parts


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def _moves(result: Diagnosis, finding: Finding) -> str:
    what = "It moves the stated place" if finding.effect.of_reference else "It moves the tip"
    return f"{what} by {tip_motion(result, finding) / UM:.0f} µm (RMS over all records)."


def _ranking(result: Diagnosis) -> list[Part]:
    parts: list[Part] = []
    if result.findings:
        caption = (
            "Causes, strongest first; geometric values last. At the tip: what the cause does, RMS over all records. "
            "Probability: of this cause against its look-alikes and none. p: chance that the best of all causes looks as "
            "good when none is there. Retained: part of the cause that a recalibration leaves."
        )
        parts.append(Table(ranking(result), caption, {"at the tip [µm]": ".0f", "retained": ".2f"}))
    if len(alike := look_alikes(result)):
        caption = (
            "What looks like them: correlation r of the two in these records, geometry refitted, and probability of the "
            "other cause in its place. With r near 1 either fits, and the probability rests on fewer values or likelier "
            "sizes."
        )
        parts.append(Table(alike, caption, {"r": ".2f"}))
    if result.cannot_tell_apart:
        found = {f.label for f in result.findings}
        groups = sorted(result.cannot_tell_apart, key=lambda group: not found & set(group))
        parts += [
            "Whatever the residuals are, these records cannot tell the causes of one line apart:",
            Bullets([f"{_capital(listed([label_in_words(label) for label in group]))}." for group in groups]),
        ]
        named = [f.label for f in result.findings if any(f.label in group for group in groups)]
        if named:
            parts.append(
                f"{_capital(listed([label_in_words(n) for n in named]))} stands in such a line: physical priors on its size "
                "may prefer it, the shape of the residuals hardly does."
            )
    return parts or ["Nothing was found, and all causes that could be there look different in these records."]


def _on_the_arm(result: Diagnosis) -> list[Part]:
    left, right = shown_models(result)
    return [
        Picture.of(
            plots.plot_arm_residuals(result, blank_axes(8.6, 8.0))[0],
            f"Residual vectors on a drawing of the arm, {left} and {right}",
            f"Residuals in space, from each stated place towards the tip: left {left}, right {right}; above in plan, below "
            "from the side; all magnified alike. Grey: the arm in some of its postures, joints as dots. Neighbours that "
            "point the same way show what a model lacks; noise points anywhere.",
        ),
        SceneView(
            diagnosis_scene(result, shown_models(result)[0]),
            f"The residuals of the {shown_models(result)[0]} arm to turn: drag to look from elsewhere; the slider goes from "
            "the largest to the smallest, with the arm as it stood.",
        ),
    ]


def _held_out(result: Diagnosis) -> list[Part]:
    if result.held_out is None:
        return [gain_in_words(result)]
    table = held_out_parts(result)
    table["chosen"] = [
        labels_in_words({label: label_in_words(label) for label in chosen}) or "nothing" for chosen in table["chosen"]
    ]
    parts: list[Part] = [
        Paragraph(gain_in_words(result), finding=True),
        f"{_capital(PARTS[result.held_out.kind])} were left out in turn, of the choice of causes as well, and then "
        "predicted by what the other records gave. Gain = 1 - RMS extended / RMS recalibrated."
        f"{' ' + LEFT_OUT_SEATS if result.held_out.kind == 'seats' else ''}",
    ]
    return [
        *parts,
        Picture.of(
            plots.plot_held_out(result, blank_axes(7.2, 3.4)),
            "RMS of each part that was left out, recalibrated and extended",
            "RMS of the records of each part, predicted by models that never saw them.",
        ),
        Table(
            table,
            "What was chosen without each part. A cause that is chosen every time does not hang on a few records.",
            {"recalibrated_mm": ".4f", "extended_mm": ".4f", "gain": "z.0%"},
            {
                "part": "left out",
                "recalibrated_mm": "recalibrated [mm]",
                "extended_mm": "extended [mm]",
                "chosen": "chosen without it",
            },
        ),
    ]


def _unexplained(result: Diagnosis) -> list[Part]:
    open_ = result.unexplained
    parts: list[Part] = [Paragraph(unexplained_in_words(result), finding=bool(open_.depends_on))]
    parts += [group_in_words(group) for group in open_.groups]
    for name in open_.shapes:
        drawn = plots.plot_unexplained(result, name, blank_axes(7.4, 4.0))
        caption = f"Over {name}: {open_.acts_on[name]}, by so much. Dots: what each record says of it."
        parts.append(Picture.of(drawn, f"Structure over {name} without a known cause", caption))
    return [*parts, *_excluded(result)]


def _excluded(result: Diagnosis) -> list[Part]:
    excluded = result.excluded
    if not len(excluded):
        return ["No record was excluded."]
    count = len(excluded)
    text = f"{count} {'record' if count == 1 else 'records'} that cannot belong even with the causes known"
    return [
        Table(
            excluded.head(MOST_ROWS).astype({"row": str}).reset_index(drop=True),
            text + (f", the first {MOST_ROWS}." if count > MOST_ROWS else "."),
            {"residual_mm": ".3f"},
            {"residual_mm": "residual [mm]", "row": "row of the file"},
        )
    ]


def _next(result: Diagnosis) -> list[Part]:
    text = _capital(result.next_measurements)
    parts: list[Part] = [Paragraph(f"{text}.", finding=True)]
    if result.notes:
        parts += ["What was assumed or found beside:", Bullets([f"{_capital(note)}." for note in result.notes])]
    return parts


def _files(result: Diagnosis, summary: dict[str, Any], when: str) -> list[Part]:
    content = json.dumps(summary, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    files: list[Part] = [
        Download("diagnosis.json", content.encode(), "application/json", "the verdict and its numbers"),
        Download(
            "residuals.csv", residuals_table(result).to_csv(index=False).encode(), "text/csv", "every record, by each model"
        ),
    ]
    if result.model.arm.dh is not None:
        comment = f"Extended by aacmm-pin diagnose on {when} (UTC) from {summary['source']}: {result}"
        text = arm_text(result.model.file(), comment)
        what = "the extended arm: recalibrated geometry, causes, covariance"
        files.append(Download("extended.toml", text.encode(), "application/toml", what))
    return ["The numbers behind this page are inside it; on screen each name below saves a file.", *files]
