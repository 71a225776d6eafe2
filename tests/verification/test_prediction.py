"""Procedures, predicted figures and virtual touches, against what is known without them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import (
    Arm,
    ErrorModel,
    accept,
    acceptance_procedure,
    perturbed_model,
    predict_acceptance,
)
from aacmm_pin.arm import joint_bounds
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Noise
from aacmm_pin.measurements.simulate import simulate_touches
from aacmm_pin.verification import Procedure
from aacmm_pin.verification.characteristics import DEFINITIONS, definitions
from tests.again import again
from tests.arm_files import changed
from tests.cli import shell
from tests.oracle import close


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("procedure") / "touches.csv"
    procedure = acceptance_procedure(Arm.load("sino6"), rng=np.random.default_rng(3))
    path.write_text(procedure.csv(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def few(planned: Path) -> Path:
    """The touches of ASME B89.4.22 alone, which are quicker."""
    return of_tests(planned, *(d.test for d in definitions("asme-b89.4.22")))


def of_tests(planned: Path, *tests: str) -> Path:
    """A file with the touches of these tests alone."""
    table = pd.read_csv(planned, dtype=str)
    path = planned.with_name(f"{'-'.join(tests)}.csv")
    table[table["test"].isin(tests)].to_csv(path, index=False)
    return path


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
    # Angles are rounded.
    close(sino6.positions(procedure.q), procedure.points, 5e-6)
    bounds = joint_bounds(sino6)
    assert ((procedure.q > bounds[:, 0]) & (procedure.q < bounds[:, 1])).all()
    exact = pd.read_csv(planned, dtype=str)
    for name in "xyz":
        exact[f"{name}_mm"] = exact[f"planned_{name}_mm"]
    exact.to_csv(planned.with_name("exact.csv"), index=False)
    figures = accept(planned.with_name("exact.csv")).figures
    assert {f.definition.name for f in figures} == {d.name for d in DEFINITIONS if not d.column}
    assert all(abs(f.evaluated.value) < 1e-8 for f in figures)  # the file has nanometres
    lengths = procedure.probed_points[procedure.probed_points["test"] == "length-uni"]
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
        return changed("sino6", {1: {"d_mm": height_mm}}, gravity_m_s2=(0.0, 0.0, gravity))

    low = replace(sino6, limits=np.vstack([sino6.limits[:1], [-0.9, 0.0], sino6.limits[2:]]))
    standing, beneath = (sino6, tall(0.0, 9.81)), (tall(300.0, 9.81), low)
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


def test_the_lengths_of_asme_b89_4_22(sino6):
    touches = acceptance_procedure(
        sino6, standard="asme-b89.4.22", lengths=[0.60002, 0.30001]
    ).probed_points
    bars = touches[touches["test"] == "volumetric"]
    assert bars.groupby("length_id")["length_mm"].unique().map(list).to_dict() == {
        "short ball bar": pytest.approx([300.01]),
        "long ball bar": pytest.approx([600.02]),
    }


def test_an_unfilled_procedure_has_no_figures(planned):
    with pytest.raises(MeasurementFileError, match="no coordinates"):
        accept(planned)


def test_what_turns_the_whole_arm_changes_no_figure(sino6, planned):
    """The zero of joint 1 and d1 move all coordinates as one body, but for the square of
    the turn.
    """
    rigid = predict_acceptance(
        str(of_tests(planned, "single-point")),
        {"rigid": only(sino6, "theta_offset1", "d1")},
        encoder_noise=0.0,
        runs=20,
    )
    assert max(f.magnitudes.max() for f in rigid.figures) < 5e-9  # the file has nanometres


def test_noise_of_readings_alone_scatters_as_its_covariance_says(sino6, planned):
    few = of_tests(planned, "single-point")
    u, procedure = 2e-5, Procedure.read(few, sino6)
    found = predict_acceptance(
        str(few), {"noisy": only(sino6)}, encoder_noise=u, runs=60, progress=False
    )
    sigma = next(f for f in found.figures if f.definition.name == "SinglePoint.Sigma")
    assert sigma.alone.index[0] == "encoder noise"
    rows = procedure.probed_points["test"] == "single-point"
    variance = u**2 * np.square(sino6.jacobian(procedure.q)).sum(axis=(1, 2))
    mean = variance[rows].reshape(3, 10).mean(axis=1)
    # The worst of three places is at least the place whose variance is largest, on average.
    assert np.sqrt(mean.max()) * 0.95 < np.median(sigma.magnitudes) < np.sqrt(mean.max()) * 1.25


@pytest.mark.parametrize(
    "tests", [("single-point", "effective-diameter"), again(("volumetric",))], ids=" ".join
)
def test_predictions_are_those_of_the_exact_chain(sino6, planned, tests, tmp_path):
    """Figures of arms that are drawn and touch exactly, judged from their files, beside the
    predicted distribution.
    """
    few = of_tests(planned, *tests)
    found = predict_acceptance(
        str(few), {"sino6": sino6}, encoder_noise=8e-6, runs=20, progress=False
    )
    procedure, ranks = Procedure.read(few, sino6), []
    for seed in range(12):
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
    mean = np.mean(ranks, axis=0)  # of uniform ranks 0.5 ± 0.083
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
    # What the errors do where the model says p.
    first = sino6.positions(procedure.q) - true.arm.positions(procedure.q)
    assert np.abs(off).max() > 5e-5
    close(off, first, 0.01 * np.abs(off).max())


def test_the_chain_at_the_shell(tmp_path):
    """plan, simulate, accept: an arm with a hidden eccentricity fails, the arm that knows it
    passes.
    """
    touches, filled, truth = (
        tmp_path / name for name in ("touches.csv", "filled.csv", "truth.toml")
    )
    sheet, page = tmp_path / "sheet.html", tmp_path / "page.html"
    asme = "--standard asme-b89.4.22"
    shell.done(f"plan acceptance sino6 {asme} -o {touches} --sheet {sheet}")
    hidden = "encoder_eccentricity:3,amplitude_rad=3e-4"
    shell.done(
        f"simulate sino6 --procedure {touches} --cause {hidden} --encoder-noise 1e-6 --arm-out "
        f"{truth} -o {filled}"
    )
    content = shell.found(f"accept sino6 {truth} {filled} --mpe SPAT.Max=0.05")
    verdicts = {
        f["coordinates"]: f["verdict"] for f in content["figures"] if f["figure"] == "SPAT.Max"
    }
    assert (verdicts["sino6"], verdicts[str(truth)]) == ("non-conformity", "conformity")
    options = f"--runs 20 --mpe SPAT.Max=10 --encoder-noise 8e-6 {asme}"
    few = of_tests(touches, "single-point")
    content = shell.found(f"predict-acceptance sino6 {few} {options} -o {page}")
    (worst,) = (f for f in content["figures"] if f["figure"] == "SPAT.Max")
    assert worst["probability_to_pass"] == 1.0
    assert worst["low_mm"] < worst["median_mm"] < worst["high_mm"] < 1.0
    assert worst["alone_mm"][worst["dominant"]] == max(worst["alone_mm"].values())
    for file, word in ((sheet, "elbow"), (page, "SPAT.Max")):
        assert word in file.read_text(encoding="utf-8")
        assert "ASME B89.4.22-2004" in file.read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "µm" not in page.read_text(encoding="utf-8")  # one unit on the page


@pytest.mark.long
def test_what_cannot_be_planned_or_predicted(sino6, planned):
    for standard, lengths, said in (
        ("asme-b89.4.22", [0.1, 0.2, 0.3], "2 different"),
        ("iso10360-12", [0.1, 0.2, 0.3, 0.4, 0.4], "5 different"),
    ):
        with pytest.raises(AacmmError, match=said):
            acceptance_procedure(sino6, standard=standard, lengths=lengths)
    with pytest.raises(AacmmError, match="--length-mm"):
        acceptance_procedure(sino6, standard="iso10360-12", measuring_range=9.0)
    for sizes in ({"probe_diameter": -1e-3}, {"sphere_diameter": 0.0}, {"lengths": [0.005, 0.2]}):
        with pytest.raises(AacmmError, match="expected"):
            acceptance_procedure(sino6, standard="asme-b89.4.22", **sizes)
    narrow = replace(
        sino6, limits=np.array([[0, 1.0], [-1.6, -0.6], [-0.5, 0.5], [0.5, 1.5], [0.3, 1], [-1, 1]])
    )
    with pytest.raises(AacmmError, match="no posture within the limits"):
        acceptance_procedure(narrow)
    less = str(planned.with_name("less.csv"))
    table = pd.read_csv(planned, dtype=str)
    table.drop(columns=["planned_x_mm", "planned_theta2_deg"]).to_csv(less, index=False)
    with pytest.raises(MeasurementFileError, match="planned_x_mm, planned_theta2_deg"):
        predict_acceptance(less, {"sino6": sino6})
