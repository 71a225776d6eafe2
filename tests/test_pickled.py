"""Every result can be sent to another process, or kept for another day."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aacmm_pin import (
    Arm,
    Conditions,
    ErrorModel,
    accuracy_volume,
    calibrate,
    circle_accuracy,
    configuration_circle,
    diagnose,
    map_workspace,
    plan_measurements,
    reaching_postures,
    simulate_measurements,
)
from aacmm_pin._support.display import Shown

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3


def test_every_result_can_be_pickled(robot_file: Callable[[str], Path]) -> None:
    """Each shows itself as before, and computes as before where it can."""
    model, rng = ErrorModel.load("sino6"), np.random.default_rng
    urdf = Arm.from_urdf(robot_file("ur5_robot.urdf"), "ee_link")
    circle = configuration_circle(model.arm, POINT, count=12)
    tip = configuration_circle(model.arm, POINT, tip=True, axis=[0.0, 0.0, -1.0], count=6)
    data = simulate_measurements(model, "seats", 60, rng=rng(1))
    diagnosis = diagnose(model, data, hold_out=True, rng=rng(1), progress=False)
    bars = simulate_measurements(model, "ball-bar", 60, rng=rng(2), bar_length=0.4)
    posture = urdf.poses(np.full((1, 6), 0.3))
    every = [
        model.arm,
        model,
        urdf,
        posture,
        circle,
        tip,
        circle.flexibility(),
        reaching_postures(urdf, posture.position[0], axis=[0.0, 0.0, -1.0], count=6, most_starts=30),
        circle_accuracy(circle, model),
        accuracy_volume(model, circle.q[:2], conditions=Conditions(1, temperature=np.array([30.0]))),
        data,
        bars,
        calibrate(model, bars, rng=rng(1), progress=False),
        diagnosis,
        *diagnosis.findings,
        plan_measurements(model, None, 12, postures=40, rng=rng(1), progress=False),
        map_workspace(model, (2, 2), 4, progress=False),
        *model.arm.parameters[:1],
    ]
    for result in every:
        assert isinstance(result, Shown)
        copy = pickle.loads(pickle.dumps(result))
        assert str(copy) == str(result) or str(result).startswith(type(result).__name__), type(result)
    assert (pickle.loads(pickle.dumps(circle)).flexibility(5)) == circle.flexibility(5)
