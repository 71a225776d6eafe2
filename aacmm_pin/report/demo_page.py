"""The demonstration with bundled data: ``index.html`` and its files."""

from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from aacmm_pin._support.output_files import OutputFiles, json_text
from aacmm_pin._support.text_escaping import csv_text, encodable
from aacmm_pin._support.units import MM
from aacmm_pin.accuracy import (
    AccuracyVolume,
    Quantity,
    WorkspaceMap,
    circle_accuracy,
    map_workspace,
)
from aacmm_pin.arm import Arm, load_arm_file, urdf_text
from aacmm_pin.calibration.random_arm import perturbed_model
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import (
    Effect,
    EncoderEccentricity,
    ErrorModel,
    in_words,
)
from aacmm_pin.errors import OutputError
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.postures import ConfigurationCircle, configuration_circle
from aacmm_pin.report import plots
from aacmm_pin.report.accuracy_page import accuracy_document, map_document
from aacmm_pin.report.diagnosis_page import diagnosis_document
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Download,
    Figure,
    Heading,
    SceneView,
    blank_axes,
)
from aacmm_pin.report.formats.html import page
from aacmm_pin.report.json_summaries import accuracy_summary, map_summary
from aacmm_pin.report.scenes import circle_scene

SEED = 1
"""Seed of every random number."""
POINT = np.array([33.6323, -671.8702, 182.9355]) * MM
"""Point of the wrist in the DH base frame [m]: the first measured one in the paper of SINO6."""
MAPS: dict[Quantity, str] = {
    "smallest_u_mm": "the smallest standard uncertainty u of the position",
    "flexibility": "the flexibility",
}
"""Quantities whose maps the page shows, in words."""
RECORDS, SEATS = 200, 10
READING_NOISE = 8e-6
"""Simulated and stated standard uncertainty of one reading [rad]."""
SIZE, JOINT = 1e-4, 3
"""Of the hidden eccentricity [rad], 5 µm off centre on a radius of 50 mm; and its joint."""
FILES = {
    "postures.html": "3D scene of the arm in its postures at the working point",
    "site/index.html": "the documentation (the README states how to build it into this folder)",
    "configurations.csv": "every posture at the working point, angles in degrees",
    "accuracy.json": "accuracy at the working point",
    "map.nc": "the map of the workspace, cell by cell (netCDF)",
    "map.json": "summary of the map of the workspace",
    "measured.csv": "the simulated measurements",
    "diagnosis.json": "the verdict and its numbers",
}
"""Links of the page."""
QUESTION = (
    "This page predicts the accuracy of the arm at one point and over its workspace. The page then "
    "finds a cause of error that the model of a simulated arm lacks, and shows how much more "
    "accurate the arm is with this cause in its model."
)
ASSUMED = (
    "The prediction contains only errors of the geometry. The errors are independent, and "
    "uniformly distributed within the half-widths. Encoder noise, eccentricity, gravity, "
    "temperature and contact increase the errors further.",
    "The wrist is at the working point. Errors of parts beyond the wrist, such as the stylus, do "
    "not contribute.",
    "Volumes are first-order approximations. The map has the accuracy at the centre of each cell "
    "and sector.",
    "Neither volume nor u is a maximum permissible error of any standard.",
)


