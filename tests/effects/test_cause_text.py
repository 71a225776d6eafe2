"""Causes as they are typed, and as people read them."""

from __future__ import annotations

import pytest

from aacmm_pin import ErrorModel
from aacmm_pin.effects import (
    CAUSES,
    BaseCompliance,
    BearingTilt,
    Effect,
    EncoderEccentricity,
    EncoderGain,
    EncoderSlip,
    JointCompliance,
    JointErrorCurve,
    JointPeriodicError,
    LinkLength,
    SeatError,
    StylusOffset,
    ThermalExpansion,
    all_candidates,
    cause_of,
    example,
)
from aacmm_pin.effects.labels import (
    cause_in_words,
    in_words,
    name_in_words,
    several_in_words,
    values_in_words,
)
from aacmm_pin.effects.text import text_of
from aacmm_pin.errors import AacmmError, UnknownNameError

pytestmark = pytest.mark.fast

KNOWN = EncoderEccentricity(joint=3, values=(1e-4, 2e-5), u=(1e-6, 1e-6))
TYPED: dict[str, Effect] = {
    "encoder_eccentricity:4,amplitude_rad=1e-4": EncoderEccentricity(4, values=(1e-4, 0.0)),
    "encoder_eccentricity:joint=3": KNOWN,
    "encoder_eccentricity:4": EncoderEccentricity(4),
    "encoder_eccentricity:3,amplitude_rad=5e-5": EncoderEccentricity(3, values=(5e-5, 0.0)),
    "joint_periodic_error:6,order=7.5,amplitude_rad=2e-5": JointPeriodicError(
        6, 7.5, values=(2e-5, 0.0)
    ),
    "seat_error:seat=S3,x_mm=0.02": SeatError("S3", values=(2e-5, 0.0, 0.0)),
    "seat_error:3": SeatError("3"),
    "thermal_expansion,expansion_per_k=2e-5": ThermalExpansion(values=(2e-5,)),
    "thermal_expansion:expansion_per_k=2e-5": ThermalExpansion(values=(2e-5,)),
    "thermal_expansion:link=3": ThermalExpansion(3),
    "joint_compliance:4": JointCompliance(4, torque="measured"),
    "joint_compliance:joint=4,torque=gravity,bodies=4+5+6": JointCompliance(4, bodies=(4, 5, 6)),
    "joint_error_curve:2,lower_rad=-4,upper_rad=1,coefficients=4,c2_rad=1e-3": JointErrorCurve(
        2, -4.0, 1.0, 4, values=(0.0, 1e-3, 0.0, 0.0)
    ),
}
REFUSED = {
    "gremlin:3": "unknown cause 'gremlin'",
    "encoder_gain:2,gian=1": "'gian' of encoder_gain",
    "encoder_gain:gain=1e-4": "joint is missing",
    "encoder_gain:two": "joint is 'two'",
    "encoder_gain:2,gain=much": "gain is 'much'",
    "encoder_gain:2,gain": "'gain' has no value",
    "encoder_gain:2,joint=3": "joint occurs twice",
    "encoder_slip:2,step_rad=5lightyears,time_s=1": "a number, such as 8urad",
    "base_compliance:3": "'3' has no value",
}


def test_texts_are_read(sino6):
    model = ErrorModel(sino6, (KNOWN,))
    for text, effect in TYPED.items():
        assert cause_of(text, model, ("torque",)) == effect, text
    for angle, radians in {
        "1.65arcsec": 7.99943e-6,
        "0.5mdeg": 8.72665e-6,
        "8e-6": 8e-6,
        "2 µrad": 2e-6,
    }.items():
        assert cause_of(f"encoder_slip:1,time_s=60,step_rad={angle}", model).values[
            0
        ] == pytest.approx(radians, rel=1e-5)
    curve = cause_of("joint_error_curve:2", model)
    assert isinstance(curve, JointErrorCurve)
    np_low, np_high = sino6.limits[1]
    assert curve.lower_rad < np_low + 0.02
    assert curve.upper_rad > np_high - 0.02
    for effect in (BaseCompliance(values=(4.138e-6,)), KNOWN, JointPeriodicError(6, 7.0)):
        again = cause_of(text_of(effect), ErrorModel(sino6))
        assert again.identity == effect.identity
        assert again.file_values() == pytest.approx(effect.file_values(), rel=1e-3)


