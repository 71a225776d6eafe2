"""A procedure of an acceptance test as a sheet: positions of artefacts, points to probe."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure as Drawing

from aacmm_pin._support.units import MM
from aacmm_pin.postures import places
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.document import (
    Bullets,
    Document,
    Download,
    Figure,
    Heading,
    Table,
    document_of,
)
from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, INK, VERMILLION, without_latex
from aacmm_pin.verification import ASME, EDITIONS, RULE_OF, Procedure

ARTEFACTS = {
    "sphere": ("sphere", BLUE),
    "single-point": ("seat", GREEN),
    "length": ("length bar", VERMILLION),
    "volumetric": ("ball bar", GREY),
}
"""Artefact of each test, and its colour."""
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
    views = Figure(
        lambda: procedure_views(procedure),
        "Spheres, seats and bars round the arm, from above and from the side",
        "The figure shows the arm in one posture (black) and the positions of all artefacts. Use "
        "the bars one after the other.",
    )
    return Document(
        f"Points to probe for the acceptance test of {procedure.arm.name}",
        [
            ORIGIN,
            f"{procedure}.",
            Heading("Artefacts"),
            views,
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
    names = {kind: name for kind, (name, _) in ARTEFACTS.items()}
    return table.assign(kind=table["kind"].map(names)).rename(columns={"kind": "artefact"})


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
    steps = described.groupby(begins_step.cumsum(), sort=False)
    sizes, first = steps.size(), steps.first()
    last_lines = sizes.cumsum() + 1  # the head of the file is line 1
    ranges = zip(sizes, last_lines, strict=True)
    lines = [f"{last}" if size == 1 else f"{last - size + 1} to {last}" for size, last in ranges]
    times = (sizes.astype(str) + " × ").where(sizes > 1, "")
    table = pd.DataFrame({"done": "☐", "lines": lines, "test": first["test"]})
    return table.assign(probe=times + first["feature"], posture=first["articulation"])


@without_latex()
def procedure_views(procedure: Procedure) -> Drawing:
    """The artefacts around the arm, from above and from the side."""
    lines = ArmLines(procedure.arm).corners(procedure.q[:1])[0] / MM
    figure = Drawing(figsize=(10.0, 5.6), layout="constrained")
    views = figure.subplots(1, 2)
    titles = ("View from above (along -z)", "View from the side (along y)")
    for view, ordinate, title in zip(views, "yz", titles, strict=True):
        plane = ["x", ordinate]
        for (kind, position), ends in _ends(procedure).groupby(["kind", "position"], sort=False):
            name, colour = ARTEFACTS[str(kind)]
            points = ends[plane].to_numpy() / MM
            view.plot(*points.T, "o-", color=colour, ms=5, lw=1.2, label=name)
            if kind != "volumetric":
                offset = {"xytext": (5, 4), "textcoords": "offset points", "fontsize": 8}
                view.annotate(str(position), points[0], color=colour, **offset)
        view.plot(*lines[:, [0, "xyz".index(ordinate)]].T, color=INK, lw=2.5)
        view.plot(0, 0, "s", color=INK, ms=7)
        view.set(xlabel="x [mm]", ylabel=f"{ordinate} [mm]", title=title)
        view.set_aspect("equal")
        view.grid(color="#eeeeee")
    handles = {line.get_label(): line for line in views[0].lines if line.get_label()[0] != "_"}
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=4)
    return figure
