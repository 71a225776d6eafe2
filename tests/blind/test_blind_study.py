"""The counting of the study of blind files, on rows that are made up, and the page with its
figures.
"""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from blind.study import __main__ as command
from blind.study import page
from blind.study.outcomes import count, outcome, rate, table
from blind.study.stored import stored
from tests.measured import DIAGNOSIS, digest, modules

Row = dict[str, Any]
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "notebooks" / "site" / "study.md"


def fault(key: str, *aliases: str) -> Row:
    seen = {"lambda": 100.0, "power": 0.99, "rivals": {}}
    return {
        "key": key,
        "parameters": {},
        "size_um": 50.0,
        "aliases": dict.fromkeys(aliases, 0.97),
    } | seen


def finding(key: str, probability: float = 0.9) -> Row:
    cause, _, at = key.partition(":")
    place = {"seat": at} if cause == "seat_error" else {"joint": int(at) if at else None}
    return {"cause": cause, **place, "probability": probability}


def row(
    said: tuple[Any, ...] = (),
    hidden: tuple[Row, ...] = (),
    verdict: str = "",
    seed: int = 1,
    **more: Any,
) -> Row:
    """Findings by key or as they are; the verdict is ``explained`` where there are any."""
    findings = [finding(f) if isinstance(f, str) else f for f in said]
    answer = {
        "verdict": verdict or ("explained" if said else "no-discrepancy"),
        "findings": findings,
    }
    regime = {"arm": "sino6", "evidence": "free", "records": 50}
    made = {
        "seed": seed,
        "family": "regimes",
        "regime": regime,
        "error": None,
        "seconds": 2.0,
        "said": answer,
        "sources": digest(*DIAGNOSIS),
    }
    return made | {"truth": {"hidden": list(hidden), "structure": None, "outliers": []}} | more


TILT = fault("bearing_tilt:1", "base_compliance", "joint_error_curve:1")
GAIN, SEAT = fault("encoder_gain:3"), fault("seat_error:P5")


def test_what_is_right_of_hidden_causes():
    for said, hidden, alike, wrong in [
        (("bearing_tilt:1",), (TILT,), True, False),
        (("encoder_gain:3", "bearing_tilt:1"), (TILT,), True, True),
        (("base_compliance",), (TILT,), True, False),
        (("bearing_tilt:3",), (TILT,), False, True),
        (("joint_error_curve:1",), (TILT,), False, True),  # alike, and yet no better name
        ((), (TILT,), False, None),
        (("seat_error:P5",), (SEAT,), True, False),
        (("seat_error:P4",), (SEAT,), False, True),
        (("encoder_gain:3",), (TILT, GAIN), True, False),
    ]:
        found = outcome(row(said, hidden))
        assert (found["alike"], found["right"], found["wrong"], found["named"]) == (
            alike,
            alike,
            wrong,
            None,
        )
        for verdict in ("ambiguous", "inconclusive"):
            assert outcome(row(said, hidden, verdict))["wrong"] is None


def test_nothing_hidden_wants_silence():
    for said, verdict, named, right in [
        ((), "", False, True),
        (("encoder_gain:2",), "", True, False),
        (("encoder_gain:2",), "inconclusive", False, False),
        ((), "unexplained", False, False),
    ]:
        found = outcome(row(said, verdict=verdict))
        assert (found["true"], found["named"], found["right"]) == ("none", named, right)
    broken = outcome(row(said=(), error="exit status 1") | {"said": None})
    assert not broken["right"]
    assert broken["verdict"] == "error"


def test_structure_outside_is_to_be_named_and_no_cause_for_it():
    structure = {
        "kind": "joint_product",
        "covariates": ["joint 2", "joint 4"],
        "times_noise": 2.0,
        "lambda": 90.0,
    }
    product = {"covariate": "joint 2 × joint 4", "rms_mm": 0.04, "u_mm": 0.01, "probability": 0.9}
    for said, more, named, false, right in [
        (
            (),
            {"unexplained": {"depends_on": ["joint 4", "joint 2", "time"]}},
            True,
            0,
            True,
        ),
        (
            (),
            {"unexplained": {"depends_on": ["joint 4"], "scattered_readings": [{"joint": 2}]}},
            True,
            0,
            True,
        ),
        ((), {"discrepancy": [product]}, True, 0, True),
        ((), {"discrepancy": [product | {"probability": 0.4}]}, False, 0, True),
        ((finding("encoder_gain:3", 0.6),), {}, False, 1, False),
        ((finding("encoder_gain:3", 0.4),), {}, False, 0, True),
    ]:
        made = row(said, verdict="unexplained", family="outside-alone")
        made["truth"]["structure"] = structure
        made["said"] |= more
        found = outcome(made)
        assert (found["structure named"], found["false"], found["right"]) == (named, false, right)


