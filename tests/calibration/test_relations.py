"""A touched cube and steps of known size as equations, by a plant with its own kinematics."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from blind.kinematics import Array
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import diagnose, next_measurements
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import Uncertainty
from aacmm_pin.calibration import Setup, problem_of, rms_residual
from aacmm_pin.calibration.calibrated_arm import moved_arm
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements
from aacmm_pin.report.verdicts import verdict_in_words
from tests.again import again
from tests.arm_files import changed
from tests.calibration.contacts import (
    COLUMNS,
    CONTACT,
    EDGE,
    NORMALS,
    PROBE,
    READING,
    Machine,
    Values,
    calibrated,
    cube_file,
    drawn,
    file_of,
    of_cubes,
    on_cube,
    planes_of,
)
from tests.cli import shell
from tests.few_causes import ECCENTRICITY_ALONE
from tests.notes import data_of
from tests.oracle import close


def probed(arm: Arm, rng: np.random.Generator, cubes: int = 1) -> tuple[Array, Array]:
    """Readings at the contacts of an arm with errors of its values, and the numbers of faces."""
    q, face = on_cube(Machine(arm, drawn(arm, rng)), rng, cubes)
    return q + READING * rng.normal(size=q.shape), face


def read(q: Array, face: Array, relations: pd.DataFrame) -> Measurements:
    return Measurements.from_frame(cube_file(q, face)).with_relations(relations)


def rough(arm: Arm, path: Path) -> Arm:
    """The arm with its geometry known within 0.5 mm and 2 mrad."""
    ErrorModel.of(arm).save(path)
    wide = (
        "[joints.uncertainty]\na_mm = 0.5\nd_mm = 0.5\nalpha_rad = 2e-3\ntheta_offset_rad = 2e-3\n"
    )
    path.write_text(re.sub(r"\[joints.uncertainty\]\n(.* = .*\n)*", wide, path.read_text()))
    return Arm.load(path)


def test_exact_relations_are_those_of_a_rigid_cube(sino6, rng):
    """Values, u and χ² of an independent least squares over the pose of each cube."""
    machine = Machine(sino6, drawn(sino6, rng))
    q, face = on_cube(machine, rng, 2)
    q += READING * rng.normal(size=q.shape)
    result = calibrated(sino6, read(q, face, of_cubes(2, u_mm=1e-5, u_deg=1e-5)))
    assert chi2.sf(*result.fit.chi2_stated) > 1e-3
    values = Values(sino6, result, q)
    at = values.tips(np.zeros(values.count))
    means = np.stack([at[face == k].mean(axis=0) for k in range(10)]).reshape(2, 5, 3)
    middles = means[:, :4].mean(axis=1)
    axes = means[:, [0, 2, 4]] - middles[:, None]
    turns = [Rotation.align_vectors(some, np.eye(3))[0] for some in axes]

    def residual(x: Array) -> Array:
        z, poses = x[: values.count], x[values.count :].reshape(2, 6)
        normal = np.concatenate(
            [
                (Rotation.from_rotvec(pose[3:]) * turn).apply(NORMALS)
                for pose, turn in zip(poses, turns, strict=True)
            ]
        )[face]
        beside = values.tips(z) - (middles + poses[:, :3])[face // 5]
        above = np.sum(beside * normal, axis=1) - (EDGE + PROBE) / 2
        return np.concatenate([above / values.scatter(normal), z])

    found = least_squares(residual, np.zeros(values.count + 12), x_scale="jac")
    values.agree(found, within=0.03)
    chi2_of_rigid = np.square(found.fun[: len(q)]).sum()
    assert result.fit.chi2_stated.value == pytest.approx(chi2_of_rigid, rel=0.03)


def test_wide_relations_say_nothing(sino6, rng):
    q, face = on_cube(Machine(sino6, drawn(sino6, rng)), rng)
    alone = calibrated(sino6, Measurements.from_frame(cube_file(q, face)))
    wide = calibrated(sino6, read(q, face, of_cubes(u_mm=9.0, u_deg=5.0)))
    close(wide.fit.point.x, alone.fit.point.x, 1e-9)


def test_a_cube_gives_the_scale(sino6, rng):
    """All lengths of the arm 1e-3 too large: one cube whose tips are 1e-3 closer."""
    errors = np.array([1e-3 * p.value * (p.unit == "m") for p in sino6.parameters])
    machine = Machine(sino6, errors)
    q, face = on_cube(machine, rng)
    records = Measurements.from_frame(cube_file(q, face))
    with pytest.raises(AacmmError, match="scale"):
        calibrated(sino6, records, prior=False)
    result = calibrated(sino6, records.with_relations(of_cubes()), prior=False)
    new = rng.uniform(-1.5, 1.5, (200, 6))
    lengths = []
    for arm in (machine, Machine(sino6)):
        tips = arm.tips(new)
        lengths.append(np.linalg.norm(tips[::2] - tips[1::2], axis=1))
    model = result.model.predict(new)
    lengths.append(np.linalg.norm(model[::2] - model[1::2], axis=1))
    true, nominal, after = lengths
    assert np.abs(nominal - true).max() > 5e-4
    assert np.sqrt(np.square(after - true).mean()) < 0.25 * np.sqrt(
        np.square(nominal - true).mean()
    )


def test_bodies_at_unknown_places_say_nothing_of_the_base(sino6, rng, tmp_path):
    """The zero of joint 1 turns the whole arm, and with it what it touched: u stays as stated."""
    arm = rough(sino6, tmp_path / "rough.toml")
    machine = Machine(sino6)
    q, face = on_cube(machine, rng)
    planes = Measurements.from_frame(cube_file(q, face))
    spheres = Measurements.from_frame(file_of(*machine.touching(rng)))
    for records in (planes, planes.with_relations(of_cubes()), spheres):
        result = calibrated(arm, records)
        k = result.parameters["parameter"].tolist().index("theta_offset1")
        assert np.sqrt(result.covariance[k, k]) == pytest.approx(2e-3 / np.sqrt(3), rel=1e-3)


@pytest.mark.parametrize(
    ("angle", "stated", "sign"), [(0.0, 20.0, 0), (180.0, 20.0, 1), (180.0, -20.0, -1)]
)
def test_steps_blocks_and_slots(sino6, rng, angle, stated, sign):
    """The centres of the ball are a diameter farther apart on a block, and nearer in a slot."""
    machine = Machine(sino6)
    start = rng.uniform(-1.0, 1.0, 6)
    normal = np.array([0.6, 0.0, 0.8])
    found, numbers = [], []
    for k, height in enumerate((0.0, 0.02 + sign * PROBE)):
        across = np.cross(normal, rng.uniform(-0.03, 0.03, (40, 3)))
        points = machine.tips(start[None]) + across + height * normal
        q = machine.at(points, np.tile(start, (40, 1)))
        found.append(q)
        numbers += [k] * len(q)
    row = [("E0", "E1", stated, 1e-3, angle, 1e-3)]
    records = read(np.concatenate(found), np.array(numbers), pd.DataFrame(row, columns=COLUMNS))
    fit = calibrated(sino6, records, parameters="theta_offset6").fit
    residual, _ = fit.observations.relation_residuals(fit.point.seats)
    assert np.abs(residual).max() < 0.1


def test_predicted_distance_of_faces_that_relations_hold(sino6, rng):
    """Distance d of row 4 is one standard uncertainty off; all else is exact."""
    half_width = 1e-3
    exact = dict.fromkeys(("a_mm", "alpha_rad", "theta_offset_rad"), 0.0)
    row = {"uncertainty": Uncertainty(d_mm=half_width * 1e3, **exact)}
    arm = changed("sino6", {0: {"uncertainty": None}, 4: row})
    errors = np.array([half_width / np.sqrt(3) * (p.name == "d4") for p in sino6.parameters])
    records = read(*on_cube(Machine(sino6, errors), rng), of_cubes())
    setup = Setup.of(arm, encoder_noise=READING, probe_noise=CONTACT)
    fitted = fit(problem_of(ErrorModel.of(arm), records, [], setup), robust=False)
    assert fitted.predicted_rms == pytest.approx(rms_residual(fitted, fitted.used), rel=0.02)


def contradictions(arm: Arm, records: Measurements) -> list[tuple[str, list[str]]]:
    notes = data_of(calibrated(arm, records).notes, "relation_off")
    return [(data["kind"], data["planes"]) for data in notes]


def test_a_value_that_all_else_contradicts_is_named(sino6, rng):
    q, face = probed(sino6, rng)
    assert not contradictions(sino6, read(q, face, of_cubes()))
    for row, column, off, kind, planes in (
        (0, "distance_mm", 0.1, "distance", ["E0", "E1"]),
        (1, "angle_deg", 0.05, "angle", ["E0", "E2"]),
    ):
        stated = of_cubes()
        stated.loc[row, column] += off
        assert contradictions(sino6, read(q, face, stated)) == [(kind, planes)]
        stated.loc[row, column] += 20 * off
        one, other = planes
        with pytest.raises(AacmmError, match=f"'{one}' and '{other}' contradict the stated {kind}"):
            calibrated(sino6, read(q, face, stated))


@pytest.mark.parametrize("seed", [again(0), 3])
def test_a_contact_with_the_label_of_another_face_is_excluded(sino6, seed, tmp_path):
    """It tilts a plane of least squares; one step would then turn the planes far beyond what is
    linear.
    """
    rng = np.random.default_rng(seed)
    arm = rough(sino6, tmp_path / "rough.toml")
    table = cube_file(*probed(arm, rng, 2))
    table.loc[3, "feature"] = "E1"
    result = calibrated(arm, Measurements.from_frame(table).with_relations(of_cubes(2)))
    assert np.flatnonzero(result.fit.excluded).tolist() == [3]


def test_faces_that_are_exchanged_or_probed_with_another_ball_are_refused(sino6, rng):
    table = cube_file(*probed(sino6, rng))
    exchanged = table.replace({"feature": {"E0": "E2", "E2": "E0"}})
    for wrong, said in (
        (exchanged, r"the stated angle by \+90°"),
        (table.assign(probe_diameter_mm=2 * PROBE * 1e3), r"the stated distance by -2\.99 mm"),
    ):
        with pytest.raises(AacmmError, match=said):
            calibrated(sino6, Measurements.from_frame(wrong).with_relations(of_cubes()))
    right_angle = of_cubes()
    right_angle.loc[1, "angle_deg"] = 180.0
    with pytest.raises(AacmmError, match=r"'E2' contradict the stated angle by \+90°"):
        calibrated(sino6, Measurements.from_frame(table).with_relations(right_angle))


@ECCENTRICITY_ALONE
def test_a_contradicted_distance_is_a_doubt_and_the_next_step(sino6, rng):
    q, face = probed(sino6, rng)
    stated = of_cubes()
    stated.loc[0, "distance_mm"] += 0.1
    found = diagnose(
        sino6, read(q, face, stated), encoder_noise=READING, probe_noise=CONTACT, hold_out=False
    )
    assert "contradicted references" in found.doubts
    assert [note.code for note in found.contradicted] == ["relation_off"]
    for words in (verdict_in_words(found), next_measurements(found)):
        assert "distance of planes E0 and E1" in words


@pytest.mark.parametrize("related", [False, True])
def test_the_predicted_distance_from_planes_is_that_of_random_arms(sino6, rng, related):
    q, face = on_cube(Machine(sino6), rng)
    q += READING * rng.normal(size=q.shape)
    records = read(q, face, of_cubes()) if related else Measurements.from_frame(cube_file(q, face))
    names = [p.name for p in sino6.parameters]
    squares = []
    for _ in range(10):
        errors = dict(zip(names, drawn(sino6, rng), strict=True))
        moved = ErrorModel.of(moved_arm(sino6, errors, sino6.covariance))
        setup = Setup.of(moved.arm, "base", "tip", True, READING, None, CONTACT, None)
        after = fit(problem_of(moved, records, [], setup), used=np.ones(records.n, bool))
        squares.append((rms_residual(after, after.used) ** 2, after.predicted_rms**2))
    measured, predicted = np.mean(squares, axis=0)
    assert np.sqrt(predicted) == pytest.approx(np.sqrt(measured), rel=0.25)


def test_relations_without_contacts_are_left_out(sino6, rng):
    q, face = on_cube(Machine(sino6, drawn(sino6, rng)), rng)
    few = read(q, face, of_cubes()).take(face % 5 == 0)
    assert not len(calibrated(sino6, few).fit.observations.ends)


@ECCENTRICITY_ALONE
def test_a_cause_is_found_by_cubes_alone(sino6, rng):
    machine = Machine(sino6)
    q, face = on_cube(machine, rng, 2)
    readings = q - 3e-4 * np.cos(q - 0.7) * (np.arange(6) == 2) + READING * rng.normal(size=q.shape)
    result = diagnose(
        sino6,
        read(readings, face, of_cubes(2)),
        encoder_noise=READING,
        probe_noise=CONTACT,
        rng=rng,
    )
    assert "encoder_eccentricity:3" in [finding.label for finding in result.findings]
    assert result.held_out is not None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"feature_a": "E9"}, "row 2, column feature_a: 'E9'; expected the label of a plane"),
        ({"feature_a": "S"}, "column feature_a: 'S'; expected the label of a plane"),
        ({"feature_a": "E1"}, "'E1' twice"),
        ({"feature_b": "E2", "angle_deg": 90.0}, "a distance between planes at 90°"),
        ({"angle_deg": None}, "column angle_deg: empty cell"),
        ({"u_angle_deg": None}, "column u_angle_deg: empty cell"),
        ({"u_angle_deg": 0.0}, "above 0"),
        ({"u_distance_mm": None}, "only one of distance"),
        ({"angle_deg": 179.9}, "expected 0 or 180"),
        ({"angle_deg": 200.0}, "row 2, column angle_deg: 200"),
        ({"feature_b": "E3"}, "expected one probe_diameter_mm in all rows"),
    ],
)
def test_relations_that_cannot_be_used_are_named(change, said):
    q = np.random.default_rng(1).uniform(-1, 1, (24, 6))
    table = cube_file(q, np.repeat(np.arange(3), 8))
    bare = planes_of(q[:8], np.full(8, 3))
    sphere = file_of(q[:8], np.zeros(8, int)).assign(feature="S")
    records = Measurements.from_frame(pd.concat([table, bare, sphere]).fillna({"feature_kind": ""}))
    row = {**dict(zip(COLUMNS, ("E0", "E1", 100.0, 1e-3, 180.0, 1e-3), strict=True)), **change}
    with pytest.raises(MeasurementFileError, match=said):
        records.with_relations(pd.DataFrame([row]))


def test_tables_of_relations_need_their_columns_and_each_pair_once():
    records = Measurements.from_frame(cube_file(np.zeros((24, 6)), np.repeat(np.arange(3), 8)))
    row = dict(zip(COLUMNS, ("E0", "E1", 100.0, 1e-3, 180.0, 1e-3), strict=True))
    other = row | {"feature_a": "E1", "feature_b": "E0"}
    with pytest.raises(MeasurementFileError, match="row 3, column feature_b: 'E1' and 'E0' again"):
        records.with_relations(pd.DataFrame([row, other]))
    with pytest.raises(MeasurementFileError, match="u_angle_deg: missing"):
        records.with_relations(pd.DataFrame([row]).drop(columns="u_angle_deg"))
    assert len(records.with_relations(pd.DataFrame([row | {"remark": "new"}])).relations) == 1
    with pytest.raises(MeasurementFileError, match="distance_mm: missing"):
        records.with_relations(pd.DataFrame([row]).rename(columns={"distance_mm": "apart"}))
    with pytest.raises(MeasurementFileError, match="expected distance_mm"):
        records.with_relations(pd.DataFrame([row]).rename(columns={"distance_mm": "distance_um"}))


def test_relations_at_the_shell(sino6, rng, tmp_path):
    q, face = on_cube(Machine(sino6, drawn(sino6, rng)), rng)
    data, relations = tmp_path / "cube.csv", tmp_path / "relations.csv"
    cube_file(q, face).to_csv(data, index=False)
    of_cubes().to_csv(relations, index=False)
    known = "--encoder-noise 8e-6 --probe-noise-mm 0.003 --no-prior --no-cross-validation"
    content = shell.found(f"calibrate sino6 {data} --relations {relations} {known}")
    shown = shell.done(f"check sino6 {data} --relations {relations}")[0]
    assert "5 with 12 records each" in shown.split("planes")[1]
    assert "2 distances and 5 angles between planes" in shown
    assert content["rms_mm"]["calibrated"] < content["rms_mm"]["nominal"]
