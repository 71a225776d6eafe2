"""``diagnose --json`` against the schema that other programs read: every field, its type, its unit,
for every verdict.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.diagnosis import THRESHOLDS
from aacmm_pin.diagnosis.verdict import DOUBTS
from aacmm_pin.effects import CAUSES
from tests.cli import shell

NOISE = "--encoder-noise 8e-6 --u-reference-mm 0.012"
ECCENTRIC = "--cause encoder_eccentricity:joint=3,amplitude_rad=1e-4,phase_rad=0.5"
VERDICTS = ("explained", "no-discrepancy", "ambiguous", "unexplained", "inconclusive")
Check = Callable[[Any], bool]


def number(least: float = -math.inf, most: float = math.inf) -> Check:
    return lambda v: (
        isinstance(v, int | float)
        and not isinstance(v, bool)
        and math.isfinite(v)
        and least <= v <= most
    )


def count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def text(value: object) -> bool:
    return (
        isinstance(value, str)
        and bool(value)
        and "nan" not in value.split()
        and "None" not in value
    )


def place(value: object) -> bool:
    return value is None or (count(value) and value != 0)


def several(check: Check) -> Check:
    return lambda value: isinstance(value, list) and all(check(v) for v in value)


def none_or(check: Check) -> Check:
    return lambda value: value is None or check(value)


def fields(schema: dict[str, Check], optional: dict[str, Check] | None = None) -> Check:
    """An object with these fields and no other."""

    def check(value: object) -> bool:
        assert isinstance(value, dict), value
        every = schema | {k: c for k, c in (optional or {}).items() if k in value}
        assert set(value) == set(every), set(value) ^ set(every)
        for name, inner in every.items():
            assert inner(value[name]), f"{name}: {value[name]!r}"
        return True

    return check


VALUE = fields({"value": number(), "u": none_or(number(0.0))})


def interval(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 2
        and several(number(most=1.0))(value)
        and value[0] <= value[1]
    )


def parameters(value: object) -> bool:
    assert isinstance(value, dict)
    assert value
    for name, entry in value.items():
        assert name.rsplit("_", 1)[-1] in UNITS or name in UNITLESS, name
        assert VALUE(entry)
    return True


UNITS = {"rad", "mm", "c", "s", "nm", "n", "k", "mrad"}
UNITLESS = {"gain", "scale"}
SHARE, SIZE = number(0.0, 1.0), number(0.0)
ALIAS = fields(
    {"cause": text, "joint": place, "correlation": SHARE, "probability": SHARE},
    {"link": count, "seat": text, "marker": text},
)
INNER: dict[str, Check] = {
    name: number() for name in ("order", "time_s", "time_constant_s", "lower_rad", "upper_rad")
}
INNER |= {"spectrum": several(fields({"order": number(0.0), "amplitude_rad": number(0.0)}))}
INNER |= {"coefficients": count} | dict.fromkeys(("seat", "marker", "torque"), text)
FINDING = fields(
    {
        "cause": lambda v: v in CAUSES,
        "joint": place,
        "probability": SHARE,
        "p_value": SHARE,
        "retained_fraction": SHARE,
        "parameters": parameters,
        "below_zero": several(text),
        "inner": lambda v: (
            not v or (set(v) <= set(INNER) and all(VALUE(entry) for entry in v.values()))
        ),
        "held_out": none_or(fields({"gain": number(most=1.0), "gain_ci95": interval})),
        "aliases": several(ALIAS),
    },
    INNER,
)
RMS = dict.fromkeys(("nominal", "simulation", "recalibrated", "extended"), SIZE)
PART_OF_BUDGET = fields(
    {
        "part": text,
        "causes": several(text),
        "rms_mm": SIZE,
        "mean_square_mm2": lambda v: isinstance(v, float),
        "u_mean_square_mm2": SIZE,
        "share": lambda v: v <= 1.0 + 1e-9,
    }
)
SUMMARY = fields(
    {
        "schema": lambda v: v == "aacmm-pin/diagnosis/1",
        "arm": text,
        "verdict": lambda v: v in VERDICTS,
        "doubts": several(lambda v: v in DOUBTS),
        "causes_shown": count,
        "causes_tried": count,
        "converged": lambda v: isinstance(v, bool),
        "converge_note": lambda v: isinstance(v, str),
        "records": fields(
            {
                "used": count,
                "excluded": several(fields({"row": count, "reason": text, "residual_mm": SIZE})),
            }
        ),
        "rms_mm": fields(RMS | {"noise": SIZE}),
        "budget": lambda parts: (
            several(PART_OF_BUDGET)(parts)
            and sum(part["share"] for part in parts) == pytest.approx(1.0)
        ),
        "rms_rad": none_or(fields(RMS)),
        "findings": several(FINDING),
        "held_out": none_or(
            fields(
                {
                    "kind": lambda v: v in ("seats", "blocks"),
                    "groups": count,
                    "rms_mm": fields(RMS),
                    "gain": number(most=1.0),
                    "gain_ci95": interval,
                    "excluded_counted": count,
                    "gross_errors": count,
                }
            )
        ),
        "alternatives": several(fields({"causes": several(text), "probability": SHARE})),
        "other_alternatives": fields({"count": count, "probability": SHARE}),
        "agreement": fields({"total_variation": SHARE, "agree": lambda v: isinstance(v, bool)}),
        "discrepancy": several(
            fields({"covariate": text, "rms_mm": SIZE, "u_mm": SIZE, "probability": SHARE})
        ),
        "unexplained": fields(
            {
                "p_value": SHARE,
                "threshold": SHARE,
                "depends_on": several(text),
                "acts_on": lambda v: (
                    isinstance(v, dict) and all(text(k) and text(words) for k, words in v.items())
                ),
                "smooth_correction_gain": none_or(number(most=1.0)),
                "groups": several(
                    fields({"name": text, "records": count, "times": SIZE, "p_value": SHARE})
                ),
                "scattered_readings": several(
                    fields(
                        {
                            "joint": count,
                            "rms_mm": SIZE,
                            "log_likelihood_ratio": SIZE,
                            "p_value": SHARE,
                        },
                        {"scatter_rad": SIZE, "scatter_mm": SIZE},
                    )
                ),
                "shared_by_postures": none_or(
                    fields({"rms_mm": SIZE, "times_a_record": SIZE, "p_value": SHARE})
                ),
                "run_order": none_or(
                    fields(
                        {
                            "joint": none_or(count),
                            "correlation": SIZE,
                            "limit": SIZE,
                            "p_value": SHARE,
                            "records": count,
                        }
                    )
                ),
            }
        ),
        "not_tried": several(fields({"column": text, "causes": several(lambda v: v in CAUSES)})),
        "base_in_reference_frame": none_or(
            lambda v: len(v["origin_mm"]) == len(v["u_rotation_rad"]) == 3
        ),
        "base_in_other_sessions": lambda v: v == [],
        "cannot_tell_apart": several(lambda v: several(text)(v) and len(v) > 1),
        "next_measurements": text,
        "notes": several(text),
        "note_codes": several(text),
        "source": text,
        "seed": count,
    }
)


def simulated(folder: Path, words: str) -> pd.DataFrame:
    path = folder / "simulated.csv"
    shell.done(f"simulate sino6 {words} -o {path} --force")
    return pd.read_csv(path)


def explained(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, f"--scheme free --records 60 {ECCENTRIC}")
    table.loc[7, "x_mm"] += 3.0
    return table, ""


def nothing(folder: Path) -> tuple[pd.DataFrame, str]:
    probe = "--probe-noise-mm 0.012"
    return simulated(folder, f"--scheme seats --records 60 --seats 6 {probe}"), probe


def too_few(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, f"--scheme free --records 60 {ECCENTRIC}").head(20)
    return table, "--reference-frame external"


def by_operator(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, "--scheme free --records 80")
    table["operator"] = np.repeat(["a", "b"], 40)
    table.loc[40:, "z_mm"] += 0.2
    return table, ""


CASES = {
    "explained": explained,
    "no-discrepancy": nothing,
    "ambiguous": too_few,
    "unexplained": by_operator,
}


@pytest.mark.parametrize("verdict", CASES)
def test_every_field_of_every_verdict(tmp_path, verdict):
    table, options = CASES[verdict](tmp_path)
    path = tmp_path / "data.csv"
    table.to_csv(path, index=False)
    json_file = tmp_path / "found.json"
    out, _ = shell.done(f"diagnose sino6 {path} {NOISE} {options} --json {json_file}")
    found = json.loads(json_file.read_text(encoding="utf-8"))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert SUMMARY(found)
    assert found["verdict"] == verdict
    assert found["records"]["used"] + len(found["records"]["excluded"]) == len(table)
    agrees(found, out)


def labelled(finding: dict[str, Any]) -> str:
    """Cause and place, as in the sets of causes."""
    places = (finding.get(key) for key in ("joint", "link", "seat", "marker"))
    return ":".join(
        map(str, [finding["cause"], *[place for place in places if place is not None][:1]])
    )


def agrees(found: dict[str, Any], shown: str) -> None:
    """The fields make sense of one another, and the text says the same."""
    assert shown.lower().startswith(found["verdict"].replace("-", " "))
    doubtful = [f for f in found["findings"] if f["probability"] < THRESHOLDS.settled]
    depends = found["unexplained"]["depends_on"]
    assert (found["verdict"] == "unexplained") == bool(depends)
    if not depends:
        assert (found["verdict"] == "no-discrepancy") == (not found["findings"])
        assert (found["verdict"] == "ambiguous") == bool(doubtful)
    shares = [each["probability"] for each in found["alternatives"]]
    assert shares == sorted(shares, reverse=True)
    rest = found["other_alternatives"]["probability"]
    assert sum(shares) + rest == pytest.approx(1.0)
    labels = [labelled(finding) for finding in found["findings"]]
    for label, finding in zip(labels, found["findings"], strict=True):
        inside = sum(
            each["probability"] for each in found["alternatives"] if label in each["causes"]
        )
        assert inside - 1e-9 <= finding["probability"] <= inside + rest + 1e-9
        assert finding["probability"] >= THRESHOLDS.named
    for finding in found["findings"]:
        assert all(
            finding["probability"] + alias["probability"] <= 1.0 + 1e-9
            for alias in finding["aliases"]
        )
    rows = {line.split()[0] for line in shown.splitlines() if line.strip()}
    assert {str(record["row"]) for record in found["records"]["excluded"]} <= rows
    for name in depends:
        assert name in shown
    assert found["next_measurements"][1:] in " ".join(shown.split())
    held = found["held_out"]
    sizes = held["rms_mm"]
    assert held["gain"] == pytest.approx(1.0 - sizes["extended"] / sizes["recalibrated"])
    assert held["gain_ci95"][0] <= held["gain"] <= held["gain_ci95"][1]
    rms = found["rms_mm"]
    assert rms["extended"] <= rms["recalibrated"] + 1e-9


def test_without_held_out_there_is_none(tmp_path):
    table, _ = nothing(tmp_path)
    table.to_csv(tmp_path / "data.csv", index=False)
    found = shell.found(f"diagnose sino6 {tmp_path / 'data.csv'} {NOISE} --no-cross-validation")
    assert SUMMARY(found)
    assert found["held_out"] is None
