"""Cards and pictures as a user meets them: whatever a name of the package gives shows itself, and
draws itself.
"""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any
from unittest.mock import patch

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import aacmm_pin
from aacmm_pin import (
    Arm,
    Calibration,
    Conditions,
    Diagnosis,
    ErrorModel,
    calibrate,
    circle_accuracy,
    configuration_circle,
    diagnose,
    map_workspace,
    plan_calibration,
    plan_measurements,
    reaching_postures,
    simulate_measurements,
)
from aacmm_pin._support.display import Shown
from aacmm_pin.accuracy import QUANTITIES, length_uncertainty, usable_postures
from aacmm_pin.effects import CAUSES, EncoderEccentricity, JointCompliance, SeatError
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import PROBED_POINT_COLUMNS
from aacmm_pin.measurements.csv_columns import single_names
from aacmm_pin.report import plots
from aacmm_pin.report.document import document_of
from aacmm_pin.verification import AcceptanceResult, Procedure
from aacmm_pin.verification.acceptance import CharacteristicValue
from aacmm_pin.verification.characteristics import DEFINITIONS
from aacmm_pin.verification.evaluators import Error, Evaluated
from tests.arm_files import changed
from tests.pages import Page

mpl.use("Agg")

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3
READINGS = 8e-6
NASTY = r"<script>alert('1 & 2')</script> $\frac{1$ $x^2$"
"""Markup, and what matplotlib would take for a formula."""


@pytest.fixture(scope="module")
def arm() -> Arm:
    return changed("sino6", name=NASTY)


@pytest.fixture(scope="module")
def hidden() -> tuple[EncoderEccentricity, JointCompliance]:
    return EncoderEccentricity(3, values=(1e-4, 0.0)), JointCompliance(2, values=(2e-5,))


@pytest.fixture(scope="module")
def calibration(arm, hidden) -> Calibration:
    data = simulate_measurements(ErrorModel(arm, hidden), "free", 60, rng=np.random.default_rng(1))
    return calibrate(arm, data, ["geometry", EncoderEccentricity(3)], encoder_noise=READINGS)


@pytest.fixture(scope="module")
def found(arm, hidden) -> Diagnosis:
    """Among few causes; a curve is an alias of each that is hidden."""
    names = ("encoder_eccentricity", "joint_compliance", "joint_error_curve")
    few = {name: CAUSES[name] for name in names}
    data = simulate_measurements(ErrorModel(arm, hidden), "free", 80, rng=np.random.default_rng(1))
    with patch.dict(CAUSES, few, clear=True):
        return diagnose(arm, data, encoder_noise=READINGS)


@pytest.fixture(scope="module")
def values(arm, calibration, found, hidden) -> dict[str, Any]:
    """One of everything that shows itself, of an arm with a nasty name."""
    circle = configuration_circle(arm, POINT, count=24)
    accuracy = circle_accuracy(circle)
    q = circle.q[circle.within_limits]
    plan = plan_measurements(arm, ("bearing_tilt:1", "base_compliance"), 4, postures=60)
    figure = CharacteristicValue(NASTY, DEFINITIONS[0], Evaluated(50, errors=(Error(1e-5),)), 2e-5)
    touches = pd.DataFrame(
        {
            "test": "single-point",
            "feature": NASTY,
            "position": NASTY,
            "repeat": [1, 2],
            "articulation": NASTY,
        },
        columns=[*single_names(PROBED_POINT_COLUMNS), "articulation"],
    )
    return {
        "Arm": arm,
        "Arm of a URDF": Arm.from_urdf("ur5", translation_half_width=5e-5),
        "DHTable": arm.dh,
        "Parameter": arm.parameters[0],
        "Effect": hidden[0],
        "ErrorModel": found.model,
        "Poses": arm.poses(q),
        "Conditions": Conditions(3, temperature=np.array([19.0, 20.0, 22.5])),
        "Measurements": replace(calibration.fit.problem.measurements, source=NASTY),
        "ConfigurationCircle": circle,
        "Flexibility": circle.flexibility(),
        "AccuracyVolume": accuracy,
        "ErrorSources": accuracy.sources,
        "LengthUncertainty": length_uncertainty(
            arm,
            q,
            usable_postures(configuration_circle(arm, POINT[[1, 0, 2]], count=24)),
            at=circle.at,
        ),
        "WorkspaceMap": map_workspace(arm, (3, 3), 4),
        "Check": aacmm_pin.diagnosis.check_measurements(arm, calibration.fit.problem.measurements),
        "Calibration": calibration,
        "HeldOut": calibration.held_out[0],
        "Observability": calibration.observability,
        "Diagnosis": found,
        "Finding": found.findings[0],
        "Alias": found.findings[0].aliases[0],
        "Gain": found.held_out,
        "Unexplained": found.unexplained,
        "OddGroup": aacmm_pin.diagnosis.OddGroup(f"bar {NASTY}", 7, 3.25, 1e-9),
        "MeasurementPlan": plan,
        "Tried": plan.tried[-1],
        "Power": plan.after,
        "AcceptanceResult": AcceptanceResult(NASTY, (figure,), (NASTY,)),
        "CalibrationPlan": plan_calibration(arm, 4, postures=60),
        "Procedure": Procedure(arm, touches, q[:2], arm.positions(q[:2]), 1),
    }