def test_texts_of_no_use_are_refused(sino6):
    for text, said in REFUSED.items():
        with pytest.raises(AacmmError, match=said):
            cause_of(text, ErrorModel(sino6))
    with pytest.raises(UnknownNameError) as caught:
        cause_of("encoder_gain:2,gian=1", ErrorModel(sino6))
    assert caught.value.known == ["joint", "gain"]


def test_a_stated_value_has_the_sign_that_nature_has(sino6):
    with pytest.raises(AacmmError, match=r"compliance_rad_per_nm is -1e-05; expected 0 or more"):
        cause_of("bearing_tilt:2,compliance_rad_per_nm=-1e-5", ErrorModel(sino6))
    estimated = BearingTilt(2, values=(-1e-7,), u=(1e-6,))
    assert cause_of("bearing_tilt:2", ErrorModel(sino6, (estimated,))) == estimated
    assert cause_of("encoder_gain:2,gain=-1e-5", ErrorModel(sino6)).values == (-1e-5,)


def test_every_cause_has_words_places_and_units(sino6):
    for cause in CAUSES.values():
        effect = example(cause)
        assert isinstance(effect, cause)
        assert cause_in_words(cause) in name_in_words(effect)
        assert set(effect.readings()) == set(effect.file_values())
        for term in effect.terms:
            assert 0.999 <= term.typical / term.scale * term.reading.factor < 1000, term
    tried = [variants[0] for variants in all_candidates(sino6)]
    assert len({effect.label for effect in tried}) == len(tried)


def test_inner_values_are_in_the_words():
    assert "31.57" in in_words(JointPeriodicError(5, 31.57))
    assert "50.0 min" in in_words(EncoderSlip(1, 3000.0))


def test_causes_of_several_joints_are_named_together():
    curves = [JointErrorCurve(joint, 0.0, 1.0, 8) for joint in (2, 1, 4)]
    several = several_in_words([*curves, EncoderEccentricity(3)])
    assert several == "error curve of joints 1, 2 and 4 and encoder eccentricity of joint 3"


def test_values_have_two_digits_of_their_uncertainty():
    wave, curve = EncoderEccentricity(1), JointErrorCurve(1, 0.0, 1.0, 24)
    for effect, key, value, u, said in (
        (wave, "amplitude_rad", 1.846e-4, 1.8e-6, "amplitude 184.6 ± 3.6 µrad"),
        (wave, "phase_rad", -0.9687, 0.0096, "phase -55.5 ± 1.1°"),
        (wave, "phase_rad", -0.9687, 7.6, "phase not determined"),
        (
            JointCompliance(2),
            "compliance_rad_per_nm",
            1.201e-5,
            1.95e-7,
            "compliance 12.01 ± 0.39 µrad/(N·m)",
        ),
        (LinkLength(1), "a_mm", 1.2345, 0.0765, "a 1230 ± 150 µm"),
        (LinkLength(1), "a_mm", 2.1e-9, 4e-10, "a 0.000002 ± 0.000001 µm"),
        (EncoderGain(1), "gain", 9e-5, 0.0, "gain 90 ppm"),
    ):
        assert values_in_words(effect, {key: (value, u)}) == said
    # Far from the tip: one unit for all.
    target = {"x_mm": (29.7748, 0.01), "y_mm": (0.373, 0.01), "z_mm": (-0.1, 0.1)}
    assert (
        values_in_words(StylusOffset(), target)
        == "x 29.775 ± 0.020 mm, y 0.373 ± 0.020 mm, z below 0.3 mm (95 %)"
    )
    assert "24 values" in values_in_words(curve, {f"c{k}_rad": (0.0, 1e-5) for k in range(1, 25)})
