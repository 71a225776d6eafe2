"""A quick gate for diagnosis on blind files of many arms: what is named surely is there, and what
is plain is named.

Each group of files is drawn from fixed seeds, diagnosed by the command line and counted. No file
may end in an error, no sure verdict may name a cause that is not there (or the same as one that
is), so many are named right, and their values hold.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from blind.study import runs
from blind.study.outcomes import key_of, outcome

Row = dict[str, Any]
TRACKER: Row = {
    "arm": "sino6",
    "evidence": "free",
    "records": 80,
    "external": False,
    "own_u": False,
    "environment": True,
    "encoder_u": 8e-6,
    "reference_u": 12e-6,
    "noise_stated": "all",
    "outliers": 0.0,
    "faults": 1,
}
SEATS = TRACKER | {"evidence": "seats", "seats": 8}
SEVEN = TRACKER | {"arm": "standard-dh", "stated": True, "masses": True, "torque": False}
BARE = SEVEN | {"stated": False, "torque": True}
ROBOT = TRACKER | {"arm": "ur5", "stated": True, "torque": False}
SINGLES: list[tuple[str, int | None]] = [
    ("joint_hysteresis", 3),
    ("encoder_eccentricity", 3),
    ("zero_drift", 1),
    ("joint_compliance", 2),
    ("thermal_expansion", None),
    ("link_length", 3),
    ("encoder_ellipticity", 2),
    ("joint_periodic_error", 1),
    ("joint_error_curve", 2),
    ("encoder_gain", 4),
    ("encoder_slip", 2),
    ("bearing_tilt", 3),
    ("link_bending", 3),
    ("torsional_windup", 3),
    ("counterbalance", 2),
    ("base_compliance", None),
    ("stylus_bending", None),
    ("stylus_offset", None),
    ("joint_zero_offset", 4),
    ("joint_distance", 5),
    ("link_twist", 2),
]
BARS = SEVEN | {"evidence": "bars", "seats": 6}
FEW = SEVEN | {
    "evidence": "seats",
    "seats": 3,
    "records": 45,
    "cause": "encoder_eccentricity",
    "value": 1.1e-4,
}
SOFT = TRACKER | {"cause": "link_bending", "joint": 3}
CASES: dict[str, list[Row]] = {
    "singles": [{**TRACKER, "seed": 1, "cause": cause, "joint": joint} for cause, joint in SINGLES]
    + [{**SEATS, "seed": 1, "cause": "seat_error"}],
    "tubes": [
        {**TRACKER, "seed": 1, "cause": "thermal_expansion", "joint": tube, "value": 1.2e-5}
        for tube in (3, 5)
    ],
    "nothing": [
        {**base, "seed": seed, "faults": 0}
        for seed, base in ((4, BARS), (5, ROBOT), (1, TRACKER), (2, SEATS), (3, SEVEN), (6, BARE))
    ],
    "pairs": [{**TRACKER, "seed": seed, "records": 100, "faults": 2} for seed in (1, 2)],
    "few": [{**FEW, "seed": seed, "joint": 1 + seed % 7} for seed in (2, 3, 7, 8, 24)],
    "soft": [{**SOFT, "seed": 3, "records": 300, "value": 8e-5}],
    "noise_unstated": [
        {**SOFT, "seed": seed, "records": 120, "value": 8e-5, "noise_stated": "none"}
        for seed in (1, 5)
    ]
    + [
        {
            **SEVEN,
            "seed": 156,
            "records": 11,
            "noise_stated": "none",
            "cause": "encoder_gain",
            "joint": 3,
        }
    ],
    "bare": [
        {**BARE, "seed": seed, "cause": cause, "joint": joint}
        for seed, cause, joint in ((1, "joint_compliance", 4), (1, "encoder_eccentricity", 2))
    ],
    "no_masses": [
        {
            **SEVEN,
            "arm": "modified-dh",
            "seed": 1,
            "records": 60,
            "masses": False,
            "cause": "joint_hysteresis",
            "joint": 3,
        }
    ],
    "curves": [
        {
            **ROBOT,
            "arm": "panda",
            "seed": 73,
            "records": 45,
            "cause": "joint_error_curve",
            "joint": 2,
        }
    ],
    "gross": [{**TRACKER, "seed": 1, "outliers": 0.1, "cause": "joint_hysteresis", "joint": 1}],
}
RIGHT = {
    "singles": 19,
    "tubes": 2,
    "nothing": 6,
    "pairs": 2,
    "few": 4,
    "soft": 1,
    "noise_unstated": 2,
    "bare": 2,
}
RIGHT |= {"no_masses": 1, "curves": 1, "gross": 1}
"""So many at least are named right: a hidden cause among the findings, or nothing where nothing is.
"""
FIRST = {
    "singles": 1,
    "nothing": 2,
    "pairs": 1,
    "curves": 1,
}
"""So many of the first files of a group are diagnosed in every run, and all of them are right."""
LIMIT = 3.3
"""Standard uncertainties by which one of the many parameters here may be off: a chance of 1
in 1000.
"""


def told(found: list[Row]) -> str:
    return "\n".join(
        f"seed {o['seed']}: {o['true']}; {o['verdict']}: {o['said']} {o['error'] or ''}"
        for o in found
    )


def off(row: Row) -> dict[str, float]:
    """How many u each parameter of a cause that is there is stated off the truth, for those that
    the truth states too.
    """
    away = {}
    for finding, fault in itertools.product(
        (row["said"] or {}).get("findings", []), row["truth"]["hidden"]
    ):
        if key_of(finding) == fault["key"]:
            for name in finding["parameters"].keys() & fault["parameters"].keys():
                stated, error = (
                    finding["parameters"][name],
                    finding["parameters"][name]["value"] - fault["parameters"][name],
                )
                error = (error + np.pi) % (2 * np.pi) - np.pi if name == "phase_rad" else error
                away[f"{fault['key']} {name}"] = abs(error) / stated["u"]
    return away


def task_of(case: Row) -> runs.Task:
    """Without the gain on held-out records, which has no part in what is named; the study
    has it.
    """
    given = {name: value for name, value in case.items() if name != "seed"}
    return runs.Task(case["seed"], given, options=("--no-cross-validation",))


def check(cases: list[Row], right: int) -> None:
    rows = [runs.perform(task_of(case)) for case in cases]
    found = [outcome(row) for row in rows]
    assert not (bad := [o for o in found if o["error"] or o["wrong"] or o["named"]]), told(bad)
    wrong = [o for o in found if not o["right"]]
    assert len(found) - len(wrong) >= right, told(wrong)
    away = {
        name: u
        for row in rows
        if row["said"]["verdict"] != "inconclusive"
        for name, u in off(row).items()
    }
    assert not {name: u for name, u in away.items() if u > LIMIT}, away


@pytest.mark.parametrize("group", FIRST)
def test_nothing_sure_is_wrong_and_the_first_files_are_right(group):
    check(CASES[group][: FIRST[group]], FIRST[group])


@pytest.mark.long
@pytest.mark.parametrize("group", CASES)
def test_nothing_sure_is_wrong_and_enough_is_right(group):
    check(CASES[group], RIGHT[group])