def test_every_class_that_a_user_meets_shows_itself(values):
    classes = [
        c for c in (getattr(aacmm_pin, name) for name in aacmm_pin.__all__) if isinstance(c, type)
    ]
    silent = {c.__name__ for c in classes if not issubclass(c, Shown | Exception)}
    assert silent == set()
    shown = {type(value) for value in values.values()}
    for kind in document_of.registry:
        if kind.__module__.startswith("aacmm_pin."):  # other tests register classes of their own
            assert any(issubclass(one, kind) for one in shown), kind
    assert {
        c for c in Shown.__subclasses__() if document_of.dispatch(c) is document_of.dispatch(object)
    } == set()


def test_a_card_is_well_formed_and_escaped(values):
    for name, value in values.items():
        html = value._repr_html_()
        card = Page(html)
        assert "script" not in {tag for tag, _ in card.tags}, name
        assert "<script" not in html.lower(), name
        assert "nan" not in re.findall(r"[a-z]+", card.text), name
        assert "style" not in {tag for tag, _ in card.tags}, name
        assert "color" not in html, name
    for name in (
        "Arm",
        "ErrorModel",
        "Calibration",
        "Diagnosis",
        "AccuracyVolume",
        "OddGroup",
        "Measurements",
    ):
        assert NASTY in Page(values[name]._repr_html_()).text


def text_of(value: Any) -> str:
    return Page(value._repr_html_()).text


def test_arms_show_their_geometry(values, sino6):
    card, file = text_of(sino6), sino6.file
    for row in file.joints:
        low, high = np.rad2deg(row.limits_rad or ())
        for text in (
            f"{row.a_mm:.5f} ± {row.uncertainty.a_mm:.5f}",
            f"{low:.5g} to {high:.5g}°",
        ):
            assert text in card
        if row.uncertainty.alpha_rad:
            assert (
                f"{np.rad2deg(row.alpha_rad):.5f} ± {np.rad2deg(row.uncertainty.alpha_rad):.5f}"
                in card
            )
    assert file.source in card
    assert "encoder u" not in card
    noisy = text_of(replace(sino6, encoder_noise=np.full(6, 7.5e-6)))
    assert re.search(r"encoder u.* 7\.5 µrad", noisy)
    assert "no uncertainty" in text_of(Arm.load("zero6"))
    ur5 = values["Arm of a URDF"]
    # The shoulder lifts about y.
    for text in (*ur5.model.names[1:], "(0, 1, 0)", "-360 to 360°", "half-widths"):
        assert text in text_of(ur5)


def test_numbers_stand_in_units_that_people_read(values):
    assert "100 ± 20 µrad" in text_of(EncoderEccentricity(3, values=(1e-4, 0.0), u=(1e-5, 1e-5)))
    assert "µm" in text_of(SeatError("S1", values=(1e-5, 0.0, 0.0)))
    accuracy = values["AccuracyVolume"]
    for size in (accuracy.u.min(), np.median(accuracy.u), accuracy.u.max(), 2 * accuracy.u.max()):
        assert f"{size * 1e3:.4f}" in text_of(accuracy)
    assert str(values["Flexibility"]) in text_of(values["Flexibility"])


def test_every_result_can_be_pickled(values, arm):
    """To be sent to another process, or kept: it shows itself as before, and computes as before
    where it can.
    """
    urdf, circle = values["Arm of a URDF"], values["ConfigurationCircle"]
    posture, down = urdf.poses(np.full((1, 6), 0.3)), [0.0, 0.0, -1.0]
    tip = configuration_circle(arm, POINT, axis=down, count=6)
    for value in (
        *values.values(),
        posture,
        tip,
        reaching_postures(urdf, posture.position[0], axis=down, count=6, most_starts=30),
    ):
        copy = pickle.loads(pickle.dumps(value))
        assert str(copy) == str(value) or str(value).startswith(type(value).__name__), type(value)
    assert pickle.loads(pickle.dumps(circle)).flexibility(5) == circle.flexibility(5)
    assert [each.name for each in pickle.loads(pickle.dumps(DEFINITIONS))] == [
        each.name for each in DEFINITIONS
    ]


