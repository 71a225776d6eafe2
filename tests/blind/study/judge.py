"""What was said beside what is true, one run at a time: ``judge(row)`` for a row of the table."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

Row = dict[str, Any]
COVARIATES = {
    "time": {"time", "time_s"},
    "tip": {"tip", "x", "y", "z", "x_mm", "y_mm", "z_mm", "tip x", "tip y", "tip z", "tip position", "position", "place"},
    "humidity": {"humidity", "humidity_pct"},
    "operator": {"operator"},
    "temperature": {"temperature", "temperature_c"},
}
"""Names under which a covariate may be spoken of."""
NESTS_ALL = "joint_error_curve"
"""Any function of one angle: whatever an encoder does looks like it, and yet it is no better name for that."""


def key_of(finding: Row) -> str:
    """``cause``, ``cause:joint`` or ``seat_error:P4``."""
    at = next((finding[name] for name in ("joint", "link", "seat") if finding.get(name) is not None), None)
    return str(finding["cause"]) if at is None else f"{finding['cause']}:{at}"


def covariate(name: str) -> str:
    """One name for each covariate: ``joint 2``, ``time``, ``tip``, ``humidity`` …"""
    low = name.lower().strip()
    if joint := re.fullmatch(r"(?:joint|theta|q|angle)[ _]?(\d+)(?:_deg|_rad)?", low):
        return f"joint {joint[1]}"
    return next((one for one, names in COVARIATES.items() if low in names), low)


def judge(row: Row) -> Row:
    """One flat row.

    - ``right``: the strongest finding has cause and joint of the (largest) hidden fault;
    - ``right_or_alias``: or those of a cause that nobody could tell from it;
    - ``listed``: the truth is the strongest finding or one of its stated aliases;
    - ``alone``: right, and nothing else found;
    - ``all_named``: every hidden fault is among the findings;
    - ``noticed``: anything at all was said;
    - ``answer``: what counts for the experiment's kind.
    """
    truth, said = row["truth"], row["said"] or {}
    hidden, findings = truth["hidden"], said.get("findings", [])
    faults = [h for h in hidden if h["cause"] != "unexplained"]
    true, named = [h["key"] for h in faults], [key_of(f) for f in findings]
    strongest = named[0] if named else None
    tolerated = {key for h in faults[:1] for key in [h["key"], *h.get("aliases", {})] if not key.startswith(NESTS_ALL)}
    alike = [key_of(a) for f in findings[:1] for a in f.get("aliases", [])]
    right = bool(true) and strongest == true[0]
    verdict = said.get("verdict")
    depends = {covariate(name) for name in said.get("unexplained", {}).get("depends_on", [])}
    wanted = {covariate(name) for h in hidden for name in h.get("depends_on", [])}
    likeliest = _likeliest(truth, true)
    judged = {
        "experiment": row["experiment"],
        "seed": row["seed"],
        "kind": row["kind"],
        "size": row["arguments"].get("size", 1.0),
        "error": row["error"],
        "true": " + ".join(h["key"] for h in hidden) or "none",
        "true_kind": hidden[0]["parameters"].get("kind", "") if hidden else "",
        "said": " + ".join(named) or "none",
        "verdict": verdict or "error",
        "said_depends_on": ", ".join(said.get("unexplained", {}).get("depends_on", [])),
        "true_cause": hidden[0]["cause"] if hidden else "none",
        "said_cause": _said_cause(strongest, verdict),
        "lambda": faults[0].get("lambda") if faults else None,
        "columns": faults[0].get("columns") if faults else None,
        "retained": faults[0].get("retained_fraction") if faults else None,
        "size_um": hidden[0].get("size_um") if hidden else None,
        "aliases": ", ".join(faults[0].get("aliases", {})) if faults else "",
        "probability": findings[0].get("probability") if findings else None,
        "right": right,
        "right_or_alias": right or strongest in tolerated,
        "cause_right": bool(faults) and strongest is not None and findings[0]["cause"] == faults[0]["cause"],
        "listed": right or (bool(true) and true[0] in alike),
        "alone": right and len(named) == len(true),
        "all_named": bool(true) and set(true) <= set(named),
        "any_named": bool(set(true) & set(named)),
        "false_findings": len([key for key in named if key not in true]),
        "noticed": bool(findings) or verdict not in (None, "no-discrepancy"),
        "silent": verdict == "no-discrepancy" and not findings,
        "verdict_unexplained": verdict == "unexplained",
        "depends_right": bool(wanted & depends),
        "depends_all": bool(wanted) and wanted <= depends,
        "oracle_said": likeliest,
        "oracle_right": None if likeliest is None else likeliest == (true[0] if true else "none"),
        "oracle_right_or_alias": None if likeliest is None else likeliest in (tolerated or {"none"}),
        "seconds": row["seconds"],
        **_exclusions(truth, said),
        **_gains(row, said),
    }
    return judged | {"answer": _answer(row["kind"], judged)}


def _answer(kind: str, judged: Row) -> bool:
    if judged["error"] is not None:
        return False
    if kind == "outside":
        return bool(judged["verdict_unexplained"] and judged["depends_right"])
    return bool(judged[{"single": "right", "pair": "all_named", "nothing": "silent"}[kind]])


def _said_cause(strongest: str | None, verdict: str | None) -> str:
    if strongest is not None:
        return strongest.partition(":")[0]
    return {"unexplained": "unexplained", None: "error"}.get(verdict, "none")


def _likeliest(truth: Row, true: list[str]) -> str | None:
    """The likeliest cause of the oracle; None where it was not asked or does not know the cause."""
    probabilities = truth.get("probabilities")
    if probabilities is None or len(true) > 1 or any(key not in probabilities for key in true):
        return None
    return str(max(probabilities, key=probabilities.__getitem__))


def _exclusions(truth: Row, said: Row) -> Row:
    """Rows of a file count from 1 with the header: record i is in row i + 2."""
    bad = {i + 2 for i in truth["outliers"]}
    out = {entry["row"] for entry in said.get("records", {}).get("excluded", [])}
    return {"outliers": len(bad), "outliers_found": len(bad & out), "good_excluded": len(out - bad)}


def _gains(row: Row, said: Row) -> Row:
    held_out, fresh, rms = said.get("held_out") or {}, row["fresh"] or {}, said.get("rms_mm") or {}
    low, high = held_out.get("gain_ci95") or (None, None)
    return {
        "gain": held_out.get("gain"),
        "gain_low": low,
        "gain_high": high,
        "gain_fresh": fresh.get("gain"),
        "fresh_error": fresh.get("error"),
        "fresh_rms_mm": fresh.get("rms_mm", {}).get("extended"),
        "fresh_noise_mm": fresh.get("rms_mm", {}).get("noise"),
        "rms_recalibrated_mm": rms.get("recalibrated"),
        "rms_extended_mm": rms.get("extended"),
        "rms_noise_mm": rms.get("noise"),
    }


def statements(row: Row) -> list[Row]:
    """Every stated probability, and whether what it is stated of is true: findings, and the aliases of the findings."""
    truth = {h["key"] for h in row["truth"]["hidden"]}
    made = []
    for finding in (row["said"] or {}).get("findings", []):
        for what, entry in [("finding", finding), *(("alias", alias) for alias in finding.get("aliases", []))]:
            if entry.get("probability") is not None:
                statement = {"what": what, "probability": float(entry["probability"]), "true": key_of(entry) in truth}
                made.append({"experiment": row["experiment"], "kind": row["kind"], **statement})
    return made


def intervals(row: Row) -> list[Row]:
    """Every stated parameter of a finding that is true: ``z`` is its distance from the truth in stated uncertainties.

    ``z`` is None where the truth has no such parameter, or no uncertainty is stated.
    """
    hidden = {h["key"]: h for h in row["truth"]["hidden"]}
    made = []
    for finding in (row["said"] or {}).get("findings", []):
        key = key_of(finding)
        if key in hidden:
            for name, stated in finding["parameters"].items():
                z = _z(name, stated, hidden[key]["parameters"].get(name))
                made.append({"experiment": row["experiment"], "cause": finding["cause"], "parameter": name, "z": z})
    return made


def _z(name: str, stated: Any, true: Any) -> float | None:
    if not isinstance(stated, dict) or not isinstance(true, int | float) or not stated.get("u"):
        return None
    off = stated["value"] - true
    if "phase" in name:
        off = (off + np.pi) % (2.0 * np.pi) - np.pi
    return float(off / stated["u"])
