"""Parts of the solver by themselves: noise of records in a turned frame, what a step promises,
weights of gross errors.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import linear_model, solver
from aacmm_pin.calibration.cross_validation import distances
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, contradictions, observations_of
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.calibration.studentised_residuals import deleted_distances
from aacmm_pin.calibration.variance_components import _variance_component
from aacmm_pin.effects import StylusOffset
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.orientation import quaternions
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements

NOISE = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) * 1e-6
FRAME = Frame(Rotation.from_rotvec([0.4, -0.9, 1.1]).as_matrix(), np.array([1.0, 2.0, -0.5]))


def external(arm: Arm, rng: np.random.Generator, off: float = 0.0, n: int = 12) -> Problem:
    """Records in a frame that is turned."""
    q = np.column_stack([rng.uniform(low, high, n) for low, high in arm.limits])
    points = FRAME.apply(arm.positions(q)) + rng.normal(scale=max(off, 1e-12), size=(n, 3))
    setup = Setup.of(arm, reference_frame="external", encoder_noise=NOISE, reference_noise=2e-6)
    return problem_of(ErrorModel(arm), Measurements.of(q, points), "geometry", setup)


def test_noise_of_readings_in_a_turned_frame(sino6: Arm, rng: np.random.Generator) -> None:
    problem = external(sino6, rng)
    found = NoiseModel.of(problem, problem.start, FRAME, Scatters(3e-6))
    by_reading = FRAME.rotation @ sino6.jacobian(problem.measurements.q) * NOISE
    wanted = by_reading @ by_reading.transpose(0, 2, 1) + 9e-12 * np.eye(3)
    np.testing.assert_allclose(found.tips, wanted, rtol=1e-9, atol=1e-19)
    np.testing.assert_allclose(
        found.of_residuals, wanted + 4e-12 * np.eye(3), rtol=1e-9, atol=1e-19
    )
    np.testing.assert_allclose(
        found.without_scatter, wanted - 5e-12 * np.eye(3), rtol=1e-9, atol=1e-19
    )
    white = found.whitening @ found.of_residuals @ found.whitening.transpose(0, 2, 1)
    np.testing.assert_allclose(white, np.broadcast_to(np.eye(3), white.shape), atol=1e-9)


def test_noise_of_readings_acts_on_the_target(sino6: Arm, rng: np.random.Generator) -> None:
    """On one beyond the tip, by differences of what the readings predict; on its
    orientation too.
    """
    n, step = 8, 1e-6
    q = np.column_stack([rng.uniform(low, high, n) for low, high in sino6.limits])
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
    np.testing.assert_allclose(found, np.stack(moved, axis=2), atol=1e-7)


def system_of(problem: Problem, off: float = 0.0) -> solver.Solution:
    """The system where the search begins, or so many widths away from it, the frame known."""
    x = problem.start + off * problem.widths
    point = solver.Point(x, FRAME, np.zeros((0, 3)), problem.predict(x, FRAME))
    noise = NoiseModel.of(problem, x, FRAME, Scatters())
    return solver.solution_at(problem, noise, point, np.ones(problem.measurements.n))


def test_what_a_step_promises(
    sino6: Arm, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What plain least squares of the same rows gains, and what is left of it in a trust region."""
    monkeypatch.setattr(linear_model, "ROWS_AT_ONCE", 7)  # not all rows at once
    problem = external(sino6, rng, off=1e-4)
    here = system_of(problem, off=0.3)
    x, scales = here.point.x, problem.scales
    rows = np.vstack([here.system.prior.rows[:, :-1] / scales, here.system.jacobian])
    residual = np.concatenate([here.system.prior.rows[:, -1], here.system.residual])
    assert here.system.cost == pytest.approx(residual @ residual, rel=1e-9)
    assert here.system.cost > 1.0 + here.system.residual @ here.system.residual
    quarter = solver.solution_at(problem, here.noise, here.point, 0.25 * here.weights).system
    np.testing.assert_allclose(quarter.residual, 0.5 * here.system.residual, rtol=1e-12)
    seen = problem.predict(x, FRAME, here.point.prediction.tips).jacobian
    np.testing.assert_allclose(
        seen / scales, here.point.prediction.jacobian / scales, rtol=1e-9, atol=1e-9
    )

    def gained(step: Array) -> float:
        return float(residual @ residual - np.square(residual + rows @ step).sum())

    best = gained(-np.linalg.lstsq(rows * scales, residual)[0] * scales)
    step = solver._Step.of(here.system, np.zeros(scales.size))
    assert best > 100.0
    assert [
        here.system.spectrum.predicted_reduction(0.0),
        step.predicted_reduction,
    ] == pytest.approx([best] * 2, rel=1e-6)
    full = step.within(np.inf)
    assert full.predicted == pytest.approx(best, rel=1e-6)
    for part in (1.1, 0.5, 0.1, 1e-6):
        delta, length, promised = step.within(part * full.length)
        assert length == pytest.approx(min(part, 1.0) * full.length, rel=1e-2)
        assert promised == pytest.approx(gained(delta), rel=1e-6)


