"""Plans of measurements as documents, and in one line."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.effects import probability
from aacmm_pin.planning import CalibrationPlan, MeasurementPlan
from aacmm_pin.postures import articulations, places
from aacmm_pin.report.document import (
    Block,
    Document,
    Download,
    Format,
    Heading,
    Notes,
    Paragraph,
    Table,
    document_of,
)
from aacmm_pin.report.numbers import capital, three_digits

RIGHT = "probability of the right decision"
CONSIDERED = f"Set-ups that the plan considered, with the {RIGHT}"
PAIRS = "Pairs of causes, and the increase T of χ² if the model has the wrong cause of a pair"
FORMS: dict[str, Format] = {"T": three_digits}
PAIRS_LISTED = 8
"""Pairs of causes to list; the JSON has all."""
COLUMNS_NOT_LISTED = r"^(theta|approach)\d|^u_|_mm$"
"""Columns that are in other words in the table, or to be filled in."""
HOW_TO_GO = (
    "The file plan.csv states the joint angles with all decimals. Move the arm to within a few "
    "degrees of these angles, and enter the readings. Left and right are those of a person behind "
    "the stand who looks from the shoulder to the tip. Bearings count counter-clockwise from the x "
    "axis. In the column last motion, + means that you move the joint to the posture towards "
    "larger angles, and - towards smaller angles. The probe direction points from the probe to the "
    "surface, in the axes of the base."
)


@document_of.register
def plan_document(plan: MeasurementPlan) -> Document:
    """The plan and its records."""
    set_ups = [
        {
            "set-up": set_up.words,
            "T": set_up.power.least,
            "probability": None if set_up.why_not else probability(set_up.power.probability),
            "obstacle": set_up.why_not,
        }
        for set_up in plan.tried
    ]
    pairs = pd.DataFrame()
    if plan.pairs is not None:  # that postures can distinguish, worst first
        pairs = plan.pairs[plan.pairs["why_not"] == ""][["cause", "other", "T", "told"]]
    heads = {"other": "other cause", "told": "distinguished"}
    return Document(
        "Plan",
        [
            Paragraph(f"{plan}.", head="Plan:"),
            Table(pd.DataFrame(set_ups if len(set_ups) > 1 else []), CONSIDERED, FORMS),
            Table(pairs, PAIRS, FORMS, heads, most=PAIRS_LISTED),
            *where_to_go(plan),
            Notes(plan.notes),
        ],
    )


def plan_line(plan: MeasurementPlan) -> str:
    """Number of records, set-up, and what they decide."""
    one, other = (effect.label for effect in plan.split)
    purpose = f"to distinguish {one} from {other}"
    if not plan.asked:
        purpose = (
            "to distinguish all causes whose effects differ in this set-up, of which "
            f"{one} and {other} are the most similar"
        )
    if plan.before is not None and not plan.needed:
        return (
            f"The {plan.existing} existing records are enough {purpose}. The {RIGHT} is "
            f"{probability(plan.before.probability)}. You can use the {len(plan.records)} planned "
            "records to check the result"
        )
    set_up = capital(plan.setup) if plan.set_up else "The set-up does not change"
    sentences = [f"Take {len(plan.records)} records {purpose}", set_up, *_power(plan)]
    for tried in plan.tried:
        if tried.why_not:
            sentences.append(f"In the set-up '{tried.words}', {tried.why_not}")
    return ". ".join(sentences)


def _power(plan: MeasurementPlan) -> Iterator[str]:
    if plan.after.inseparable:
        yield "No set-up that the plan considered distinguishes both causes"
        yield "If both correct the arm in the same way, use the extended arm with either cause"
        return
    without_new = ""
    if plan.before is not None:
        chance = probability(plan.before.probability)
        without_new = f", and {chance} with only the existing records"
    yield f"The {RIGHT} is {probability(plan.after.probability)}{without_new}"
    increase = f"T = {three_digits(plan.after.least)}"
    yield f"If the model has the wrong cause, χ² increases by about {increase}"
    if not plan.decided:
        yield "The probability is too small to decide"
        if plan.enough is not None:
            yield f"About {plan.enough} new records{_besides_existing(plan)} would be enough"


def _besides_existing(plan: CalibrationPlan | MeasurementPlan) -> str:
    return f" in addition to the {plan.existing} existing ones" if plan.existing else ""


# Calibration, and where to go --------------------------------------------


@document_of.register
def calibration_plan_document(plan: CalibrationPlan) -> Document:
    """The plan and its records."""
    finding = Paragraph(f"{plan}.", finding=True, head="Plan:")
    title = f"Plan for the calibration of {plan.model.arm.name}"
    seed = "" if plan.seed is None else f"seed {plan.seed}"
    return Document(title, [finding, *where_to_go(plan), Notes(plan.notes)], seed)


def calibration_plan_line(plan: CalibrationPlan) -> str:
    """Number of records, and observability and u compared with random records."""
    besides = _besides_existing(plan)
    return (
        f"Take {len(plan.records)} records to calibrate {plan.model.arm.name}{besides}. "
        "After calibration, the standard uncertainty u of the tip is "
        f"{plan.u / MM:.4f} mm (RMS over the postures). Random records would give "
        f"{float(np.median(plan.u_random)) / MM:.4f} mm. The observability index O1 is "
        f"{plan.ratio:.2f} times as large as with random records"
    )


def where_to_go(plan: CalibrationPlan | MeasurementPlan) -> list[Block]:
    """The records of a plan for printing, with the CSV file to complete."""
    arm, measurements = plan.model.arm, plan.measurements
    q, readings = measurements.q, measurements.readings
    tips = plan.model.predict(q, measurements.conditions)
    stated = plan.records.dropna(axis=1, how="all")
    planned = stated.filter(regex=COLUMNS_NOT_LISTED)
    other_columns = stated.drop(columns=[*planned, "record"], errors="ignore").astype(str)
    other_columns = other_columns.rename(columns={"temperature_c": "temperature [°C]"})
    # a file that is appended to may have no column record
    labels = pd.Series(measurements.record, name="record")
    locations = places(arm, tips).map(lambda value: f"{value:z.0f}")
    locations = locations.set_axis(["from the stand [mm]", "bearing [°]", "height [mm]"], axis=1)
    table = pd.concat([labels, other_columns, locations], axis=1)
    table["posture"] = articulations(arm, q)
    angles = np.where(arm.chain.prismatic, readings, readings / DEG)
    table["joints [°]"] = [" ".join(f"{x:z.0f}" for x in row) for row in angles]
    last_motions = plan.records.filter(regex=r"^approach\d").to_numpy()
    if last_motions.size:
        table["last motion"] = [
            " ".join("-0+"[int(sign) + 1] for sign in row) for row in last_motions
        ]
    return [
        Heading("Where to go"),
        Table(table, "Records, in order", explained=HOW_TO_GO, detail=True),
        Download("plan.csv", "the file to fill in", plan.csv().encode()),
    ]
