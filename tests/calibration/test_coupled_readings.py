"""Readings of coupled encoders, by a plant of its own: Pinocchio's kinematics of a URDF, and the
couplings written out.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from oracle import close, derivative

from aacmm_pin import calibrate, diagnose
from aacmm_pin.accuracy import accuracy_volume
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import MistakenFileError
from aacmm_pin.measurements import Measurements
from tests.arm_files import serial_urdf
from tests.cli import shell
from tests.tables import PLACES, THETAS

Array = np.ndarray
READING, REFERENCE = 8e-6, 10e-6
SHIFT, TURN = 3e-4, 3e-4
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
ORIGINS = ("0 0 0.2", "0.05 0 0.1", "0 0 0.5", "0.1 0 0.02", "0.4 0 0", "0.08 0 0.03")
SUM = (3, 2, -1.0)
GEAR = (5, 5, 0.5)


URDF = serial_urdf(
    [("revolute", axis, place, -2, 2) for axis, place in zip(AXES, ORIGINS, strict=True)],
    "0.12 0.03 0.05",
)


class Plant:
    """The URDF with errors of its placements; readings of joint 3 show the sum with joint 2, those
    of joint 5 twice its angle.
    """

    def __init__(self, rng: np.random.Generator, ratio: float = -1.0) -> None:
        self.model = pin.buildModelFromXML(URDF)
        self.data, self.ratio = self.model.createData(), ratio
        for joint in range(1, 7):
            twist = rng.uniform(-1, 1, 6) * np.repeat([SHIFT, TURN], 3)
            placement = self.model.jointPlacements[joint]
            self.model.jointPlacements[joint] = placement * pin.exp6(twist)

    def angles(self, readings: Array) -> Array:
        one, two, three, four, five, six = readings.T
        return np.stack([one, two, three + self.ratio * two, four, 0.5 * five, six], axis=1)

    def tips(self, readings: Array) -> Array:
        found = []
        for q in self.angles(readings):
            pin.framesForwardKinematics(self.model, self.data, q)
            found.append(self.data.oMf[self.model.getFrameId("tip")].translation.copy())
        return np.array(found)

    def readings(self, rng: np.random.Generator, n: int) -> Array:
        q = rng.uniform(-1.8, 1.8, (n, 6))
        q[:, 2] += q[:, 1]
        q[:, 4] *= 2.0
        return q

    def records(self, rng: np.random.Generator, n: int) -> Measurements:
        readings = self.readings(rng, n)
        tips = self.tips(readings) + REFERENCE * rng.normal(size=(n, 3))
        shown = readings + READING * rng.normal(size=(n, 6))
        return Measurements.of(shown, tips, np.full((n, 3), REFERENCE))


@pytest.fixture
def crane(tmp_path) -> Arm:
    path = tmp_path / "crane.urdf"
    path.write_text(URDF, encoding="utf-8")
    arm = Arm.from_urdf(path, "tip", translation_half_width=SHIFT, rotation_half_width=TURN)
    return arm.with_encoder_noise(np.full(6, READING))


def test_known_couplings_calibrate_to_the_truth(crane, rng):
    plant = Plant(rng)
    arm = crane.with_couplings(SUM, GEAR)
    records = plant.records(rng, 120)
    found = calibrate(arm, records, hold_out=False)
    new = plant.readings(rng, 200)
    off = found.model.arm.positions(arm.joint_angles(new)) - plant.tips(new)
    predicted = accuracy_volume(
        found.model.arm, arm.joint_angles(new), method="ellipsoid", encoder_noise=0.0
    )
    ratio = np.linalg.norm(off, axis=1) / predicted.u
    assert 0.5 < np.sqrt(np.mean(ratio**2)) < 1.5
    assert found.model.arm.couplings == arm.couplings
    # Records that have joint angles already are not mapped once more.
    again = calibrate(arm, found.fit.problem.measurements, hold_out=False)
    close(again.model.arm.positions(new), found.model.arm.positions(new))


def test_a_stated_ratio_that_the_encoder_does_not_have_is_named(crane, rng):
    for truth, couplings, said in (
        (0.0, (SUM, GEAR), r"joint = 3, of = 2\D* -1 \D* 0\b"),
        (1.0, (SUM, GEAR), r"joint = 3, of = 2\D* -1 \D* 1\b"),
        (-1.0, (SUM, (5, 5, 2.0)), r"joint = 5, of = 5\D* 0\.5"),
    ):
        records = Plant(rng, truth).records(rng, 40)
        with pytest.raises(MistakenFileError, match=said):
            calibrate(crane.with_couplings(*couplings), records, hold_out=False)


@pytest.mark.long
def test_a_ratio_that_is_off_is_found_with_its_u(crane, rng):
    records = Plant(rng, -1.002).records(rng, 150)
    arm = crane.with_couplings(SUM, GEAR)
    result = diagnose(arm, records, hold_out=False, rng=np.random.default_rng(1))
    (finding,) = result.findings
    effect = finding.effect
    assert (effect.cause, effect.joint, effect.of) == ("joint_coupling", 3, 2)
    value, u = finding.parameters["ratio_change"]
    assert 1e-6 < u < 2e-5
    assert abs(value + 0.002) < 3.0 * u
    extended = result.model.file()
    assert [(one.joint, one.of, one.ratio) for one in extended.couplings] == [SUM, GEAR]


def test_the_jacobian_of_readings_is_that_of_differences(crane, rng):
    plant = Plant(rng)
    records = plant.records(rng, 12)
    fit = calibrate(crane.with_couplings(SUM, GEAR), records, hold_out=False).fit
    jacobian = fit.problem.reading_jacobian(fit.problem.start, fit.point.frame)
    plant.model = pin.buildModelFromXML(URDF)
    for reading, columns in zip(records.q, jacobian, strict=True):
        close(columns, derivative(lambda x: plant.tips(x[None])[0], reading), 1e-8)


def test_noise_of_readings_is_that_of_draws(crane, rng):
    plant = Plant(rng)
    plant.model = pin.buildModelFromXML(URDF)
    arm = crane.with_couplings(SUM, GEAR)
    reading = plant.readings(rng, 1)
    noise = np.array([10.0, 20.0, 40.0, 10.0, 50.0, 10.0]) * 1e-6
    drawn = plant.tips(reading + noise * rng.normal(size=(20_000, 6)))
    model = ErrorModel(arm, ["joint_hysteresis:1,half_width_rad=0"])
    for given in (arm, model):  # by the arm's own Jacobian, and by that of displaced places
        exact = given.without_covariance if isinstance(given, ErrorModel) else given
        found = accuracy_volume(
            exact, arm.joint_angles(reading), method="ellipsoid", encoder_noise=noise
        )
        of_parameters = accuracy_volume(
            exact, arm.joint_angles(reading), method="ellipsoid", encoder_noise=0.0
        )
        of_noise = found.covariance[0] - of_parameters.covariance[0]
        assert np.abs(of_noise / np.cov(drawn.T) - 1.0)[np.diag_indices(3)].max() < 0.04
        close(of_noise, np.cov(drawn.T), 0.04 * np.trace(of_noise))


def test_an_error_of_an_encoder_acts_on_each_joint_that_it_is_a_part_of(crane, rng):
    plant = Plant(rng)
    plant.model = pin.buildModelFromXML(URDF)
    reading = plant.readings(rng, 20)
    arm = crane.with_couplings(SUM, GEAR)
    amplitude, gain, ratio = 3e-4, 2e-4, 1e-3
    model = ErrorModel(
        arm,
        [
            f"encoder_eccentricity:2,amplitude_rad={amplitude},phase_rad=0.3",
            f"encoder_gain:5,gain={gain}",
            f"joint_coupling:4,of=5,ratio_change={ratio}",
        ],
    )
    true = reading.copy()
    true[:, 1] += np.arcsin(amplitude * np.cos(reading[:, 1] - 0.3))
    true[:, 4] *= 1.0 + gain
    true[:, 3] += ratio * reading[:, 4]
    close(model.correct(arm.joint_angles(reading)), plant.tips(true), 1e-12)


def test_commands_write_and_take_readings(crane, rng, tmp_path):
    plant = Plant(rng)
    plant.model = pin.buildModelFromXML(URDF)
    arm = crane.with_couplings(SUM, GEAR)
    path = tmp_path / "arm.toml"
    ErrorModel(arm).save(path)
    data, corrected = tmp_path / "data.csv", tmp_path / "corrected.csv"
    shell.done(
        f"simulate {path} --scheme free --records 40 --encoder-noise 0 --u-reference-mm 0 "
        f"--probe-noise-mm 0 -o {data}"
    )
    table = pd.read_csv(data)
    close(plant.tips(np.radians(table[THETAS].to_numpy())), table[PLACES].to_numpy() / 1e3, 1e-8)

    shell.done(f"correct {path} {data} -o {corrected}")
    found = pd.read_csv(corrected)[[f"corrected_{name}" for name in PLACES]]
    close(found.to_numpy(), table[PLACES].to_numpy(), 1e-4)

    moved, sent = ErrorModel(arm, ["joint_zero_offset:3,offset_rad=1e-3"]), tmp_path / "sent.csv"
    moved.save(tmp_path / "moved.toml")
    shell.done(f"correct {tmp_path / 'moved.toml'} {data} --commands --nominal {path} -o {sent}")
    commands = pd.read_csv(sent)[[f"command{j}_deg" for j in range(1, 7)]].dropna().to_numpy()
    shift = np.degrees(1e-3) * np.eye(6)[2]
    expected = table[THETAS].to_numpy() - shift
    assert np.isclose(commands, expected, atol=1e-6).all(axis=1).sum() > 30

    plan = tmp_path / "plan.csv"
    shell.done(f"plan calibration {path} --records 12 --postures 30 -o {plan}")
    readings = np.radians(pd.read_csv(plan)[THETAS].to_numpy())
    assert (np.abs(plant.angles(readings)) <= 2.0 + 1e-6).all()

    out = tmp_path / "calibrated.toml"
    shell.done(f"calibrate {path} {data} --u-reference-mm 0.01 --arm-out {out}")
    assert Arm.load(out).couplings == arm.couplings


def test_an_acceptance_file_has_readings(sino6, tmp_path):
    paths = [str(tmp_path / name) for name in ("belt.toml", "plan.csv", "touches.csv", "read.csv")]
    belt, plan, touches, read = paths
    ErrorModel(sino6.with_couplings(SUM)).save(belt)
    shell.done(f"plan acceptance {belt} --standard asme-b89.4.22 -o {plan}")
    shell.done(
        f"simulate {belt} --procedure {plan} --encoder-noise 0 --probe-noise-mm 0 -o {touches}"
    )
    table = pd.read_csv(touches)
    readings = np.radians(table[THETAS].to_numpy())
    readings[:, 2] -= readings[:, 1]
    planned = table[["planned_x_mm", "planned_y_mm", "planned_z_mm"]].to_numpy()
    close(1e3 * sino6.positions(readings), planned, 1e-6)
    table.drop(columns=PLACES).to_csv(read, index=False)
    found = shell.found(f"accept {belt} {read} --standard asme-b89.4.22")
    values = [figure["value_mm"] for figure in found["figures"]]
    assert values
    assert max(map(abs, values)) < 1e-6
