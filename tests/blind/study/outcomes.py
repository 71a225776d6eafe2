"""What was said beside what is true: ``outcome(row)``, one flat row for each run; ``figures`` and ``table``, the counts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from blind.regimes import SIZES

Row = dict[str, Any]
COVARIATES = {
    "time": {"time", "time_s"},
    "tip": {"tip", "x", "y", "z", "x_mm", "y_mm", "z_mm", "tip x", "tip y", "tip z", "tip position", "position", "place"},
    "humidity": {"humidity", "humidity_pct"},
    "operator": {"operator"},
    "temperature": {"temperature", "temperature_c"},
}
"""Names under which a covariate may be spoken of."""
CURVE = "joint_error_curve"
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


def outcome(row: Row) -> Row:
    """What a run came to; None where a question does not arise.

    - ``sure``: the verdict is ``explained``; ``wrong``: and a name is neither hidden nor like something hidden;
    - ``named``: a cause is named where nothing is hidden (an ``inconclusive`` verdict is an abstention);
    - ``strict``, ``alike``, ``all``: one of the hidden causes is among the findings; or one that nobody could tell from it
      (a free curve is not excused); every hidden cause is;
    - ``covariate``: a cause outside the library leads to the verdict ``unexplained`` with one of its covariates;
    - ``oracle``: the oracle's likeliest cause is the hidden one;
    - ``right``: ``covariate`` of a cause outside the library, ``alike`` of another; nothing named where nothing is hidden;
    - ``statements``, ``over``, ``over2``: number of stated probabilities, sum and sum of squares of stated less true;
    - ``intervals``, ``inside``: number of stated parameters of causes rightly named, and of those within ± 1.96 u.
    """
    truth, said, error = row["truth"], row["said"] or {}, row["error"]
    hidden, findings, verdict = truth["hidden"], said.get("findings", []), said.get("verdict")
    names = [key_of(f) for f in findings]
    true = {h["key"] for h in hidden}
    excused = true | {key for h in hidden for key in h["aliases"] if not key.startswith(CURVE)}
    outside = any(h["cause"] == "unexplained" for h in hidden)
    told = {covariate(name) for name in said.get("unexplained", {}).get("depends_on", [])}
    wanted = {covariate(name) for h in hidden for name in h.get("depends_on", [])}
    nameable = bool(hidden) and not outside
    off = [f["probability"] - (key_of(f) in true) for f in findings if f.get("probability") is not None]
    z = list(_distances(hidden, findings))
    regime = row.get("regime", {})
    found: Row = {
        "experiment": row["experiment"],
        "seed": row["seed"],
        "arm": regime.get("arm", "sino6"),
        "evidence": regime.get("evidence", row["arguments"].get("plan", "free")),
        "records": regime.get("records", row["arguments"].get("records", 300)),
        "error": error,
        "verdict": verdict or "error",
        "true": " + ".join(h["key"] for h in hidden) or "none",
        "said": " + ".join(names) or "none",
        "depends_on": ", ".join(sorted(told)),
        "lambda": hidden[0].get("lambda") if hidden else None,
        "sure": verdict == "explained",
        "wrong": not set(names) <= excused if verdict == "explained" else None,
        "named": None if hidden else bool(names) and verdict != "inconclusive",
        "strict": bool(true & set(names)) if nameable else None,
        "alike": bool(excused & set(names)) if nameable else None,
        "all": true <= set(names) if nameable else None,
        "covariate": verdict == "unexplained" and bool(wanted & told) if outside else None,
        "oracle": _oracle_right(truth["probabilities"], true),
        "statements": len(off),
        "over": float(np.sum(off)),
        "over2": float(np.sum(np.square(off))),
        "intervals": len(z),
        "inside": sum(abs(x) <= 1.96 for x in z),
        "seconds": row["seconds"],
    }
    silent = not names and verdict in ("no-discrepancy", "inconclusive")
    found["right"] = error is None and bool(found["covariate"] if outside else found["alike"] if hidden else silent)
    return found | _exclusions(truth, said) | _gains(row, said)


def _oracle_right(probabilities: dict[str, float] | None, true: set[str]) -> bool | None:
    """None where the oracle was not asked or does not know the cause."""
    if probabilities is None or len(true) > 1 or not true <= set(probabilities):
        return None
    return max(probabilities, key=probabilities.__getitem__) == next(iter(true), "none")


def _exclusions(truth: Row, said: Row) -> Row:
    """Rows of a file count from 1 with the header: record i is in row i + 2."""
    bad = {i + 2 for i in truth["outliers"]}
    out = {entry["row"] for entry in said.get("records", {}).get("excluded", [])}
    return {"outliers": len(bad), "outliers_found": len(bad & out), "good_excluded": len(out - bad)}


def _gains(row: Row, said: Row) -> Row:
    """Gain as stated for held-out records, and on fresh data."""
    held_out, fresh = said.get("held_out") or {}, (row["fresh"] or {}).get("gain")
    low, high = held_out.get("gain_ci95") or (np.nan, np.nan)
    if fresh is None:
        return {"gain": held_out.get("gain"), "fresh": None, "fresh_held": None}
    return {"gain": held_out.get("gain"), "fresh": fresh, "fresh_held": low <= fresh <= high}


def _distances(hidden: Sequence[Row], findings: Sequence[Row]) -> Iterator[float]:
    """From each stated parameter of a cause rightly named to the truth, in its standard uncertainty."""
    parameters = {h["key"]: h["parameters"] for h in hidden}
    for finding in findings:
        for name, stated in finding["parameters"].items() if key_of(finding) in parameters else ():
            true = parameters[key_of(finding)].get(name)
            if isinstance(stated, dict) and isinstance(true, int | float) and stated.get("u"):
                off = stated["value"] - true
                yield ((off + np.pi) % (2.0 * np.pi) - np.pi if "phase" in name else off) / stated["u"]


# --- counts


def rate(values: pd.Series) -> Row:
    """Share of true values among those known, with its Wilson 95 % interval."""
    known = values.dropna().astype(bool)
    return share(int(known.sum()), len(known))


def share(k: int, n: int) -> Row:
    if n == 0:
        return {"k": 0, "n": 0, "share": None, "low": None, "high": None}
    interval = binomtest(k, n).proportion_ci(0.95, method="wilson")
    return {"k": k, "n": n, "share": k / n, "low": float(interval.low), "high": float(interval.high)}


def figures(runs: pd.DataFrame) -> Row:
    """The counts of some outcomes."""
    something = runs[runs["true"] != "none"]
    gains = runs.loc[runs["fresh"].notna() & runs["gain"].notna(), ["gain", "fresh"]].astype(float)
    return {
        "files": len(runs),
        "errors": int(runs["error"].notna().sum()),
        "sure and wrong": rate(runs["wrong"]),
        "named where nothing is hidden": rate(runs["named"]),
        "hidden cause named": rate(runs["strict"]),
        "or one alike": rate(runs["alike"]),
        "all hidden causes named": rate(runs["all"]),
        "covariate named": rate(runs["covariate"]),
        "oracle names it": rate(runs["oracle"]),
        "explained": rate(something["sure"]),
        "stated minus true": _mean(int(runs["statements"].sum()), runs["over"].sum(), runs["over2"].sum()),
        "within ± 1.96 u": share(int(runs["inside"].sum()), int(runs["intervals"].sum())),
        "outliers found": share(int(runs["outliers_found"].sum()), int(runs["outliers"].sum())),
        "good records excluded": int(runs["good_excluded"].sum()),
        "stated minus fresh gain": _mean(len(gains), *(((gains["gain"] - gains["fresh"]) ** p).sum() for p in (1, 2))),
        "fresh gain in stated interval": rate(runs["fresh_held"]),
        "median CPU s": float(runs["seconds"].median()),
    }


def _mean(n: int, total: float, squares: float) -> Row:
    """Mean of n numbers from their sum and sum of squares, with its standard error."""
    if n == 0:
        return {"n": 0, "mean": None, "u": None}
    mean = float(total) / n
    return {"n": n, "mean": mean, "u": (max(float(squares) / n - mean**2, 0.0) / (n - 1)) ** 0.5 if n > 1 else None}


def count(rows: Sequence[Row]) -> tuple[list[Row], pd.DataFrame]:
    """Figures by experiment, where the files are of many sizes also by number of records; and the outcomes."""
    outcomes = pd.DataFrame([outcome(row) for row in rows])
    counted = []
    for name, runs in outcomes.groupby("experiment", sort=False):
        classes = [(f"{low} to {high}", runs["records"].between(low, high)) for low, high in SIZES]
        parts = [(label, runs[inside]) for label, inside in classes if inside.any()]
        parts = [*parts, ("all", runs)] if runs["records"].nunique() > 1 else [(str(runs["records"].iloc[0]), runs)]
        counted += [{"experiment": str(name), "records": label, **figures(part)} for label, part in parts]
    return counted, outcomes


def table(counted: Sequence[Row]) -> str:
    """The figures as Markdown; a column that holds nothing is left out."""
    lines = pd.DataFrame([{name: _said(value) for name, value in row.items()} for row in counted])
    lines = lines.loc[:, (lines != "").any()]
    rows = [list(lines.columns), ["---"] * lines.shape[1], *lines.to_numpy().tolist()]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _said(value: Any) -> str:
    """``93/100 (0.86 to 0.97)``, ``+0.012 ± 0.004 of 120`` (with the standard error) or a number."""
    if isinstance(value, dict) and not value["n"]:
        return ""
    if isinstance(value, dict) and "k" in value:
        return f"{value['k']}/{value['n']} ({value['low']:.2f} to {value['high']:.2f})"
    if isinstance(value, dict):
        return f"{value['mean']:+.3f}" + (f" ± {value['u']:.3f}" if value["u"] is not None else "") + f" of {value['n']}"
    return f"{value:.1f}" if isinstance(value, float) else str(value)
