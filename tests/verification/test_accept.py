"""Figures of touches whose errors are known, verdicts, and files that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from aacmm_pin import Arm, ErrorModel, accept, simulate_measurements
from aacmm_pin._support.checks import Array
from aacmm_pin.cli.root_command import app
from aacmm_pin.effects import EncoderEccentricity
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.noise import Noise
from aacmm_pin.verification.touches import ACCEPTANCE, AS_GIVEN

DIRECTIONS = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0], [0, -0.6, 0.8], [0.8, 0, -0.6]]])


def rows(points: Array, **cells: Any) -> pd.DataFrame:
    """Touches at ``points`` (n, 3) [mm]."""
    return pd.DataFrame(points, columns=["x_mm", "y_mm", "z_mm"]).assign(**cells)


def sphere(count: int, center: Array, diameter: float, **cells: Any) -> pd.DataFrame:
    """Touches all over a sphere of 25 mm with a probe of 6 mm, whose centres lie on one of ``diameter`` [mm]."""
    rng = np.random.default_rng(count)
    directions = np.vstack([DIRECTIONS, rng.normal(size=(count, 3))])[:count]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    known = {"feature_diameter_mm": 25.0, "probe_diameter_mm": 6.0, "u_length_mm": 0.001}
    return rows(center + diameter / 2 * directions, **(known | cells))


def lengths(count: int, positions: int, repeats: int, probe: float, error: float, **cells: Any) -> pd.DataFrame:
    """Lengths of 300 mm and more that are all right, but for the last one."""
    tables, rng = [], np.random.default_rng(1)
    for number in range(count):
        length = 300.0 + 200.0 * number
        for position in range(positions):
            a, direction = rng.uniform(-500, 500, size=3), rng.normal(size=3)
            direction /= np.linalg.norm(direction)
            for repeat in range(repeats):
                last = (number, position, repeat) == (count - 1, positions - 1, repeats - 1)
                labels = {"length_id": f"L{number}", "position": position, "repeat": repeat, "length_mm": length}
                ends = np.array([a, a + (length + probe + error * last) * direction])
                tables.append(rows(ends, feature=["A", "B"], u_length_mm=0.002, probe_diameter_mm=probe, **labels, **cells))
    return pd.concat(tables)


def everything() -> pd.DataFrame:
    """All tests in one table."""
    tables = [
        sphere(25, np.array([500.0 * k, 0, 0]), 31.0 + 0.02 * k, test="sphere", feature="S", position=k) for k in (0, 1)
    ]
    corners = np.array([[0, 0, 0], [0.03, 0, 0], [0.01, 0.001, 0], [0.02, 0, 0.001], [0.015, 0, 0]])
    tables += [
        sphere(5, corner, 31.0, test="location", feature="S", position=0, repeat=k) for k, corner in enumerate(corners)
    ]
    tables += [lengths(5, 7, 3, 0.0, -0.04, test="length-uni"), lengths(5, 7, 3, 6.0, 0.05, test="length-bi")]
    tables += [sphere(9, np.zeros(3), 31.0 - 0.01 * k, test="effective-diameter", feature="S", repeat=k) for k in range(3)]
    tables.append(lengths(2, 10, 1, 0.0, 0.06, test="volumetric"))
    for place in range(3):
        offsets = np.zeros((10, 3))
        offsets[0, 2], offsets[1, 2] = 0.01 * place, -0.01 * place
        tables.append(rows(np.array([100.0 * place, 0, 0]) + offsets, test="single-point", position=place))
    return pd.concat(tables, ignore_index=True)


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


@pytest.fixture
def data(tmp_path: Path) -> Path:
    path = tmp_path / "touches.csv"
    everything().to_csv(path, index=False)
    return path


def test_figures_are_those_of_the_touches(data: Path) -> None:
    result = accept(data)
    values = {f.definition.name: f.evaluated.value * 1e3 for f in result.figures}
    assert values == pytest.approx(EXPECTED, abs=1e-7)
    assert {f.verdict for f in result.figures} == {None}
    assert {f.source for f in result.figures} == {AS_GIVEN}
    u = {f.definition.name: f.evaluated.u * 1e3 for f in result.figures}
    assert (u["P_Size.Sph.1x25"], u["E_Bi"], u["Volumetric.2RMS"]) == pytest.approx((0.001, 0.002, 0.004))
    assert [f.definition.name for f in accept(data, standard="asme-b89.4.22").figures] == [*EXPECTED][5:10]


VERDICTS = {0.0441: "conformity", 0.0439: "neither", 0.0361: "neither", 0.0359: "non-conformity"}


@pytest.mark.parametrize(("mpe", "verdict"), VERDICTS.items())
def test_verdicts_have_a_guard_band(data: Path, mpe: float, verdict: str) -> None:
    (found,) = (f for f in accept(data, mpe={"E_Uni": mpe * 1e-3}).figures if f.definition.name == "E_Uni")
    assert found.verdict == verdict  # |-0.04| mm with U = 0.004 mm


@pytest.mark.parametrize(
    ("test", "left_out", "missing"),
    [
        ("sphere", slice(0, 3), 3),
        ("location", slice(0, 5), 5),
        ("length-uni", slice(0, 2), 1),
        ("length-bi", slice(0, 42), 21),
        ("effective-diameter", slice(0, 9), 9),
        ("volumetric", slice(0, 6), 3),
        ("single-point", slice(8, 10), 2),
    ],
)
def test_too_few_touches_give_no_value(tmp_path: Path, test: str, left_out: slice, missing: int) -> None:
    table = everything()
    table.drop(table.index[table["test"] == test][left_out]).to_csv(tmp_path / "few.csv", index=False)
    found = [f for f in accept(tmp_path / "few.csv", mpe={"E_Uni": 1e-3}).figures if f.definition.test == test]
    assert {f.evaluated.missing for f in found} == {missing}
    assert all(np.isnan(f.evaluated.value) and f.verdict is None for f in found)


def test_lengths_are_long_enough_for_the_range(data: Path) -> None:
    """The longest is 1100 mm."""
    for measuring_range, there in ((1.64, True), (1.66, False)):
        found = {f.definition.name: f for f in accept(data, measuring_range=measuring_range).figures}
        assert np.isfinite(found["E_Uni"].evaluated.value) == there
        assert bool(found["E_Bi"].missing) != there


def test_an_extended_arm_passes_where_the_nominal_one_fails(tmp_path: Path) -> None:
    arm = Arm.load("sino6")
    true = ErrorModel(arm, (EncoderEccentricity(joint=3, values=(3e-4, 0.0)),))
    quiet = Noise.of(6, encoder=1e-7, reference=1e-6, probe=1e-7)
    records = simulate_measurements(true, "seats", 60, seats=4, rng=np.random.default_rng(4), noise=quiet)
    table = records.to_frame()
    table = table[table["seat"].isin(table["seat"].value_counts().index[:3])]
    table = table.assign(test="single-point", position=table["seat"]).filter(regex="theta|test|position")
    path, extended = tmp_path / "touches.csv", tmp_path / "extended.toml"
    table.to_csv(path, index=False)
    true.save(extended)
    content = json.loads(done("sino6", extended, path, "--mpe", "SPAT.Max=0.005", "--json", "-"))
    verdicts = {f["coordinates"]: f["verdict"] for f in content["figures"] if f["figure"] == "SPAT.Max"}
    assert verdicts == {"sino6": "non-conformity", str(extended): "conformity"}


def done(*words: object) -> str:
    outcome = CliRunner().invoke(app, ["accept", *map(str, words)])
    assert outcome.exit_code == 0, outcome.output
    return outcome.stdout


def test_certificate_has_every_figure_and_the_touches(data: Path, tmp_path: Path) -> None:
    limits, target = tmp_path / "limits.toml", tmp_path / "certificate.html"
    limits.write_text('"P_Form.Sph.1x25" = 0.02\nE_Uni = 0.03\n', encoding="utf-8")
    out = done(data, "--mpe", limits, "--mpe", "E_Bi=0.06", "-o", target)
    page = target.read_text(encoding="utf-8")
    for name in EXPECTED:
        assert name in out
        assert name in page
    assert out.count("non-conformity") >= 1
    assert "touches.csv" in page


@pytest.mark.parametrize(
    ("column", "cell", "said"),
    [
        ("test", "ball", ["row 3", "column test", "'ball'"]),
        ("x_mm", "", ["row 3", "column x_mm"]),
        ("feature_diameter_mm", "25,0", ["row 3", "column feature_diameter_mm"]),
        ("probe_diameter_mm", "", ["row 3", "column probe_diameter_mm", "sphere"]),
        ("u_length_mm", "-1", ["row 3", "column u_length_mm"]),
    ],
)
def test_errors_name_row_and_column(data: Path, column: str, cell: str, said: list[str]) -> None:
    table = pd.read_csv(data, dtype=str)
    table.loc[1, column] = cell
    table.to_csv(data, index=False)
    with pytest.raises(AacmmError) as raised:
        accept(data)
    assert all(word in str(raised.value) for word in [str(data), *said])


def test_what_cannot_be_judged(data: Path, tmp_path: Path) -> None:
    for words in (
        ["--mpe", "E_Uno=0.1"],
        ["--mpe", "E_Uni=small"],
        ["--mpe", "E_Uni=-1"],
        ["--standard", "iso"],
        ["--range-mm", "0"],
    ):
        outcome = CliRunner().invoke(app, ["accept", str(data), *words])
        assert (outcome.exit_code, outcome.stdout) == (1, ""), words
    table = everything()[["test", *ACCEPTANCE[:1], "position", "repeat", "length_id"]]
    table[table["test"] == "single-point"].to_csv(tmp_path / "no.csv", index=False)
    with pytest.raises(AacmmError, match="no coordinates"):
        accept(tmp_path / "no.csv")
    flat = everything()
    flat.loc[flat["test"] == "sphere", "z_mm"] = 0.0
    flat.to_csv(data, index=False)
    with pytest.raises(AacmmError, match=r"P_Form.*plane"):
        accept(data)