# Pictures ------------------------------------------------------------


OF_CALIBRATION = (
    plots.plot_residuals_over_joints,
    plots.plot_parameter_changes,
)
OF_DIAGNOSIS = (
    plots.plot_error_budget,
    plots.plot_groups,
    plots.plot_held_out,
)


def drawings(values: dict[str, Any]) -> list[tuple[str, Callable[..., Any]]]:
    calibration, found = values["Calibration"], values["Diagnosis"]
    circle, map_ = values["ConfigurationCircle"], values["WorkspaceMap"]
    accuracy = values["AccuracyVolume"]
    single = [
        ("accuracy", accuracy.plot),
        ("accuracy by joint", lambda ax=None: accuracy.plot("joint", ax=ax)),
        ("map", map_.plot),
        *((q, lambda ax=None, q=q: map_.plot(q, ax)) for q in QUANTITIES),
        ("calibration", calibration.plot),
        *((draw.__name__, partial(draw, calibration)) for draw in OF_CALIBRATION),
        ("diagnosis", found.plot),
        ("second cause", partial(found.plot, 1)),
        *((draw.__name__, partial(draw, found)) for draw in OF_DIAGNOSIS),
    ]
    return [
        *single,
        ("circle", circle.plot),
        ("circle, accuracy", lambda ax=None: circle.plot(accuracy, 3, ax)),
    ]


def test_plot_draws_on_given_axes_and_every_axis_has_a_unit(values):
    for name, draw in drawings(values):
        kind = {"projection": "3d"} if name.startswith("circle") else {}
        ax = Figure(layout="constrained").add_subplot(**kind)
        whole = ax.figure
        axes = draw(ax=ax)
        assert plt.get_fignums() == [], name
        assert axes in (ax, whole), name  # the figure, of several panels in the place of the axes
        whole.canvas.draw()
        for one in whole.axes:  # colour bars too
            check_units(name, one)


def check_units(name: str, ax: Axes) -> None:
    """Every axis of numbers has a label with a unit; names of things need none; panels share that
    of the first.
    """
    labels = {"x": ax.get_xlabel(), "y": ax.get_ylabel()} | (
        {"z": ax.get_zlabel()} if hasattr(ax, "get_zlabel") else {}
    )
    for axis, label in labels.items():
        ticks = [
            tick.get_text() for tick in getattr(ax, f"get_{axis}ticklabels")() if tick.get_text()
        ]
        numbers = [t for t in ticks if re.fullmatch(r"[−-]?[\d.]+", t)]
        if (
            len(numbers) < len(ticks)
            or not ticks
            or label in ("seat", "point", "held-out block of joint space")
        ):
            continue
        assert re.search(r"\[.+\]", label), (name, axis, label, ticks)


def test_the_main_picture_of_a_diagnosis_is_its_strongest_cause(found, values):
    assert "compliance under gravity of joint 2" in found.plot().get_title()
    assert "encoder eccentricity of joint 3" in found.plot(1).get_title()
    nothing = replace(found, findings=())
    assert nothing.plot().get_xlabel() == "RMS displacement of the tip [mm]"
    with pytest.raises(AacmmError, match="finding is 2; expected a number from 0 below 2"):
        found.plot(2)
    with pytest.raises(
        UnknownNameError, match="unknown quantity 'u'; expected one of working_sectors"
    ):
        values["WorkspaceMap"].plot("u")


# Names in the place of
# arms ------------------------------------------------------------


def test_mix_ups_are_answered_with_what_to_do(sino6, calibration):
    data = calibration.fit.problem.measurements
    calls = [
        lambda model: diagnose(model, data),
        lambda model: calibrate(model, data),
        lambda model: configuration_circle(model, POINT),
    ]
    mistakes = [("sino", "unknown arm 'sino'"), (3, "type int; expected an Arm")]
    for call in calls:
        for wrong, words in mistakes:
            with pytest.raises(AacmmError, match=words):
                call(wrong)
    with pytest.raises(AacmmError, match="type ErrorModel; expected an Arm"):
        configuration_circle(ErrorModel(sino6), POINT)
    for function in (diagnose, calibrate):
        with pytest.raises(AacmmError, match="type int; expected Measurements"):
            function(sino6, 3)
        with pytest.raises(AacmmError, match=r"no_such\.csv"):
            function(sino6, "no_such.csv")
