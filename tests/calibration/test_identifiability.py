"""What records leave open: directions that move the tip, targets at other postures, or the base;
and those that do not.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin import accuracy_volume
from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration import Calibration, base_is_open, base_placements, calibrate
from aacmm_pin.effects import Conditions, ErrorModel, JointPlacement, StylusOffset
from aacmm_pin.measurements import Measurements
from aacmm_pin.report.calibration_page import frame_in_words, open_in_words
from tests.again import again
from tests.arm_files import by_table, changed
from tests.notes import data_of

FRAME = Rotation.from_rotvec([0.4, -0.9, 1.1]).as_matrix(), np.array([1.0, 2.0, -0.5])


def by_tracker(
    arm: Arm, rng: np.random.Generator, *, marker: bool
) -> tuple[Calibration, ErrorModel]:
    """A robot with placements that are off, calibrated by a target 70 mm beyond its flange, and as
    it is.
    """
    off = rng.normal(size=(6, 6)) * [2e-4, 2e-4, 2e-4, 3e-4, 3e-4, 3e-4]
    true = ErrorModel(
        arm, tuple(JointPlacement(row, values=tuple(each)) for row, each in enumerate(off, start=1))
    )
    n, noise = 80, 1e-5
    q, seen = random_postures(arm, n, rng), Conditions(n, marker=np.full(n, "smr", dtype=object))
    at_target = true.with_effects(StylusOffset("smr", values=(0.02, -0.03, 0.06)))
    points = at_target.predict(q + noise * rng.normal(size=q.shape), seen) + noise * rng.normal(
        size=(n, 3)
    )
    data = Measurements.of(q, points, conditions=seen if marker else None)
    target = "tip" if marker else "unknown"
    return calibrate(
        arm, data, target=target, encoder_noise=noise, reference_noise=noise, hold_out=False
    ), true


@pytest.mark.parametrize("half_width", [None, 5e-4])
def test_u_of_the_tip_has_what_a_marker_does_not_determine(rng, half_width):
    """Beyond the last joint the flange may be anywhere within its stated half-width, or that of an
    assembled arm.
    """
    stated = (
        {}
        if half_width is None
        else {"translation_half_width": half_width, "rotation_half_width": 1e-3}
    )
    arm = Arm.from_urdf("ur5", **stated)
    result, true = by_tracker(arm, rng, marker=True)
    q = random_postures(arm, 100, rng)
    off = np.linalg.norm(result.model.predict(q) - true.predict(q), axis=1)
    u = accuracy_volume(result.model, q, method="ellipsoid").u
    assert off.max() > 5e-5
    assert off.max() < 3 * u.min()
    known = result.parameters.set_index("parameter")["known"]
    assert known["stylus_offset:smr.z"] == ("in combination" if half_width is None else "measured")
    assert result.fit.undetermined.tip_spread.shape[1] == (1 if half_width is None else 0)
    assert result.fit.undetermined.target_directions.size == 0
    assert bool(data_of(result.notes, "tip_undetermined")) is (half_width is None)


def test_what_describes_the_same_arm_otherwise_moves_nothing(rng):
    """A target that becomes the tip: how its place is shared out between joint and target does not
    matter there.
    """
    arm = Arm.from_urdf("ur5")
    undetermined = by_tracker(arm, rng, marker=False)[0].fit.undetermined
    assert undetermined.directions.shape[1] >= 10
    assert undetermined.tip_spread.size == undetermined.target_directions.size == 0
    assert undetermined.tied_to_frame == ()


def test_what_is_known_only_together_with_the_base_is_named(rng):
    arm = changed("sino6", {0: {"uncertainty": None}})
    q = random_postures(arm, 60, rng)
    data = Measurements.of(
        q, arm.positions(q) @ FRAME[0].T + FRAME[1] + 5e-6 * rng.normal(size=(60, 3))
    )
    result = calibrate(
        arm,
        data,
        reference_frame="external",
        encoder_noise=1e-6,
        reference_noise=5e-6,
        hold_out=False,
    )
    assert set(result.fit.undetermined.tied_to_frame) == {"d1", "theta_offset1"}
    assert "d1, theta_offset1" in frame_in_words(result.fit)


@pytest.mark.parametrize("parameters", ["zero-offsets", "geometry"])
@pytest.mark.parametrize("scattered", [False, True])
def test_references_on_one_line_leave_the_base_open(sino6, rng, scattered, parameters):
    """The base may turn about the line; its u is there as soon as the references leave the line.

    With stated half-widths it is not quite free, for tips leave the line by as much as the arm is
    off.
    """
    points = np.array([0.5, -0.2, 0.1]) + rng.uniform(-0.2, 0.2, (12, 1)) * [0.1, 0.9, 0.3]
    points += rng.normal(scale=0.05, size=points.shape) * scattered
    wanted, q = np.repeat(points, 3, axis=0), random_postures(sino6, 36, rng)
    for _ in range(60):  # Newton's method, from as many random postures
        step = (
            np.linalg.pinv(sino6.jacobian(q), rcond=0.05)
            @ (wanted - sino6.positions(q))[:, :, None]
        )
        q += 0.5 * step[:, :, 0]
    q = q[np.linalg.norm(sino6.positions(q) - wanted, axis=1) < 1e-9]
    assert len(q) > 20
    references = sino6.positions(q) @ FRAME[0].T + FRAME[1] + 5e-6 * rng.normal(size=(len(q), 3))
    noise = {"encoder_noise": 1e-6, "reference_noise": 5e-6}
    result = calibrate(
        sino6,
        Measurements.of(q, references),
        parameters,
        reference_frame="external",
        hold_out=False,
        **noise,
    )
    assert base_is_open(result.fit) is not scattered
    assert bool(open_in_words(result)) is not scattered
    if not scattered:
        assert not base_placements(result.fit)
        assert frame_in_words(result.fit) == ""
        return
    (base,) = base_placements(result.fit)
    shift, turn = base.u_shift, base.u_rotation
    frame = result.fit.point.frame
    turned = Rotation.from_matrix(frame.rotation @ FRAME[0].T).as_rotvec()
    assert np.abs((frame.shift - FRAME[1]) / shift).max() < 4
    assert np.abs(turned / turn).max() < 4


@pytest.mark.parametrize("seed", [2, *map(again, range(3, 6))])
def test_less_knowledge_of_geometry_gives_no_smaller_u(seed):
    """Rows of parallel axes without half-widths: the stated ones of other rows still count."""
    rng = np.random.default_rng(seed)
    rows = [(0, 320, 90, 0), (425, 20, 0, 5), (392, -15, 0, -3)]
    rows += [(0, 110, 90, 0), (0, 95, -90, 1), (60, 82, 0, 0)]
    half_widths = {"a_mm": 0.1, "d_mm": 0.1, "alpha_rad": 2e-4, "theta_offset_rad": 2e-4}
    stated = by_table("parallel", rows, 150.0, uncertainty=half_widths)
    some = changed(stated.file, {2: {"uncertainty": None}, 3: {"uncertainty": None}})
    q = random_postures(stated, 80, rng)
    noise = {"encoder_noise": 1e-5, "reference_noise": 1e-5}
    points = stated.positions(q + 1e-5 * rng.normal(size=q.shape)) @ FRAME[0].T + FRAME[1]
    data = Measurements.of(q, points + 1e-5 * rng.normal(size=points.shape))
    u = []
    for arm in (stated, some):
        found = calibrate(arm, data, reference_frame="external", **noise, hold_out=False)
        volume = accuracy_volume(found.model, q, method="ellipsoid", encoder_noise=0.0)
        u.append(volume.u)
    assert (u[1] >= 0.99 * u[0]).all()
