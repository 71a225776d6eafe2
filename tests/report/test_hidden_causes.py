"""Causes to be found: drawn where the arm can have them, and told truly when they are uncovered."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin import Arm, Diagnosis, ErrorModel, Measurements, diagnose, simulate_measurements
from aacmm_pin.effects import CAUSES, EncoderEccentricity, JointCompliance
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.blind_trial import finding_of, hidden_cause, hideable, uncovered, uncovered_in_words

HIDDEN = EncoderEccentricity(3, values=(-3e-4, -1e-6))  # a phase next to ±180°


def test_every_cause_can_be_chosen_and_acts(sino6: Arm) -> None:
    data = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(1))
    for name in hideable(sino6):
        effect = hidden_cause(sino6, np.random.default_rng(2), name)
        assert effect.cause == name
        assert effect.cause in CAUSES
        times = np.linalg.norm(np.array(effect.values) / [term.typical for term in effect.terms])
        assert 1.0 <= times <= 2.5
        moved = ErrorModel(sino6, (effect,)).predict(data.q, data.conditions) - sino6.positions(data.q)
        assert np.abs(moved).max() > 1e-9


def test_what_is_drawn(sino6: Arm) -> None:
    positive = ("joint_compliance", "link_bending", "thermal_expansion", "stylus_bending", "base_compliance")
    for seed in range(2):
        for name in positive:
            assert min(hidden_cause(sino6, np.random.default_rng(seed), name).values) > 0
    drawn = [hidden_cause(sino6, np.random.default_rng(seed)) for seed in range(50)]
    assert {effect.cause for effect in drawn} == set(hideable(sino6))
    assert drawn[7] == hidden_cause(sino6, np.random.default_rng(7))
    with pytest.raises(UnknownNameError, match="encoder_eccentricity"):
        hidden_cause(sino6, np.random.default_rng(1), "gremlin")


@pytest.fixture(scope="module")
def records(sino6: Arm) -> Measurements:
    return simulate_measurements(ErrorModel(sino6, (HIDDEN,)), "free", 120, rng=np.random.default_rng(3))


@pytest.fixture(scope="module")
def found(sino6: Arm, records: Measurements) -> Diagnosis:
    return diagnose(sino6, records, encoder_noise=8e-6, hold_out=False)


def test_uncovered_beside_the_finding(sino6: Arm, records: Measurements, found: Diagnosis) -> None:
    finding = finding_of(found, HIDDEN)
    assert finding is not None
    table = uncovered(found, HIDDEN).set_index("value")
    for name, true in HIDDEN.described().items():
        value, u = finding.parameters[name]
        off = (value - true + np.pi) % (2 * np.pi) - np.pi if name == "phase_rad" else value - true
        assert table.loc[name, "times_u"] == pytest.approx(off / u)
        assert table.loc[name, "U"] == pytest.approx(2 * u)
    assert (table["times_u"].abs() < 4).all()
    words = uncovered_in_words(found, HIDDEN)
    moved = ErrorModel(sino6, (HIDDEN,)).predict(records.q) - sino6.positions(records.q)
    rms = 1e6 * np.sqrt(np.square(moved[found.extended.used]).sum(axis=1).mean())
    for part in ("encoder eccentricity of joint 3", "It is named", "settled", f"({rms:.1f} µm RMS at the tip"):
        assert part in words


def test_what_was_not_named_is_said_to_be_that(found: Diagnosis) -> None:
    for hidden in (JointCompliance(5, values=(2e-5,)), EncoderEccentricity(6)):
        assert uncovered(found, hidden)["found"].isna().all()
        assert "not named" in uncovered_in_words(found, hidden)
    alias = next(a.effect for f in found.findings for a in f.aliases if a.effect is not None)
    assert "look-alike" in uncovered_in_words(found, alias)