def run_demo(
    arm_name: str = "sino6",
    folder: Path = Path("out"),
    force: bool = False,
    progress: bool = True,
    cells: tuple[int, int] = (48, 48),
    sectors: int = 12,
) -> str:
    """Compute the demonstration and write it to ``folder``, whole or not at all.

    Args:
        arm_name: bundled arm or arm file with uncertainties.
        force: replace files of the same names.
        cells: cells of the map along x and z.
        sectors: sectors of the swivel angle.

    Returns:
        Lines with the results and the number of files.

    Raises:
        OutputError: the folder cannot be used.
        UnknownNameError, ArmFileError: the arm cannot be read.
        AacmmError: the arm states no uncertainty, or cannot reach the point within its limits.
    """
    started, when = time.perf_counter(), f"{datetime.now(UTC):%Y-%m-%d}"
    arm_file = load_arm_file(arm_name)
    arm = Arm.from_file(arm_file)
    with OutputFiles(force) as outputs:
        circle = configuration_circle(arm, POINT)
        accuracy = circle_accuracy(circle)
        _make_folder(folder, force)
        outputs.check(folder / "index.html")
        map_ = map_workspace(arm, cells, sectors, progress=progress)
        hidden, data = _simulated(arm)
        rng = np.random.default_rng(SEED)
        result = diagnose(arm, data, encoder_noise=READING_NOISE, rng=rng, progress=progress)
        of_point = accuracy_summary(circle, accuracy, sectors)
        diagnosis = result.summary() | {"source": "measured.csv", "seed": SEED}
        diagnosis_page = diagnosis_document(result)
        urdf = f"{arm.name.lower()}.urdf"
        files = FILES | {urdf: "the arm for Pinocchio, lengths in metres"}
        index = Document(
            f"{arm.name}: postures, accuracy, diagnosis",
            [
                QUESTION,
                *_accuracy(circle, accuracy, of_point, map_),
                Heading("Diagnosis of simulated records"),
                f"A virtual {arm.name} has an eccentric encoder: {in_words(hidden)}. The geometry "
                "of the virtual arm differs from the arm file within the half-widths. The arm "
                f"probes {SEATS} seats of known coordinates in {RECORDS} records. The diagnosis "
                "uses only the records and the arm file.",
                *(block for block in diagnosis_page.blocks if not isinstance(block, SceneView)),
                Heading("Assumptions"),
                Bullets(ASSUMED),
                Heading("Files"),
                *(Download(name, text) for name, text in files.items()),
                f"The demo made this page with seed {SEED} on {when}.",
            ],
            f"Geometry: {arm.source}",
        )
        texts = {
            urdf: urdf_text(arm_file),
            "configurations.csv": csv_text(circle.columns()),
            "accuracy.json": json_text(of_point),
            "map.json": json_text(map_summary(map_)),
            "diagnosis.json": json_text(diagnosis),
            "postures.html": circle_scene(circle, accuracy).html(),
            "index.html": page(index),
        }
        map_.save(outputs.file(folder / "map.nc"))
        data.save(outputs.file(folder / "measured.csv"))
        for name, text in texts.items():
            outputs.file(folder / name).write_text(encodable(text), encoding="utf-8")
    seconds = time.perf_counter() - started
    end = f"The demo wrote {len(texts) + 2} files in {seconds:.0f} s; open {folder / 'index.html'}"
    return f"{accuracy}.\n{map_}.\n{result}\n{end}"


def _make_folder(folder: Path, force: bool) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: the folder cannot be made: {error.strerror}; expected the name of a new or "
            "empty folder"
        ) from None
    if any(folder.iterdir()) and not force:
        raise OutputError(
            f"{folder}: this folder has files; expected an empty or new folder; to replace files "
            "of the same names, use --force"
        )


def _simulated(arm: Arm) -> tuple[Effect, Measurements]:
    """A hidden cause, and records of an arm that has it."""
    rng = np.random.default_rng(SEED)
    phase = rng.uniform(-np.pi, np.pi)
    hidden = EncoderEccentricity(JOINT, values=(SIZE * np.cos(phase), SIZE * np.sin(phase)))
    perturbed = perturbed_model(ErrorModel(arm), rng).arm
    truth = ErrorModel(perturbed, (hidden,))
    return hidden, simulate_measurements(truth, "seats", RECORDS, rng=rng, seats=SEATS)


def _accuracy(
    circle: ConfigurationCircle,
    accuracy: AccuracyVolume,
    summary: dict[str, Any],
    map_: WorkspaceMap,
) -> Iterator[Block | str]:
    yield Heading("Accuracy at one point")
    yield f"{circle}."
    yield Figure(
        lambda: plots.plot_circle(circle, accuracy, ax=blank_axes(7.2, 6.6, projection="3d")),
        f"The elbow's path round the working point and {circle.arm.name} in five postures",
        "The figure shows five postures and the path of the elbow. The colour of "
        "the path shows the accuracy volume of each posture within the joint limits.",
    )
    yield from accuracy_document(accuracy, summary).blocks
    yield Heading("Accuracy over the workspace")
    yield from map_document(map_).blocks
    for quantity, words in MAPS.items():
        yield Figure(
            partial(plots.plot_map, map_, quantity, blank_axes(6.0, 6.0)),
            f"Map of {words} over distance from joint axis 1 and z",
            f"The map shows {words} in each cell. Joint 1 rotates the arm about the z axis, so "
            "that one half-plane represents the whole workspace.",
        )