def test_ends_of_bars_are_where_they_fit_best(sino6: Arm, rng: np.random.Generator) -> None:
    """From a start that is off, parameters as they are: no step of the ends by themselves
    is left.
    """
    noise = {"encoder_noise": 8e-6, "probe_noise": 5e-6}
    data = simulate_measurements(
        sino6, "ball-bar", 60, rng=rng, known=False, bar_length=0.5, **noise
    )
    setup = Setup.of(sino6, **noise)
    problem = problem_of(ErrorModel(sino6), data, "geometry", setup)
    model = NoiseModel.of(problem, problem.start, Frame.identity(), Scatters())
    search = solver._Search(problem, model, np.ones(60), False, solver.SETTLED)
    begun = solver.initial_point(problem, model.observations)
    start = replace(begun, seats=begun.seats + rng.normal(scale=2e-3, size=begun.seats.shape))
    still = np.zeros(problem.scales.size)
    seats, bars = len(model.observations.labels), len(model.observations.ends)
    assert bars > 0
    assert search.system(start).free == 3 * (60 - seats) + bars
    assert np.abs(search.system(start).seat_step(still)).max() > 1e-3
    assert (
        np.abs(search.seats_at_best(start, search.system(start))[1].seat_step(still)).max() < 1e-7
    )


def test_records_without_weight_count_for_nothing(sino6: Arm, rng: np.random.Generator) -> None:
    problem, weights = external(sino6, rng, off=1e-4), np.ones(12)
    weights[[2, 7]] = 0.0
    here = system_of(problem)
    found = solver.solution_at(problem, here.noise, here.point, weights).chi2
    fewer = system_of(problem.of(problem.measurements.take(np.flatnonzero(weights))))
    assert tuple(found) == pytest.approx(tuple(fewer.chi2), rel=1e-6)


@pytest.mark.parametrize("known", [True, False])
def test_distance_from_where_the_others_put_a_seat(
    sino6: Arm, rng: np.random.Generator, known: bool
) -> None:
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
    step = solver.solution_at(problem, model, begun, weights).system.seat_step(
        np.zeros(problem.scales.size)
    )
    best = solver.solution_at(problem, model, replace(begun, seats=begun.seats + step), weights)
    assert best.system.free == 3 * 24 - (0 if known else 9)
    found = deleted_distances(best)
    tips, covariance = begun.prediction.tips, model.of_residuals
    for k, seat in enumerate(observations.seat):
        others = [j for j in np.flatnonzero(observations.seat == seat) if j != k]
        told = [(np.linalg.inv(covariance[j]), tips[j]) for j in others]
        told += [(np.eye(3) / 12e-6**2, observations.stated[seat])] if known else []
        u = np.linalg.inv(sum(information for information, _ in told))
        off = tips[k] - u @ sum(information @ place for information, place in told)
        assert found[k] == pytest.approx(off @ np.linalg.solve(covariance[k] + u, off), rel=1e-4)


def test_a_promise_that_nothing_comes_of_ends_the_search(
    sino6: Arm, rng: np.random.Generator
) -> None:
    """At the minimum with a derivative that is wrong by a little: a small promise is let go, a
    large one is not.
    """
    problem = external(sino6, rng, off=3e-6)
    begun = system_of(problem)
    weights = begun.weights
    best = solver.solve(problem, begun.noise, begun.point, weights)
    assert best.converged
    assert solver.solve(problem, begun.noise, best.point, weights).steps == 1
    wrong = rng.normal(size=best.point.prediction.jacobian.shape) / problem.scales
    for promise, converged in ((1e-3, True), (1.0, False)):
        search = solver._Search(problem, begun.noise, weights, False, solver.SETTLED)
        search.correction = 1e-12 * wrong
        for _ in range(20):
            start = search.corrected(best.point)
            found = solver._Step.of(search.system(start), search.units).predicted_reduction
            search.correction = search.correction * np.sqrt(promise / found)
        assert found == pytest.approx(promise, rel=1e-3)
        assert search.run(search.corrected(best.point)).converged == converged


def test_a_frame_is_no_mirror_image(rng: np.random.Generator) -> None:
    """Of points nearly in a plane, whose mirror image fits as well."""
    for _ in range(8):
        flat = rng.normal(size=(5, 3)) * [1.0, 1.0, 1e-6]
        noisy = FRAME.apply(flat) + 1e-6 * rng.normal(size=(5, 3))
        np.testing.assert_allclose(registered(flat, noisy).rotation, FRAME.rotation, atol=1e-4)


