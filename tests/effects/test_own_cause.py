"""A cause that the package does not have: registered from outside, hidden in data, found by its name, written and read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from aacmm_pin import Arm, ErrorModel, Measurements, diagnose, simulate_measurements
from aacmm_pin.arm.chain import axis
from aacmm_pin.cli.effect_options import effects_of
from aacmm_pin.effects import (
    CAUSES,
    Displacement,
    Effect,
    EncoderGain,
    JointCompliance,
    JointPeriodicError,
    LinkLength,
    Term,
    register,
)
from aacmm_pin.effects.effect import about_axis
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, ArmFileError, MissingConditionError, UnknownNameError
from aacmm_pin.planning.causes import cause_of
from aacmm_pin.report import plots
from aacmm_pin.report.diagnosis_findings import verdict_in_words
from aacmm_pin.report.plots.partial_residuals import partial_residual

NOISE = 8e-6
HOOK = (0.0, 0.0, 1000.0)


@dataclass(frozen=True)
class HosePull(Effect):
    """A hose from the wrist to a hook turns a joint by the moment of its pull."""

    joint: int
    hook_mm: tuple[float, float, float] = HOOK
    cause: ClassVar[str] = "hose_pull"
    elastic: ClassVar[bool] = True

    @property
    def terms(self) -> tuple[Term, ...]:
        return (Term("", "rad/m", 1e-4, "turn_rad_per_m"),)

    def displacements(self, state: State) -> list[Displacement]:
        wrist, pivot = state.origin[axis(5)], state.origin[axis(self.joint)]
        pull = np.array(self.hook_mm) * 1e-3 - wrist
        pull /= np.linalg.norm(pull, axis=1, keepdims=True)
        moment = np.sum(state.rotation[axis(self.joint)][:, :, 2] * np.cross(wrist - pivot, pull), axis=1)
        return [about_axis(state, self.joint, moment[:, None])]


@pytest.fixture(autouse=True)
def _registered() -> None:
    register(HosePull)


@pytest.fixture(scope="module")
def hidden() -> Measurements:
    arm = Arm.load("sino6")
    return simulate_measurements(ErrorModel(arm, (HosePull(2, values=(2e-4,)),)), "free", 200, rng=np.random.default_rng(1))


def test_it_is_found_by_its_name_only_where_it_is_tried(sino6: Arm, hidden: Measurements, tmp_path: Path) -> None:
    without = diagnose(sino6, hidden, encoder_noise=NOISE, hold_out=False)
    assert "hose_pull" not in {f.cause for f in without.findings}
    tried = [HosePull(joint) for joint in (1, 2, 3, 4)]
    found = diagnose(sino6, hidden, encoder_noise=NOISE, extra_causes=tried)
    assert [f.label for f in found.findings] == ["hose_pull:2"]
    assert found.verdict == "explained"
    assert verdict_in_words(found).startswith("SINO6: the simulation lacks one cause, hose pull of joint 2.")
    value, u = found.findings[0].parameters["turn_rad_per_m"]
    assert abs(value - 2e-4) < 3.3 * u
    assert found.held_out is not None
    assert found.held_out.gain > 0.2
    assert found.summary()["findings"][0]["hook_mm"] == HOOK

    path = tmp_path / "extended.toml"
    found.model.save(path)
    loaded = ErrorModel.load(path)
    assert loaded.effects == found.model.effects
    np.testing.assert_allclose(loaded.predict(hidden.q), found.model.predict(hidden.q), rtol=0, atol=1e-12)
    ax = plots.plot_cause(found, found.findings[0])
    assert "hose pull of joint 2" in ax.get_title()
    del CAUSES["hose_pull"]
    with pytest.raises(ArmFileError, match="unknown cause 'hose_pull'"):
        ErrorModel.load(path)


def test_options_and_plans_know_its_name(sino6: Arm) -> None:
    (typed,) = effects_of(["hose_pull:joint=2,turn_rad_per_m=1e-4"])
    assert typed == HosePull(2, values=(1e-4,)) == cause_of("hose_pull:2,turn_rad_per_m=1e-4", ErrorModel(sino6))


@dataclass(frozen=True)
class Coupled(Effect):
    """A joint that turns with the angle of the one before it, and is not said to be elastic."""

    joint: int
    cause: ClassVar[str] = "coupled"

    @property
    def terms(self) -> tuple[Term, ...]:
        return (Term("", "1", 1e-4, "gain"),)

    def displacements(self, state: State) -> list[Displacement]:
        return [about_axis(state, self.joint, np.sin(state.angle(self.joint - 1) * state.angle(self.joint))[:, None])]


def test_a_cause_of_two_angles_is_not_drawn_over_one(sino6: Arm) -> None:
    register(Coupled)
    model = ErrorModel(sino6, (Coupled(4, values=(3e-4,)),))
    data = simulate_measurements(model, "free", 200, rng=np.random.default_rng(2))
    found = diagnose(sino6, data, encoder_noise=NOISE, extra_causes=[Coupled(4)], hold_out=False)
    assert [f.label for f in found.findings] == ["coupled:4"]
    shown = partial_residual(found, found.findings[0].effect)
    assert shown.x_label == "load [1]"
    angle = data.q[:, 3] * data.q[:, 2]
    np.testing.assert_allclose(np.sort(shown.x), np.sort(np.sin(angle)), atol=1e-9)


def test_another_order_of_a_known_cause_is_one_more_variant(sino6: Arm) -> None:
    """Order 77 is beyond those that are tried anyway."""
    model = ErrorModel(sino6, (JointPeriodicError(2, 77.0, values=(1e-4, 0.0)),))
    data = simulate_measurements(model, "free", 200, rng=np.random.default_rng(3))
    without = diagnose(sino6, data, encoder_noise=NOISE, hold_out=False)
    assert "joint_periodic_error:2" not in {f.label for f in without.findings}
    found = diagnose(sino6, data, encoder_noise=NOISE, extra_causes=[JointPeriodicError(2, 77.0)], hold_out=False)
    assert [(f.label, f.effect.order) for f in found.findings] == [("joint_periodic_error:2", 77.0)]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("extra", "error", "said"),
    [
        (HosePull(9), AacmmError, "SINO6 has rows 1 to 6"),
        (Coupled(4), UnknownNameError, "aacmm_pin.effects.register"),
        (JointCompliance(2, torque="measured"), MissingConditionError, "torque1_nm"),
    ],
)
def test_what_cannot_be_tried_is_refused(
    sino6: Arm, hidden: Measurements, extra: Effect, error: type[AacmmError], said: str
) -> None:
    with pytest.raises(error, match=said):
        diagnose(sino6, hidden, encoder_noise=NOISE, extra_causes=[extra], hold_out=False)


def test_what_the_arm_is_known_to_have_is_no_candidate(sino6: Arm, hidden: Measurements) -> None:
    known = ErrorModel(sino6, (HosePull(2, values=(2e-4,), u=(1e-5,)),))
    found = diagnose(known, hidden, encoder_noise=NOISE, extra_causes=[HosePull(2)], hold_out=False)
    assert found.verdict == "no-discrepancy"


def test_names_that_are_of_no_use_are_refused() -> None:
    @dataclass(frozen=True)
    class Nameless(LinkLength):
        cause: ClassVar[str] = "Link Length!"

    @dataclass(frozen=True)
    class Taken(LinkLength):
        cause: ClassVar[str] = "encoder_gain"

    with pytest.raises(AacmmError, match="small letters"):
        register(Nameless)
    with pytest.raises(
        AacmmError, match=r"the cause encoder_gain is there already, aacmm_pin\.effects\.encoder\.EncoderGain"
    ):
        register(Taken)
    assert CAUSES["encoder_gain"] is EncoderGain


def test_a_class_defined_anew_takes_its_own_place() -> None:
    old = CAUSES["hose_pull"]
    new = register(dataclass(frozen=True)(type("HosePull", (HosePull,), {"__module__": __name__, "cause": "hose_pull"})))
    assert CAUSES["hose_pull"] is new is not old
    register(HosePull)
