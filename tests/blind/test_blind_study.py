"""The counting of the study of blind files, on tables that are made up: what a right answer is, rates, curves, intervals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from blind.study import evaluate as study
from blind.study.experiments import EXPERIMENTS
from blind.study.judge import covariate, intervals, judge, statements
from blind.study.report import report
from blind.study.table import Results

ABOUT = {"date": "today", "command": "made up", "version": ["0"]}


def fault(key: str, aliases: tuple[str, ...] = (), lambda_: float = 100.0, **parameters: Any) -> dict[str, Any]:
    cause, _, at = key.partition(":")
    hidden: dict[str, Any] = {
        "cause": cause,
        "joint": int(at) if at.isdigit() else None,
        "key": key,
        "parameters": parameters,
    }
    hidden |= {"size_um": 50.0, "depends_on": [], "lambda": lambda_, "retained_fraction": 0.5, "columns": 2}
    return hidden | {"aliases": dict.fromkeys(aliases, 0.97)}


def finding(key: str, probability: float = 0.99, aliases: tuple[str, ...] = (), parameters: Any = ()) -> dict[str, Any]:
    cause, _, at = key.partition(":")
    place = {"seat": at} if cause == "seat_error" else {"joint": int(at) if at else None}
    said: dict[str, Any] = {"cause": cause, **place, "probability": probability, "parameters": dict(parameters)}
    return said | {"aliases": [{"correlation": 0.97, **finding(a, 0.01)} for a in aliases]}


def row(
    kind: str = "single",
    hidden: tuple[dict[str, Any], ...] = (),
    findings: tuple[dict[str, Any], ...] = (),
    verdict: str = "",
    depends_on: tuple[str, ...] = (),
    **more: Any,
) -> dict[str, Any]:
    said: dict[str, Any] = {
        "verdict": verdict or ("explained" if findings else "no-discrepancy"),
        "findings": list(findings),
    }
    said |= {"unexplained": {"p_value": 0.5, "depends_on": list(depends_on)}, "records": {"excluded": []}}
    truth: dict[str, Any] = {"hidden": list(hidden), "outliers": [], "probabilities": None}
    plain = {"experiment": kind, "seed": 1, "kind": kind, "arguments": {}, "error": None, "seconds": 2.0, "fresh": None}
    return plain | {"said": said, "truth": truth, "version": "0"} | more


TILT = fault("bearing_tilt:1", ("base_compliance", "joint_error_curve:1"))


# --- one run


@pytest.mark.parametrize(
    ("said", "right", "tolerated", "listed", "alone"),
    [
        (("bearing_tilt:1",), True, True, True, True),
        (("bearing_tilt:1", "encoder_gain:3"), True, True, True, False),
        (("encoder_gain:3", "bearing_tilt:1"), False, False, False, False),
        (("base_compliance",), False, True, False, False),
        (("bearing_tilt:3",), False, False, False, False),
        (("joint_error_curve:1",), False, False, False, False),
        ((), False, False, False, False),
    ],
)
def test_what_is_right_of_one_fault(said: tuple[str, ...], right: bool, tolerated: bool, listed: bool, alone: bool) -> None:
    judged = judge(row(hidden=(TILT,), findings=tuple(map(finding, said))))
    assert [judged[name] for name in ("right", "right_or_alias", "listed", "alone")] == [right, tolerated, listed, alone]
    assert judged["answer"] == right
    assert judged["silent"] == (not said)
    assert judged["false_findings"] == sum(key != "bearing_tilt:1" for key in said)


def test_a_stated_alias_lists_the_truth() -> None:
    judged = judge(row(hidden=(TILT,), findings=(finding("base_compliance", aliases=("bearing_tilt:1",)),)))
    assert judged["listed"]
    assert not judged["right"]


def test_a_seat_is_part_of_the_name() -> None:
    hidden = (fault("seat_error:P5", seat="P5"),)
    assert judge(row(hidden=hidden, findings=(finding("seat_error:P5"),)))["right"]
    assert not judge(row(hidden=hidden, findings=(finding("seat_error:P4"),)))["right"]


def test_pairs_need_both_in_any_order() -> None:
    hidden = (fault("encoder_gain:2"), fault("link_bending:3"))
    both = judge(row("pair", hidden, (finding("link_bending:3"), finding("encoder_gain:2"))))
    assert both["answer"]
    assert not both["right"]
    one = judge(row("pair", hidden, (finding("link_bending:3"), finding("encoder_gain:4"))))
    assert not one["answer"]
    assert one["any_named"]
    assert one["false_findings"] == 1


def test_nothing_hidden_wants_silence() -> None:
    assert judge(row("nothing"))["answer"]
    assert not judge(row("nothing", findings=(finding("encoder_gain:2"),)))["answer"]
    assert not judge(row("nothing", verdict="unexplained"))["answer"]
    assert judge(row("nothing"))["true"] == "none"


@pytest.mark.parametrize(
    ("verdict", "depends_on", "answer"),
    [
        ("unexplained", ("joint 4",), True),
        ("unexplained", ("time", "joint 2"), True),
        ("unexplained", ("joint 3",), False),
        ("unexplained", (), False),
        ("explained", ("joint 4",), False),
    ],
)
def test_outside_the_library_the_covariate_counts(verdict: str, depends_on: tuple[str, ...], answer: bool) -> None:
    hidden = fault("unexplained", kind="joint_product") | {"depends_on": ["theta2", "theta4"]}
    judged = judge(row("outside", (hidden,), verdict=verdict, depends_on=depends_on))
    assert judged["answer"] == answer
    assert not judged["depends_all"]


@pytest.mark.parametrize(
    ("name", "one"),
    [
        ("theta2_deg", "joint 2"),
        ("Joint 2", "joint 2"),
        ("time_s", "time"),
        ("z_mm", "tip"),
        ("tip position", "tip"),
        ("humidity_pct", "humidity"),
        ("session", "session"),
    ],
)
def test_covariates_have_one_name(name: str, one: str) -> None:
    assert covariate(name) == one


def test_a_broken_run_is_a_wrong_answer() -> None:
    judged = judge(row("nothing", said=None, error="diagnose: exit status 1"))
    assert not judged["answer"]
    assert judged["verdict"] == "error"


def test_excluded_rows_are_those_of_the_file() -> None:
    table = row("nothing")
    table["truth"]["outliers"] = [0, 7]
    table["said"]["records"]["excluded"] = [{"row": 2}, {"row": 8}]
    judged = judge(table)
    assert (judged["outliers"], judged["outliers_found"], judged["good_excluded"]) == (2, 1, 1)


def test_the_likeliest_of_the_oracle() -> None:
    def asked(**probabilities: float) -> Any:
        table = row(hidden=(fault("base_compliance"),))
        table["truth"]["probabilities"] = probabilities
        return judge(table)["oracle_right"]

    assert asked(base_compliance=0.6, none=0.4) is True
    assert asked(base_compliance=0.4, none=0.6) is False
    assert asked(none=1.0) is None  # a cause that the oracle does not know
    assert judge(row(hidden=(TILT,)))["oracle_right"] is None


# --- rates and curves


def test_wilson_intervals() -> None:
    """Brown, Cai, DasGupta 2001: 10 of 10 leaves 0.7225."""
    r = study.rate(pd.Series([True] * 10))
    assert (r["k"], r["n"], r["share"], r["high"]) == (10, 10, 1.0, 1.0)
    assert r["low"] == pytest.approx(0.7225, abs=1e-4)
    assert study.rate(pd.Series(dtype=bool))["share"] is None


def test_confusion_keeps_wrong_joints_apart() -> None:
    rows = [row(hidden=(TILT,), findings=(finding(key),)) for key in ("bearing_tilt:1", "bearing_tilt:3", "base_compliance")]
    rows += [row(hidden=(TILT,)), row("nothing"), row(hidden=(TILT,), said=None, error="broke")]
    table = study.confusion(pd.DataFrame(list(map(judge, rows))))
    assert table.loc["bearing_tilt"].to_dict() == {"base_compliance": 1, "bearing_tilt": 1, "none": 1, "other joint": 1}
    assert list(table.index) == ["bearing_tilt"]


def test_the_oracles_power_is_that_of_the_noncentral_chi_square() -> None:
    """λ of 80 % power of a two-sided z test at 1 %: (2.5758 + 0.8416)² = 11.679; q = 1 is that test."""
    assert study.oracle_lambda([1]) == pytest.approx(11.679, abs=2e-3)
    assert study.oracle_power([0.0], [5])[0] == pytest.approx(0.01, abs=1e-6)
    rng = np.random.default_rng(1)
    drawn = ((rng.standard_normal((40000, 3)) + np.array([3.0, 0.0, 0.0])) ** 2).sum(axis=1)
    assert study.oracle_power([9.0], [3])[0] == pytest.approx((drawn > 11.345).mean(), abs=0.01)


def test_the_logistic_fit_finds_the_curve_it_was_drawn_from() -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(np.log(1.0), np.log(400.0), 4000)
    right = rng.uniform(size=4000) < 1.0 / (1.0 + np.exp(-2.0 * (x - np.log(20.0))))
    fit = study.logistic_lambda(np.exp(x), right)
    assert fit["slope"] == pytest.approx(2.0, rel=0.1)
    assert fit["lambda"] == pytest.approx(20.0 * 4.0**0.5, rel=0.1)  # ln 4 / 2 above the middle


@pytest.mark.parametrize("right", [[True] * 20, [False] * 20, [False] * 18 + [True] * 2])
def test_no_curve_where_the_data_hold_none(right: list[bool]) -> None:
    fit = study.logistic_lambda(np.geomspace(1.0, 100.0, 20), right)
    assert fit["lambda"] is None or fit["lambda"] > 50.0


def test_power_counts_by_lambda() -> None:
    rows = [
        row(hidden=(fault("encoder_gain:2", lambda_=x),), findings=(finding("encoder_gain:2"),) if x > 12.0 else ())
        for x in np.geomspace(1.0, 200.0, 60)
    ]
    power = study.power(pd.DataFrame(list(map(judge, rows))))
    shares = [b["right"]["share"] for b in power["bins"]]
    assert shares[:3] == [0.0, 0.0, 0.0]
    assert 0.0 < shares[3] < 1.0  # 10 to 15
    assert set(shares[4:]) == {1.0}
    assert power["at_80"]["right"]["lambda"] == pytest.approx(12.0, rel=0.1)
    assert power["oracle_lambda_at_80"] == pytest.approx(study.oracle_lambda([2]))


def test_probabilities_are_compared_with_what_came_true() -> None:
    """80 % said of ten statements of which eight are true: nothing to blame; 99 % said of the same: 0.19 too much."""
    rows = [
        row(hidden=(TILT,), findings=(finding("bearing_tilt:1" if i < 8 else "encoder_gain:1", 0.8),)) for i in range(10)
    ]
    said = pd.DataFrame([s for r in rows for s in statements(r)])
    found = study.reliability(said)
    assert found["mean_stated_minus_true"] == pytest.approx(0.0)
    assert found["brier"] == pytest.approx(0.16)
    assert [(b["stated"], b["k"], b["n"]) for b in found["bins"]] == [(pytest.approx(0.8), 8, 10)]
    assert study.reliability(said.assign(probability=0.99))["mean_stated_minus_true"] == pytest.approx(0.19)


def test_aliases_are_statements_too() -> None:
    said = statements(row(hidden=(TILT,), findings=(finding("base_compliance", 0.7, aliases=("bearing_tilt:1",)),)))
    assert [(s["what"], s["probability"], s["true"]) for s in said] == [("finding", 0.7, False), ("alias", 0.01, True)]


def test_intervals_hold_or_miss_the_truth() -> None:
    hidden = (fault("encoder_eccentricity:3", amplitude_rad=1e-4, phase_rad=3.1),)
    stated = {
        "amplitude_rad": {"value": 1.3e-4, "u": 1e-5},
        "phase_rad": {"value": -3.1, "u": 0.1},
        "beside": {"value": 1.0, "u": 0.1},
    }
    found = pd.DataFrame(intervals(row(hidden=hidden, findings=(finding("encoder_eccentricity:3", parameters=stated),))))
    z = found.set_index("parameter")["z"]
    assert z["amplitude_rad"] == pytest.approx(3.0)
    assert z["phase_rad"] == pytest.approx((2.0 * np.pi - 6.2) / 0.1)
    cover = study.coverage(found)
    assert (cover["all"]["k"], cover["all"]["n"]) == (1, 2)
    assert cover["without_truth"] == {"encoder_eccentricity.beside": 1}
    assert intervals(row(hidden=hidden, findings=(finding("encoder_eccentricity:4", parameters=stated),))) == []


def test_gains_stated_and_fresh() -> None:
    def run(stated: float, fresh: float) -> dict[str, Any]:
        table = row(hidden=(TILT,), fresh={"gain": fresh, "rms_mm": {"extended": 0.022, "noise": 0.020}})
        table["said"]["held_out"] = {"gain": stated, "gain_ci95": [stated - 0.1, stated + 0.1]}
        return table

    found = study.gains(pd.DataFrame(list(map(judge, [run(0.8, 0.78), run(0.8, 0.72), run(0.6, 0.1), row()]))))
    assert found["n"] == 3
    assert found["mean_stated_minus_fresh"] == pytest.approx(0.2)
    assert found["within_0.05"]["k"] == 1
    assert found["in_stated_interval"]["k"] == 2
    assert found["fresh_rms_over_noise"] == pytest.approx(1.1)


# --- files


def test_a_study_is_taken_up_where_it_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    first = Results(path)
    first.add(row(seed=1))
    with path.open("a") as file:
        file.write('{"experiment": "single", "se')
    again = Results(path)
    assert again.has(("single", 1), fresh=False)
    assert not again.has(("single", 1), fresh=True)
    assert not again.has(("single", 2), fresh=False)
    again.add(row(seed=3, error="broke"))
    assert again.has(("single", 3), fresh=True)
    assert not again.has(("single", 3), fresh=True, retry=True)
    again.add(row(seed=2))
    again.add(row(seed=1, seconds=5.0))
    assert {key: r["seconds"] for key, r in Results(path).rows.items()} == {
        ("single", 1): 5.0,
        ("single", 2): 2.0,
        ("single", 3): 2.0,
    }


def test_the_page_says_what_was_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row(hidden=(TILT,), findings=(finding("bearing_tilt:1"),), seed=i) for i in range(11)]
    rows += [row(hidden=(TILT,), findings=(finding("base_compliance"),), seed=11), row("nothing"), row("outside")]
    report(rows, tmp_path, ABOUT)
    assert "11/12" in (tmp_path / "study.md").read_text()
    wrong = pd.read_csv(tmp_path / "wrong.csv")
    assert list(zip(wrong["experiment"], wrong["seed"], strict=True)) == [("single", 11), ("outside", 1)]
    assert wrong["said"][0] == "base_compliance"
    found = json.loads((tmp_path / "study.json").read_text())
    assert found["experiments"]["single"]["rates"]["right"]["k"] == 11
    assert found["about"]["seeds"]["single"] == [0, 11]
    assert {p.stem for p in tmp_path.glob("*.png")} == {"confusion", "power", "reliability"}
    assert "11/12" in capsys.readouterr().out


def test_experiments_have_their_own_names_and_fixed_seeds() -> None:
    assert len({e.name for e in EXPERIMENTS}) == len(EXPERIMENTS)
    by_name = {e.name: e for e in EXPERIMENTS}
    assert by_name["single-free"].arguments(3) == {"seed": 10003, "cause": "any"}
    assert by_name["twins"].arguments(3) == {"seed": 10003, "cause": "any", "twin": True}
    assert by_name["outside-seats"].arguments(1)["cause"] != by_name["outside-seats"].arguments(2)["cause"]
    assert by_name["single-seats"].options[-2:] == ["--probe-noise-mm", "0.012"]
    assert by_name["single-free"].options == ["--encoder-noise-rad", "8e-06", "--reference-noise-mm", "0.012"]
    assert by_name["external"].options[-1] == "external"
