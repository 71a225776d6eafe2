"""What changes during a session, what the order of the records tells, and the budget: on a plant
that shares no code with the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aacmm_pin import Diagnosis, Measurements, diagnose, next_measurements
from tests.again import again
from tests.arm_files import AACMM, by_table
from tests.few_causes import FEW
from tests.oracle import derivative, dh_frames
from tests.tables import PLACES, readings

ON_TIP = np.zeros(3)
RECORDS, AT = 120, 54
ENCODER, NOISE = 1e-5, 0.015
Array = NDArray[np.float64]
DEG = np.pi / 180.0


ARM = by_table(
    "OWN",
    AACMM,
    170.0,
    encoder_noise_rad=ENCODER,
    uncertainty={"a_mm": 0.03, "d_mm": 0.05, "alpha_rad": 8e-5, "theta_offset_rad": 1e-4},
)


def tips(q: Array, off: Array, tip: Array) -> Array:
    """Positions of the tip by homogeneous matrices (n, 3) [mm]; ``off`` are errors of a, d, α."""
    rows = np.c_[np.array(AACMM)[:, :3] * [1.0, 1.0, DEG] + off, np.zeros(6)]
    return (dh_frames(rows, q) @ [*tip, 1.0])[:, :3]


@dataclass(frozen=True)
class Plant:
    """Postures and errors of an arm, drawn from a seed."""

    rng: np.random.Generator
    q: Array
    off: Array
    time: Array

    @staticmethod
    def of(seed: int) -> Plant:
        rng = np.random.default_rng(seed)
        q = rng.uniform(-2.9, 2.9, (RECORDS, 6))
        off = rng.uniform(-1.0, 1.0, (6, 3)) * [0.03, 0.05, 8e-5]
        return Plant(rng, q, off, np.cumsum(rng.uniform(4.0, 12.0, RECORDS)))

    def places(self, angle: Array | float = 0.0, tip: Array = ON_TIP) -> Array:
        """Tips with errors of the joint angles and of the tip, without noise of the references."""
        noise = ENCODER * self.rng.normal(size=self.q.shape)
        return tips(self.q + angle + noise, self.off, tip)

    def diagnosed(self, places: Array, **columns: Any) -> Diagnosis:
        places = places + NOISE * self.rng.normal(size=places.shape)
        table = readings(self.q)
        table[PLACES] = places
        records = Measurements.from_frame(table.assign(**columns))
        return diagnose(
            ARM,
            records,
            reference_noise=NOISE * 1e-3,
            hold_out=False,
            progress=False,
        )


def moved(places: Array, rng: np.random.Generator) -> Array:
    """Places after the stand was bumped at the record AT."""
    turn, shift = rng.normal(size=3) * 8e-5, rng.normal(size=3) * 0.12
    after = places.copy()
    after[AT:] += np.cross(turn, places[AT:]) + shift
    return after


@FEW
@pytest.mark.parametrize("seed", [1, again(2)])
def test_a_stand_that_moved_is_no_encoder_fault(seed):
    plant = Plant.of(seed)
    found = plant.diagnosed(moved(plant.places(), plant.rng), time_s=plant.time)
    (finding,) = found.findings
    assert (found.verdict, finding.label) == ("explained", "frame_shift")
    assert abs(np.searchsorted(plant.time, finding.effect.time_s) - AT) <= 3  # type: ignore[attr-defined]


@FEW
@pytest.mark.parametrize(("seed", "asked"), [(1, "session"), (2, "time_s")])
def test_next_are_labels_or_times_if_a_stand_moved_in_records_without_time(seed, asked):
    """Labels where the fit excluded the rows after the movement, times where it kept them."""
    plant = Plant.of(seed)
    found = plant.diagnosed(moved(plant.places(), plant.rng))
    assert f"in the column {asked}" in next_measurements(found)


@FEW
@pytest.mark.parametrize("moves", [True, False])
def test_next_is_a_frame_for_each_session_if_these_moved(moves):
    plant = Plant.of(9)
    places = moved(plant.places(), plant.rng) if moves else plant.places()
    session = np.where(np.arange(RECORDS) < AT, "first", "second")
    found = plant.diagnosed(places, session=session)
    assert ("--reference-frame session" in next_measurements(found)) == moves


@FEW
def test_a_stylus_that_was_mounted_again_is_no_encoder_fault():
    plant = Plant.of(3)
    shift = np.array([0.08, -0.06, 0.07])
    places = plant.places()
    places[AT:] = plant.places(tip=shift)[AT:]
    (finding,) = plant.diagnosed(places, time_s=plant.time).findings
    assert finding.label == "stylus_shift"
    off = np.array(finding.effect.values) * 1e3 - shift
    assert np.all(np.abs(off) < 3.0 * np.array(finding.effect.u) * 1e3)


@FEW
@pytest.mark.parametrize("column", [again("time_s"), "record"])
def test_backlash_in_the_order_of_the_rows(column):
    plant = Plant.of(4)
    side = np.sign(np.diff(plant.q[:, 2], prepend=plant.q[0, 2] - 1.0))
    angle = np.zeros(plant.q.shape)
    angle[:, 2] = 7e-5 * side
    order = {column: plant.time}
    (finding,) = plant.diagnosed(plant.places(angle), **order).findings
    assert finding.label == "joint_hysteresis:3"


@FEW
def test_bursts_of_an_encoder_are_in_the_order_of_the_records():
    plant = Plant.of(5)
    angle = np.zeros(plant.q.shape)
    for first in (10, 40, 70, 95):
        angle[first : first + 11, 4] = -3.5e-4
    order = plant.diagnosed(plant.places(angle)).unexplained.run_order
    assert order is not None
    assert order.joint == 5
    assert order.correlation > 2.0 * order.limit


@FEW
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torques_of_the_load_instead_of_the_drive(sign):
    plant = Plant.of(8)
    load = plant.rng.uniform(-60.0, 60.0, plant.q.shape)
    angle = load * [0.0, 6e-6, 9e-6, 0.0, 0.0, 0.0]
    columns = {f"torque{j}_nm": sign * load[:, j - 1] for j in range(1, 7)}
    found = plant.diagnosed(plant.places(angle), **columns)
    assert {f.label for f in found.findings} == {"joint_compliance:2", "joint_compliance:3"}
    assert found.reversed_torques == (sign > 0.0)


@pytest.mark.parametrize(("joint", "order"), [(1, 3), again(3, 4)])
def test_a_wave_that_does_not_change_is_a_cause(joint, order):
    """And no structure over its joint and another joint or the load."""
    plant = Plant.of(12)
    angle = np.zeros(plant.q.shape)
    angle[:, joint - 1] = 5e-5 * np.cos(order * plant.q[:, joint - 1] - 1.0)
    (finding,) = plant.diagnosed(plant.places(angle)).findings
    assert finding.label == f"joint_periodic_error:{joint}"
    assert finding.probability > 0.95


def test_two_waves_of_one_joint():
    """Neither a single wave, nor a dependence on two joints."""
    plant = Plant.of(6)
    angle = np.zeros(plant.q.shape)
    angle[:, 2] = 9e-5 * np.cos(4 * plant.q[:, 2]) + 7e-5 * np.cos(25 * plant.q[:, 2] + 1.0)
    found = plant.diagnosed(plant.places(angle))
    labels = {finding.label for finding in found.findings}
    assert labels == {"joint_periodic_error:3", "second_periodic_error:3"}
    orders = {round(f.effect.order, 1) for f in found.findings}  # type: ignore[attr-defined]
    assert orders == {4.0, 25.0}


@FEW
def test_the_budget_is_that_of_the_plant():
    """Of each part, within three standard uncertainties; and it adds up."""
    plant = Plant.of(7)
    angle = np.zeros(plant.q.shape)
    angle[:, 2] = 1.2e-4 * np.cos(plant.q[:, 2] - 0.4)
    exact = tips(plant.q + angle, plant.off, ON_TIP) - tips(plant.q, plant.off, ON_TIP)
    places = plant.places(angle)
    scatter = places - tips(plant.q + angle, plant.off, ON_TIP)
    found = plant.diagnosed(places)
    parts = {part.part: part for part in found.budget}
    assert list(parts) == ["geometry", "encoder_eccentricity:3", "noise"]
    whole = found.rms["nominal"] ** 2
    assert sum(part.mean_square for part in found.budget) == pytest.approx(whole, rel=1e-9)

    def displaced(x: Array) -> Array:
        """By errors of a, d, α of each row, then of the zeros."""
        return tips(plant.q + x[18:], x[:18].reshape(6, 3), ON_TIP).ravel()

    by_geometry = derivative(displaced, np.zeros(24))
    left = exact.ravel() - by_geometry @ np.linalg.lstsq(by_geometry, exact.ravel())[0]
    wanted = {
        "encoder_eccentricity:3": np.square(left).sum() / RECORDS,
        "noise": np.square(scatter).sum(axis=1).mean() + 3 * NOISE**2,
    }
    for name, size in wanted.items():
        assert abs(parts[name].mean_square * 1e6 - size) < 3.0 * parts[name].u * 1e6
