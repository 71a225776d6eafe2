"""Sessions with reference frames of their own, by a plant that moves the references of each."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import calibrate, diagnose
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration, base_placements
from aacmm_pin.effects import ReferenceFrame
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.calibration.contacts import drawn
from tests.cli import shell
from tests.few_causes import ECCENTRICITY_ALONE
from tests.notes import data_of
from tests.oracle import perturbed_positions
from tests.tables import PLACES, THETAS

READING, REFERENCE = 8e-6, 12e-6
FAR = (Rotation.from_euler("xyz", [3, -2, 130], degrees=True), np.array([1.5, -0.8, 0.3]))
NEAR = (Rotation.from_rotvec([0, 0, 2e-4]), np.array([1e-4, -2e-4, 0]))
SAME = (Rotation.identity(), np.zeros(3))


def measured(arm: Arm, rng: np.random.Generator, *frames: tuple[Rotation, np.ndarray]):
    """A table of 60 records for each frame, and the errors of the arm."""
    errors = drawn(arm, rng)
    tables = []
    for k, (turn, shift) in enumerate((FAR, *frames)):
        q = rng.uniform(-1.2, 1.2, (60, 6))
        tips = perturbed_positions(arm, q, np.tile(errors, (60, 1)))
        if k:
            tips = turn.apply(tips) + shift
        seen = FAR[0].apply(tips) + FAR[1] + rng.normal(0, REFERENCE, tips.shape)
        read = np.degrees(q + rng.normal(0, READING, q.shape))
        table = pd.DataFrame(read, columns=THETAS)
        places = dict(zip(PLACES, 1e3 * seen.T, strict=True))
        tables.append(table.assign(**places, session=f"day {k + 1}"))
    return pd.concat(tables, ignore_index=True), errors


def calibrated(arm: Arm, table: pd.DataFrame, **options: object) -> Calibration:
    known = {"encoder_noise": READING, "reference_noise": REFERENCE, "hold_out": False}
    records = Measurements.from_frame(table)
    return calibrate(arm, records, **({"reference_frame": "session"} | known | options))


def codes(result: Calibration) -> set[str]:
    return {note.code for note in result.notes if note.code.startswith("session")}


@pytest.mark.parametrize(
    ("frame", "code"),
    [(SAME, "sessions_agree"), (NEAR, "sessions_differ"), (FAR, "session_moved")],
)
def test_each_session_has_its_frame(sino6, rng, frame, code):
    """The residuals have the stated noise, and the arm is as good as by one frame."""
    table, errors = measured(sino6, rng, frame)
    result = calibrated(sino6, table)
    assert codes(result) == {code}
    assert chi2.sf(*result.fit.chi2_stated) > 1e-3
    names = [p.name for p in sino6.parameters]
    vector = result.fit.problem.vector
    own = [k for k, p in enumerate(vector.arm_parameters) if p is not None]
    true = errors[[names.index(vector.names[k]) for k in own]]
    miss = result.fit.point.x[own] - true
    covariance = result.covariance[np.ix_(own, own)]
    assert chi2.sf(miss @ np.linalg.solve(covariance, miss), len(own)) > 1e-3
    assert not any(isinstance(effect, ReferenceFrame) for effect in result.model.effects)


def test_the_displacement_of_a_frame_has_its_u(sino6):
    rng = np.random.default_rng(4)
    total = 0.0
    for _ in range(12):
        table, _ = measured(sino6, rng, NEAR)
        result = calibrated(sino6, table, prior=True)
        (own,) = (
            place
            for effect, place in result.fit.problem.vector
            if isinstance(effect, ReferenceFrame)
        )
        true = np.concatenate([NEAR[1], NEAR[0].as_rotvec()])
        miss = result.fit.point.x[own] - true
        total += miss @ np.linalg.solve(result.covariance[own, own], miss)
    assert 0.001 < chi2.sf(total, 72) < 0.999


@ECCENTRICITY_ALONE
def test_a_cause_is_found_over_sessions(sino6, rng):
    table, _ = measured(sino6, rng, FAR, NEAR)
    q = np.radians(table["theta3_deg"])
    table["theta3_deg"] -= np.degrees(2e-4 * np.cos(q - 0.7))
    result = diagnose(
        sino6,
        Measurements.from_frame(table),
        reference_frame="session",
        encoder_noise=READING,
        reference_noise=REFERENCE,
        rng=rng,
    )
    assert [finding.label for finding in result.findings] == ["encoder_eccentricity:3"]
    assert result.held_out is not None


def test_what_a_frame_of_each_session_needs(sino6, rng, tmp_path):
    table, _ = measured(sino6, rng, NEAR)
    for changed, said in (
        (table.drop(columns="session"), "session"),
        (table.assign(session=["", *table["session"][1:]]), "row 2"),
        (table.assign(session=["c", "c", *table["session"][2:]]), "session c"),
        (table.assign(seat="A", x_mm=np.nan, y_mm=np.nan, z_mm=np.nan), "no record has reference"),
    ):
        with pytest.raises(AacmmError, match=said):
            calibrated(sino6, changed)
    table.to_csv(tmp_path / "days.csv", index=False)
    command = f"check sino6 {tmp_path / 'days.csv'} --reference-frame session"
    assert shell.found(command)["rms_mm"] < 0.2


def test_a_mistake_in_all_sessions_is_named(sino6, rng):
    table, _ = measured(sino6, rng, FAR)
    with pytest.raises(AacmmError, match="joint 3 have the opposite sign"):
        calibrated(sino6, table.assign(theta3_deg=-table["theta3_deg"]))


def test_the_base_in_each_frame_has_its_u(sino6, rng):
    """Beside what the arm's own errors shift its base by."""
    table, _ = measured(sino6, rng, FAR, NEAR)
    found = base_placements(calibrated(sino6, table).fit)
    assert [base.session for base in found] == ["day 1", "day 2", "day 3"]
    for base, (turn, shift) in zip(found, (SAME, FAR, NEAR), strict=True):
        origin = FAR[0].apply(shift) + FAR[1]
        assert (np.abs(base.shift - origin) < 5 * base.u_shift + 5e-5).all()
        rotation = (FAR[0] * turn).as_matrix()
        np.testing.assert_allclose(base.rotation, rotation, atol=5e-4)


def test_contacts_without_coordinates_need_no_session(sino6, rng):
    """Two bars' ends, probed without a tracker, beside two sessions with one."""
    table, _ = measured(sino6, rng, FAR)
    again = table.iloc[:8].assign(session="", seat=list("PPQQPPQQ"))
    again[PLACES] = np.nan
    both = pd.concat([table.assign(seat=""), again], ignore_index=True)
    result = calibrated(sino6, both, probe_noise=1.0e-2)
    assert codes(result) == {"session_moved"}


def test_rows_after_a_bump_are_one_run(sino6):
    """The base of the fit is between those before and after: it excludes only the farthest."""
    data = simulate_measurements(sino6, "free", 200, rng=np.random.default_rng(1))
    reference = data.reference.copy()
    turn = Rotation.from_rotvec([6e-4, -7e-4, 5e-4])
    reference[100:] = np.array([2.5e-4, -1.5e-4, 2e-4]) + turn.apply(reference[100:])
    result = calibrate(sino6, Measurements.of(data.q, reference), hold_out=False)
    assert result.fit.excluded.sum() < 50
    (note,) = data_of(result.notes, "rows_in_another_frame")
    assert note["rows"] == [*range(102, 202)]