def test_coordinates_of_a_seat_that_hardly_differ_are_the_same(sino6: Arm) -> None:
    seats = Conditions(2, seat=np.array(["A", "A"], dtype=object))
    for apart, u, noise, labels in (
        (0.3, 1e-5, None, ("A",)),
        (0.4, 1e-5, None, ()),
        (0.3, np.nan, 1e-5, ("A",)),
        (0.3, np.nan, None, ()),
    ):
        points = np.array([[0.5, 0.0, 0.0], [0.5 + apart * 1e-5, 0.0, 0.0]])
        records = Measurements.of(np.zeros((2, 6)), points, np.full((2, 3), u), conditions=seats)
        assert observations_of(records, Setup.of(sino6, reference_noise=noise)).labels == labels


@pytest.mark.parametrize(
    ("apart", "loose"), [(3e-6, False), (1.9e-5, False), (2.1e-5, True), (3e-3, True)]
)
def test_a_seat_of_which_some_records_are_rounded_or_wrong_was_measured_once(
    sino6: Arm, apart: float, loose: bool
) -> None:
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
    assert len(contradictions(records, noise, Scatters())) == loose
    assert observations_of(replace(records, reference=own), noise).labels == (
        ("A",) if apart == 3e-6 else ()
    )


def test_distances_at_unknown_seats() -> None:
    """From the mean of the others of a seat, widened; from where others put it; none of a single
    record.
    """
    seats = Conditions(6, seat=np.array([*"AAA", "B", *"CC"], dtype=object))
    tips = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0], [1, 1, 1], [3, 4, 0], [0, 0, 2]], dtype=float)
    found = distances(Measurements.of(np.zeros((6, 6)), conditions=seats), tips, {"C": np.zeros(3)})
    np.testing.assert_allclose(found, [*np.sqrt(1.5 * np.array([2.0, 5.0, 5.0])), np.nan, 5.0, 2.0])


def test_observability_by_hand() -> None:
    """Singular values 4 and 1, and a direction that nothing tells."""
    found = Observability.of(np.diag([4.0, 1.0, 0.0]), 4)
    assert (found.o1, found.o2, found.o3, found.o4, found.o5) == pytest.approx(
        (1.0, 0.25, 1.0, 0.25, 0.8)
    )
    assert found.directions == 2


def test_chi2_that_the_noise_does_not_explain() -> None:
    for chance, acceptable in ((2e-3, True), (5e-4, False)):
        assert solver.Chi2(float(chi2.isf(chance, 300)), 300.0).acceptable == acceptable
    assert solver.Chi2(5.0, 0.4).acceptable  # nothing to judge it by


def test_the_scatter_with_which_chi2_meets_its_degrees_of_freedom() -> None:
    """Ties of seats and bars have a part of them, or, not stated, one of their own; records that do
    not count have none; too few tell nothing.
    """
    deviation = np.array([[3.0, 0, 0], [0, 4.0, 0], [0, 0, 12.0], [900.0, 0, 0]]) * 1e-5
    ties: Any = SimpleNamespace(
        of_seats=lambda seats: np.array([[0.0, seats, 0.0]]),
        of_bars=lambda seats: (np.array([seats / 2]), None),
    )
    own = np.broadcast_to(9e-10 * np.eye(3), (4, 3, 3))
    noise = SimpleNamespace(scatters=Scatters(7e-5), observations=ties, without_scatter=own)
    closed, open_ = np.zeros((1, 3), dtype=bool), np.array([[False, True, False]])
    for dof, seats, apart, wanted in (
        (8.0, 0.0, (closed, 0.0), 169 / 8.0),
        (8.0, 2.0, (closed, 0.0), 169 / 3.0),
        (8.0, 2.0, (open_, 1.5), 169 / 5.5),
        (0.4, 2.0, (closed, 0.0), None),
    ):
        found: Any = SimpleNamespace(
            noise=noise,
            chi2=SimpleNamespace(dof=dof),
            turn_dof=0.0,
            system=SimpleNamespace(off=deviation),
            point=SimpleNamespace(seats=seats),
        )
        scatter = 7e-5 if wanted is None else 1e-5 * np.sqrt(wanted - 9.0)
        assert _variance_component(found, np.arange(4) < 3, False, *apart) == pytest.approx(
            scatter, rel=1e-6
        )


def test_weights_of_gross_errors() -> None:
    """Cauchy's: half at two standard deviations in each of three coordinates, by the scatter of
    most records.
    """
    for scale in (1.0, 50.0):
        distance = scale * np.array([*[solver.MEDIAN] * 9, 0.0, 12.0, 108.0, np.nan])
        np.testing.assert_allclose(solver._robust_weights(distance)[9:], [1.0, 0.5, 0.1, 1.0])
    assert (solver._robust_weights(np.full(3, np.nan)) == 1.0).all()
