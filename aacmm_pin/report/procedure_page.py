"""A procedure of an acceptance test as a sheet: positions of artefacts, points to probe."""

from __future__ import annotations

import pandas as pd

from aacmm_pin.postures import places
from aacmm_pin.report.document import (
    Bullets,
    Document,
    Download,
    Heading,
    Table,
    document_of,
)
from aacmm_pin.verification import ASME, EDITIONS, RULE_OF, Procedure

ARTEFACTS = {
    "sphere": "sphere",
    "single-point": "seat",
    "length": "length bar",
    "volumetric": "ball bar",
}
"""Artefact of each test."""
ARTEFACT_OF_TEST = {
    "location": "sphere",
    "effective-diameter": "sphere",
    "length-uni": "length",
    "length-bi": "length",
}
"""Tests with the artefacts of another test."""
ORIGIN = (
    "The definitions and the decision rule come from public descriptions of "
    f"{', '.join(EDITIONS.values())} and {RULE_OF}. Before a contract depends on a verdict, "
    "compare the definitions and rule with the standards."
)
"""First sentence of every acceptance page."""
ZONES = "0 to 20, 20 to 80 and 80 to 100 % of the reach"
"""Zones of the single points of ASME B89.4.22; the text of the standard rules."""
POSITIONS = "Positions of the artefacts, and of the far end of each bar"
ONE_ROW = "Points to probe, with one row for consecutive points of one feature in one posture"
FILL_IN = (
    "Probe the points in this order, and tick each row. The column 'lines' states lines of the "
    "CSV file.",
    "Fill in the coordinates of the centre of the probe (x_mm, y_mm, z_mm), the "
    "readings (theta1_deg …), or both. The evaluation ignores empty columns.",
    "Replace the planned diameters and lengths by the calibrated values. State their standard "
    "uncertainty in u_length_mm, because the verdict depends on it.",
    "Place each artefact within a few centimetres of its position. Move the arm to the posture "
    "that the row describes. The test uses the measured values, not the planned ones.",
    "Left and right are those of a person behind the stand who looks from the shoulder to the tip. "
    "Out means away from the stand. Bearings count from the x axis of the base, counter-clockwise "
    "if seen from above.",
)


@document_of.register
def procedure_document(procedure: Procedure) -> Document:
    """The sheet, with the CSV file to complete."""
    points, seats = procedure.probed_points, ""
    if "single-point" in set(points["test"]):
        seats = (
            f"According to public descriptions of {EDITIONS[ASME]}, the distances of the seats "
            f"must be {ZONES}."
        )
    seed = "" if procedure.seed is None else f", seed {procedure.seed}"
    return Document(
        f"Points to probe for the acceptance test of {procedure.arm.name}",
        [
            ORIGIN,
            f"{procedure}.",
            Heading("Artefacts"),
            Table(_sizes(points), "Artefacts and probe", detail=True),
            Table(_positions_table(procedure), POSITIONS, explained=seats),
            Heading("Points to probe, in order"),
            Bullets(FILL_IN),
            Table(_steps(points), ONE_ROW, detail=True),
            Download("procedure.csv", "the file to fill in", procedure.csv().encode()),
        ],
        f"{len(points)} points{seed}",
        by_hand=("Date", "Operator", "Instrument, serial number", "Temperature [°C]"),
    )


def _ends(procedure: Procedure) -> pd.DataFrame:
    """Places of artefacts, and of far ends of bars: kind, position, end, x, y, z [m]."""
    columns = ["test", "position", "feature"]
    points = pd.DataFrame(procedure.points, columns=[*"xyz"])
    table = procedure.probed_points[columns].reset_index(drop=True).join(points)
    table["kind"] = table["test"].replace(ARTEFACT_OF_TEST)
    is_bar = table["kind"].isin(["length", "volumetric"])
    table["end"] = table["feature"].where(is_bar, "")
    artefact = ["kind", "position"]
    features = table.groupby([*artefact, "end"], sort=False, as_index=False)[[*"xyz"]].mean()
    is_between_ends = features.duplicated(artefact) & features.duplicated(artefact, keep="last")
    return features[~is_between_ends].reset_index(drop=True)


def _positions_table(procedure: Procedure) -> pd.DataFrame:
    ends = _ends(procedure)
    heads = ["distance [mm]", "bearing [°]", "height [mm]"]
    located = places(procedure.arm, ends[[*"xyz"]].to_numpy()).set_axis(heads, axis=1)
    table = ends[["kind", "position", "end"]].join(located.map(lambda value: f"{value:z.0f}"))
    return table.assign(kind=table["kind"].map(ARTEFACTS)).rename(columns={"kind": "artefact"})


def _sizes(points: pd.DataFrame) -> pd.DataFrame:
    bars = points["length_id"].replace(r"^(L\d+)$", r"length bar, A to \1", regex=True)
    names = {
        "feature_diameter_mm": "sphere, diameter",
        "probe_diameter_mm": "probe, diameter",
        "length_mm": bars,
    }
    sizes = [
        pd.DataFrame({"artefact": name, "size [mm]": pd.to_numeric(points[column])})
        for column, name in names.items()
    ]
    return pd.concat(sizes).dropna().drop_duplicates().assign(**{"serial number": 24 * "_"})


def _steps(points: pd.DataFrame) -> pd.DataFrame:
    """Consecutive points of one feature in one posture as one row."""
    repeat = ", repeat " + points["repeat"].astype("string")
    repeat = repeat.where(points["repeat"] != "").fillna("")
    test = points["test"] + " " + points["position"] + repeat
    described = points[["feature", "articulation"]].assign(test=test).reset_index(drop=True)
    begins_step = (described != described.shift()).any(axis=1)
    described["line"] = described.index + 2  # after the head of the file
    steps = described.groupby(begins_step.cumsum())
    first, last = steps.first(), steps["line"].last().astype(str)
    times = steps.size().astype(str) + " × "
    table = pd.DataFrame({"done": "☐", "lines": first["line"].astype(str) + " to " + last})
    return table.assign(
        test=first["test"], probe=times + first["feature"], posture=first["articulation"]
    )