def test_what_the_oracle_sees_is_to_be_stated_surely():
    weak = GAIN | {"power": 0.5}
    for p, hidden, seen, found in [(0.96, GAIN, 1, 1), (0.9, GAIN, 1, 0), (0.96, weak, 0, 0)]:
        made = outcome(row((finding("encoder_gain:3", p),), (hidden,)))
        assert (made["seen"], made["found"]) == (seen, found)


def test_counts():
    """Wilson's interval: Brown, Cai, DasGupta 2001, 10 of 10 leaves 0.7225; 90 % said of four
    names, one of them right.
    """
    assert rate(pd.Series([True] * 10 + [None] * 3)) == "10/10 (0.72 to 1.00)"
    assert rate(pd.Series(dtype=bool)) == ""
    rows = [
        row(("encoder_slip:3",), (GAIN,)),
        row(("encoder_gain:3",), (GAIN,)),
        row(("encoder_slip:1",)),
    ]
    rows += [
        row(("encoder_slip:3",), verdict="inconclusive"),
        row(regime={"arm": "a", "evidence": "b", "records": 400}),
    ]
    found = count(rows)[0].set_index("class")
    assert found["files"].to_dict() == {"20 to 60 records": 4, "301 to 3000 records": 1, "all": 5}
    few = found.loc["20 to 60 records"]
    assert few["explained, false name"].startswith("2/3 ")
    assert few["false alarms"].startswith("1/2 ")
    assert few["hidden cause named"].startswith("1/2 ")
    half = 1.96 * np.sqrt(4 / 3 * (3 * 0.25**2 + 0.75**2)) / 4
    assert (few["stated minus true"], few["names"]) == (f"{0.9 - 0.25:+.3f} ± {half:.3f}", 4)
    assert few["0.8 to 0.95"].startswith("stated 0.90, true 1/4 ")
    assert len({line.count("|") for line in table(count(rows)[0]).splitlines()}) == 1


def test_a_study_is_taken_up_where_it_was_cut_off(tmp_path, capsys):
    """Two runs are in the file already, and so are not made; one is of other code, one was
    cut off.
    """
    path, first = tmp_path / "runs.jsonl", command.FIRST
    rows = [
        row((said,), (TILT,), seed=first + k)
        for k, said in enumerate(("bearing_tilt:1", "encoder_gain:5"))
    ]
    other = row(seed=first + 2, sources="0")
    path.write_text(
        "".join(json.dumps(r) + "\n" for r in (*rows, other)) + '{"seed": 100003, "se',
        encoding="utf-8",
    )
    assert [*stored(path, digest(*DIAGNOSIS))] == [("regimes", first), ("regimes", first + 1)]
    assert command.main(["--count", "2", "-o", str(tmp_path)]) == 0
    assert "1/2 (0.09 to 0.91)" in capsys.readouterr().out
    assert pd.read_csv(tmp_path / "wrong.csv")["said"].tolist() == ["encoder_gain:5 (0.90)"]


# --- the page


def test_each_family_has_its_table():
    rows = [
        row(family=family, seed=seed)
        for family in ("nothing", "outside-alone")
        for seed in range(3)
    ]
    found = page.tables(rows)
    assert [text.splitlines()[0] for text in found] == ["## outside-alone", "## nothing"]
    assert all("| all | 3 |" in text for text in found)


def stated(name: str) -> str:
    found = re.search(rf"^\| {name} \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None, f"{PAGE.name} states no {name}"
    return found[1].strip("`")


def git(*words: str) -> str:
    return subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()


def test_the_commit_is_of_this_history():
    if git("rev-parse", "--is-shallow-repository") != "false":
        pytest.skip("no whole git history")
    assert git("merge-base", stated("commit"), "HEAD") == stated("commit")


def test_the_diagnosis_code_is_the_one_measured():
    """Skipped, and said, where it is not: a change of code need not wait for hours of
    measurement.
    """
    measured, package = modules(*DIAGNOSIS), ROOT / "aacmm_pin"
    assert {
        package / "diagnosis" / "search.py",
        package / "effects" / "compliance.py",
    } <= measured
    assert not {path for path in measured if "plots" in path.parts or "cli" in path.parts}
    if stated("code") != digest(*DIAGNOSIS):
        pytest.skip(f"the tables of {PAGE.name} are of older diagnosis code: measure again")
