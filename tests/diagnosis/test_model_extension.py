"""From a posterior to an extended arm: records far off, seats in several parts, nonlinear
parameters.
"""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from aacmm_pin.diagnosis import Choice, choice, model_extension, nonlinear_parameters
from aacmm_pin.effects import Conditions, EncoderSlip, JointErrorCurve, JointPeriodicError
from aacmm_pin.measurements import Measurements

pytestmark = pytest.mark.fast


def choice_of(**known: Any) -> Choice:
    """A choice of which nothing is known but some fields."""
    nothing: Any = dict.fromkeys((each.name for each in fields(Choice)), None)
    return Choice(**nothing | known)


def test_how_far_from_its_target_a_record_is():
    """Over what one of all records may be off with a chance of 1 %, by Bonferroni's bound; none
    where nothing is said.
    """
    limit = chi2.isf(0.01 / 4, 3)
    off = np.array([[3e-5, 0.0, 0.0], [0.0, 4e-5, 0.0], [0.0, 3e-5, 4e-5], [np.nan] * 3])
    has_target = np.array([True, True, True, False])
    at = SimpleNamespace(observations=SimpleNamespace(has_target=has_target, counts=3 * has_target))
    judge = SimpleNamespace(
        residual_noise=np.array([1.0, 4.0, 1.0, 1.0])[:, None, None] * 1e-10 * np.eye(3)
    )
    found = model_extension._times_the_limit(at, off, judge)
    np.testing.assert_allclose(found, np.array([3.0, 2.0, 5.0, 0.0]) / np.sqrt(limit), rtol=1e-6)


@pytest.mark.parametrize(
    ("parts", "torn"),
    [([0, 0, 1, 1, 0, 1], False), ([0, 1, 1, 1, 0, 1], True), ([0, 0, 0, 1, 0, 1], True)],
)
def test_seats_and_bars_in_several_parts(parts, torn):
    """Seats 0 and 1 at the ends of a bar, seat 2 alone; two records at none."""
    observations = SimpleNamespace(
        seat=np.array([0, 1, 2, 2, -1, -1]), clusters=np.array([0, 0, 1])
    )
    at = SimpleNamespace(observations=observations)
    assert choice._torn(at, np.array(parts)) == torn


@pytest.mark.parametrize(
    ("moved", "used", "parts", "inside"),
    [
        ([0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], True),
        ([0, 1, 1, 1], [1, 1, 1, 1], [0, 0, 1, 1], False),
        ([0, 1, 1, 1], [1, 0, 1, 1], [0, 0, 1, 1], True),
        ([0, 0, 1, 1], [1, 1, 1, 1], [0, 0, 0, 0], False),  # nothing is left out
        ([0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 1, 1], False),
    ],
)
def test_a_cause_of_records_that_are_left_out_together(moved, used, parts, inside):
    columns = np.zeros((4, 3, 2))
    columns[:, 2, 1] = moved
    design = SimpleNamespace(columns=lambda _: columns)
    posterior = SimpleNamespace(space=SimpleNamespace(candidates=SimpleNamespace(design=design)))
    fit = SimpleNamespace(used=np.array(used, dtype=bool))
    assert choice_of(posterior=posterior, fit=fit, parts=np.array(parts)).in_one_part(0) == inside


def test_a_refined_value_takes_the_place_of_the_nearest():
    """So that there are no more of them where the evidence is; whole orders stay."""
    waves = tuple(JointPeriodicError(3, order) for order in (3.5, 4.0, 4.4, 4.9))
    library = [(JointErrorCurve(3, -1.0, 1.0, 11),), waves, (EncoderSlip(3, 20.0),)]
    refined = JointPeriodicError(3, 4.1, values=(1e-4, 0.0))
    found = model_extension._with_variants(library, [refined])
    assert [found[0], found[2]] == [library[0], library[2]]
    assert [wave.order for wave in found[1]] == [3.5, 4.0, 4.1, 4.9]
    assert not any(any(wave.values) for wave in found[1])
    there = model_extension._with_variants(library, [waves[2]])
    assert list(there) == library


def test_a_refit_holds_what_can_be_any_function_of_its_place():
    """At its values; all others are estimated from nothing, within their u."""
    curve = JointErrorCurve(3, -1.0, 1.0, 5, values=(1e-4,) * 5)
    wave = JointPeriodicError(2, 3.0, values=(1e-4, 2e-4), u=(1e-3, 1e-3))
    asked = []

    def problem_of(causes, held, gone=()):
        asked.append((causes, held, gone))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_extension, "fit", lambda problem, used: used)
        assert model_extension.refitted(problem_of, [wave, curve], used=None) is None
    assert asked == [([wave.at((), wave.u)], [curve], ())]


def test_the_top_of_a_parabola():
    """Between the neighbours of the best; no further, and nowhere where there is no top."""
    tried = [JointPeriodicError(3, order) for order in (2.0, 2.5, 3.5)]
    for top in (2.3, 2.9):
        evidences = -np.array([(2.0 - top) ** 2, (2.5 - top) ** 2, (3.5 - top) ** 2])
        assert nonlinear_parameters._at_the_top(tried, evidences, 1).order == pytest.approx(top)
    flat, at_the_end = np.zeros(3), np.array([0.0, -1.0, -2.0])
    assert nonlinear_parameters._at_the_top(tried, flat, 1) == tried[1]
    assert nonlinear_parameters._at_the_top(tried, at_the_end, 0) == tried[0]


def test_nonlinear_parameters_by_their_evidence(monkeypatch):
    """A whole order unless another is far better; u of a step by the gaps between the records."""
    for far, expected in ((1.0, 4.0), (3.0, 4.11)):
        wave = JointPeriodicError(3, 4.0)
        tried = wave.nonlinear.refine(wave, Measurements.of(np.zeros((4, 6))))
        peak = far / 0.11**2  # so much better than the whole order
        refined = nonlinear_parameters.likeliest(
            tried, np.array([-peak * (e.order - 4.11) ** 2 for e in tried])
        )
        assert refined.order == pytest.approx(expected, abs=1e-3)
    records = Measurements.of(
        np.zeros((4, 6)), conditions=Conditions(4, time=np.array([0.0, 10.0, 30.0, 70.0]))
    )
    fit = SimpleNamespace(problem=SimpleNamespace(measurements=records))
    slip = SimpleNamespace(
        variant=lambda _: EncoderSlip(3, 20.0),
        fit=fit,
        noise=None,
        candidates=None,
        top_causes=(),
    )
    monkeypatch.setattr(nonlinear_parameters, "_acting", lambda *_: [])
    monkeypatch.setattr(
        nonlinear_parameters, "evidences", lambda *given: {0: [np.zeros(len(given[3][0][0]))]}
    )
    times = np.array([0.0, 5.0, 20.0, 50.0])
    # Around each of them; the first is the first record itself.
    gaps = np.array([0.0, 10.0, 20.0, 40.0])
    variance = np.square(times - 20.0).mean() + np.square(gaps).mean() / 12.0
    assert nonlinear_parameters.step_of(slip, 0, "time_s") == nonlinear_parameters.Step(
        pytest.approx(np.sqrt(variance)), 0.0, 50.0
    )
