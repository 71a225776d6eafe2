"""URDF joints that mimic others, by Pinocchio's own mimic joints, and by rotations written out."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin import accuracy_volume
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.measurements import Measurements
from tests.cli import shell
from tests.oracle import close, derivative, perturbed_positions

Array = np.ndarray
READING, REFERENCE = 2e-5, 1e-5
RATIO, OFFSET = -0.5, 0.3
JOINTS = (
    ("turret", "revolute", "0 0 1", "0 0 0.3", ""),
    ("shoulder", "revolute", "0 1 0", "0.1 0 0.1", ""),
    (
        "rod",
        "revolute",
        "0 1 0",
        "0 0 0.5",
        f'<mimic joint="shoulder" multiplier="{RATIO}" offset="{OFFSET}"/>',
    ),
    ("rack", "prismatic", "1 0 0", "0.1 0 0", '<mimic joint="turret" multiplier="0.05"/>'),
    ("wrist", "revolute", "0 0 1", "0.4 0 0", ""),
    ("pen", "revolute", "0 1 0", "0.1 0.02 0", '<mimic joint="rod" multiplier="2"/>'),
)
FULL = np.array([[1, 0, 0], [0, 1, 0], [0, RATIO, 0], [0.05, 0, 0], [0, 0, 1], [0, 2 * RATIO, 0]])
OFFSETS = np.array([0, 0, OFFSET, 0, 0, 2 * OFFSET])


def urdf(joints=JOINTS) -> str:
    """Six joints, of which three follow; the last follows one that follows."""
    text = ['<robot name="crane"><link name="base"/>']
    before = "base"
    for name, kind, axis, place, mimic in joints:
        text.append(
            f'<link name="of_{name}"/><joint name="{name}" type="{kind}"><parent link="{before}"/>'
            f'<child link="of_{name}"/><origin xyz="{place}"/><axis xyz="{axis}"/>{mimic}'
            '<limit lower="-1.5" upper="2.5" effort="1" velocity="1"/></joint>'
        )
        before = f"of_{name}"
    text.append(
        f'<link name="tip"/><joint name="end" type="fixed"><parent link="{before}"/>'
        '<child link="tip"/><origin xyz="0.12 0.03 0.05"/></joint></robot>'
    )
    return "\n".join(text)


@pytest.fixture
def crane(tmp_path) -> Arm:
    path = tmp_path / "crane.urdf"
    path.write_text(urdf(), encoding="utf-8")
    arm = Arm.from_urdf(path, "tip", translation_half_width=3e-4, rotation_half_width=3e-4)
    return arm.with_encoder_noise(np.full(3, READING))


def test_kinematics_are_those_of_pinocchio(crane, rng):
    model = crane.model
    for joint, of, ratio, offset in (
        (3, 2, RATIO, OFFSET),
        (4, 1, 0.05, 0.0),
        (6, 2, 2 * RATIO, 2 * OFFSET),
    ):
        model = pin.transformJointIntoMimic(model, of, joint, ratio, offset)
    data, tip = model.createData(), model.getFrameId("tip")
    q = rng.uniform(-1, 1, (20, 3))
    jacobian = crane.jacobian(q)
    state = ErrorModel(crane).state(q)
    shifts, turns = crane.chain.jacobian(state.rotation, state.origin, state.position)
    for k, each in enumerate(q):
        pin.framesForwardKinematics(model, data, each)
        expected = pin.computeFrameJacobian(model, data, each, tip, pin.LOCAL_WORLD_ALIGNED)
        close(crane.positions(q)[k], data.oMf[tip].translation)
        close(crane.poses(q).placement[k], data.oMf[tip].homogeneous)
        close(jacobian[k], expected[:3])
        close(np.concatenate([shifts[k], turns[k]]), expected)
    numeric = derivative(lambda one: crane.positions(one[None])[0], q[0])
    close(jacobian[0], numeric, 1e-9)
    steps = 1e-6 * np.eye(len(crane.parameters))
    ends = [perturbed_positions(crane, q[:1], sign * steps) for sign in (1, -1)]
    close(crane.sensitivity(q)[0], ((ends[0] - ends[1]) / 2e-6).T, 1e-9)


def tips(q: Array, off: float = 0.0, ratio: float = 0.0) -> Array:
    """Of the crane, its rod turned by ``off`` and by ``ratio`` times joint 2 more, by turns of
    SciPy.
    """
    values = q @ FULL.T + OFFSETS + np.outer(off + ratio * q[:, 1], np.eye(6)[2])
    turned, point = Rotation.identity(len(q)), np.zeros((len(q), 3))
    for (_, kind, axis, place, _), value in zip(JOINTS, values.T, strict=True):
        point = point + turned.apply(np.array(place.split(), float))
        along = np.outer(value, np.array(axis.split(), float))
        if kind == "prismatic":
            point = point + turned.apply(along)
        else:
            turned = turned * Rotation.from_rotvec(along)
    return np.asarray(point + turned.apply([0.12, 0.03, 0.05]))


def records(rng: np.random.Generator, off: float, ratio: float = 0.0, n: int = 60) -> Measurements:
    q = rng.uniform(-1, 1, (n, 3))
    shown = q + READING * rng.normal(size=q.shape)
    stated = tips(q, off, ratio) + REFERENCE * rng.normal(size=q.shape)
    return Measurements.of(shown, stated, np.full(q.shape, REFERENCE))


def test_noise_and_errors_of_an_encoder_act_on_each_joint_that_it_moves(crane, rng):
    arm, q = crane.with_couplings((2, 2, 0.5)), rng.uniform(-1, 1, (1, 3))
    angles = q * [1.0, 0.5, 1.0]
    close(arm.joint_angles(q), angles)
    ends = [tips((q + sign * 1e-6 * np.eye(3)) * [1.0, 0.5, 1.0]) for sign in (1, -1)]
    by_reading = ((ends[0] - ends[1]) / 2e-6).T
    expected = READING**2 * by_reading @ by_reading.T
    for given in (arm, ErrorModel(arm, ["joint_hysteresis:1,half_width_rad=0"])):
        u = [
            accuracy_volume(given, angles, method="ellipsoid", encoder_noise=noise).covariance[0]
            for noise in (READING, 0.0)
        ]
        close(u[0] - u[1], expected, 1e-6 * np.trace(expected))
    moved = ErrorModel(arm, ["encoder_gain:2,gain=1e-3"]).predict(angles)
    close(moved, tips(angles * [1.0, 1.001, 1.0]), 1e-9)


@pytest.mark.parametrize(
    ("leader", "words"),
    [("end", "is 'end'"), ("none", "there is no joint 'none'")],
)
def test_a_leader_that_does_not_move_is_refused(tmp_path, leader, words):
    path = tmp_path / "crane.urdf"
    path.write_text(urdf().replace('joint="shoulder"', f'joint="{leader}"'), encoding="utf-8")
    with pytest.raises(UnsupportedArmError, match=rf"joint 'rod': mimic: .*{words}"):
        Arm.from_urdf(path, "tip")


def test_a_leader_beside_the_chain_is_an_encoder(tmp_path, rng):
    """As of a lift whose stages follow the reading of a virtual joint."""
    q = rng.uniform(-1, 1, (20, 3))
    arms = []
    for name, text in (
        ("follows", urdf().replace('joint="shoulder"', 'joint="wrist"')),
        ("free", urdf(tuple((*j[:4], "" if j[0] == "rod" else j[4]) for j in JOINTS))),
    ):
        path = tmp_path / f"{name}.urdf"
        path.write_text(text, encoding="utf-8")
        arms.append(Arm.from_urdf(path, "of_rack"))
    follows, free = arms
    close(follows.positions(q), free.positions(q * [1, 1, RATIO] + [0, 0, OFFSET]), 1e-12)
    assert follows.limits[2] == pytest.approx(np.sort((free.limits[2] - OFFSET) / RATIO))


def test_limits_are_those_in_which_all_joints_are_inside_theirs(crane, tmp_path, rng):
    q = rng.uniform(-4, 4, (2000, 3))
    values = q @ FULL.T + OFFSETS
    inside = ((values >= -1.5) & (values <= 2.5)).all(axis=1)
    low, high = crane.limits.T
    np.testing.assert_array_equal(inside, ((q >= low) & (q <= high)).all(axis=1))
    path = tmp_path / "none.urdf"
    path.write_text(urdf().replace(f'offset="{OFFSET}"', 'offset="9"'), encoding="utf-8")
    with pytest.raises(UnsupportedArmError, match="limits"):
        Arm.from_urdf(path, "tip")


@pytest.mark.long
def test_commands_with_such_an_arm(crane, tmp_path, rng):
    data, arm, urdf_file = (tmp_path / name for name in ("data.csv", "arm.toml", "new.urdf"))
    records(rng, 2e-4).save(data)
    half_widths = "--translation-half-width-mm 0.3 --rotation-half-width 3e-4"
    words = f"--urdf {tmp_path / 'crane.urdf'} --frame tip {data} {half_widths}"
    shell.done(f"calibrate {words} --encoder-noise 2e-5 --no-cross-validation -o {arm}")
    shell.done(f"urdf {arm} -o {urdf_file}")
    again, written = Arm.load(arm), Arm.from_urdf(urdf_file, "tip")
    close(again.encoder_noise, np.full(3, 2e-5))
    new = rng.uniform(-1, 1, (50, 3))
    close(again.positions(new), written.positions(new))
    assert np.abs(again.positions(new) - tips(new, 2e-4)).max() < 5e-5
    shell.done(f"correct {arm} {data} --commands -o {tmp_path / 'commands.csv'}")
    sent = pd.read_csv(tmp_path / "commands.csv").dropna()
    q, commands = (
        np.radians(sent[[f"{name}{joint}_deg" for joint in (1, 2, 3)]].to_numpy())
        for name in ("theta", "command")
    )
    close(again.positions(commands), tips(q), 1e-8)
    for words in (f"urdf {arm} --to-dh", f"configurations {arm} --point 600 100 300"):
        shell.refused(words, said=["mimics another"])
