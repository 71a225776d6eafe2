"""Procedures, predicted figures and virtual touches, against what is known without them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from aacmm_pin import (
    Arm,
    ErrorModel,
    accept,
    acceptance_procedure,
    perturbed_model,
    predict_acceptance,
)
from aacmm_pin.arm import joint_bounds
from aacmm_pin.cli.root_command import app
from aacmm_pin.effects import JointPeriodicError
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Noise
from aacmm_pin.measurements.simulate import simulate_touches
from aacmm_pin.report.procedure import _sizes, _steps
from aacmm_pin.verification import Procedure
from aacmm_pin.verification.characteristics import DEFINITIONS, definitions
from aacmm_pin.verification.prediction import READINGS, _Test


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("procedure") / "touches.csv"
    procedure = acceptance_procedure(Arm.load("sino6"), rng=np.random.default_rng(3))
    path.write_text(procedure.csv(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def few(planned: Path) -> Path:
    """The touches of ASME B89.4.22 alone, which are quicker."""
    table = pd.read_csv(planned, dtype=str)
    tests = [d.test for d in definitions("asme-b89.4.22")]
    table[table["test"].isin(tests)].to_csv(planned.with_name("few.csv"), index=False)
    return planned.with_name("few.csv")


def only(arm: Arm, *uncertain: str) -> Arm:
    """The arm with no uncertainty but 1 µm and 1 µrad of the parameters with these names."""
    width = dict.fromkeys(uncertain, 1e-6)
    parameters = tuple(
        replace(p, half_width=width.get(p.name, 0.0), u=width.get(p.name, 0.0) / np.sqrt(3))
        for p in arm.parameters
    )
    return replace(arm, parameters=parameters)


def test_every_touch_of_every_figure_is_planned_within_reach(sino6, planned):
    procedure = Procedure.read(planned, sino6)
    np.testing.assert_allclose(
        sino6.positions(procedure.q), procedure.points, atol=5e-6
    )  # angles are rounded
    bounds = joint_bounds(sino6)
    assert ((procedure.q > bounds[:, 0]) & (procedure.q < bounds[:, 1])).all()
    exact = pd.read_csv(planned, dtype=str)
    for name in "xyz":
        exact[f"{name}_mm"] = exact[f"planned_{name}_mm"]
    exact.to_csv(planned.with_name("exact.csv"), index=False)
    figures = accept(planned.with_name("exact.csv")).figures
    assert {f.definition.name for f in figures} == {d.name for d in DEFINITIONS if not d.column}
    assert all(abs(f.evaluated.value) < 1e-8 for f in figures)  # the file has nanometres
    lengths = procedure.touches[procedure.touches["test"] == "length-uni"]
    assert (
        lengths["length_mm"].astype(float).max() * 1e-3
        >= 2 / 3 * 2 * np.linalg.norm(procedure.points, axis=1).max() * 0.8
    )
    assert exact.loc[exact["test"] == "single-point", "articulation"].nunique() > 3


def test_artefacts_stand_where_a_table_or_a_tripod_holds_them(sino6):
    """Over the base of an arm that stands, along gravity; anywhere if the arm hangs, or reaches
    hardly so high.
    """

    def lowest(arm: Arm) -> float:
        planned = acceptance_procedure(arm, standard="asme-b89.4.22", rng=np.random.default_rng(2))
        return float((planned.points @ arm.up).min())

    def tall(height_mm: float, gravity: float) -> Arm:
        joints = [
            sino6.file.joints[0].model_copy(update={"d_mm": height_mm}),
            *sino6.file.joints[1:],
        ]
        return Arm.from_file(
            sino6.file.model_copy(update={"joints": joints, "gravity_m_s2": (0.0, 0.0, gravity)})
        )

    low = replace(sino6, limits=np.vstack([sino6.limits[:1], [-0.9, 0.0], sino6.limits[2:]]))
    standing, beneath = (sino6, tall(300.0, -9.81), tall(0.0, 9.81)), (tall(300.0, 9.81), low)
    assert all(lowest(arm) > -0.02 for arm in standing)  # a sphere goes round its centre
    assert all(lowest(arm) < -0.3 for arm in beneath)


def test_single_points_stand_in_the_zones_of_asme_b89_4_22(sino6, planned, rng):
    """Joint 2 of SINO6 is 0.3 mm from the origin of its base."""
    low, high = sino6.limits.T
    reach = np.linalg.norm(sino6.positions(rng.uniform(low, high, (20_000, 6))), axis=1).max()
    touches = pd.read_csv(planned).query("test == 'single-point'").groupby("position", sort=False)
    parts = (
        touches[["planned_x_mm", "planned_y_mm", "planned_z_mm"]]
        .first()
        .pipe(np.linalg.norm, axis=1)
        / reach
        * 1e-3
    )
    assert [int(np.searchsorted([0.2, 0.8], part)) for part in parts] == [0, 1, 2]


def test_the_lengths_of_asme_b89_4_22_and_what_the_sheet_says(sino6, planned):
    touches = acceptance_procedure(
        sino6, standard="asme-b89.4.22", lengths=[0.60002, 0.30001]
    ).touches
    bars = touches[touches["test"] == "volumetric"]
    assert bars.groupby("length_id")["length_mm"].unique().map(list).to_dict() == {
        "short ball bar": pytest.approx([300.01]),
        "long ball bar": pytest.approx([600.02]),
    }
    sizes, steps = _sizes(read := Procedure.read(planned, sino6)), _steps(read)
    assert sizes.set_index("artefact").loc[
        ["sphere, diameter", "probe, diameter"], "size [mm]"
    ].to_list() == [25, 6]
    assert sizes["artefact"].is_unique
    assert len(sizes) == 2 + 5 + 2
    assert steps["lines"].str.split().str[-1].iloc[-1] == str(len(read.touches) + 1)
    assert (
        steps["touch"] == "seat"
    ).sum() > 25  # one row each, where words tell the ten articulations apart
    every = pd.read_csv(planned, dtype=str)
    assert not {*every.loc[every["test"] == "volumetric", "position"]} & {
        *every["feature"],
        *every["length_id"].dropna(),
    }
    pairs = every[every["test"] == "length-uni"].drop_duplicates(["length_id", "feature"])
    assert set(pairs["feature"]) == {"A", *pairs["length_id"]}


def test_an_unfilled_procedure_has_no_figures(planned):
    with pytest.raises(MeasurementFileError, match="no coordinates"):
        accept(planned)


def test_what_turns_the_whole_arm_changes_no_figure(sino6, few):
    """The zero of joint 1 and d1 move all coordinates as one body, but for the square of
    the turn.
    """
    rigid = predict_acceptance(
        str(few),
        {"rigid": only(sino6, "theta_offset1", "d1")},
        encoder_noise=0.0,
        runs=20,
        progress=False,
    )
    assert max(f.magnitudes.max() for f in rigid.figures) < 5e-9  # the file has nanometres


def test_noise_of_readings_alone_scatters_as_its_covariance_says(sino6, few):
    u, procedure = 2e-5, Procedure.read(few, sino6)
    found = predict_acceptance(
        str(few), {"noisy": only(sino6)}, encoder_noise=u, runs=60, progress=False
    )
    sigma = next(f for f in found.figures if f.definition.name == "SinglePoint.Sigma")
    assert sigma.alone.index[0] == "encoder noise"
    rows = procedure.touches["test"] == "single-point"
    variance = u**2 * np.square(sino6.jacobian(procedure.q)).sum(axis=(1, 2))
    mean = variance[rows].reshape(3, 10).mean(axis=1)
    # The worst of three places is at least the place whose variance is largest, on average.
    assert np.sqrt(mean.max()) * 0.95 < np.median(sigma.magnitudes) < np.sqrt(mean.max()) * 1.25


def test_predictions_are_those_of_the_exact_chain(sino6, few, tmp_path):
    """Figures of arms that are drawn and touch exactly, judged from their files, beside the
    predicted distribution.
    """
    found = predict_acceptance(
        str(few), {"sino6": sino6}, encoder_noise=8e-6, runs=100, progress=False
    )
    procedure, ranks = Procedure.read(few, sino6), []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        true = perturbed_model(ErrorModel(sino6), rng)
        noise = Noise.of(6, encoder=8e-6)
        records = simulate_touches(true, procedure.q, procedure.points, rng=rng, noise=noise)
        procedure.filled(records, ErrorModel(sino6)).to_csv(tmp_path / "filled.csv", index=False)
        values = {
            f.definition.name: abs(f.evaluated.value)
            for f in accept(tmp_path / "filled.csv").figures
        }
        ranks.append([np.mean(f.magnitudes < values[f.definition.name]) for f in found.figures])
    mean = np.mean(ranks, axis=0)  # of uniform ranks 0.5 ± 0.118
    assert (np.abs(mean - 0.5) < 0.3).all(), dict(
        zip((f.definition.name for f in found.figures), mean, strict=True)
    )
    assert abs(np.mean(ranks) - 0.5) < 0.17


def test_the_first_order_step_is_exact_physics(sino6, few):
    """One drawn arm without noise: coordinates by exact postures, and p - S e."""
    procedure, rng = Procedure.read(few, sino6), np.random.default_rng(5)
    true = perturbed_model(ErrorModel(sino6), rng)
    silent = Noise.of(6, encoder=0.0)
    records = simulate_touches(true, procedure.q, procedure.points, rng=rng, noise=silent)
    off = sino6.positions(records.q) - procedure.points
    first = sino6.positions(procedure.q) - true.arm.positions(
        procedure.q
    )  # what the errors do where the model says p
    assert np.abs(off).max() > 5e-5
    np.testing.assert_allclose(off, first, atol=0.01 * np.abs(off).max())


def test_the_order_of_a_wave_belongs_to_it(sino6, few):
    wave = JointPeriodicError(3, 7.1, values=(1e-4, 0.0), u=(1e-5, 1e-5), nonlinear_u=0.02)
    causes = _Test.of(ErrorModel(sino6, (wave,)), Procedure.read(few, sino6), 8e-6, 0.0, 1).causes
    assert causes[-9:] == (*[wave.label] * 3, *[READINGS] * 6)


def test_the_chain_at_the_shell(tmp_path):
    """plan, simulate, accept: an arm with a hidden eccentricity fails, the arm that knows it
    passes.
    """
    touches, filled, truth = (
        tmp_path / name for name in ("touches.csv", "filled.csv", "truth.toml")
    )
    sheet, page = tmp_path / "sheet.html", tmp_path / "page.html"
    asme = "--standard asme-b89.4.22"
    said = run(f"plan sino6 --for acceptance {asme} -o {touches} --sheet {sheet}")
    assert str(touches) in said
    hidden = "encoder_eccentricity:3,amplitude_rad=3e-4"
    run(
        f"simulate sino6 --plan {touches} --effect {hidden} --encoder-noise-rad 1e-6 --truth "
        f"{truth} -o {filled}"
    )
    content = json.loads(run(f"accept sino6 {truth} {filled} --mpe SPAT.Max=0.05 --json -"))
    verdicts = {
        f["coordinates"]: f["verdict"] for f in content["figures"] if f["figure"] == "SPAT.Max"
    }
    assert (verdicts["sino6"], verdicts[str(truth)]) == ("non-conformity", "conformity")
    options = f"--predict --runs 20 --mpe SPAT.Max=10 --encoder-noise-rad 8e-6 {asme}"
    content = json.loads(run(f"accept sino6 {touches} {options} --json - -o {page}"))
    (worst,) = (f for f in content["figures"] if f["figure"] == "SPAT.Max")
    assert worst["probability_to_pass"] == 1.0
    assert worst["low_mm"] < worst["median_mm"] < worst["high_mm"] < 1.0
    assert worst["alone_mm"][worst["dominant"]] == max(worst["alone_mm"].values())
    for file, word in ((sheet, "elbow"), (page, "SPAT.Max")):
        assert word in file.read_text(encoding="utf-8")
        assert "ASME B89.4.22-2004" in file.read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "µm" not in page.read_text(encoding="utf-8")  # one unit on the page


def test_an_mpe_without_its_figure_is_told_by_an_example(tmp_path):
    for given in ("0.1", "E_Uni", "E_Uni:0.1"):
        result = CliRunner().invoke(
            app, ["accept", "sino6", str(tmp_path / "touches.csv"), "--mpe", given]
        )
        assert result.exit_code == 2
        assert given in result.stderr
        assert "FIGURE=MM" in result.stderr
        assert "E_Uni=0.1" in result.stderr


def test_what_cannot_be_planned_or_predicted(sino6, planned):
    for standard, lengths, said in (
        (None, [0.1, 0.2], "5 different"),
        ("asme-b89.4.22", [0.1, 0.2, 0.3], "2 different ones above 0 for ASME B89.4.22"),
        ("iso10360-12", [0.1, 0.2, 0.3, 0.4, 0.4], "5 different"),
    ):
        with pytest.raises(AacmmError, match=said):
            acceptance_procedure(sino6, standard=standard, lengths=lengths)
    with pytest.raises(AacmmError, match="shorter"):
        acceptance_procedure(sino6, standard="iso10360-12", measuring_range=9.0)
    for sizes in ({"probe_diameter": -1e-3}, {"sphere_diameter": 0.0}, {"lengths": [0.005, 0.2]}):
        with pytest.raises(AacmmError, match="expected"):
            acceptance_procedure(sino6, standard="asme-b89.4.22", **sizes)
    narrow = replace(
        sino6, limits=np.array([[0, 1.0], [-1.6, -0.6], [-0.5, 0.5], [0.5, 1.5], [0.3, 1], [-1, 1]])
    )
    with pytest.raises(
        AacmmError, match="no posture inside the limits was found with the tip at 20% to 45%"
    ):
        acceptance_procedure(narrow)
    less = str(_without(planned, "planned_x_mm", "planned_theta2_deg"))
    with pytest.raises(
        MeasurementFileError,
        match=r"planned_x_mm, planned_theta2_deg.*plan ARM --for acceptance -o",
    ):
        predict_acceptance(less, {"sino6": sino6}, progress=False)
    for words in (
        f"plan sino6 --for calibration --sphere-mm 20 -o {planned}",
        f"simulate sino6 --plan {planned} --records 20",
        f"plan sino6 --for acceptance --postures 100 -o {planned}",
        f"plan sino6 --for acceptance --encoder-noise-rad 1e-6 -o {planned}",
        f"accept sino6 {planned} --seed 1",
        f"accept sino6 {planned} --predict --range-mm 1200",
    ):
        assert CliRunner().invoke(app, words.split()).exit_code == 2, words


def _without(path: Path, *columns: str) -> Path:
    pd.read_csv(path, dtype=str).drop(columns=[*columns]).to_csv(
        path.with_name("less.csv"), index=False
    )
    return path.with_name("less.csv")


def run(command: str) -> str:
    done = CliRunner().invoke(app, command.split())
    assert done.exit_code == 0, done.output
    return done.stdout
