"""Parts of the solver by themselves: noise of records in a turned frame, what a step promises,
weights of gross errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from aacmm_pin.arm import Arm, exp
from aacmm_pin.calibration import Fit, Observability, solver
from aacmm_pin.calibration.cross_validation import distances
from aacmm_pin.calibration.estimation import deleted_distances, variance_components
from aacmm_pin.calibration.linearisation import Point
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, contradictions, observations_of
from aacmm_pin.calibration.parameter_vector import Columns
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import (
    BearingTilt,
    Conditions,
    EncoderEccentricity,
    ErrorModel,
    JointZeroOffset,
    LinkLength,
    LinkTwist,
    SeatError,
    State,
    StylusOffset,
    ThermalExpansion,
    sensitivity,
)
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.measurements.orientation import quaternions
from tests.oracle import close, postures

pytestmark = pytest.mark.fast

NOISE = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-6
FRAME = Frame(Rotation.from_rotvec([0.4, -0.9, 1.1]).as_matrix(), np.array([1.0, 2.0, -0.5]))


def external(arm: Arm, rng: np.random.Generator, off: float = 0.0, n: int = 12) -> Problem:
    """Records in a frame that is turned."""
    q = postures(arm, rng, n)
    points = FRAME.apply(arm.positions(q)) + rng.normal(scale=max(off, 1e-12), size=(n, 3))
    setup = Setup.of(arm, reference_frame="external", encoder_noise=NOISE, reference_noise=2e-6)
    return problem_of(ErrorModel(arm), Measurements.of(q, points), "geometry", setup)


def test_noise_of_readings_in_a_turned_frame(sino6, rng):
    problem = external(sino6, rng)
    found = NoiseModel.of(problem, problem.start, FRAME, Scatters(3e-6))
    by_reading = FRAME.rotation @ sino6.jacobian(problem.measurements.q) * NOISE
    wanted = by_reading @ by_reading.transpose(0, 2, 1) + 9e-12 * np.eye(3)
    np.testing.assert_allclose(found.tip_covariance, wanted, rtol=1e-9, atol=1e-19)
    np.testing.assert_allclose(
        found.of_residuals, wanted + 4e-12 * np.eye(3), rtol=1e-9, atol=1e-19
    )
    np.testing.assert_allclose(
        found.without_scatter, wanted - 5e-12 * np.eye(3), rtol=1e-9, atol=1e-19
    )
    white = found.whitening @ found.of_residuals @ found.whitening.transpose(0, 2, 1)
    close(white, np.broadcast_to(np.eye(3), white.shape), 1e-9)


def test_noise_of_readings_acts_on_the_target(sino6, rng):
    """On one beyond the tip, by differences of what the readings predict; on its
    orientation too.
    """
    n, step = 8, 1e-6
    q = postures(sino6, rng, n)
    model = ErrorModel(sino6, (StylusOffset("far", values=(0.05, -0.1, 0.3)),))
    marker = Conditions(n, marker=np.full(n, "far", dtype=object))
    orientation = quaternions(model.state(q, marker).rotation[-1])
    points = model.predict(q, marker)
    records = Measurements.of(q, points, conditions=marker, orientation=orientation)
    problem = problem_of(model, records, [], Setup.of(sino6, target="frame"))
    moved = []
    for j in range(sino6.nq):
        low, high = (model.state(q + sign * step * np.eye(sino6.nq)[j], marker) for sign in (-1, 1))
        turn = Rotation.from_matrix(
            high.rotation[-1] @ low.rotation[-1].transpose(0, 2, 1)
        ).as_rotvec()
        moved.append(np.hstack([high.position - low.position, turn]) / (2 * step))
    found = problem.reading_jacobian(np.array([0.05, -0.1, 0.3]), Frame.identity())
    close(found, np.stack(moved, axis=2), 1e-7)


def system_of(problem: Problem, off: float = 0.0) -> Fit:
    """The system where the search begins, or so many widths away from it, the frame known."""
    x = problem.start + off * problem.widths
    point = Point(x, FRAME, np.zeros((0, 3)), problem.predict(x, FRAME))
    noise = NoiseModel.of(problem, x, FRAME, Scatters())
    return Fit.at(problem, noise, point, np.ones(problem.measurements.n))


@pytest.mark.parametrize("known", [True, False])
def test_distance_from_where_the_others_put_a_seat(sino6, rng, known):
    """Each record's seat anew from all others, and from what is stated of it, by weighted least
    squares.
    """
    noise = {"encoder_noise": 8e-6, "reference_noise": 12e-6, "probe_noise": 5e-6}
    data = simulate_measurements(sino6, "seats", 24, rng=rng, seats=3, known=known, **noise)
    setup = Setup.of(sino6, **noise)
    problem = problem_of(ErrorModel(sino6), data, "geometry", setup)
    model = NoiseModel.of(problem, problem.start, Frame.identity(), Scatters())
    begun, weights, observations = (
        solver.initial_point(problem, model.observations),
        np.ones(24),
        model.observations,
    )
    step = Fit.at(problem, model, begun, weights).system.seat_step(np.zeros(problem.scales.size))
    best = Fit.at(problem, model, replace(begun, seats=begun.seats + step), weights)
    assert best.free == 3 * 24 - (0 if known else 9)
    found = deleted_distances(best)
    tips, covariance = begun.prediction.tips, model.of_residuals
    for k, seat in enumerate(observations.seat):
        others = [j for j in np.flatnonzero(observations.seat == seat) if j != k]
        told = [(np.linalg.inv(covariance[j]), tips[j]) for j in others]
        told += [(np.eye(3) / 12e-6**2, observations.stated[seat])] if known else []
        u = np.linalg.inv(sum(information for information, _ in told))
        off = tips[k] - u @ sum(information @ place for information, place in told)
        assert found[k] == pytest.approx(off @ np.linalg.solve(covariance[k] + u, off), rel=1e-4)


def several_targets(arm: Arm, rng: np.random.Generator, turned: bool) -> Problem:
    """Three targets in each of eight readings, whose records are not one after the other, and one
    that was measured twice in the last.
    """
    n = 25
    reading = np.append(np.tile(np.arange(8), 3), 7)
    q = np.column_stack([rng.uniform(low, high, 8) for low, high in arm.limits])[reading]
    places = {"a": (0.0, 0.1, 0.0), "b": (0.1, 0.0, 0.05), "c": (0.0, 0.0, 0.2)}
    model = ErrorModel(arm, tuple(StylusOffset(one, values=at) for one, at in places.items()))
    labels = np.append(np.repeat([*"abc"], 8), "c").astype(object)
    conditions = Conditions(n, marker=labels)
    off = 2e-5 * rng.standard_normal((n, 3))
    points = FRAME.apply(model.predict(q, conditions)) + off
    orientation = None
    if turned:
        turn = FRAME.rotation @ model.state(q, conditions).rotation[-1]
        orientation = quaternions(
            turn @ exp(np.pad(1e-5 * off / 2e-5, ((0, 0), (3, 0))))[:, :3, :3]
        )
    records = Measurements.of(
        q,
        points,
        conditions=conditions,
        orientation=orientation,
        orientation_u=np.full(n, 7e-6) if turned else None,
    )
    setup = Setup.of(arm, "external", "frame", encoder_noise=1e2 * NOISE, reference_noise=2e-6)
    return problem_of(model, records, "geometry", setup)


@pytest.mark.parametrize("turned", [False, True])
def test_targets_of_one_reading_share_its_noise(sino6, rng, turned):
    """χ², covariance, distances and scatter by the covariance matrix of all residuals; a record
    that does not count has no part in it.
    """
    problem = several_targets(sino6, rng, turned)
    n, width, left_out = 25, 6 if turned else 3, 9
    weights = np.ones(n)
    weights[left_out] = 0.0
    here = system_of(problem)
    found = Fit.at(problem, here.noise, here.point, weights)
    reading = np.append(np.tile(np.arange(8), 3), 8)
    together = (reading[:, None] == reading)[:, None, :, None]
    by_reading = problem.reading_jacobian(here.point.x, FRAME) * problem.setup.encoder_noise
    shared = np.einsum("nij,mkj->nimk", by_reading, by_reading) * together
    own = np.diag(np.tile([2e-6**2] * 3 + [7e-6**2] * (width - 3), n))
    counts = np.repeat(weights > 0.0, width)
    covariance = (shared.reshape(own.shape) + own)[np.ix_(counts, counts)]
    columns = here.point.prediction.jacobian.reshape(n * width, -1)[counts]
    residual = found.system.deviations.ravel()[counts]
    prior = found.system.prior
    scaled = prior.rows[:, :-1] / prior.scales
    information = columns.T @ np.linalg.solve(covariance, columns) + scaled.T @ scaled
    assert found.chi2.value == pytest.approx(
        residual @ np.linalg.solve(covariance, residual), rel=1e-5
    )
    unknown = np.zeros((prior.scales.size, 0))
    u = np.sqrt(np.diag(np.linalg.inv(information)))
    np.testing.assert_allclose(np.sqrt(np.diag(found.system.covariance(unknown))), u, rtol=1e-5)
    scatter = variance_components(found, np.zeros((0, 3), dtype=bool)).tip
    of_tips = np.tile(np.arange(width) < 3, n)[counts]
    more = covariance[np.ix_(of_tips, of_tips)] + scatter**2 * np.eye(int(of_tips.sum()))
    chi2 = residual[of_tips] @ np.linalg.solve(more, residual[of_tips])
    assert chi2 == pytest.approx(found.chi2.dof - found.turn_dof, rel=1e-5)
    first = slice(0, width)
    distance = residual[first] @ np.linalg.solve(covariance[first, first], residual[first])
    alone = found.of_each_record(found.system.rows)[0, :, -1]
    assert alone @ alone == pytest.approx(distance, rel=1e-5)


def test_a_frame_is_no_mirror_image(rng):
    """Of points nearly in a plane, whose mirror image fits as well."""
    for _ in range(8):
        flat = rng.normal(size=(5, 3)) * [1.0, 1.0, 1e-6]
        noisy = FRAME.apply(flat) + 1e-6 * rng.normal(size=(5, 3))
        close(registered(flat, noisy).rotation, FRAME.rotation, 1e-4)


def test_a_frame_has_the_least_sum_of_distances(rng):
    """By a search of another kind, with gross errors in a third of the references."""
    tips = rng.normal(size=(30, 3))
    references = FRAME.apply(tips) + 1e-4 * rng.normal(size=(30, 3))
    references[:10] += 0.5 * rng.normal(size=(10, 3))

    def total(vector):
        rotated = Rotation.from_rotvec(vector[:3]).apply(tips)
        return np.linalg.norm(rotated + vector[3:] - references, axis=1).sum()

    frame = registered(tips, references)
    vector = [*Rotation.from_matrix(frame.rotation).as_rotvec(), *frame.shift]
    best = minimize(total, vector, method="Nelder-Mead", options={"xatol": 1e-7, "maxiter": 4000})
    assert total(np.array(vector)) == pytest.approx(best.fun, rel=1e-4)


@pytest.mark.parametrize(
    ("apart", "loose"), [(3e-6, False), (1.9e-5, False), (2.1e-5, True), (3e-3, True)]
)
def test_a_seat_of_which_some_records_are_rounded_or_wrong_was_measured_once(sino6, apart, loose):
    """Coordinates that records repeat are of one measurement, beside those of a record that are far
    from them; where each has its own, these are of many.
    """
    seats, noise = (
        Conditions(8, seat=np.full(8, "A", dtype=object)),
        Setup.of(sino6, reference_noise=1e-5),
    )
    points = np.tile([0.5, 0.0, 0.0], (8, 1))
    points[5, 0] += apart
    own = points.copy()
    own[:, 0] = 0.5 + np.linspace(0.0, apart, 8)
    records = Measurements.of(np.zeros((8, 6)), points, conditions=seats)
    found = observations_of(records, noise)
    assert found.seat.tolist() == np.where(loose & (np.arange(8) == 5), -1, 0).tolist()
    assert abs(found.stated[0, 0] - 0.5 - (not loose) * apart / 8) < 1e-12
    assert len([*contradictions(records, noise, Scatters())]) == loose
    assert observations_of(replace(records, reference=own), noise).labels == (
        ("A",) if apart == 3e-6 else ()
    )


def test_distances_at_unknown_seats():
    """From the mean of the others of a seat, widened; from where others put it; none of a single
    record.
    """
    seats = Conditions(6, seat=np.array([*"AAA", "B", *"CC"], dtype=object))
    tips = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [1, 1, 1], [3, 4, 0], [0, 0, 2]], dtype=float)
    found = distances(Measurements.of(np.zeros((6, 6)), conditions=seats), tips, {"C": np.zeros(3)})
    np.testing.assert_allclose(found, [*np.sqrt(1.5 * np.array([2.0, 5.0, 5.0])), np.nan, 5.0, 2.0])


def test_observability_by_hand():
    """Singular values 4 and 1, and a direction that nothing tells."""
    found = Observability.of(np.diag([4.0, 1.0, 0.0]), 4)
    assert (found.o1, found.o2, found.o3, found.o4, found.o5) == pytest.approx(
        (1.0, 0.25, 1.0, 0.25, 0.8)
    )
    assert found.directions == 2


@pytest.mark.parametrize("n", [1, 8])
def test_columns_of_all_effects_are_those_of_each(n, sino6, rng):
    """Tips and derivatives; constant twists, those of a record, an exact arcsine, what bends, and a
    seat.

    In a single record thermal expansion too is a parameter with constant twists, at several places
    at once.
    """
    q = postures(sino6, rng, n)
    seat = np.array(["A", "", "B", "A"] * 2, dtype=object)[:n]
    known = Conditions(n, temperature=rng.uniform(15.0, 30.0, n), seat=seat)
    effects = [
        LinkLength(2), LinkTwist(3), JointZeroOffset(1), StylusOffset(),
        EncoderEccentricity(4), ThermalExpansion(), BearingTilt(2), SeatError("A")
    ]  # fmt: skip
    columns = Columns.of(State(sino6, q, known, sino6.chain.tip), effects)
    x = rng.normal(size=columns.vector.size) * columns.vector.typical
    model = ErrorModel(sino6, tuple(e.at(tuple(x[own])) for e, own in columns.vector))
    state = columns.at(x)
    close(state.position, model.predict(q, known, as_referenced=True), 1e-14)
    wanted = np.concatenate([sensitivity(e, state) for e in effects], axis=2)
    np.testing.assert_allclose(columns.jacobian(state), wanted, rtol=1e-12, atol=1e-14)
    given, estimated = model.effects[1::2], effects[::2]
    some = Columns.of(columns.state, estimated, given)
    at = np.concatenate([x[own] for own in columns.vector.slices[::2]])
    close(some.at(at).position, state.position, 1e-14)
    wanted = np.concatenate([sensitivity(e, state) for e in estimated], axis=2)
    np.testing.assert_allclose(some.jacobian(some.at(at)), wanted, rtol=1e-9, atol=1e-12)
