"""A cause that the package does not have: the class of its page, known to every command and
nowhere else.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from typer.testing import CliRunner

from aacmm_pin import (
    Arm,
    Diagnosis,
    ErrorModel,
    Measurements,
    calibrate,
    diagnose,
    plan_measurements,
    simulate_measurements,
)
from aacmm_pin._support.workers import results
from aacmm_pin.cli.plugins import import_plugin
from aacmm_pin.cli.root_command import app
from aacmm_pin.effects import (
    CAUSES,
    Displacement,
    Effect,
    EncoderGain,
    JointCompliance,
    LinkLength,
    State,
    Term,
    about_axis,
    cause_of,
    example,
    register,
)
from aacmm_pin.errors import AacmmError, ArmFileError, MissingConditionError, UnknownNameError
from aacmm_pin.report import plots
from tests.few_causes import WAVES
from tests.oracle import close

NOISE = 8e-6
PAGE = Path(__file__).parents[2] / "notebooks" / "site" / "own_cause.md"
HOSE = re.search(
    r"<!-- file: hose.py "
    r"-->\n```python\n(.*?)```",
    PAGE.read_text(encoding="utf-8"),
    re.DOTALL,
)[1]  # type: ignore[index]
SIZE = 2e-4


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """With the page's file and nothing else."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "hose.py").write_text(HOSE, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def hose(folder) -> Iterator[Any]:
    """The class, as a program has it that imports the file; known as long as this file's
    tests run.
    """
    before = dict(CAUSES)
    yield import_plugin(str(folder / "hose.py")).HosePull
    CAUSES.clear()
    CAUSES.update(before)


@pytest.fixture(scope="module")
def hidden(hose) -> Measurements:
    truth = ErrorModel(Arm.load("sino6"), (hose(2, values=(SIZE,)),))
    return simulate_measurements(truth, "free", 100, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def found(hidden) -> Diagnosis:
    with patch.dict(CAUSES):
        for wave in WAVES:
            del CAUSES[wave]
        return diagnose(Arm.load("sino6"), hidden, encoder_noise=NOISE)


def test_it_is_found_written_read_and_drawn(hose, found, hidden, tmp_path):
    assert [f.label for f in found.findings] == ["hose_pull:2"]
    assert found.verdict == "explained"
    (finding,) = found.findings
    value, u = finding.parameters["turn_rad_per_m"]
    assert abs(value - SIZE) < 3.3 * u
    assert found.held_out is not None
    assert found.held_out.gain > 0.2
    assert found.summary()["findings"][0]["hook_mm"] == [0.0, 0.0, 1000.0]
    assert "µrad/m" in str(finding)

    found.model.save(tmp_path / "extended.toml")
    loaded = ErrorModel.load(tmp_path / "extended.toml")
    assert loaded.effects == found.model.effects
    close(loaded.predict(hidden.q), found.model.predict(hidden.q), 1e-12)
    ax = plots.plot_cause(found, finding)
    assert "hose pull of joint 2" in ax.get_title()
    assert ax.get_xlabel() == "load [m]"
    del CAUSES["hose_pull"]
    with pytest.raises(ArmFileError, match="unknown cause 'hose_pull'"):
        ErrorModel.load(tmp_path / "extended.toml")


def test_it_is_calibrated_planned_and_known(hose, hidden, sino6):
    fitted = calibrate(
        sino6, hidden, ["geometry", hose(2)], encoder_noise=NOISE, hold_out=False
    ).model.effects[-1]
    assert abs(fitted.values[0] - SIZE) < 3.3 * fitted.u[0]
    known = ErrorModel(sino6, (hose(2, values=(SIZE,), u=(1e-5,)),))
    assert diagnose(known, hidden, encoder_noise=NOISE, hold_out=False).verdict == "no-discrepancy"
    assert cause_of("hose_pull:2", known) == known.effects[0]
    plan = plan_measurements(
        sino6, ("hose_pull:2", "encoder_gain:2"), 10, postures=60, progress=False
    )
    assert [effect.label for effect in plan.split] == ["hose_pull:2", "encoder_gain:2"]
    assert plan.after.least > 0
    assert isinstance(example(hose), hose)


def test_worker_processes_know_it(folder):
    hose = import_plugin(str(folder / "hose.py")).HosePull
    with results(repr, [hose(1), hose(2)], 2) as found:
        assert dict(found) == {0: repr(hose(1)), 1: repr(hose(2))}


def refusal(*words: str) -> str:
    """Why a command ends with status 1, in one line behind notes."""
    done = CliRunner().invoke(app, list(words))
    assert isinstance(done.exception, SystemExit), done.exception
    *notes, said = done.stderr.splitlines()
    assert (done.exit_code, done.stdout, {note[:6] for note in notes} - {"note: "}) == (
        1,
        "",
        set(),
    ), done.output
    return said


def test_plugins_that_are_none_and_entry_points(folder, monkeypatch):
    monkeypatch.chdir(folder)
    Path("numpy.py").write_text("")
    Path("fails.py").write_text("\n\n1 / 0")
    for name, said in {
        "not_a_module": "ModuleNotFoundError",
        "numpy.py": "numpy is the name of an installed module",
        "fails.py": "ZeroDivisionError: division by zero (fails.py, line 3)",
    }.items():
        assert f"--plugin {name}: {said}" in refusal("--plugin", name, "causes")
    Path("nothing.py").write_text("print('no result')")
    done = CliRunner().invoke(app, ["--plugin", "nothing.py", "urdf", "sino6"])
    assert done.stdout.startswith("<?xml")
    assert "no result\nnote: --plugin nothing.py registers no cause" in done.stderr
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group: [EntryPoint("hose", "hose", group)]
    )
    monkeypatch.delitem(sys.modules, "hose", raising=False)
    done = CliRunner().invoke(app, ["causes"])
    assert "hose_pull:JOINT" in done.stdout, done.stderr


