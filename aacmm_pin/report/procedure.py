"""A procedure of an acceptance test as a sheet for the workshop: positions of the artefacts, and
the points to probe, in order.
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure as Drawing

from aacmm_pin._support.checks import Array
from aacmm_pin.postures import places
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Download,
    Figure,
    Heading,
    Table,
    document_of,
)
from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, VERMILLION
from aacmm_pin.report.plots.two_views import two_views
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
"""Tests whose artefacts are those of another."""
ORIGIN = (
    "The definitions and the decision rule come from public descriptions of "
    f"{', '.join(EDITIONS.values())} and {RULE_OF}. Before a contract depends on a verdict, "
    "compare the definitions and rule with the standards."
)
"""Stands first where a test is planned, predicted or evaluated."""
ZONES = "0 to 20, 20 to 80 and 80 to 100 % of the reach"
"""Zones of the single points of ASME B89.4.22; the standard's text rules. Probed points do not show
whether they were kept.
"""
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
    """The sheet, with the CSV to be filled in inside."""
    tests = set(procedure.probed_points["test"])
    seats = (
        f"According to public descriptions of {EDITIONS[ASME]}, the distances of the seats must "
        f"be {ZONES}."
        if "single-point" in tests
        else ""
    )
    seed = "" if procedure.seed is None else f", seed {procedure.seed}"
    views = Figure(
        lambda: procedure_views(procedure),
        "Spheres, seats and bars round the arm, from above and from the side",
        "The figure shows the arm in one posture (black) and the positions of all artefacts. Use "
        "the bars one after the other.",
    )
    things: list[Block] = [Heading("Artefacts"), views]
    things.append(Table(_sizes(procedure), "Artefacts and probe", detail=True))
    things.append(Table(_stands(procedure), POSITIONS, explained=seats))
    probed_points: list[Block] = [Heading("Points to probe, in order"), Bullets(FILL_IN)]
    probed_points.append(Table(_steps(procedure), ONE_ROW, detail=True))
    file = Download("procedure.csv", "the file to fill in", procedure.csv().encode())
    return Document(
        f"Points to probe for the acceptance test of {procedure.arm.name}",
        [ORIGIN, f"{procedure}.", *things, *probed_points, file],
        f"{len(procedure.probed_points)} points{seed}",
        by_hand=("Date", "Operator", "Instrument, serial number", "Temperature [°C]"),
    )


def _ends(procedure: Procedure) -> pd.DataFrame:
    """One row for each place of an artefact, and one more for the far end of a bar: kind, position,
    end, x, y, z [m].
    """
    names = ["test", "position", "feature"]
    points = pd.DataFrame(procedure.points, columns=[*"xyz"])
    table = procedure.probed_points[names].reset_index(drop=True).join(points)
    table["kind"] = table["test"].replace(ARTEFACT_OF_TEST)
    rows = []
    for (kind, position), probed_points in table.groupby(["kind", "position"], sort=False):
        features = [probed_points["feature"].iloc[0]]
        barred = kind in ("length", "volumetric")
        if barred:
            features.append(probed_points["feature"].iloc[-1])
        for feature in features:
            at = probed_points.loc[probed_points["feature"] == feature, [*"xyz"]].mean()
            place = {"kind": kind, "position": position, "end": feature if barred else ""}
            rows.append(place | at.to_dict())
    return pd.DataFrame(rows)


def _stands(procedure: Procedure) -> pd.DataFrame:
    """One row for each place of an artefact, with that of its far end."""
    ends = _ends(procedure)
    heads = ["distance [mm]", "bearing [°]", "height [mm]"]
    where = places(procedure.arm, ends[[*"xyz"]].to_numpy()).set_axis(heads, axis=1)
    table = ends[["kind", "position", "end"]].join(where.map(lambda value: f"{value:z.0f}"))
    table["kind"] = table["kind"].map({kind: name for kind, (name, _) in ARTEFACTS.items()})
    again = table.duplicated(["kind", "position"])
    far = table[again].rename(columns={name: f"far {name}" for name in ("end", *heads)})
    near = table[~again].drop(columns="end").merge(far, "left", on=["kind", "position"])
    return near.rename(columns={"kind": "artefact"}).fillna("")


def _sizes(procedure: Procedure) -> pd.DataFrame:
    """The size of every artefact, and room for its serial number."""
    probed_points = procedure.probed_points
    bars = probed_points["length_id"].replace(r"^(L\d+)$", r"length bar, A to \1", regex=True)
    names = {
        "feature_diameter_mm": "sphere, diameter",
        "probe_diameter_mm": "probe, diameter",
        "length_mm": bars,
    }
    sizes = [
        pd.DataFrame({"artefact": name, "size [mm]": pd.to_numeric(probed_points[column])})
        for column, name in names.items()
    ]
    return pd.concat(sizes).dropna().drop_duplicates().assign(**{"serial number": 24 * "_"})


def _steps(procedure: Procedure) -> pd.DataFrame:
    """Consecutive points of one feature in one posture as one row."""
    probed_points = procedure.probed_points.reset_index(drop=True)
    repeat = probed_points["repeat"].astype("string").fillna("")
    repeat = (", repeat " + repeat).where(repeat != "", "")
    test = probed_points["test"] + " " + probed_points["position"] + repeat
    rows = probed_points[["feature", "articulation"]].assign(test=test)
    new = (rows != rows.shift()).any(axis=1)
    steps = rows.groupby(new.cumsum(), sort=False)
    count, first = steps.size(), steps.first()
    last = count.cumsum() + 1  # the head of the file is line 1
    lines = [f"{b}" if n == 1 else f"{b - n + 1} to {b}" for n, b in zip(count, last, strict=True)]
    times = (count.astype(str) + " × ").where(count > 1, "")
    table = pd.DataFrame({"done": "☐", "lines": lines, "test": first["test"]})
    return table.assign(probe=times + first["feature"], posture=first["articulation"])


def procedure_views(procedure: Procedure) -> Drawing:
    """The artefacts round the arm, from above and from the side."""
    groups: dict[str, tuple[str, list[tuple[str, Array]]]] = {}
    for (kind, position), place in _ends(procedure).groupby(["kind", "position"], sort=False):
        name, colour = ARTEFACTS[str(kind)]
        label = "" if kind == "volumetric" else str(position)
        groups.setdefault(name, (colour, []))[1].append((label, place[["x", "y", "z"]].to_numpy()))
    return two_views(procedure.arm, procedure.q[:1], groups)
