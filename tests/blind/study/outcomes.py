"""What was said beside what is true: ``outcome(row)``, one flat row for each run; ``count`` and ``table``, the counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from scipy.stats import binomtest

from blind.regimes import SIZES

Row = dict[str, Any]
CURVE = "joint_error_curve"
"""Any function of one angle: whatever an encoder does looks like it, and yet it is no better name for that."""


def key_of(finding: Row) -> str:
    """``cause``, ``cause:joint`` or ``seat_error:P4``."""
    at = next((finding[name] for name in ("joint", "link", "seat") if finding.get(name) is not None), None)
    return str(finding["cause"]) if at is None else f"{finding['cause']}:{at}"


def outcome(row: Row) -> Row:
    """What a run came to; None where a question does not arise.

    - ``sure``: the verdict is ``explained``; ``wrong``: and a name is neither hidden nor like something hidden;
    - ``named``: a cause is named where nothing is hidden (an ``inconclusive`` verdict is an abstention);
    - ``alike``: one of the hidden causes, or one that nobody could tell from it (a free curve is not excused), is named;
    - ``right``: ``alike``, or nothing named where nothing is hidden;
    - ``statements``, ``over``: number of stated probabilities, and their sum less the number of those that are of a hidden
      cause.
    """
    hidden, said, error = row["truth"]["hidden"], row["said"] or {}, row["error"]
    findings, verdict = said.get("findings", []), said.get("verdict", "error")
    names, true = {key_of(f) for f in findings}, {h["key"] for h in hidden}
    excused = true | {key for h in hidden for key in h["aliases"] if not key.startswith(CURVE)}
    alike = bool(excused & names)
    silent = not names and verdict in ("no-discrepancy", "inconclusive")
    return {
        "seed": row["seed"],
        "arm": row["regime"]["arm"],
        "evidence": row["regime"]["evidence"],
        "records": row["regime"]["records"],
        "error": error,
        "verdict": verdict,
        "true": " + ".join(h["key"] for h in hidden) or "none",
        "said": " + ".join(key_of(f) for f in findings) or "none",
        "lambda": hidden[0]["lambda"] if hidden else None,
        "sure": verdict == "explained",
        "wrong": not names <= excused if verdict == "explained" else None,
        "named": None if hidden else bool(names) and verdict != "inconclusive",
        "alike": alike if hidden else None,
        "right": error is None and (alike if hidden else silent),
        "statements": len(findings),
        "over": sum(f["probability"] - (key_of(f) in true) for f in findings),
        "seconds": row["seconds"],
    }


def rate(values: pd.Series) -> str:
    """``93/100 (0.86 to 0.97)``: how many of those known are true, with Wilson's 95 % interval of the share."""
    known = values.dropna().astype(bool)
    if not len(known):
        return ""
    interval = binomtest(int(known.sum()), len(known)).proportion_ci(0.95, method="wilson")
    return f"{known.sum()}/{len(known)} ({interval.low:.2f} to {interval.high:.2f})"


def count(rows: Sequence[Row]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Figures by number of records, and the outcomes."""
    outcomes = pd.DataFrame([outcome(row) for row in rows])
    classes = [(f"{low} to {high}", outcomes[outcomes["records"].between(low, high)]) for low, high in SIZES]
    return pd.DataFrame([_figures(label, runs) for label, runs in [*classes, ("all", outcomes)] if len(runs)]), outcomes


def _figures(records: str, runs: pd.DataFrame) -> Row:
    statements = int(runs["statements"].sum())
    return {
        "records": records,
        "files": len(runs),
        "errors": int(runs["error"].notna().sum()),
        "sure and wrong": rate(runs["wrong"]),
        "named where nothing is hidden": rate(runs["named"]),
        "hidden cause named": rate(runs["alike"]),
        "explained": rate(runs.loc[runs["true"] != "none", "sure"]),
        "stated minus true": f"{runs['over'].sum() / statements:+.3f}" if statements else "",
        "of statements": statements,
        "median CPU s": f"{runs['seconds'].median():.1f}",
    }


def table(counted: pd.DataFrame) -> str:
    """The figures as Markdown."""
    rows = [list(counted.columns), ["---"] * counted.shape[1], *counted.astype(str).to_numpy().tolist()]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)