def test_mistakes_of_a_class_are_told_with_its_name_and_place(hose, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # the file changes within a second
    records, wrong = tmp_path / "data.csv", folder / "wrong.py"
    simulate_measurements(Arm.load("sino6"), "free", 30, rng=np.random.default_rng(1)).save(records)
    tried = ("diagnose", "sino6", str(records))
    given = ("simulate", "sino6", "--records", "20", "--cause", "hose_pull:3,turn_rad_per_m=1e-4")
    moment, last = "moment[:, None]", "return [about_axis(state, self.joint, moment[:, None])]"
    terms = 'terms = (Term("", "rad/m", 1e-4, "turn_rad_per_m"),)'
    for old, new, words, said in (
        (
            moment,
            "np.nan * moment[:, None]",
            given,
            ":3: displacements: numbers that are not finite",
        ),
        (
            last,
            "return [Displacement(99, np.ones((1, 6, 1)))]",
            given,
            ":3: displacements: place is 99",
        ),
        (
            last,
            "return nothing",
            tried,
            ":1: displacements: NameError: name 'nothing' is not defined (wrong.py, line 25)",
        ),
        ("def displacements", "def displacement", ("causes",), ": HosePull lacks displacements"),
        (
            terms,
            f"{terms}\n    needs = 'time'",
            ("causes",),
            ": needs is 'time'; expected a tuple of some of time",
        ),
        (
            terms,
            f"{terms}\n    candidates = lambda *_: None",
            tried,
            ": candidates yields None; expected tuples of one",
        ),
    ):
        assert old in HOSE
        wrong.write_text(HOSE.replace(old, new), encoding="utf-8")
        del CAUSES["hose_pull"]
        assert f"hose_pull{said}" in refusal("--plugin", str(wrong), *words)
        CAUSES["hose_pull"] = hose


def test_what_it_prints_is_no_result(hose, folder):
    speaks = folder / "speaks.py"
    speaks.write_text(
        HOSE.replace("        return [", "        print('here')\n        return ["),
        encoding="utf-8",
    )
    del CAUSES["hose_pull"]
    words = [
        "simulate",
        "sino6",
        "--scheme",
        "free",
        "--records",
        "3",
        "--cause",
        "hose_pull:3,turn_rad_per_m=1e-4",
    ]
    done = CliRunner().invoke(app, ["--plugin", str(speaks), *words])
    CAUSES["hose_pull"] = hose
    assert (done.exit_code, len(done.stdout.splitlines())) == (0, 4), done.output
    assert "here" in done.stderr.splitlines()


@dataclass(frozen=True)
class Coupled(Effect):
    """A joint that turns with the angle of the one before it, and is not said to be elastic."""

    joint: int
    cause = "coupled"
    terms = (Term("", "1", 1e-4, "gain"),)

    def displacements(self, state: State) -> list[Displacement]:
        return [
            about_axis(
                state,
                self.joint,
                np.sin(state.angle(self.joint - 1) * state.angle(self.joint))[:, None],
            )
        ]


def test_candidates_of_a_registered_cause_are_where_it_has_its_angles(sino6):
    """Joint 1 has none before it."""
    register(Coupled)
    assert [variants[0].joint for variants in Coupled.candidates(sino6)] == [2, 3, 4, 5, 6]


def test_what_cannot_be_tried_is_refused(hose, sino6, hidden):
    for extra, error, said in (
        (hose(9), AacmmError, "hose_pull:9: .* 1 to 6"),
        (Coupled(4), UnknownNameError, r"aacmm_pin\.effects\.register"),
        (JointCompliance(2, torque="measured"), MissingConditionError, "torque1_nm"),
    ):
        with pytest.raises(error, match=said):
            diagnose(sino6, hidden, encoder_noise=NOISE, extra_causes=[extra], hold_out=False)


def test_names_that_are_of_no_use_are_refused(hose):
    for name, said in {
        "Link Length!": "lower-case letters",
        "encoder_gain": r""
        r"aacmm_pin\.effects\.encoder\.EncoderGain",
    }.items():
        with pytest.raises(AacmmError, match=said):
            register(
                dataclass(frozen=True)(
                    type("Own", (LinkLength,), {"__module__": __name__, "cause": name})
                )
            )
    assert CAUSES["encoder_gain"] is EncoderGain
    anew = dataclass(frozen=True)(
        type("HosePull", (hose,), {"__module__": "hose", "cause": "hose_pull"})
    )
    assert register(anew) is CAUSES["hose_pull"] is not hose
