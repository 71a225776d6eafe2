"""plan as a user meets it: the file to be filled in, what is said, exit statuses, and the way back
through diagnose.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from shell import NOISE, done, found, refused, run

from aacmm_pin._support.display import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.effects import (
    Displacement,
    Effect,
    ErrorModel,
    JointCompliance,
    State,
    Term,
    about_axis,
    register,
)
from aacmm_pin.measurements import Measurements
from tests.few_causes import FEW
from tests.pages import Page

PAIR = "--causes joint_compliance:2 encoder_eccentricity:2"
SMALL = "--records 20 --postures 100"
STATED = f"{NOISE} --u-reference-mm 0.012"
QUICK = f"{SMALL} {STATED}"


def filled_in(path: Path, true: ErrorModel, seed: int = 1) -> None:
    """The plan carried out by an arm with errors, its references filled in."""
    rng = np.random.default_rng(seed)
    table = pd.read_csv(path)
    q = Measurements.read(path).q
    tips = true.predict(q - 8e-6 * rng.standard_normal(q.shape)) + 1.2e-5 * rng.standard_normal(
        (len(q), 3)
    )
    table[["x_mm", "y_mm", "z_mm"]] = tips / MM
    table.to_csv(path, index=False)


@FEW
def test_a_plan_is_filled_in_appended_and_diagnosed(tmp_path, sino6):
    old, plan, both = (tmp_path / name for name in ("old.csv", "plan.csv", "both.csv"))
    effect = "joint_compliance:joint=2,compliance_rad_per_nm=1e-5"
    done(f"simulate sino6 --scheme free --records 40 --cause {effect} {NOISE} -o {old}")
    pd.read_csv(old).assign(session="monday").to_csv(old, index=False)
    out, _ = done(f"plan distinguish sino6 {PAIR} {QUICK} --records 40 --existing {old} -o {plan}")
    assert "existing records are enough" in out
    assert not Measurements.read(plan, 6).known.any()
    filled_in(plan, ErrorModel(sino6, (JointCompliance(2, values=(1e-5,)),)))
    before, new = pd.read_csv(old), pd.read_csv(plan)
    # The new records can be appended to the old ones.
    assert list(new.columns) == list(before.columns)
    assert (new["u_x_mm"] == 0.012).all()
    assert new["session"].isna().all()
    both.write_text(old.read_text() + "".join(plan.read_text().splitlines(keepends=True)[1:]))
    assert Measurements.read(both, 6).known.all()
    first = found(f"diagnose sino6 {both} {STATED} --no-cross-validation")["findings"][0]
    assert (first["cause"], first["joint"]) == ("joint_compliance", 2)
    out, _ = done(f"plan distinguish sino6 {PAIR} {QUICK} --existing {both} -o {plan} --force")
    assert "existing records are enough" in out


def test_a_condition_that_nobody_set_is_to_be_measured(tmp_path):
    """A cause of one's own needs it; beside existing records it is as in the last of them."""

    @register
    @dataclass(frozen=True)
    class Leaning(Effect):
        """A joint that turns with the mount."""

        joint: int
        cause = "leaning"
        needs = ("tilt_x",)
        terms = (Term("", "rad", 1e-4, "turn_rad"),)

        def displacements(self, state: State) -> list[Displacement]:
            tilt = state.conditions.require("tilt_x", self.label)
            return [about_axis(state, self.joint, np.cos(state.q[:, 1] + tilt)[:, None])]

    old, plan = tmp_path / "old.csv", tmp_path / "plan.csv"
    words = "plan distinguish sino6 --causes leaning:3 encoder_gain:3 --records 10 --postures 50"
    words += f" {STATED} -o {plan}"
    out, _ = done(words)
    assert "Fill in x_mm, y_mm, z_mm, tilt_x_deg in" in out
    assert pd.read_csv(plan)["tilt_x_deg"].isna().all()
    done(f"simulate sino6 --scheme free --records 20 {NOISE} -o {old}")
    pd.read_csv(old).assign(tilt_x_deg=np.linspace(0.0, 5.0, 20)).to_csv(old, index=False)
    out, _ = done(words, f"--existing {old} --force")
    assert "tilt_x_deg" not in out
    assert (pd.read_csv(plan)["tilt_x_deg"] == 5.0).all()


