"""Mistakes in an arm file, and rows that do not belong together: on a plant that shares no code
with the package.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from aacmm_pin import Measurements, calibrate, next_measurements, perturbed_model
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration
from aacmm_pin.diagnosis import check_measurements, diagnose
from aacmm_pin.effects import Conditions
from aacmm_pin.errors import MistakenFileError
from aacmm_pin.measurements import simulate_measurements
from tests.again import again
from tests.arm_files import AACMM, by_table
from tests.calibration import contacts
from tests.few_causes import ECCENTRICITY_ALONE
from tests.notes import data_of
from tests.oracle import dh_frames, perturbed_positions

Array = NDArray[np.float64]
DEG = np.pi / 180.0
RECORDS = 60
Rows = tuple[tuple[float, float, float, float], ...]
UR: Rows = (
    (0, 127.3, 90, 0),
    (-612, 0, 0, 0),
    (-572.3, 0, 0, 0),
    (0, 163.9, 90, 0),
    (0, 115.7, -90, 0),
    (0, 92.2, 0, 0),
)
HOBBY: Rows = ((0, 60, 90, 0), (115, 0, 0, 90), (135, 0, 0, -90), (0, 0, -90, -90), (12, 160, 0, 0))
"""a [mm], d [mm], α [°], zero offset [°]."""
BOUNDS = {"a_mm": 0.03, "d_mm": 0.05, "alpha_rad": 8e-5, "theta_offset_rad": 1e-4}


def frames(rows: Rows, q: Array) -> Array:
    """The last frame (n, 4, 4) [mm]."""
    return dh_frames(np.array(rows) * [1.0, 1.0, DEG, DEG], q)


def tips(rows: Rows, q: Array) -> Array:
    return frames(rows, q)[:, :3, 3]


@dataclass(frozen=True)
class Plant:
    """An arm whose values are about those of its drawing, and its records."""

    q: Array
    places: Array

    @staticmethod
    def of(drawn: Rows, seed: int, zeros: Array | float = 0.0) -> Plant:
        rng = np.random.default_rng(seed)
        off = rng.normal(size=(len(drawn), 4)) * [0.01, 0.015, 2e-3, 2e-3]
        off[:, 3] += zeros
        q = rng.uniform(-2.5, 2.5, (RECORDS, len(drawn)))
        places = tips(tuple(map(tuple, np.array(drawn) + off)), q)
        return Plant(q, places + 0.02 * rng.normal(size=places.shape))

    @property
    def records(self) -> Measurements:
        return Measurements.of(self.q, self.places * 1e-3)


def arm_of(rows: Rows, bounds: bool) -> Arm:
    return by_table("OWN", rows, 170.0, **({"uncertainty": BOUNDS} if bounds else {}))


def with_value(rows: Rows, row: int, column: int, value: float) -> Rows:
    table = np.array(rows, dtype=np.float64)
    table[row - 1, column] = value
    return tuple(map(tuple, table.tolist()))


@pytest.mark.parametrize(
    ("drawn", "row", "column", "value", "words"),
    [
        (AACMM, 3, 1, 902.0, ("d3 is 902 mm", "give 920")),
        (AACMM, 3, 1, 9200.0, ("d3 is 9200 mm", "give 920 mm")),
        (UR, 3, 0, 572.3, ("a3 is 572.3 mm", "give -572.3 mm")),
        (HOBBY, 4, 3, -84.0, ("theta_offset4 is -84°", "give -")),
    ],
)
def test_one_wrong_value_is_named(drawn, row, column, value, words):
    """Whether it keeps the records from being fitted or not."""
    given = arm_of(with_value(drawn, row, column, value), drawn is AACMM)
    try:
        found = calibrate(given, Plant.of(drawn, 1).records, hold_out=False)
        said = str(found.notes[0])
    except MistakenFileError as error:
        said = error.mistake
    for word in words:
        assert word in said


def test_nothing_is_named_where_nothing_is_wrong():
    for drawn in (AACMM, UR, HOBBY):
        given = arm_of(drawn, drawn is AACMM)
        found = calibrate(given, Plant.of(drawn, 2).records, hold_out=False)
        for code in ("wrong_value", "wrong_sign", "zeros_off", "rows_in_another_frame"):
            assert not data_of(found.notes, code)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        ((1e-3, 1e-3, 1.0, 1.0), "lengths of the arm file are in metres"),
        ((1.0, 1.0, np.pi / 180.0, np.pi / 180.0), "angles of the arm file are in radians"),
    ],
)
def test_a_table_in_other_units(factor, words):
    table = np.array(AACMM) * factor
    given = arm_of(tuple(map(tuple, table.tolist())), False)
    with pytest.raises(MistakenFileError, match=words):
        check_measurements(given, Plant.of(AACMM, 3).records)


def test_zeros_of_servos_are_all_off():
    """``check`` does not refuse what ``calibrate`` fits."""
    given = arm_of(HOBBY, False)
    records = Plant.of(HOBBY, 4, np.array([2.1, -3.4, 4.0, -1.7, 0.9])).records
    check = check_measurements(given, records)
    (told,) = data_of(check.notes, "zeros_off")
    assert told["joints"] == 5
    assert np.degrees(told["largest"]) == pytest.approx(4.0, abs=0.4)
    fitted = calibrate(given, records, "zero-offsets", hold_out=False)
    assert check.rms == pytest.approx(fitted.rms_before)
    assert fitted.rms < 2e-4


@ECCENTRICITY_ALONE
def test_rows_in_another_frame_and_rows_shifted_by_one():
    given = arm_of(AACMM, True)
    plant = Plant.of(AACMM, 5)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    places = plant.places.copy()
    places[36:] = places[36:] @ turn.T + [100.0, 0.0, 0.0]
    mixed = Plant(plant.q, places).records
    for notes in (
        check_measurements(given, mixed).notes,
        calibrate(given, mixed, hold_out=False).notes,
        diagnose(given, mixed, hold_out=False).notes,
    ):
        (told,) = data_of(notes, "rows_in_another_frame")
        assert told["rows"] == mixed.row[36:].tolist()
        assert told["turn"] == pytest.approx(np.pi / 2, abs=1e-3)
    shifted = Plant(plant.q[1:], plant.places[:-1]).records
    with pytest.raises(MistakenFileError, match="row before"):
        check_measurements(given, shifted)


def fitted(given: Arm, records: Measurements, names: str, **options: object) -> Calibration:
    return calibrate(given, records, names.split(","), hold_out=False, **options)


def test_parameters_by_name_and_pattern():
    given = arm_of(AACMM, True)
    records = Plant.of(AACMM, 6).records
    for names, wanted in (
        ("d3,a2", {"a2", "d3"}),
        ("theta_offset*", {f"theta_offset{j}" for j in range(1, 7)}),
    ):
        assert {*fitted(given, records, names).parameters["parameter"]} == wanted
    held = fitted(given, records, "theta_offset*").parameters
    free = fitted(given, records, "theta_offset*", prior=False).parameters
    assert (held["u"] < free["u"]).any()


def test_the_tool_by_touches_of_one_seat():
    """As linear least squares gives it: ``R t + p = s`` for each touch."""
    given = arm_of(UR, False)
    rng = np.random.default_rng(7)
    tool, spike = np.array([30.0, -12.0, 80.0]), np.array([300.0, 200.0, 100.0])

    def off(angles: Array) -> Array:
        q = angles.reshape(1, 6)
        return (frames(UR, q) @ [*tool, 1.0])[0, :3] - spike

    starts = rng.uniform(-1.5, 1.5, (5, 6))
    q = np.array([least_squares(off, start).x for start in starts])
    q += 5e-4 * rng.normal(size=q.shape)
    axes = frames(UR, q)[:, :3, :3]
    columns = np.concatenate([axes, -np.broadcast_to(np.eye(3), (5, 3, 3))], axis=2)
    wanted = np.linalg.lstsq(columns.reshape(15, 6), -tips(UR, q).ravel())[0][:3]
    seats = Conditions(len(q), seat=np.full(len(q), "spike", dtype=object))
    records = Measurements.of(q, conditions=seats)
    (effect,) = fitted(given, records, "tool").fit.effects
    assert effect.label == "stylus_offset"
    assert np.array(effect.values) * 1e3 == pytest.approx(wanted, abs=0.02)


def turned(q: Array) -> Array:
    """Readings of a controller that counts three joints in its own way."""
    readings = q.copy()
    readings[:, 1] = np.pi / 2 - q[:, 1]
    readings[:, 2] = q[:, 2] + np.pi / 2
    readings[:, 3] = -q[:, 3]
    return readings


@pytest.mark.parametrize(
    ("drawn", "external"),
    [(AACMM, False), *(again(*case) for case in ((AACMM, True), (UR, False), (UR, True)))],
)
def test_several_columns_a_ratio_exchanged_rows_and_a_scale(drawn, external):
    plant = Plant.of(drawn, 4)
    q, places = plant.q, plant.places * 1e-3
    frame = "external" if external else "base"
    if external:
        places = places @ np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]).T
    given = arm_of(drawn, drawn is AACMM)
    for changed, words in (
        ((turned(q), places), "joints 2 and 4 have the opposite sign, and the zero of joint 2"),
        ((q[:, [0, 2, 3, 1, 4, 5]], places), "they are of joints 1, 3, 4, 2, 5 and 6"),
        ((q * [1.0, 1.0, 2.0, 1.0, 1.0, 1.0], places), "joint = 3, of = 3, ratio = 0.5"),
        ((q, places * 0.98), "x, y and z coordinates are 0.98"),
    ):
        with pytest.raises(MistakenFileError) as caught:
            calibrate(given, Measurements.of(*changed), reference_frame=frame, hold_out=False)
        assert words in caught.value.mistake
    if drawn is UR:
        return  # its rows 2 and 3 differ by 40 mm only
    given = arm_of((drawn[0], drawn[2], drawn[1], *drawn[3:]), True)
    with pytest.raises(MistakenFileError, match="rows 2 and 3 of the arm file are exchanged"):
        calibrate(given, Measurements.of(q, places), reference_frame=frame, hold_out=False)


def exchanged(rows: Rows, row: int, other: int) -> Rows:
    """With the lengths a of two rows exchanged; of one row a and d."""
    table = np.array(rows)
    if row == other:
        table[row, :2] = table[row, 1::-1]
    else:
        table[[row, other], 0] = table[[other, row], 0]
    return tuple(map(tuple, table.tolist()))


@pytest.mark.parametrize(
    ("drawn", "given", "words"),
    [
        (AACMM, with_value(AACMM, 3, 2, 0.0), "alpha3 is 0° in the arm file"),
        (AACMM, with_value(AACMM, 3, 2, -90.0), "alpha3 is -90° in the arm file"),
        (HOBBY, exchanged(HOBBY, 1, 2), "values a of rows 2 and 3"),
        (AACMM, exchanged(AACMM, 2, 2), "values a and d of row 3"),
    ],
)
def test_twists_and_exchanged_lengths(drawn, given, words):
    records = Plant.of(drawn, 6).records
    with pytest.raises(MistakenFileError) as caught:
        calibrate(arm_of(given, drawn is AACMM), records, hold_out=False)
    assert str(caught.value).count(words) == 1


def test_a_ratio_beside_zeros_that_are_all_off():
    plant = Plant.of(HOBBY, 7, zeros=np.array([3.0, -4.0, 2.0, -3.0, 5.0]))
    doubled = Measurements.of(plant.q * [1.0, 2.0, 1.0, 1.0, 1.0], plant.places * 1e-3)
    with pytest.raises(MistakenFileError) as caught:
        calibrate(arm_of(HOBBY, False), doubled, hold_out=False)
    assert "joint = 2, of = 2, ratio = 0.5" in caught.value.mistake


def test_rows_that_share_a_mistake():
    plant = Plant.of(AACMM, 5)
    stuck = plant.q.copy()
    stuck[24:36, 3] = stuck[24, 3]
    records = Measurements.of(stuck, plant.places * 1e-3)
    found = calibrate(arm_of(AACMM, True), records, hold_out=False)
    (told,) = data_of(found.notes, "excluded_share")
    assert told["where"] == "row numbers from 27 to 37"  # of the file, with its header


def with_bars(lengths: dict[str, float], factors: dict[str, float]) -> tuple[Arm, Measurements]:
    """Five bars, one after the other; what is added to the lengths [m], and what they are
    multiplied with.
    """
    arm = Arm.load("sino6")
    rng = np.random.default_rng(1)
    truth = perturbed_model(arm, rng).arm
    data = simulate_measurements(truth, "ball-bar", 200, rng=rng, seats=10, bar_length=0.5)
    data = data.take(np.argsort(data.bar, kind="stable"))
    stated = data.bar_length * [factors.get(bar, 1.0) for bar in data.bar]
    stated = stated + [lengths.get(bar, 0.0) for bar in data.bar]
    conditions = replace(data.conditions, time=20.0 * np.arange(data.n))
    return arm, replace(data, bar_length=stated, conditions=conditions)


@pytest.mark.parametrize("stated", [{}, {"encoder_noise": 1e-5, "probe_noise": 1e-5}])
def test_one_bar_that_is_a_millimetre_off(stated):
    """Not a stand that moved."""
    arm, records = with_bars({"B3": 1e-3}, {})
    (told,) = data_of(check_measurements(arm, records, **stated).notes, "bar_length_off")
    assert told["bar"] == "B3"
    found = diagnose(arm, records, **stated, hold_out=False, progress=False)
    assert not found.findings
    assert "stated length of bar B3 differs" in next_measurements(found)


@pytest.mark.parametrize("bars", [("B2", "B3", "B4"), *(again(case) for case in (("B2",),))])
def test_some_bars_in_inches(bars):
    arm, records = with_bars({}, dict.fromkeys(bars, 1 / 25.4))
    with pytest.raises(MistakenFileError) as caught:
        check_measurements(arm, records)
    assert caught.value.mistake.startswith("the lengths of bar")
    assert all(bar in caught.value.mistake for bar in bars)
    assert "inches" in caught.value.mistake


def test_values_that_hardly_move_the_tip_are_not_wrong(rng):
    """Placements of a URDF have many combinations that no record determines."""
    ur5 = Arm.from_urdf("ur5", translation_half_width=3e-4, rotation_half_width=1e-3)
    q = rng.uniform(-2.5, 2.5, (100, 6))
    names = [parameter.name for parameter in ur5.parameters]
    for name, error in (("x3", 1e-3), ("y3", 0.02)):
        errors = contacts.drawn(ur5, rng)
        errors[names.index(name)] += error
        places = perturbed_positions(ur5, q, np.tile(errors, (100, 1)))
        records = Measurements.of(q, places[:, [1, 2, 0]])
        try:
            found = calibrate(ur5, records, reference_frame="external", hold_out=False)
            named = [str(note) for note in found.notes if note.code.startswith("wrong_value")]
        except MistakenFileError as error:
            named = [error.mistake]
        assert all(name in said for said in named)
