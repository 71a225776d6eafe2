"""The counting of the study of blind files, on rows that are made up: what a right answer is, rates, intervals, files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from blind.study import __main__ as command
from blind.study import sources
from blind.study.experiments import EXPERIMENTS
from blind.study.outcomes import count, covariate, figures, outcome, rate, table
from blind.study.results import Results

Row = dict[str, Any]


def fault(key: str, aliases: tuple[str, ...] = (), **parameters: Any) -> Row:
    cause, _, at = key.partition(":")
    hidden: Row = {"cause": cause, "joint": int(at) if at.isdigit() else None, "key": key, "parameters": parameters}
    return hidden | {"size_um": 50.0, "depends_on": [], "lambda": 100.0, "aliases": dict.fromkeys(aliases, 0.97)}


def finding(key: str, probability: float = 0.9, parameters: Any = ()) -> Row:
    cause, _, at = key.partition(":")
    place = {"seat": at} if cause == "seat_error" else {"joint": int(at) if at else None}
    return {"cause": cause, **place, "probability": probability, "parameters": dict(parameters)}


def row(said: tuple[Any, ...] = (), hidden: tuple[Row, ...] = (), verdict: str = "", **more: Any) -> Row:
    """Findings by key or as they are; the verdict is ``explained`` where there are any."""
    findings = [finding(f) if isinstance(f, str) else f for f in said]
    answer = {"verdict": verdict or ("explained" if said else "no-discrepancy"), "findings": findings}
    truth = {"hidden": list(hidden), "outliers": [], "probabilities": None}
    made = {"experiment": "made-up", "seed": 1, "arguments": {"seed": 1, "records": 50}, "error": None, "fresh": None}
    return made | {"seconds": 2.0, "said": answer, "truth": truth} | more


TILT = fault("bearing_tilt:1", ("base_compliance", "joint_error_curve:1"))
GAIN = fault("encoder_gain:3")
SEAT = fault("seat_error:P5", seat="P5")


# --- one run


@pytest.mark.parametrize(
    ("said", "hidden", "strict", "alike", "all_named", "wrong"),
    [
        (("bearing_tilt:1",), (TILT,), True, True, True, False),
        (("encoder_gain:3", "bearing_tilt:1"), (TILT,), True, True, True, True),
        (("base_compliance",), (TILT,), False, True, False, False),
        (("bearing_tilt:3",), (TILT,), False, False, False, True),
        (("joint_error_curve:1",), (TILT,), False, False, False, True),  # alike, and yet no better name
        ((), (TILT,), False, False, False, None),
        (("seat_error:P5",), (SEAT,), True, True, True, False),
        (("seat_error:P4",), (SEAT,), False, False, False, True),
        (("encoder_gain:3", "bearing_tilt:1"), (TILT, GAIN), True, True, True, False),
        (("encoder_gain:3",), (TILT, GAIN), True, True, False, False),
    ],
)
def test_what_is_right_of_hidden_causes(
    said: tuple[str, ...], hidden: tuple[Row, ...], strict: bool, alike: bool, all_named: bool, wrong: bool | None
) -> None:
    found = outcome(row(said, hidden))
    assert [found[name] for name in ("strict", "alike", "all", "wrong")] == [strict, alike, all_named, wrong]
    assert found["right"] == alike
    assert found["named"] is found["covariate"] is None
    for verdict in ("ambiguous", "inconclusive"):
        assert outcome(row(said, hidden, verdict))["wrong"] is None


def test_nothing_hidden_wants_silence() -> None:
    def told(*said: str, verdict: str = "") -> tuple[bool, bool]:
        found = outcome(row(said, verdict=verdict))
        assert found["true"] == "none"
        return found["named"], found["right"]

    assert told() == (False, True)
    assert told("encoder_gain:2") == (True, False)
    assert told("encoder_gain:2", verdict="inconclusive") == (False, False)
    assert told(verdict="unexplained") == (False, False)
    broken = outcome(row() | {"said": None, "error": "diagnose: exit status 1"})
    assert not broken["right"]
    assert broken["verdict"] == "error"


def test_outside_the_library_the_covariate_counts() -> None:
    hidden = fault("unexplained", kind="joint_product") | {"depends_on": ["theta2_deg", "theta4_deg"]}
    for verdict, told, right in [
        ("unexplained", ["Joint 4"], True),
        ("unexplained", ["time_s", "joint 2"], True),
        ("unexplained", ["joint 3"], False),
        ("unexplained", [], False),
        ("explained", ["joint 4"], False),
    ]:
        made = row((), (hidden,), verdict)
        made["said"]["unexplained"] = {"depends_on": told}
        found = outcome(made)
        assert found["covariate"] == found["right"] == right
        assert found["alike"] is None
    assert [covariate(n) for n in ("z_mm", "tip position", "humidity_pct", "session")] == [
        "tip",
        "tip",
        "humidity",
        "session",
    ]


def test_excluded_rows_are_those_of_the_file() -> None:
    made = row()
    made["truth"]["outliers"] = [0, 7]
    made["said"]["records"] = {"excluded": [{"row": 2}, {"row": 8}]}
    found = outcome(made)
    assert (found["outliers"], found["outliers_found"], found["good_excluded"]) == (2, 1, 1)


def test_the_likeliest_of_the_oracle() -> None:
    def asked(hidden: tuple[Row, ...], **probabilities: float) -> bool | None:
        made = row(hidden=hidden)
        made["truth"]["probabilities"] = probabilities or None
        return outcome(made)["oracle"]

    base = (fault("base_compliance"),)
    assert asked(base, base_compliance=0.6, none=0.4) is True
    assert asked(base, base_compliance=0.4, none=0.6) is False
    assert asked((), base_compliance=0.4, none=0.6) is True
    assert asked(base, none=1.0) is None  # a cause that the oracle does not know
    assert asked(base) is None


# --- counts


def counted(*rows: Row) -> Row:
    return figures(pd.DataFrame([outcome(r) for r in rows]))


def test_wilson_intervals() -> None:
    """Brown, Cai, DasGupta 2001: 10 of 10 leaves 0.7225."""
    r = rate(pd.Series([True] * 10 + [None] * 3))
    assert (r["k"], r["n"], r["share"], r["high"]) == (10, 10, 1.0, 1.0)
    assert r["low"] == pytest.approx(0.7225, abs=1e-4)
    assert rate(pd.Series(dtype=bool))["share"] is None


def test_wrong_names_are_counted_where_the_verdict_is_sure() -> None:
    rows = [row(("encoder_slip:3",), (GAIN,)), row(("encoder_gain:3",), (GAIN,)), row(("encoder_slip:1",))]
    found = counted(*rows, row(verdict="inconclusive"))
    assert (found["sure and wrong"]["k"], found["sure and wrong"]["n"]) == (2, 3)
    assert (found["named where nothing is hidden"]["k"], found["named where nothing is hidden"]["n"]) == (1, 2)
    assert (found["hidden cause named"]["k"], found["hidden cause named"]["n"]) == (1, 2)
    assert found["stated minus true"]["mean"] == pytest.approx(0.9 - 1 / 3)


def test_probabilities_are_compared_with_what_came_true() -> None:
    """80 % said of ten statements of which eight are true: nothing to blame; 99 % said of the same: 0.19 too much."""
    for stated in (0.8, 0.99):
        named = [finding("bearing_tilt:1" if i < 8 else "encoder_gain:1", stated) for i in range(10)]
        found = counted(*(row((f,), (TILT,)) for f in named))["stated minus true"]
        off = np.array([stated - (i < 8) for i in range(10)])
        assert found == {"n": 10, "mean": pytest.approx(off.mean()), "u": pytest.approx(off.std(ddof=1) / 10**0.5)}


def test_intervals_hold_or_miss_the_truth() -> None:
    hidden = (fault("encoder_eccentricity:3", amplitude_rad=1e-4, phase_rad=3.1),)
    stated = {
        "amplitude_rad": {"value": 1.3e-4, "u": 1e-5},  # 3 u off
        "phase_rad": {"value": -3.1, "u": 0.1},  # 0.08 rad off, round the turn
        "beside": {"value": 1.0, "u": 0.1},
    }
    found = counted(row((finding("encoder_eccentricity:3", parameters=stated),), hidden))["within ± 1.96 u"]
    assert (found["k"], found["n"]) == (1, 2)
    assert not counted(row((finding("encoder_eccentricity:4", parameters=stated),), hidden))["within ± 1.96 u"]["n"]


def test_gains_stated_and_fresh() -> None:
    def run(stated: float, fresh: float) -> Row:
        made = row(("bearing_tilt:1",), (TILT,), fresh={"gain": fresh})
        made["said"]["held_out"] = {"gain": stated, "gain_ci95": [stated - 0.1, stated + 0.1]}
        return made

    found = counted(run(0.8, 0.78), run(0.8, 0.72), run(0.6, 0.1), row())
    assert found["stated minus fresh gain"]["n"] == 3
    assert found["stated minus fresh gain"]["mean"] == pytest.approx(0.2)
    assert (found["fresh gain in stated interval"]["k"], found["fresh gain in stated interval"]["n"]) == (2, 3)


def test_the_table_is_by_experiment_and_number_of_records() -> None:
    rows = [row(("bearing_tilt:1",), (TILT,)), row(), row(experiment="other")]
    rows.append(row(experiment="other", arguments={"records": 400}))
    found, _ = count(rows)
    assert [(f["experiment"], f["records"], f["files"]) for f in found] == [
        ("made-up", "50", 2),
        ("other", "20 to 60", 1),
        ("other", "301 to 3000", 1),
        ("other", "all", 2),
    ]
    head, _, first, *_ = table(found).splitlines()
    assert "| 1/1 (0.21 to 1.00) |" in first
    assert "covariate" not in head  # nothing to say there


# --- files


def test_a_study_is_taken_up_where_it_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    first = Results(path)
    first.add(row() | {"seed": 1})
    with path.open("a") as file:
        file.write('{"experiment": "made-up", "se')
    again = Results(path)
    assert again.has(("made-up", 1), fresh=False)
    assert not again.has(("made-up", 1), fresh=True)
    assert not again.has(("made-up", 2), fresh=False)
    again.add(row() | {"seed": 3, "error": "broke"})
    assert again.has(("made-up", 3), fresh=True)
    assert not again.has(("made-up", 3), fresh=True, retry=True)
    again.add(row() | {"seed": 1, "seconds": 5.0})
    assert {key: r["seconds"] for key, r in Results(path).rows.items()} == {("made-up", 1): 5.0, ("made-up", 3): 2.0}


def test_the_command_counts_what_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs that are in the file already, and so are not made."""
    experiment = next(e for e in EXPERIMENTS if e.name == "single-free")
    results = Results(tmp_path / "runs.jsonl")
    for number, said in enumerate(("bearing_tilt:1", "encoder_gain:5")):
        made = row((said,), (TILT,), experiment="single-free", version="0", sources=sources.digest())
        results.add(made | {"seed": 10000 + number, "arguments": experiment.arguments(number)})
    assert command.main(["--only", "single-free", "--count", "2", "-o", str(tmp_path)]) == 0
    assert "1/2 (0.09 to 0.91)" in capsys.readouterr().out
    assert pd.read_csv(tmp_path / "wrong.csv")["said"].tolist() == ["encoder_gain:5"]
    found = json.loads((tmp_path / "study.json").read_text())
    assert found["figures"][0]["hidden cause named"]["k"] == 1


def test_experiments_have_their_own_names_and_fixed_seeds() -> None:
    by_name = {e.name: e for e in EXPERIMENTS}
    assert len(by_name) == len(EXPERIMENTS)
    assert by_name["single-free"].arguments(3) == {"seed": 10003, "cause": "any"}
    assert by_name["twins"].arguments(3) == {"seed": 10003, "cause": "any", "twin": True}
    assert by_name["outside-seats"].arguments(1)["cause"] != by_name["outside-seats"].arguments(2)["cause"]
    assert by_name["single-seats"].options[-2:] == ["--probe-noise-mm", "0.012"]
    assert by_name["single-free"].options == ["--encoder-noise-rad", "8e-06", "--reference-noise-mm", "0.012"]
    assert by_name["external"].options[-1] == "external"
