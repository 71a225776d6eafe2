"""A name stands for an arm, a path for an arm or records, a text for a cause: wherever Python takes
one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import aacmm_pin
from aacmm_pin import Arm, ErrorModel, Measurements
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    JointCompliance,
    all_candidates,
    joint_commands,
)
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report import scenes
from tests.few_causes import ECCENTRICITY_ALONE

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3
NOISE = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
ECCENTRIC = "encoder_eccentricity:3,amplitude_rad=1e-4"


@pytest.fixture(scope="module")
def extended(tmp_path_factory) -> Path:
    """The file of an arm with a cause."""
    path = tmp_path_factory.mktemp("arm") / "extended.toml"
    ErrorModel("sino6", (EncoderEccentricity(3, values=(1e-4, 0.0), u=(1e-6, 1e-6)),)).save(path)
    return path


@pytest.fixture(scope="module")
def records(tmp_path_factory) -> Path:
    """Records of such an arm."""
    path, rng = tmp_path_factory.mktemp("data") / "records.csv", np.random.default_rng(1)
    aacmm_pin.simulate_measurements(ErrorModel("sino6", [ECCENTRIC]), "free", 60, rng=rng).save(
        path
    )
    return path


def volumes(model: Any) -> Any:
    return aacmm_pin.accuracy_volume(model, np.zeros((1, 6))).covariance


def between(model: Any) -> Any:
    ends = [aacmm_pin.configuration_circle("sino6", at, count=6) for at in (POINT, POINT + 0.1)]
    return aacmm_pin.length_uncertainty(model, ends[0].q[:1], ends[1].q[:1]).u


def simulated(model: Any) -> Any:
    return aacmm_pin.simulate_measurements(model, "free", 5, rng=np.random.default_rng(1)).reference


def planned(model: Any) -> Any:
    return aacmm_pin.plan_calibration(model, 10, postures=20).measurements.q


OF_MODELS: list[Callable[[Any], Any]] = [
    volumes,
    between,
    simulated,
    planned,
    lambda model: aacmm_pin.map_workspace(model, (2, 2)).data["comprehensive_mm3"].values,
    lambda model: joint_commands(model, model, np.full((1, 6), 0.3))[0],
    lambda model: len(scenes.arm_scene(model, np.zeros((1, 6))).embedded()) > 0,
]
OF_ARMS: list[Callable[[Any], Any]] = [
    lambda arm: aacmm_pin.configuration_circle(arm, POINT, count=6).q,
    lambda arm: aacmm_pin.reaching_postures(arm, POINT, axis=[0, 0, -1], count=6, most_starts=20).q,
    lambda arm: [variants[0].label for variants in all_candidates(arm)],
    lambda arm: ErrorModel(arm, [ECCENTRIC]).predict(np.zeros((1, 6))),
]


@pytest.mark.parametrize("call", OF_MODELS)
def test_a_path_stands_for_an_arm_with_its_causes(call, extended):
    np.testing.assert_array_equal(call(extended), call(ErrorModel.load(extended)))


@pytest.mark.parametrize("call", OF_ARMS)
def test_a_name_stands_for_an_arm(call):
    np.testing.assert_array_equal(call("sino6"), call(Arm.load("sino6")))


@ECCENTRICITY_ALONE
def test_a_path_stands_for_records(records):
    read, arm = Measurements.read(records, 6), Arm.load("sino6")
    causes = (EncoderEccentricity(3), JointCompliance(2))
    quiet = {**NOISE}
    calls = [
        lambda data: aacmm_pin.calibrate(arm, data, hold_out=False, **NOISE).rms,
        lambda data: aacmm_pin.diagnose(arm, data, hold_out=False, **quiet).rms["extended"],
        lambda data: (
            aacmm_pin.plan_measurements(
                arm, causes, 3, existing=data, postures=20, **quiet
            ).measurements.q
        ),
        lambda data: (
            aacmm_pin.plan_calibration(arm, 10, existing=data, postures=20, **quiet).measurements.q
        ),
    ]
    for call in calls:
        np.testing.assert_array_equal(call(records), call(read))
    np.testing.assert_array_equal(calls[0](str(records)), calls[0](read))


def test_a_text_stands_for_a_cause(sino6, records):
    model = ErrorModel(sino6, [ECCENTRIC, EncoderGain(5, values=(1e-5,))])
    assert model.effects == (
        EncoderEccentricity(3, values=(1e-4, 0.0)),
        EncoderGain(5, values=(1e-5,)),
    )
    assert ErrorModel(sino6, ECCENTRIC).effects == model.effects[:1]
    assert model.with_effects("encoder_gain:5,gain=2e-5").effects[-1].values == (2e-5,)
    found = aacmm_pin.calibrate(
        sino6, records, ["geometry", "encoder_eccentricity:3"], hold_out=False, **NOISE
    )
    same = aacmm_pin.calibrate(
        sino6, records, ["geometry", EncoderEccentricity(3)], hold_out=False, **NOISE
    )
    np.testing.assert_array_equal(found.fit.point.x, same.fit.point.x)


def test_what_stands_for_nothing_is_refused(sino6, records):
    with pytest.raises(UnknownNameError, match="encoder_gian"):
        ErrorModel(sino6, ["encoder_gian:5"])
    with pytest.raises(UnknownNameError, match=r"encoder_gian.*geometry.*encoder_gain"):
        aacmm_pin.calibrate(sino6, records, ["encoder_gian:5"])
    with pytest.raises(AacmmError, match="of type int"):
        ErrorModel(sino6, (5,))
