"""Hidden effects of a plant that shares no code with the package, found through the command
line.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from blind import Draw, draw

from tests.again import again
from tests.cli import shell
from tests.few_causes import FEW

NOISE = "--encoder-noise 8e-6 --u-reference-mm 0.012"
LIMIT = 3.3
"""Standard uncertainties by which one of the many parameters here may be off: a chance of 1
in 1000.
"""


def diagnosis(
    folder: Path, words: str = "", *, seed: int, cause: str | None, **options: Any
) -> tuple[dict[str, Any], Draw]:
    """What the command says of a file of the plant, and what was drawn."""
    hidden = draw(seed, cause, **{"records": 120, **options})
    data = folder / "data.csv"
    hidden.write(data)
    at_seats = options.get("plan", "free") != "free"
    probe = "--probe-noise-mm 0.012" if at_seats else ""
    return shell.found(f"diagnose sino6 {data} {NOISE} {probe} {words}"), hidden


def named(found: dict[str, Any]) -> list[tuple[str, int | str | None]]:
    return [(f["cause"], f.get("seat", f["joint"])) for f in found["findings"]]


def off(found: dict[str, Any], hidden: Draw) -> dict[str, float]:
    """How many u each parameter of the strongest finding is from the truth, for those that the
    truth states too.
    """
    away = {}
    for name, stated in found["findings"][0]["parameters"].items():
        if name in hidden.hidden[0].parameters:
            error = stated["value"] - hidden.hidden[0].parameters[name]
            error = (error + np.pi) % (2 * np.pi) - np.pi if name == "phase_rad" else error
            away[name] = abs(error) / stated["u"]
    return away


CAUSES = [  # files of the gate in ``tests/blind`` hide the others
    ("encoder_slip", "unknown-seats", 12),
    again("link_bending", "seats", 10),
]


@FEW
@pytest.mark.parametrize(("cause", "plan", "seed"), CAUSES)
def test_a_hidden_cause_is_named_and_measured(tmp_path, cause, plan, seed):
    words = "--no-cross-validation"
    found, drawn = diagnosis(tmp_path, words, seed=seed, cause=cause, plan=plan, records=300)
    (hidden,) = drawn.hidden
    assert named(found) == [(hidden.cause, hidden.joint)]
    assert found["verdict"] in ("explained", "ambiguous")
    assert found["findings"][0]["probability"] > 0.5
    assert max(off(found, drawn).values(), default=0.0) < LIMIT


@FEW
def test_look_alikes_are_said(tmp_path):
    """On a level mount a tilting first bearing and a tilting stand have the same columns: both are
    listed.
    """
    found, _ = diagnosis(tmp_path, "--no-cross-validation", seed=13, cause="base_compliance")
    (finding,) = found["findings"]
    both = {
        (finding["cause"], finding["joint"]),
        *((a["cause"], a["joint"]) for a in finding["aliases"]),
    }
    assert {("base_compliance", None), ("bearing_tilt", 1)} <= both
    assert found["verdict"] == "ambiguous"
    assert any(
        {"base_compliance", "bearing_tilt:1"} <= set(group) for group in found["cannot_tell_apart"]
    )
    assert "aacmm-pin plan" in found["next_measurements"]


OUTSIDE = {
    "joint_product": None,
    "humidity": {"humidity_pct"},
    "operator": {"operator"},
    "frame_walk": {"time"},
    "tip_field": {"x", "y", "z"},
}


@pytest.mark.long
@pytest.mark.parametrize("kind", OUTSIDE)
def test_what_no_cause_explains_is_said_to_be_that(tmp_path, kind):
    found, drawn = diagnosis(tmp_path, seed=2, cause=f"unexplained:{kind}")
    assert found["verdict"] == "unexplained"
    wanted = OUTSIDE[kind] or {
        name.replace("theta", "joint ") for name in drawn.hidden[0].depends_on
    }
    assert wanted <= set(found["unexplained"]["depends_on"])
    assert found["unexplained"]["smooth_correction_gain"] > 0.2
    assert not [f for f in found["findings"] if f["held_out"]["gain_ci95"][0] > 0.0]
    # What is no cause is not in the model, nor in its gain.
    assert abs(found["held_out"]["gain"]) < 0.02


@FEW
@pytest.mark.parametrize(
    ("seed", "options"),
    [
        (15, {"external": True}),
        again(13, {"outliers": 0.1}),
        again(7, {"cause": "encoder_slip", "twin": True}),
    ],
)
def test_nothing_hidden_is_said_to_be_nothing(tmp_path, seed, options):
    options = {"cause": None} | options
    words = "--reference-frame external" if options.get("external") else ""
    found, drawn = diagnosis(tmp_path, f"--no-cross-validation {words}", seed=seed, **options)
    assert found["verdict"] == "no-discrepancy"
    assert found["findings"] == []
    assert {r["row"] - 2 for r in found["records"]["excluded"]} == set(drawn.outliers)


@FEW
def test_geometry_beyond_what_is_stated_is_a_finding(tmp_path):
    """Held-out records have nothing to say of it: recalibration moves the value as well."""
    found, _ = diagnosis(
        tmp_path, seed=60016, cause=None, plan="unknown-seats", shifts={(3, "d"): 9.0}
    )
    assert named(found) == [("joint_distance", 3)]
    assert found["verdict"] == "explained"
    assert "more records" not in found["next_measurements"]


@pytest.mark.long
def test_gross_errors_neither_hide_a_cause_nor_stay(tmp_path):
    """A moved seat looks like thirty gross errors; nine real ones are beside it."""
    found, drawn = diagnosis(
        tmp_path, "--no-cross-validation", seed=3, cause="seat_error", plan="seats", outliers=0.03
    )
    assert named(found) == [("seat_error", drawn.hidden[0].parameters["seat"])]
    assert {r["row"] - 2 for r in found["records"]["excluded"]} == set(drawn.outliers)


@FEW
def test_a_plan_that_nobody_filled_in_is_refused(tmp_path):
    plan = tmp_path / "plan.csv"
    words = "--causes joint_compliance:2 encoder_gain:2 --records 10 --postures 20"
    shell.done(f"plan distinguish sino6 {words} -o {plan}")
    shell.refused(f"diagnose sino6 {plan} {NOISE}")
    words = "--causes joint_compliance:2 encoder_gain:2 --records 30 --postures 100"
    shell.done(f"plan distinguish sino6 {words} --scheme seats -o {plan} --force")
    found = shell.found(f"diagnose sino6 {plan} --encoder-noise 8e-6 --no-cross-validation")
    assert found["doubts"] == ["residuals too small"]


@FEW
def test_the_extended_arm_is_written_and_used(tmp_path):
    extended = tmp_path / "extended.toml"
    words = f"--arm-out {extended}"
    found, drawn = diagnosis(tmp_path, words, seed=3, cause="encoder_eccentricity")
    fresh = tmp_path / "fresh.csv"
    sample = drawn.plant.sample(1, 200)
    sample.write(fresh)
    out = tmp_path / "corrected.csv"
    shell.done(f"correct {extended} {fresh} -o {out}")
    table = pd.read_csv(out)
    tips = table[["corrected_x_mm", "corrected_y_mm", "corrected_z_mm"]].to_numpy()
    rms = float(np.sqrt(np.square(tips - 1e3 * sample.noted).sum(axis=1).mean()))
    assert rms < 1.1 * sample.oracle_rms * 1e3
    # The gain that was quoted is the gain on records that were taken afterwards.
    assert rms == pytest.approx(found["held_out"]["rms_mm"]["extended"], rel=0.1)
    once_more = f"diagnose {extended} {tmp_path / 'data.csv'} {NOISE} --no-cross-validation"
    assert shell.found(once_more)["verdict"] == "no-discrepancy"