def test_another_mount_comes_as_an_arm_file(tmp_path, sino6):
    plan, arm = tmp_path / "plan.csv", tmp_path / "turned.toml"
    words = f"plan distinguish sino6 --causes bearing_tilt:1 base_compliance {QUICK} -o {plan}"
    out, err = done(words)
    assert "rotate the mount by 90°" in out
    assert str(Note("causes_inseparable")) in " ".join(out.split())
    assert "--arm-out" in err
    refused(words, said=["--force"])
    done(words, f"--arm-out {arm} --force")
    turned = ErrorModel.load(arm).arm
    assert abs(turned.gravity @ sino6.gravity) < 1e-9
    np.testing.assert_array_equal(turned.require_dh("").a, sino6.require_dh("").a)


def test_json_is_alone_on_stdout_and_the_seed_is_in_it(tmp_path):
    again, words = tmp_path / "plan.csv", f"plan distinguish sino6 {PAIR} {SMALL} --seed 7"
    content = found(words)
    assert (content["schema"], content["seed"], content["records"]) == ("aacmm-pin/plan/1", 7, 20)
    assert content["power"]["decided"] is True
    assert len(content["expected_mm"]) == 20
    _, err = done(words, f"-o {again}")
    assert "--encoder-noise" in err
    assert done(words)[0] == again.read_text()


def test_existing_seats_are_used_again_and_new_ones_are_left_to_be_measured(tmp_path):
    data, plan = tmp_path / "data.csv", tmp_path / "plan.csv"
    done(f"simulate sino6 --scheme seats --records 40 --seats 5 -o {data}")
    content = found(
        f"plan distinguish sino6 {PAIR} {QUICK} --existing {data}", "--scheme seats -o", plan
    )
    assert content["existing"] == 40
    assert min(content["power"]["before"]["T"]) < min(content["power"]["after"]["T"])
    old, new = Measurements.read(data, 6), Measurements.read(plan, 6)
    assert set(new.seats()) <= set(old.seats())
    both = pd.concat([pd.read_csv(data), pd.read_csv(plan)], ignore_index=True)
    assert Measurements.from_frame(both, 6).n == 60
    done(f"plan distinguish sino6 {PAIR} {QUICK} --scheme seats -o {plan} --force")
    table = pd.read_csv(plan)
    assert table["x_mm"].isna().all()
    assert set(table["seat"]) <= {f"P{k}" for k in range(1, 9)}


def test_one_cause_does_not_take_the_next_option():
    status, _, err = run("plan distinguish sino6 --causes encoder_gain:3 -o plan.csv")
    assert status == 2
    assert "--causes" in err
    assert "two causes" in err


def test_everything_at_once(tmp_path):
    sheet = tmp_path / "sheet.html"
    out, err = done(f"plan distinguish sino6 {QUICK} -o {tmp_path / 'plan.csv'} --sheet {sheet}")
    assert "20 records to distinguish all causes" in out
    assert " T " in out
    (pair,) = (line for line in err.splitlines() if "bearing_tilt:1 from base_compliance" in line)
    assert "rotate the mount" in pair
    assert {"temperature_c", "approach1"} <= set(pd.read_csv(tmp_path / "plan.csv").columns)
    page = Page(sheet.read_text(encoding="utf-8"))
    assert page.downloads()["plan.csv"].decode() == (tmp_path / "plan.csv").read_text()
    assert [head in page.text for head in ("temperature [°C]", "last motion", "posture")] == [
        True
    ] * 3
    assert " -0 " not in page.text
    q = Measurements.read(tmp_path / "plan.csv", 6).q
    lowest = -Arm.load("sino6").positions(q)[:, 2].min() / MM
    assert f"tip is {lowest:.0f} mm below the base" in err
