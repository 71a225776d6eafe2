"""An effect hidden in simulated measurements, and what a diagnosis that is not told of it finds."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import Effect, EncoderEccentricity
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.report import plots
from aacmm_pin.report.demo.picture import new_axes, picture
from aacmm_pin.report.diagnosis_findings import (
    LEFT_OUT_SEATS,
    gain_in_words,
    in_words,
    line_to_remember,
    parameters_in_words,
    verdict_in_words,
)
from aacmm_pin.report.diagnosis_page import diagnosis_page
from aacmm_pin.report.diagnosis_tables import look_alikes
from aacmm_pin.report.html import Download, Paragraph, Part, Section, Table

RECORDS, SEATS = 200, 10
READING_NOISE = 8e-6
"""Standard uncertainty of one reading, simulated and stated [rad]."""
SIZE = 1e-4
"""Of the hidden eccentricity [rad]: 5 µm off centre on a circle of 50 mm radius."""
JOINT = 3


@dataclass(frozen=True, eq=False)
class Hidden:
    """What was hidden, in which measurements, and what was found.

    Attributes:
        effect: the cause that the true arm has and its file does not.
        data: what was measured.
        found: the diagnosis of these.
        seed: of all that was drawn.
    """

    effect: Effect
    data: Measurements
    found: Diagnosis
    seed: int


def hide_and_find(arm: Arm, seed: int, progress: bool = False) -> Hidden:
    """Measure with an arm whose geometry is off as its file allows and whose encoder is eccentric; diagnose the records.

    Raises:
        AacmmError: the arm states no uncertainty of its geometry.
    """
    rng = np.random.default_rng(seed)
    phase = rng.uniform(-np.pi, np.pi)
    effect = EncoderEccentricity(JOINT, values=(SIZE * np.cos(phase), SIZE * np.sin(phase)))
    truth = ErrorModel(perturbed_model(ErrorModel(arm), rng).arm, (effect,))
    data = simulate_measurements(truth, "seats", RECORDS, rng=rng, seats=SEATS)
    found = diagnose(arm, data, encoder_noise=READING_NOISE, rng=np.random.default_rng(seed), progress=progress)
    return Hidden(effect, data, found, seed)


def hidden_section(hidden: Hidden, out: Path, when: str) -> Section:
    """The section of the page; the records and the diagnosis' own page are written to ``out``."""
    found = hidden.found
    hidden.data.save(out / "measured.csv")
    summary = found.summary() | {"source": "measured.csv", "seed": hidden.seed}
    (out / "diagnosis.json").write_bytes(_json(summary))
    (out / "diagnosis.html").write_text(diagnosis_page(found, summary, when), encoding="utf-8")
    parts: list[Part] = [
        _introduction(hidden),
        Paragraph(verdict_in_words(found), finding=True),
        Paragraph(line_to_remember(found), finding=True),
        Table(
            _comparison(hidden),
            "What was hidden, which the diagnosis was not told, and what it found; ± U (k = 2). In both, the phase is the "
            "angle of the joint at which the reading is most too small.",
        ),
        *_pictures(hidden, out),
        f"{gain_in_words(found)} {LEFT_OUT_SEATS} "
        "The whole diagnosis, with what could look like it, is diagnosis.html beside this page.",
        Download("measured.csv", (out / "measured.csv").read_bytes(), "text/csv", "the simulated measurements"),
        Download("diagnosis.json", (out / "diagnosis.json").read_bytes(), "application/json", "the verdict and its numbers"),
    ]
    return Section("An effect hidden in measurements, and found", parts)


def _introduction(hidden: Hidden) -> Part:
    model = hidden.found.model
    return (
        f"And after measuring? A virtual {model.arm.name} was given a geometry drawn within the half-widths above, and an "
        f"encoder that sits off its centre. It touched {SEATS} seats of known coordinates, {hidden.data.n} records in "
        "all, with the noise of good encoders and references. From these records alone the diagnosis says what the "
        "simulation gets wrong, which cause it has, and how much better the arm is once the model knows. Seed "
        f"{hidden.seed}."
    )


def _comparison(hidden: Hidden) -> pd.DataFrame:
    cosine, sine = hidden.effect.values
    size, phase = np.hypot(cosine, sine), np.degrees(np.arctan2(sine, cosine))
    rows = [("hidden", in_words(hidden.effect), f"amplitude {size * 1e6:.1f} µrad, phase {phase:.1f}°")]
    rows += [("found", in_words(f.effect), parameters_in_words(f)) for f in hidden.found.findings]
    return pd.DataFrame(rows, columns=["", "cause", "values"])


def _pictures(hidden: Hidden, out: Path) -> list[Part]:
    found = hidden.found
    parts: list[Part] = [
        picture(
            plots.plot_rms(found, new_axes(6.8, 2.0)),
            out,
            "hidden_rms",
            "RMS of the residuals by the three models",
            "Residuals of the records by the arm as simulated, recalibrated, and extended by what was found. Dashed: noise "
            "alone.",
        )
    ]
    for number, finding in enumerate(found.findings, start=1):
        drawn = plots.plot_cause(found, finding, new_axes(7.4, 4.0))
        caption = (
            f"{in_words(finding.effect).capitalize()} as the records show it once everything else is as fitted: dots are "
            "records, circles their means with u, the line is the cause as fitted."
        )
        parts.append(picture(drawn, out, f"hidden_cause{number}", f"{in_words(finding.effect)}, from the records", caption))
    if len(alike := look_alikes(found)):
        caption = "What looks like it in these records: correlation r, geometry refitted, and probability in its place."
        parts.append(Table(alike, caption, {"r": ".2f"}))
    return parts


def _json(summary: dict[str, object]) -> bytes:
    return (json.dumps(summary, allow_nan=False, ensure_ascii=False, indent=2) + "\n").encode()
