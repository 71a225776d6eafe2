"""Figures of touches whose errors are known, verdicts, and files that cannot be used."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import Arm, Measurements, accept
from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin.errors import AacmmError
from aacmm_pin.verification import AcceptanceResult
from aacmm_pin.verification.acceptance import CharacteristicValue
from aacmm_pin.verification.acceptance_file import AS_GIVEN
from tests.again import again
from tests.cli import shell
from tests.notes import data_of
from tests.tables import PLACES, THETAS
from tests.verification.probed_points import everything, rows, sphere

EXPECTED = {
    "P_Form.Sph.1x25": 0.0,
    "P_Size.Sph.1x25": 0.02,
    "L_Dia.5x5": 0.03,
    "E_Uni": -0.04,
    "E_Bi": 0.05,
    "EffectiveDiameter": -0.02,
    "SPAT.Max": 0.02,
    "SPAT.2s": 2 * np.sqrt(2 * 0.02**2 / 9),
    "Volumetric.Max": 0.06,
    "Volumetric.2RMS": 2 * 0.06 / np.sqrt(20),
    "SinglePoint.Sigma": np.sqrt(2 * 0.02**2 / 9),
}


def figure(result: AcceptanceResult, name: str) -> CharacteristicValue:
    """The figure of this name."""
    (found,) = (f for f in result.figures if f.definition.name == name)
    return found


@pytest.fixture
def data(tmp_path) -> Path:
    path = tmp_path / "touches.csv"
    everything().to_csv(path, index=False)
    return path


def test_figures_are_those_of_the_touches(data):
    result = accept(data)
    values = {f.definition.name: f.evaluated.largest.value * 1e3 for f in result.figures}
    assert values == pytest.approx(EXPECTED, abs=1e-7)
    assert {f.verdict for f in result.figures} == {None}
    assert {f.source for f in result.figures} == {AS_GIVEN}
    table = pd.read_csv(data)
    # Every other touch.
    table.assign(u_length_mm=table["u_length_mm"].where(table.index % 2 == 1)).to_csv(
        data, index=False
    )
    u = {f.definition.name: f.evaluated.largest.u * 1e3 for f in accept(data).figures}
    assert (u["P_Size.Sph.1x25"], u["E_Bi"], u["Volumetric.2RMS"]) == pytest.approx(
        (0.001, 0.002, 0.004)
    )
    assert [f.definition.name for f in accept(data, standard="asme-b89.4.22").figures] == [
        *EXPECTED
    ][5:10]


VERDICTS = [(0.0439, "neither"), (0.0359, "non-conformity")]
VERDICTS += [again(0.0441, "conformity"), again(0.0361, "neither")]


@pytest.mark.parametrize(("mpe", "verdict"), VERDICTS)
def test_verdicts_have_a_guard_band(data, mpe, verdict):
    everything("length-uni").to_csv(data, index=False)
    # |-0.04| mm with U = 0.004 mm.
    assert figure(accept(data, mpe={"E_Uni": mpe * 1e-3}), "E_Uni").verdict == verdict


@pytest.mark.parametrize(
    ("mpe", "u", "verdict"),
    [(0.05, 0.03, "neither"), (0.03, 0.03, "non-conformity"), (0.05, None, "conformity")],
)
def test_every_error_of_which_one_is_the_largest_decides(tmp_path, mpe, u, verdict):
    """The error of -0.04 mm is known badly in the second case; in the first the exact
    others are.
    """
    table = everything("length-uni")
    last = (table["length_id"] == "L4") & (table["position"] == 6) & (table["repeat"] == 2)
    table.loc[
        (table["test"] == "length-uni") & (last if verdict == "non-conformity" else ~last),
        "u_length_mm",
    ] = u
    if verdict == "non-conformity":  # another error of 0.038 mm stands by its small U
        near = (
            (table["test"] == "length-uni")
            & (table["length_id"] == "L3")
            & (table["position"] == 6)
            & (table["repeat"] == 2)
        )
        table.loc[near, "length_mm"] -= 0.038
    path = tmp_path / "touches.csv"
    table.to_csv(path, index=False)
    result = accept(path, mpe={"E_Uni": mpe * 1e-3})
    assert figure(result, "E_Uni").verdict == verdict
    assert data_of(result.notes, "some_guard_bands_zero" if u is None else "other_error_decides"), (
        result.notes
    )


@pytest.mark.parametrize(
    ("mpe", "verdict", "named"),
    [
        ({}, None, ""),
        again({"E_Uni": 1.0, "SPAT.Max": 1.0}, "conformity", "E_Uni, SPAT.Max"),
        again({"E_Uni": 0.0401e-3, "SPAT.Max": 1.0}, "neither", "E_Uni."),
        ({"SinglePoint.Part": 1.0, "SPAT.Max": 1.0}, "neither", "SinglePoint.Part"),
        ({"SinglePoint.Part": 1.0, "SPAT.Max": 1e-6}, "non-conformity", "SPAT.Max"),
    ],
)
def test_the_worst_verdict_is_that_of_the_whole(data, mpe, verdict, named):
    everything("length-uni", "single-point").to_csv(data, index=False)
    result = accept(data, mpe=mpe)
    assert result.summary()["overall"][0]["verdict"] == verdict
    assert f"decided by {named}" in str(result) or verdict is None


@pytest.mark.parametrize(
    ("options", "status"),
    [
        ("--mpe E_Uni=0.0359", 3),
        ("--mpe E_Uni=0.0439 --mpe SPAT.Max=1000", 4),
        ("--mpe E_Uni=0.0441 --mpe SPAT.Max=1000", 0),
        ("--mpe E_Uni=0.0441 --mpe SinglePoint.Part=1", 4),
        ("", 2),
    ],
)
def test_a_script_has_the_verdict_by_the_exit_status(data, tmp_path, options, status):
    everything("length-uni", "single-point").to_csv(data, index=False)
    target = tmp_path / "report.html"
    assert shell.run(f"accept {data} {options} -o {target} --exit-status")[0] == status
    assert target.exists() == (status != 2)


def test_a_sphere_touched_on_a_small_cap_has_no_size(tmp_path):
    table = sphere(25, np.zeros(3), 31.0, test="sphere", feature="S", position=0)
    cap = rows(31.0 / 2 * cap_directions(25, np.radians(20))).assign(
        **(dict(table.iloc[0, 3:]) | {"position": 1})
    )
    path = tmp_path / "touches.csv"
    pd.concat([table, cap]).to_csv(path, index=False)
    for figure in accept(path, mpe={"P_Size.Sph.1x25": 1e-3}).figures:
        assert np.isnan(figure.evaluated.largest.value)
        assert figure.missing == "points all over the sphere"


def cap_directions(count: int, half_angle: float) -> Array:
    """Unit vectors within ``half_angle`` [rad] of the z axis, in a spiral."""
    z, turn = np.linspace(np.cos(half_angle), 1.0, count), 2.4 * np.arange(count)
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])


@pytest.mark.parametrize(
    ("test", "left_out", "missing"),
    [
        ("sphere", slice(0, 3), 3),
        again("location", slice(0, 5), 5),
        ("length-uni", slice(0, 2), 1),
        again("length-bi", slice(0, 42), 21),
        ("effective-diameter", slice(0, 8), 8),
        again("volumetric", slice(0, 6), 3),
        ("single-point", slice(8, 10), 2),
    ],
)
def test_too_few_touches_give_no_value(tmp_path, test, left_out, missing):
    table = everything(test)
    table.drop(table.index[left_out]).to_csv(tmp_path / "few.csv", index=False)
    found = [
        f
        for f in accept(tmp_path / "few.csv", mpe={"E_Uni": 1e-3}).figures
        if f.definition.test == test
    ]
    assert {f.evaluated.missing for f in found} == {missing}
    assert all(np.isnan(f.evaluated.largest.value) and f.verdict is None for f in found)
    begun = {
        "sphere": "feature S, position 0",
        "length-uni": "length L0, position 0",
        "effective-diameter": "feature S, repeat 0",
        "single-point": "position 0",
    }
    assert {f.evaluated.lacking for f in found} == {(begun[test],) if test in begun else ()}


def test_an_end_has_one_touch_or_a_sphere(data):
    table = everything("volumetric")
    row = table.index[0]
    for touches, refused in ((1, False), (3, True), (4, False)):
        end = pd.concat([table.loc[[row]]] * touches)
        end[PLACES] += 15.0 * np.vstack([np.zeros(3), np.eye(3)])[:touches]
        pd.concat([table.drop(row), end]).to_csv(data, index=False)
        assert bool(data_of(accept(data).notes, "figure_without_value")) == refused


def test_part_that_was_predicted_to_be_accurate(tmp_path):
    offsets = np.random.default_rng(3).normal(scale=0.01, size=(10, 3))
    part = ["high"] * 4 + [""] * 6
    table = pd.concat(
        [rows(offsets + 100 * k, test="single-point", position=k, part=part) for k in range(3)]
    )
    table.to_csv(tmp_path / "part.csv", index=False)
    of = {f.definition.name: f.evaluated for f in accept(tmp_path / "part.csv").figures}
    assert of["SinglePoint.Part"].largest.value == pytest.approx(
        1e-3 * np.sqrt(np.mean(np.sum((offsets - offsets.mean(axis=0))[:4] ** 2, axis=1)))
    )
    table.assign(part=["high"] * 10 + part * 2).to_csv(tmp_path / "part.csv", index=False)
    found = {f.definition.name: f.evaluated.missing for f in accept(tmp_path / "part.csv").figures}
    assert (found["SinglePoint.Part"], found["SinglePoint.Rest"]) == (0, 1)


def test_lengths_are_long_enough_for_the_range(data):
    """The longest is 1100 mm."""
    everything("length-uni", "length-bi", "volumetric").to_csv(data, index=False)
    for measuring_range, there in ((1.666, True), (1.667, False)):
        found = {
            f.definition.name: f for f in accept(data, measuring_range=measuring_range).figures
        }
        assert np.isfinite(found["E_Uni"].evaluated.largest.value) == there
        assert bool(found["E_Bi"].missing) != there
        others = [figure for name, figure in found.items() if name not in ("E_Uni", "E_Bi")]
        assert all(np.isfinite(figure.evaluated.largest.value) for figure in others)


def test_touches_are_records_of_a_measurement_file(tmp_path):
    """Those of single points, of ends touched once and of spheres are seats, lengths are bars;
    coordinates are no reference.
    """
    table = everything()
    angles = np.random.default_rng(1).uniform(-20, 20, (len(table), 6))
    table[THETAS] = angles
    table["planned_theta4_deg"], table["u_length_mm"] = (
        angles[:, 3],
        table["length_mm"].where(table["length_mm"] == "", 0.002),
    )
    table.rename(columns=str.upper).to_csv(tmp_path / "touches.csv", index=False)
    records = Measurements.read(tmp_path / "touches.csv", 6)
    np.testing.assert_allclose(np.rad2deg(records.q), angles)
    assert not records.known.any()
    tests = table["test"].to_numpy()
    touched = {label: (set(tests[rows]), len(rows)) for label, rows in records.seats().items()}
    assert Counter((*test, n) for test, n in touched.values()) == {
        ("single-point", 10): 3,
        ("length-uni", 3): 70,
        ("length-bi", 3): 70,
        ("volumetric", 1): 40,
        ("sphere", 25): 2,
        ("location", 25): 1,
        ("effective-diameter", 27): 1,
    }
    assert records.on_sphere.sum() == 2 * 25 + 25 + 27
    lengths = {(bar.bar.split()[0], round(bar.length * 1e3)) for bar in records.bars()}
    longer = {"length-uni": (0, 5), "length-bi": (6, 5), "volumetric": (0, 2)}
    assert lengths == {
        (test, 300 + probe + 200 * k)
        for test, (probe, count) in longer.items()
        for k in range(count)
    }
    assert {bar.u for bar in records.bars()} == {2e-6}
    assert list(records.extra) == []
    own = table.assign(seat="", bar="", bar_end="", bar_length_mm="")
    assert Measurements.from_frame(own, 6).seats() == {}
    table.iloc[4, table.columns.get_loc("test")] = "ball"
    with pytest.raises(AacmmError, match=r"row 6.*test.*'ball'"):
        Measurements.from_frame(table, 6)


def test_the_test_report_has_every_figure_and_the_touches(data, tmp_path):
    limits, target = tmp_path / "limits.toml", tmp_path / "report.html"
    limits.write_text('"P_Form.Sph.1x25" = 0.02\nE_Uni = 0.03\n', encoding="utf-8")
    options = f"--mpe {limits} --mpe E_Bi=0.06"
    out, _ = shell.done(f"accept {data} {options} -o {target}")
    page = target.read_text(encoding="utf-8")
    for name in EXPECTED:
        assert name in out
        assert name in page
    assert "nonconformity" in out
    assert "probed_points.csv" in page


@pytest.mark.parametrize(
    ("column", "cell", "said"),
    [
        ("test", "ball", ["row 3", "column test", "'ball'"]),
        ("x_mm", "", ["row 3", "column x_mm"]),
        ("probe_diameter_mm", "", ["row 3", "column probe_diameter_mm", "sphere"]),
        *(
            (name, "25.1", ["row 3", f"column {name}", "row 2"])
            for name in ("feature_diameter_mm", "probe_diameter_mm")
        ),
        ("u_length_mm", "0.1", ["row 3", "column u_length_mm", "row 2"]),
    ],
)
def test_errors_name_row_and_column(data, column, cell, said):
    table = everything("sphere").astype(str)
    table.loc[1, column] = cell
    table.to_csv(data, index=False)
    with pytest.raises(AacmmError) as raised:
        accept(data)
    assert all(word in str(raised.value) for word in [str(data), *said])


def test_what_cannot_be_judged(data, tmp_path):
    assert shell.run(f"accept {data} --mpe E_Uni=1 --mpe E_Uni=2")[0] == 2
    for words in (
        "--mpe E_Uno=0.1",
        "--mpe E_Uni=0_06",
        "--measuring-range-mm 0",
    ):
        shell.refused(f"accept {data} {words}")
    table = everything("single-point").drop(columns=PLACES)
    table.to_csv(tmp_path / "no.csv", index=False)
    with pytest.raises(AacmmError, match="no coordinates"):
        accept(tmp_path / "no.csv")


@pytest.mark.parametrize("test", ["sphere", again("volumetric")])
def test_touches_that_fit_no_sphere_take_only_their_figures_values(data, test):
    """Touches of a sphere in a plane; a third feature of a length, with three touches."""
    table = everything("sphere", "volumetric", "single-point")
    table.loc[table["test"] == "sphere", "z_mm"] *= test != "sphere"
    table = pd.concat(
        [
            table,
            *[table[table["test"] == "volumetric"][:1].assign(feature="C")]
            * 3
            * (test != "sphere"),
        ]
    )
    table.to_csv(data, index=False)
    result = accept(data)
    assert {f.definition.test for f in result.figures if np.isnan(f.evaluated.largest.value)} == {
        test
    }
    note = data_of(result.notes, "figure_without_value")[0]["error"]
    assert ("plane" if test == "sphere" else "3 of C") in note
    assert (" 2 to " if test == "sphere" else f"{len(table) + 1}") in note


@pytest.mark.parametrize(
    ("test", "name"), [("length-uni", "E_Uni"), again("volumetric", "Volumetric.Max")]
)
def test_an_end_without_the_other_takes_the_value_of_its_figure(data, test, name):
    """A mistyped repeat of the one length that does not conform would leave it out."""
    table = everything(test).astype({"repeat": object})
    more = table.iloc[-2:].assign(position=99, repeat=["4", "04"])
    more["z_mm"] += [0.0, 5.0]
    pd.concat([table, more]).to_csv(data, index=False)
    result = accept(data)
    assert np.isnan(figure(result, name).evaluated.largest.value)
    told = data_of(result.notes, "figure_without_value")
    assert any(name in one["place"] and f"row {len(table) + 2}" in one["error"] for one in told)


def test_every_figure_says_where_it_is(data):
    table = everything()
    lines = np.arange(len(table)) + 2
    table.to_csv(data, index=False)
    content = shell.found(f"accept {data}")
    where = {f["figure"]: f["where"] for f in content["figures"]}
    last = {"position": "6", "repeat": "2", "length_id": "L4"}
    assert where["E_Uni"] == last | {"rows": lines[table["test"] == "length-uni"][-2:].tolist()}
    assert where["SPAT.Max"] == {
        "position": "2",
        "rows": [lines[table["test"] == "single-point"][20]],
    }
    assert where["P_Size.Sph.1x25"]["position"] == "1"
    assert [name for name, place in where.items() if place is None] == ["Volumetric.2RMS"]
    row = table.index[table["test"] == "length-uni"][40]
    table[table["test"] == "length-uni"].drop(row).to_csv(data, index=False)
    assert figure(accept(data), "E_Uni").missing == (
        "1 length: length L0, feature B, position 6, repeat 2"
    )


OFF_SPHERE = ("touch_off_sphere", "touches_off_sphere")


def test_a_touch_beside_its_sphere_is_named_and_not_left_out(data):
    """5 mm off: of 25 and of nine touches the very row, of five the sphere."""
    tests = ("sphere", "effective-diameter", "location")
    table, rng = everything(*tests), np.random.default_rng(1)
    table[PLACES] += rng.normal(scale=0.005, size=(len(table), 3))
    table.to_csv(data, index=False)
    assert not [note for note in accept(data).notes if note.code in OFF_SPHERE]
    for test, said in (
        ("sphere", "row 12: "),
        ("effective-diameter", "row {}: "),
        ("location", "rows {} to {}: "),
    ):
        first = int(table.index[table["test"] == test][0])
        off, at = table.copy(), first + 10 if test != "location" else first + 6
        off.loc[at, PLACES] += 5.0 / np.sqrt(3)
        off.to_csv(data, index=False)
        said = said.format(at + 2) if test != "location" else said.format(first + 7, first + 11)
        (note,) = (note for note in accept(data).notes if note.code in OFF_SPHERE)
        assert said in str(note)


@pytest.mark.parametrize(
    ("columns", "unit", "said"),
    [
        (PLACES, 25.4, "0.03937 times"),
        again(PLACES, 1e3, "0.001 times"),
        (["length_mm"], 25.4, " 25.4 "),
    ],
)
def test_lengths_in_another_unit_are_refused(data, columns, unit, said):
    table = everything("sphere", "length-uni")
    table[columns] = table[columns].apply(pd.to_numeric) / unit
    table.to_csv(data, index=False)
    with pytest.raises(AacmmError, match=said):
        accept(data)


def test_single_points_in_another_unit_are_noted(data):
    table = everything("single-point")

    def notes(factor: float, **options: float) -> list[Note]:
        """Of coordinates that are ``factor`` times as large."""
        scaled = table.copy()
        scaled[PLACES] *= factor
        scaled.to_csv(data, index=False)
        return accept(data, **options).notes

    assert not data_of(notes(1.0), "test_small")
    assert [told["test"] for told in data_of(notes(1e-3), "test_small")] == ["single-point"]
    for factor, noted in ((1.0, 0), (1 / 25.4, 1)):
        found = notes(factor, measuring_range=2.0)
        assert len(data_of(found, "test_small_in_range")) == noted


def test_touches_that_are_there_twice_are_noted(data):
    table = everything("sphere")
    for twice, noted in ((table.iloc[:0], False), (table.iloc[:5].round(3), True)):
        pd.concat([table, twice]).to_csv(data, index=False)
        copied = [
            (told["copies"], told["touches"])
            for told in data_of(accept(data).notes, "touches_copied")
        ]
        assert copied == [(10, len(table) + 5)] * noted


def test_an_mpe_in_another_unit_is_noted(data):
    everything("single-point").to_csv(data, index=False)
    for mpe, noted in ((6e-5, False), (6e-2, True)):
        told = data_of(accept(data, mpe={"SPAT.Max": mpe}).notes, "mpe_large")
        assert [one["figure"] for one in told] == ["SPAT.Max"] * noted


def test_figures_with_an_mpe_that_are_left_out_are_named(data):
    everything("sphere", "single-point").to_csv(data, index=False)
    notes = accept(data, standard="iso10360-12", mpe={"SPAT.Max": 1e-5}).notes
    assert data_of(notes, "mpe_of_other_standard") == [
        {"figures": ["SPAT.Max"], "standard": "iso10360-12"}
    ]


@pytest.mark.parametrize(("probe", "difference"), [(0.0, 6e-3), again(12.0, -6e-3)])
def test_a_probe_that_the_spheres_contradict_is_noted(data, probe, difference):
    table = everything("sphere")
    table.to_csv(data, index=False)
    assert not data_of(accept(data).notes, "sphere_size_off")
    table["probe_diameter_mm"] = probe
    table.to_csv(data, index=False)
    (told,) = data_of(accept(data).notes, "sphere_size_off")
    assert told["difference"] == pytest.approx(difference, rel=0.01)


@pytest.mark.parametrize("columns", [0, 6])
def test_arms_need_readings(data, columns):
    """Their columns may be there, and empty."""
    table = everything("single-point")
    table.assign(**{f"theta{k}_deg": "" for k in range(1, columns + 1)}).to_csv(data, index=False)
    with pytest.raises(AacmmError, match="no readings; expected numbers in theta1_deg"):
        accept(data, {"sino6": Arm.load("sino6")})
