"""Compute the tour, write it, and say what was found."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from aacmm_pin._support.output_files import whole_folder
from aacmm_pin._support.units import ARCSEC, UM
from aacmm_pin.arm.urdf_writer import urdf_text
from aacmm_pin.report.demo.diagnosed import diagnosed_sections
from aacmm_pin.report.demo.hidden import Hidden, hidden_section
from aacmm_pin.report.demo.in_short import in_short
from aacmm_pin.report.demo.paper import paper_sections, ratio_text
from aacmm_pin.report.demo.sections import about_accuracy, about_arm, about_assumptions, about_map, about_postures
from aacmm_pin.report.demo.study import SEED, Study, make_study
from aacmm_pin.report.diagnosis_findings import in_words, line_to_remember, several_in_words
from aacmm_pin.report.html import Download, Part, Section, render_report
from aacmm_pin.report.summaries import accuracy_summary, map_summary


@dataclass(frozen=True)
class DemoSummary:
    """What the tour found and where it was written.

    Attributes:
        folder: where the files are.
        files: their names.
        findings: one sentence each.
        accuracy: content of accuracy.json.
        map: content of map.json.
        seconds: time that all took.
    """

    folder: Path
    files: tuple[str, ...]
    findings: tuple[str, ...]
    accuracy: dict[str, Any]
    map: dict[str, Any]
    seconds: float

    def __str__(self) -> str:
        end = f"{len(self.files)} files in {self.seconds:.0f} s; the page is {self.folder / 'index.html'}"
        return "\n".join([*self.findings, end])


def run_demo(
    arm_name: str = "sino6",
    folder: Path = Path("out"),
    force: bool = False,
    progress: bool = True,
    cells: tuple[int, int] = (48, 48),
    sectors: int = 12,
) -> DemoSummary:
    """Compute the tour and write it to ``folder``: index.html, the files behind it, all pictures as PNG.

    The working point is the first one that the paper measured (its Table 3), for the wrist.

    Args:
        arm_name: bundled arm or arm file; it needs uncertainties.
        folder: where to write; whole or not at all.
        force: replace files of the same names.
        progress: show bars in a notebook, or on stderr at a terminal.
        cells: cells of the map along x and z.
        sectors: sectors of the configuration circle.

    Raises:
        OutputError: the folder cannot be used.
        UnknownNameError, ArmFileError: the arm cannot be read.
        AacmmError: the arm states no uncertainty, or cannot reach the point within its limits.
    """
    started = time.perf_counter()
    folder = Path(folder)
    with whole_folder(folder, force) as out:
        study = make_study(arm_name, progress, cells, sectors)
        accuracy = accuracy_summary(study.circle, study.accuracy, sectors)
        over_map = map_summary(study.map)
        downloads = _write_data(study, accuracy, over_map, out)
        sections = [
            Section("In short", in_short(study, accuracy)),
            Section("What this arm is", about_arm(study)),
            Section("Postures at the working point", about_postures(study, out)),
            Section("Accuracy at the working point, and why", about_accuracy(study, accuracy, out)),
            Section("Over the workspace", about_map(study, out)),
            hidden_section(study.hidden, out, f"{datetime.now(UTC):%Y-%m-%d}"),
            *paper_sections(study, out),
            *diagnosed_sections(study, out),
            Section("What is assumed, and what is left out", about_assumptions(study)),
            Section("Files", [_files_text(), *downloads]),
        ]
        page = render_report(
            f"{study.arm.name}: postures, accuracy, diagnosis", f"Geometry and uncertainties: {study.arm.source}", sections
        )
        (out / "index.html").write_text(page, encoding="utf-8")
        files = tuple(sorted(path.name for path in out.iterdir()))
    seconds = time.perf_counter() - started
    return DemoSummary(folder, files, _findings(study, accuracy), accuracy, over_map, seconds)


def _write_data(study: Study, accuracy: dict[str, Any], over_map: dict[str, Any], out: Path) -> list[Download]:
    urdf = f"{study.arm.name.lower()}.urdf"
    (out / urdf).write_text(urdf_text(study.arm_file), encoding="utf-8")
    study.circle.to_frame().to_csv(out / "configurations.csv", index=False)
    for name, content in (("accuracy.json", accuracy), ("map.json", over_map)):
        text = json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2)
        (out / name).write_text(text + "\n", encoding="utf-8")
    study.map.save(out / "map.nc")
    described = (
        (urdf, "application/xml", "the arm for Pinocchio and other robotics programs, lengths in metres"),
        ("configurations.csv", "text/csv", "every configuration at the working point, angles in degrees"),
        ("accuracy.json", "application/json", "accuracy at the working point"),
        ("map.nc", "application/x-netcdf", "the map, cell by cell (netCDF)"),
        ("map.json", "application/json", "summary of the map"),
    )
    return [Download(name, (out / name).read_bytes(), media, text) for name, media, text in described]


def _files_text() -> Part:
    return "The numbers behind this page are inside it; on screen each name below saves a file."


def _findings(study: Study, summary: dict[str, Any]) -> tuple[str, ...]:
    volume, u = summary["volume_mm3"], study.accuracy.u / UM
    counts = study.map.working_sectors()
    deviation = study.accuracy.largest_deviation / UM
    budget = study.accuracy.budget().head(3)
    largest = ", ".join(f"{row['parameter']} {100 * row['share']:.0f} %" for row in budget.to_dict("records"))
    findings = [
        str(study.circle),
        f"accuracy volume {volume['min']:.5f} to {volume['max']:.5f} mm³, comprehensive {volume['comprehensive']:.5f} mm³",
        f"standard uncertainty u of the position {u.min():.1f} to {u.max():.1f} µm; {u[study.best]:.1f} µm where the volume "
        f"is smallest, {u[study.worst]:.1f} µm where it is largest",
        f"largest deviation that the half-widths allow together: {deviation.min():.0f} to {deviation.max():.0f} µm",
        f"Monte Carlo (seed {SEED}), hull of corners of the box against the zonotope: {study.monte_carlo_text}",
        f"budget: {largest} of the variance; theta_offset is the zero offset of a joint",
        f"map: {counts[study.map.sectors]} of {sum(counts.values())} reachable cells have the full circle, "
        f"mean flexibility {float(study.map.data['flexibility'].mean()):.3f}",
    ]
    findings += _hidden_findings(study.hidden)
    return tuple(findings + _paper_findings(study) + _diagnosed_findings(study))


def _hidden_findings(hidden: Hidden) -> list[str]:
    return [
        f"hidden in {hidden.data.n} simulated records: {in_words(hidden.effect)}; "
        f"found: {several_in_words([f.effect for f in hidden.found.findings]) or 'nothing'} ({hidden.found.verdict}). "
        f"{line_to_remember(hidden.found)}"
    ]


def _paper_findings(study: Study) -> list[str]:
    if study.table2 is None or study.table3 is None:
        return []
    mean, points = study.table2.mean_flexibility, study.table3.points
    return [
        f"Table 2 of the paper: histogram reproduced to a total variation distance of "
        f"{100 * study.table2.total_variation:.1f} %; mean flexibility {mean['paper']:.3f} printed, {mean['exact']:.3f} by "
        "exact geometry on the same cells",
        f"Table 3 of the paper: spreads of {points['measured_mm'].min():.4f} to {points['measured_mm'].max():.4f} mm "
        f"measured, {points['dh_p05_mm'].min():.3f} to {points['dh_p95_mm'].max():.3f} mm by DH errors alone (5–95 %), but "
        f"{ratio_text(study.table3, len(study.table3.spreads))} spreads as much more at seat 6 than at seat 5 as measured",
    ]


def _diagnosed_findings(study: Study) -> list[str]:
    found = study.diagnosed
    if found is None:
        return []
    low, middle, high = found.noise / ARCSEC
    contrast, ratio = found.contrast, found.contrast.summary["mean_ratio"].to_dict()
    return [
        f"Table 3 diagnosed: encoder noise of {middle:.1f}″ ({low:.1f}″ to {high:.1f}″) gives seats 1 to 5 within "
        f"{found.fit_percent:.1f} %, other small random errors as well; seat 6 needs "
        f"{found.local_noise / UM:.0f} µm in each coordinate of its own",
        f"marked part of Table 3: {contrast.measured_mean_ratio:.2f} times the spread of the rest; the smallest deviations "
        f"picked after measuring give {ratio['after_noise']:.2f}, the smallest predicted volume "
        f"{ratio['before_dh']:.2f}; gain by encoder noise on a seat left out "
        f"{100 * found.held_out_five.gain['extended']:.0f} %",
    ]
