"""Probe directions in measurement files, by a plant of its own kinematics whose stylus bends."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from blind.kinematics import Array
from scipy.spatial.transform import Rotation

from aacmm_pin import calibrate, diagnose
from aacmm_pin.arm import Arm
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.effects import ErrorModel, ProbeBending
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.planning import plan_measurements
from tests.again import again
from tests.cli import shell
from tests.notes import data_of
from tests.oracle import close, dh_frames
from tests.tables import PLACES, readings

READING, REFERENCE, PROBE = 8e-6, 8e-6, 6e-3
BEND = 25e-6
DIRECTION = ["probe_direction_x", "probe_direction_y", "probe_direction_z"]
ROW = ("a", "d", "alpha", "theta_offset")
TURN, SHIFT = Rotation.from_euler("xyz", [3, -2, 130], degrees=True), np.array([1.5, -0.8, 0.3])


def frames(arm: Arm, errors: Array, q: Array) -> Array:
    """Frames of the tip (n, 4, 4) of SINO6 with errors of its DH parameters (p,)."""
    stated = {p.name: p.value + e for p, e in zip(arm.parameters, errors, strict=True)}
    return dh_frames(np.array([[stated[f"{name}{j}"] for name in ROW] for j in range(1, 7)]), q)


def measured(arm: Arm, rng: np.random.Generator, bend: float, n: int = 120) -> pd.DataFrame:
    """A file of records in the base, with coordinates of the ball's centre; the stylus is along x
    of the last frame.
    """
    errors = rng.normal(size=len(arm.parameters)) * np.array([p.u for p in arm.parameters])
    q = rng.uniform(-1.2, 1.2, (n, 6))
    tip = frames(arm, errors, q)
    moved = rng.normal(size=(n, 3))
    moved /= np.linalg.norm(moved, axis=1)[:, None]
    stylus = tip[:, :3, 0]
    across = moved - np.sum(moved * stylus, axis=1)[:, None] * stylus
    ball = tip[:, :3, 3] - bend * across + REFERENCE * rng.normal(size=(n, 3))
    read = q + READING * rng.normal(size=q.shape)
    table = readings(read)
    table[PLACES], table[DIRECTION] = 1e3 * ball, moved
    return table


def touching(table: pd.DataFrame) -> pd.DataFrame:
    """The same with the coordinates of the contacts."""
    contacts = table[PLACES].to_numpy() + 0.5e3 * PROBE * table[DIRECTION].to_numpy()
    return table.assign(**dict(zip(PLACES, contacts.T, strict=True)), probe_diameter_mm=1e3 * PROBE)


def elsewhere(table: pd.DataFrame) -> pd.DataFrame:
    """The same in another frame, coordinates and directions."""
    places = TURN.apply(table[PLACES]) + 1e3 * SHIFT
    turned = TURN.apply(table[DIRECTION])
    return table.assign(
        **dict(zip([*PLACES, *DIRECTION], np.hstack([places, turned]).T, strict=True))
    )


def diagnosed(arm: Arm, table: pd.DataFrame, **options: str) -> Diagnosis:
    known = {"encoder_noise": READING, "reference_noise": REFERENCE, "hold_out": False}
    return diagnose(arm, Measurements.from_frame(table), **known, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("frame", [again("base"), "external"])
def test_a_bending_stylus_is_named(sino6, rng, frame):
    """Of contacts in an unknown frame too."""
    table = measured(sino6, rng, BEND)
    stated = table if frame == "base" else elsewhere(touching(table))
    found = diagnosed(sino6, stated, reference_frame=frame)
    (finding,) = found.findings
    assert finding.label == "probe_bending"
    (value,), (u,) = finding.effect.values, finding.effect.u
    assert u < 2e-6
    assert abs(value - BEND) < 3.0 * u


def test_a_stiff_stylus_is_not_named(sino6, rng):
    assert diagnosed(sino6, measured(sino6, rng, 0.0)).findings == ()


def test_sessions_turn_their_directions(sino6, rng):
    """The second session has a frame of its own; a record without coordinates is in it too."""
    table = measured(sino6, rng, BEND)
    moved = elsewhere(table.iloc[60:])
    both = pd.concat([table.iloc[:60].assign(session="A"), moved.assign(session="B")])
    both = both.reset_index(drop=True)
    both.loc[119, PLACES] = np.nan
    records = Measurements.from_frame(both)
    found = calibrate(
        sino6, records, ["geometry", "probe_bending"], reference_frame="session", hold_out=False
    )
    turned = found.fit.problem.measurements.conditions.probe_direction
    assert np.abs(turned - table[DIRECTION].to_numpy()).max() < 1e-3
    effect = next(e for e in found.model.effects if e.cause == "probe_bending")
    assert abs(effect.values[0] - BEND) < 3.0 * effect.u[0]


def test_contacts_become_centres(sino6, rng):
    table = measured(sino6, rng, 0.0, 20)
    contacts = touching(table)
    contacts.loc[3, DIRECTION] = [np.nan] * 3
    contacts.loc[3, [*PLACES, "probe_diameter_mm"]] = [*table.loc[3, PLACES], np.nan]
    records, plain = Measurements.from_frame(contacts, 6), Measurements.from_frame(table, 6)
    close(records.reference, plain.reference)
    assert not records.conditions.probe_direction[3].any()
    (note,) = data_of(records.read_as, "contacts_at_centres")
    assert note["rows"] == [2, 3, 4, *range(6, 22)]
    # What is written has centres, and is read as such.
    again = Measurements.from_frame(records.to_frame(), 6)
    close(again.reference, plain.reference)
    assert data_of(again.read_as, "contacts_at_centres") == []
    assert data_of(again.read_as, "directions_missing") == [{"rows": [5]}]
    given = Measurements.of(
        plain.q,
        contacts[PLACES].to_numpy() / 1e3,
        probe_diameter=contacts["probe_diameter_mm"] / 1e3,
        conditions=records.conditions,
    )
    close(given.reference, plain.reference)
    # A probe in a sphere touches it along its normal, and its centre is what is stated.
    sphere = contacts.assign(feature="S", feature_diameter_mm=25.0).drop(index=3)
    sphere[PLACES] = [500.0, 0.0, 0.0]
    assert (Measurements.from_frame(sphere, 6).reference == [0.5, 0.0, 0.0]).all()


def test_check_states_contacts(sino6, rng, tmp_path):
    path = tmp_path / "contacts.csv"
    touching(measured(sino6, rng, 0.0, 20)).to_csv(path, index=False)
    checked = shell.found(f"check sino6 {path}")
    assert "contacts_at_centres" in checked["note_codes"]
    assert set(DIRECTION) <= {*checked["columns"]}
    assert checked["rms_mm"] < 0.2
    assert all("probe_bending" not in one["causes"] for one in checked["not_tried"])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({DIRECTION[0]: 0.3}, r"column probe_direction_x … probe_direction_z: .*length"),
        ({DIRECTION[2]: np.nan}, "column probe_direction_z: empty"),
        ({"probe_diameter_mm": 6.0, "seat": "A"}, "column feature_diameter_mm: empty"),
        (
            {"probe_diameter_mm": 6.0, **dict.fromkeys(DIRECTION, 0.0)},
            "column feature_diameter_mm: empty",
        ),
    ],
)
def test_cells_that_cannot_be(sino6, rng, changes, said):
    table = measured(sino6, rng, 0.0, 6).assign(**changes)
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.from_frame(table, 6)


def test_simulation_writes_directions_where_a_cause_needs_them(sino6):
    bent, straight = (
        simulate_measurements(ErrorModel(sino6, effects), "free", 30, rng=np.random.default_rng(1))
        for effects in ((ProbeBending(values=(BEND,)),), ())
    )
    assert straight.conditions.probe_direction is None
    close(np.linalg.norm(bent.conditions.probe_direction, axis=1), np.ones(30))
    close(bent.q, straight.q)
    off = bent.reference - straight.reference
    assert (np.linalg.norm(off, axis=1) <= BEND).all()
    assert (np.sum(off * bent.conditions.probe_direction, axis=1) < 0.0).all()


def test_plans_state_directions(sino6):
    """Unit vectors, in the file to be filled in."""
    causes = ("probe_bending", "stylus_bending")
    plan = plan_measurements(sino6, causes, records=4, postures=20, rng=np.random.default_rng(1))
    close(np.linalg.norm(plan.records[DIRECTION], axis=1), np.ones(4), 1e-5)
