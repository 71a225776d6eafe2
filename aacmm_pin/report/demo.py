"""The demonstration on bundled input: ``index.html``, an arm at a working point, over its workspace, and measured; the files
behind it; and for the papers' arm ``papers.html``.

Every number in the text is computed when the page is made; the sentences around them are fixed.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Drawing

from aacmm_pin._support.output_files import whole_folder
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy.volume import AccuracyVolume, accuracy_volume, circle_accuracy
from aacmm_pin.accuracy.workspace import WorkspaceMap, map_workspace
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import load_arm_file
from aacmm_pin.arm.urdf import urdf_text
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import Effect, EncoderEccentricity
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.labels import in_words, several_in_words, values_in_words
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.papers.sino6 import printed_points
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circle
from aacmm_pin.report import plots
from aacmm_pin.report.diagnosis import diagnosis_document, line_to_remember, verdict_in_words
from aacmm_pin.report.document import Block, Bullets, Document, Figure, Heading, Link, Paragraph, Table, blank_axes
from aacmm_pin.report.html import page
from aacmm_pin.report.papers_page import PaperStudy, papers_document
from aacmm_pin.report.scenes import circle_scene, map_scene
from aacmm_pin.report.summaries import accuracy_summary, map_summary

SEED = 1
"""Seed of every random number."""
DRAWS = 4000
"""Monte Carlo draws for a configuration."""
ARM_OF_THE_PAPER = "SINO6"
RECORDS, SEATS = 200, 10
READING_NOISE = 8e-6
"""Standard uncertainty of one reading, simulated and stated [rad]."""
SIZE, JOINT = 1e-4, 3
"""Of the hidden eccentricity [rad], 5 µm off centre on a circle of 50 mm radius; and its joint."""
FILES = {
    "diagnosis.html": "the whole diagnosis, with what could look like its findings",
    "postures.html": "in 3D: the arm going round its postures at the working point",
    "workspace.html": "in 3D: the arm in one cell of the workspace after the other",
    "papers.html": "the two source papers, reproduced: equations, tables, measurements",
    "site/index.html": "the documentation, once it is built into this folder as the README says",
    "configurations.csv": "every configuration at the working point, angles in degrees",
    "accuracy.json": "accuracy at the working point",
    "map.nc": "the map, cell by cell (netCDF)",
    "map.json": "summary of the map",
    "measured.csv": "the simulated measurements",
    "diagnosis.json": "the verdict and its numbers",
}
"""What the page links to."""


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


@dataclass(frozen=True, eq=False)
class Study:
    """What is computed for the page.

    Attributes:
        arm: the arm.
        circle: every configuration at the working point.
        accuracy: of those within limits, by the zonotope; ``summary``: the same as accuracy.json has it.
        map: flexibility and accuracy over the half-plane.
        hidden: the cause that a virtual arm has and its file does not.
        data: what that arm measured; ``found``: the diagnosis, which was not told of the cause.
    """

    arm: Arm
    circle: ConfigurationCircle
    accuracy: AccuracyVolume
    summary: dict[str, Any]
    map: WorkspaceMap
    hidden: Effect
    data: Measurements
    found: Diagnosis

    @staticmethod
    def of(arm: Arm, cells: tuple[int, int], sectors: int, progress: bool) -> Study:
        """Compute everything; arguments and errors as in :func:`run_demo`."""
        circle = configuration_circle(arm, printed_points()[0])
        accuracy = circle_accuracy(circle)
        map_ = map_workspace(arm, cells, sectors, progress=progress)
        rng = np.random.default_rng(SEED)
        phase = rng.uniform(-np.pi, np.pi)
        hidden = EncoderEccentricity(JOINT, values=(SIZE * np.cos(phase), SIZE * np.sin(phase)))
        truth = ErrorModel(perturbed_model(ErrorModel(arm), rng).arm, (hidden,))
        data = simulate_measurements(truth, "seats", RECORDS, rng=rng, seats=SEATS)
        found = diagnose(arm, data, encoder_noise=READING_NOISE, rng=np.random.default_rng(SEED), progress=progress)
        return Study(arm, circle, accuracy, accuracy_summary(circle, accuracy, sectors), map_, hidden, data, found)

    def findings(self) -> list[str]:
        """What the shell says."""
        volume, accuracy, u = self.summary["volume_mm3"], self.accuracy, self.accuracy.u / UM
        ends = [int(np.argmin(accuracy.volume)), int(np.argmax(accuracy.volume))]
        at, rng = self.circle.at, np.random.default_rng(SEED)
        hull = accuracy_volume(self.arm, accuracy.q[ends], at=at, method="monte-carlo", rng=rng, draws=DRAWS)
        low, high = 100 * (hull.volume / accuracy.volume[ends] - 1)
        deviation, counts = accuracy.largest_deviation / UM, self.map.working_sectors()
        return [
            str(self.circle),
            f"accuracy volume {volume['min']:.5f} to {volume['max']:.5f} mm³, comprehensive {volume['comprehensive']:.5f} "
            "mm³",
            f"standard uncertainty u of the position {u.min():.1f} to {u.max():.1f} µm; {u[ends[0]]:.1f} µm where the "
            f"volume is smallest, {u[ends[1]]:.1f} µm where it is largest",
            f"largest deviation that the half-widths allow together: {deviation.min():.0f} to {deviation.max():.0f} µm",
            f"Monte Carlo (seed {SEED}), hull of corners of the box against the zonotope: {low:+.1f} % where the volume is "
            f"smallest and {high:+.1f} % where it is largest",
            f"budget: {self._largest(3)} of the variance; theta_offset is the zero offset of a joint",
            f"map: {counts[self.map.sectors]} of {sum(counts.values())} reachable cells have the full circle, "
            f"mean flexibility {float(self.map.data['flexibility'].mean()):.3f}",
            f"hidden in {self.data.n} simulated records: {in_words(self.hidden)}; "
            f"found: {several_in_words([f.effect for f in self.found.findings]) or 'nothing'} ({self.found.verdict}). "
            f"{line_to_remember(self.found)}",
        ]

    def _largest(self, count: int) -> str:
        rows = self.accuracy.budget().head(count).to_dict("records")
        return ", ".join(f"{row['parameter']} {100 * row['share']:.0f} %" for row in rows)

    def document(self, files: list[str], when: str) -> Document:
        """The page, with links to those of ``files`` that it names."""
        links = [Link(name, FILES[name]) for name in FILES if name in (*files, "site/index.html")]
        links += [Link(name, "the arm for Pinocchio, lengths in metres") for name in files if name.endswith(".urdf")]
        question = (
            f"Before measuring: how accurate is {self.arm.name} at a point and over its workspace, in which posture, and "
            "why? After measuring: what does its model get wrong, what causes it, and how much better is the arm once the "
            "model knows?"
        )
        blocks: list[Block] = [question, *self._at_the_point(), *self._over_the_workspace(), *self._measured()]
        assumed = Bullets(
            [
                "Before measuring only the geometry is uncertain: independent errors, uniform within the half-widths of the "
                "calibration. Encoder noise, eccentricity, gravity, temperature and contact come on top.",
                "The working point is the wrist; what lies behind it, the stylus too, has no part in these numbers.",
                "Volumes are first order in the errors; cells and sectors are judged at their centres.",
                "Neither volume nor u is a maximum permissible error of any standard.",
            ]
        )
        blocks += [Heading("What is assumed"), assumed, Heading("More"), *links, f"Seed {SEED}; made {when}."]
        return Document(f"{self.arm.name}: postures, accuracy, diagnosis", blocks, f"Geometry: {self.arm.source}")

    def _at_the_point(self) -> list[Block]:
        circle, accuracy, volume = self.circle, self.accuracy, self.summary["volume_mm3"]
        x, y, z = circle.point / MM
        u = 2 * accuracy.u / MM
        picks = {
            "smallest volume": int(np.argmin(accuracy.volume)),
            "largest volume": int(np.argmax(accuracy.volume)),
            "smallest U": int(np.argmin(accuracy.u)),
            "largest U": int(np.argmax(accuracy.u)),
        }
        rows = list(picks.values())
        table = pd.DataFrame({"posture": list(picks), "U, k = 2 [mm]": u[rows], "volume [mm³]": accuracy.volume[rows] / MM3})
        table["swivel [°]"] = (circle.swivel[circle.within_limits][rows] / DEG).round() + 0.0  # + 0.0: no minus zero
        for joint in range(self.arm.nq):
            table[f"θ{joint + 1} [°]"] = accuracy.q[rows, joint] / DEG
        formats = {"U, k = 2 [mm]": ".3f", "volume [mm³]": ".5f"} | dict.fromkeys(table.columns[3:], ".0f")
        return [
            Heading("At one point: in which posture, how accurate, and why"),
            f"With the wrist held at ({x:.1f}, {y:.1f}, {z:.1f}) mm the arm can still move: its elbow runs along "
            f"{len(circle.components.curves)} closed curves. {int(circle.within_limits.sum())} of {len(circle)} sampled "
            "configurations are within the joint limits.",
            Paragraph(
                f"The expanded uncertainty of the position, U with k = 2, is {u.min():.3f} mm to {u.max():.3f} mm, "
                "depending on the posture; the accuracy volume, all that the half-widths allow together, "
                f"{volume['min']:.4f} mm³ to {volume['max']:.4f} mm³. Most of the variance comes from {self._largest(2)} "
                "(theta_offset: zero offset of a joint).",
                finding=True,
            ),
            Figure(
                lambda: plots.plot_circle(circle, accuracy, ax=_axes_3d()),
                f"The elbow's path round the working point and {self.arm.name} in five postures",
                "Five of the postures, and the path of the elbow, coloured by the accuracy volume where all joints are "
                "within limits.",
            ),
            Table(table, "Postures at the ends; swivel 0 where the elbow is highest", formats),
            Figure(
                lambda: plots.plot_budget(accuracy, "parameter", blank_axes(7.0, 3.6)),
                "Bars of the shares of the variance by parameter",
                "Uncertainty budget: share of the variance, and the standard uncertainty that each parameter alone would "
                "cause.",
            ),
        ]

    def _over_the_workspace(self) -> list[Block]:
        data, counts = self.map.data, self.map.working_sectors()
        least, most = (2 * float(pick(data["smallest_u_mm"].values)) for pick in (np.nanmin, np.nanmax))
        return [
            Heading("Over the workspace"),
            f"The arm turns about joint 1, so one half-plane stands for all of space: {data.sizes['x_mm']} × "
            f"{data.sizes['z_mm']} cells, {sum(counts.values())} of them in reach.",
            Paragraph(
                f"In the best posture of each cell U (k = 2) is {least:.3f} mm to {most:.3f} mm. {counts[self.map.sectors]} "
                f"of {sum(counts.values())} reachable cells can be reached all round the circle; mean flexibility "
                f"{float(data['flexibility'].mean()):.3f}.",
                finding=True,
            ),
            Figure(
                self._maps,
                f"Maps of {self.arm.name} over distance from joint axis 1 and z: uncertainty and flexibility",
                "Standard uncertainty u of the position in the posture where it is smallest, and flexibility. The star is "
                "the working point above, turned into the plane.",
            ),
        ]

    def _maps(self) -> Drawing:
        figure = Drawing(figsize=(10.0, 6.0), layout="constrained")
        x, y, z = self.circle.point / MM
        drawings = (plots.plot_uncertainty, plots.plot_flexibility)
        for axes, draw in zip(figure.subplots(1, 2), drawings, strict=True):
            draw(self.map, axes).plot(np.hypot(x, y), z, "*", ms=13, mfc=plots.VERMILLION, mec="white")
        return figure

    def _measured(self) -> list[Block]:
        found, (cosine, sine) = self.found, self.hidden.values
        true = f"amplitude {np.hypot(cosine, sine) * 1e6:.1f} µrad, phase {np.degrees(np.arctan2(sine, cosine)):.1f}°"
        rows = [("hidden", in_words(self.hidden), true)]
        rows += [("found", in_words(f.effect), values_in_words(f.effect, f.parameters)) for f in found.findings]
        return [
            Heading("After measuring: a hidden effect found"),
            f"A virtual {self.arm.name}, its geometry drawn within the half-widths, got an encoder that sits off its centre "
            f"and touched {SEATS} seats of known coordinates, {self.data.n} records in all, with the noise of good encoders "
            "and references. The diagnosis knows the records and the arm file only.",
            Paragraph(verdict_in_words(found), finding=True),
            Table(pd.DataFrame(rows, columns=["", "cause", "values"]), "What was hidden, and what was found; ± U (k = 2)"),
            Paragraph(line_to_remember(found), finding=True),
            Figure(
                lambda: plots.plot_rms(found, blank_axes(6.8, 2.0)),
                "RMS of the residuals by the three models",
                "Residuals by the arm as simulated, recalibrated, and extended by what was found. Dashed: noise alone.",
            ),
            *(
                Figure(
                    lambda finding=finding: plots.plot_cause(found, finding, blank_axes(7.4, 4.0)),  # type: ignore[misc]
                    f"{in_words(finding.effect)}, from the records",
                    f"{in_words(finding.effect).capitalize()} as the records show it: dots are records, circles their means "
                    "with u, the line is the cause as fitted.",
                )
                for finding in found.findings
            ),
        ]


def _axes_3d() -> Any:
    return Drawing(figsize=(7.2, 6.6), layout="constrained").add_subplot(projection="3d")


def run_demo(
    arm_name: str = "sino6",
    folder: Path = Path("out"),
    force: bool = False,
    progress: bool = True,
    cells: tuple[int, int] = (48, 48),
    sectors: int = 12,
) -> DemoSummary:
    """Compute the tour and write it to ``folder``: index.html, and the files and pages behind it.

    The working point is the first one that the paper measured (its Table 3), for the wrist. The papers' page is written for
    their arm alone.

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
    started, folder, when = time.perf_counter(), Path(folder), f"{datetime.now(UTC):%Y-%m-%d}"
    with whole_folder(folder, force) as out:
        arm_file = load_arm_file(arm_name)
        study = Study.of(Arm.from_file(arm_file), cells, sectors, progress)
        arm, found, over_map = study.arm, study.found, map_summary(study.map)
        diagnosis = found.summary() | {"source": "measured.csv", "seed": SEED}
        texts = {
            f"{arm.name.lower()}.urdf": urdf_text(arm_file),
            "configurations.csv": study.circle.to_frame().to_csv(index=False),
            "accuracy.json": _json(study.summary),
            "map.json": _json(over_map),
            "diagnosis.json": _json(diagnosis),
            "diagnosis.html": page(diagnosis_document(found, diagnosis, when)),
            "postures.html": circle_scene(study.circle, study.accuracy).html(),
            "workspace.html": map_scene(study.map, arm).html(),
        }
        findings = study.findings()
        if arm.name == ARM_OF_THE_PAPER:
            papers = PaperStudy.of(SEED, progress)
            findings += papers.findings()
            texts["papers.html"] = page(papers_document(papers))
        study.map.save(out / "map.nc")
        study.data.save(out / "measured.csv")
        files = [*texts, "map.nc", "measured.csv", "index.html"]
        texts["index.html"] = page(study.document(files, when))
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")
    seconds = time.perf_counter() - started
    return DemoSummary(folder, tuple(sorted(files)), tuple(findings), study.summary, over_map, seconds)


def _json(content: dict[str, Any]) -> str:
    return json.dumps(content, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
