"""What was said beside what is true: ``outcome(row)``, one flat row for each run; ``count`` and
``table``, the counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binomtest

from blind.regimes import SIZES

Row = dict[str, Any]
CURVE = "joint_error_curve"
"""Any function of one angle: whatever an encoder does looks like it, and yet it is no better name
for that.
"""
NAMED, SURE = 0.5, 0.95
"""Probabilities from which a cause counts as named, and as named surely."""
SEEN = 0.9
"""Power of the oracle from which a cause counts as one that the records show."""
STRUCTURE_SEEN = 50.0
"""λ of structure from which the records show it: smooth functions with 20 parameters have power 0.9
at 1e-4.
"""
BINS = ((0.5, 0.8), (0.8, 0.95), (0.95, 1.0))
"""Of stated probabilities."""
PLACE = ("x", "y", "z")


def key_of(finding: Row) -> str:
    """``cause``, ``cause:joint`` or ``seat_error:P4``."""
    at = next(
        (finding[name] for name in ("joint", "link", "seat") if finding.get(name) is not None), None
    )
    return str(finding["cause"]) if at is None else f"{finding['cause']}:{at}"


def covariates_of(said: Row) -> set[str]:
    """What the residuals are said to depend on: ``joint 2``, ``x``, ``humidity_pct``."""
    unexplained = said.get("unexplained") or {}
    names = set(unexplained.get("depends_on", []))
    names |= {f"joint {each['joint']}" for each in unexplained.get("scattered_readings", [])}
    for part in said.get("discrepancy", []):
        if part["probability"] >= NAMED:
            names |= set(str(part["covariate"]).split(" × "))
    return names | set(PLACE) if "place" in names else names


def outcome(row: Row) -> Row:
    """What a run came to; None where a question does not arise. A cause is named from a probability
    of :data:`NAMED` on.

    - ``sure``: the verdict is ``explained``; ``wrong``: and a name is neither hidden nor like
      something hidden;
    - ``named``: a cause is named where nothing is hidden (an ``inconclusive`` verdict is an
      abstention);
    - ``alike``: one of the hidden causes, or one that nobody could tell from it (a free curve is
      not excused), is named;
    - ``right``: ``alike``, or nothing named where nothing is hidden;
    - ``seen``, ``found``: hidden causes that the oracle sees, and those of them that are named
      surely;
    - ``apart``, ``found apart``: of these, those that no other cause of the library could be;
    - ``false``: names that are neither hidden nor like something hidden;
    - ``structure named``: what is said of the unexplained holds all covariates of a structure
      outside the library that the records show;
    - ``stated``, ``hits``: the stated probability of each finding, and whether it is of a hidden
      cause.
    """
    hidden, said, error = row["truth"]["hidden"], row["said"] or {}, row["error"]
    findings, verdict = said.get("findings", []), said.get("verdict", "error")
    stated = {key_of(f): float(f["probability"]) for f in findings}
    names, true = {key for key, p in stated.items() if p >= NAMED}, {h["key"] for h in hidden}
    excused = true | {key for h in hidden for key in h["aliases"] if not key.startswith(CURVE)}
    alike = bool(excused & names)
    structure = row["truth"]["structure"]
    silent = not names and verdict in (
        "no-discrepancy",
        "inconclusive",
        *(["unexplained"] if structure else []),
    )
    seen = [h for h in hidden if h["power"] >= SEEN]
    found = [h for h in seen if stated.get(h["key"], 0.0) >= SURE]
    return {
        "seed": row["seed"],
        "family": row["family"],
        "arm": row["regime"]["arm"],
        "evidence": row["regime"]["evidence"],
        "records": row["regime"]["records"],
        "error": error,
        "verdict": verdict,
        "true": " + ".join(h["key"] for h in hidden) or "none",
        "structure": structure["kind"] if structure else "",
        "size": structure["times_noise"] if structure else 0.0,
        "said": " + ".join(f"{key} ({p:.2f})" for key, p in stated.items()) or "none",
        "depends on": " + ".join(sorted(covariates_of(said))),
        "lambda": hidden[0]["lambda"] if hidden else None,
        "sure": verdict == "explained",
        "wrong": not names <= excused if verdict == "explained" else None,
        "named": None if hidden else bool(names) and verdict != "inconclusive",
        "alike": alike if hidden else None,
        "right": error is None and (alike if hidden else silent),
        "seen": len(seen),
        "found": len(found),
        "apart": sum(not h["rivals"] for h in seen),
        "found apart": sum(not h["rivals"] for h in found),
        "false": len(names - excused),
        "structure named": _all_named(structure, said),
        "stated": [*stated.values()],
        "hits": [key in true for key in stated],
        "seconds": row["seconds"],
    }


def _all_named(structure: Row | None, said: Row) -> bool | None:
    """None if there is no structure, or none that records show or a covariate names."""
    if structure is None or structure["lambda"] < STRUCTURE_SEEN or not structure["covariates"]:
        return None
    return set(structure["covariates"]) <= covariates_of(said)


def rate(values: pd.Series) -> str:
    """``93/100 (0.86 to 0.97)``: how many of those known are true, with Wilson's 95 % interval of
    the share.
    """
    known = values.dropna().astype(bool)
    return share(int(known.sum()), len(known))


def share(hits: int, of: int) -> str:
    """As :func:`rate`."""
    if not of:
        return ""
    interval = binomtest(hits, of).proportion_ci(0.95, method="wilson")
    return f"{hits}/{of} ({interval.low:.2f} to {interval.high:.2f})"


def overstated(runs: pd.DataFrame) -> str:
    """Mean of stated probabilities less the share of true names, and its 95 % interval; names of
    one file go together.
    """
    gaps = np.array([sum(stated) - sum(hits) for stated, hits in _statements(runs)])
    counts = np.array([len(stated) for stated, _ in _statements(runs)])
    total = int(counts.sum())
    if not total:
        return ""
    mean = float(gaps.sum()) / total
    files = max(2, int((counts > 0).sum()))
    half = 1.96 * float(np.sqrt(files / (files - 1) * ((gaps - mean * counts) ** 2).sum())) / total
    return f"{mean:+.3f} ± {half:.3f}"


def binned(runs: pd.DataFrame, low: float, high: float) -> str:
    """``stated 0.87, true 5/6 (0.44 to 0.97)``: mean of the stated probabilities in a bin, and how
    many of these names are true.
    """
    both = [
        (p, hit) for stated, hits in _statements(runs) for p, hit in zip(stated, hits, strict=True)
    ]
    inside: NDArray[np.float64] = np.array(
        [pair for pair in both if low <= pair[0] < high or pair[0] == high == 1.0]
    )
    if not len(inside):
        return ""
    return f"stated {inside[:, 0].mean():.2f}, true {share(int(inside[:, 1].sum()), len(inside))}"


def _statements(runs: pd.DataFrame) -> Iterator[tuple[list[float], list[bool]]]:
    return zip(runs["stated"], runs["hits"], strict=True)


def count(rows: Sequence[Row]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Figures of one family by class, and the outcomes."""
    outcomes = pd.DataFrame([outcome(row) for row in rows])
    classes = [*_classes(outcomes), ("all", outcomes)]
    counted = pd.DataFrame(
        [{"class": label} | _figures(runs) for label, runs in classes if len(runs)]
    )
    return counted.loc[:, (counted != "").any()], outcomes


def _classes(outcomes: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """By number of records; beside structure outside the library by its size over that of the
    noise.
    """
    family = outcomes["family"].iloc[0]
    if family == "regimes":
        return [
            (f"{low} to {high} records", outcomes[outcomes["records"].between(low, high)])
            for low, high in SIZES
        ]
    if family.startswith("outside"):
        return [(f"{size:g} × noise", runs) for size, runs in outcomes.groupby("size")]
    if family == "held-postures":
        return [
            (f"{faults} hidden", runs)
            for faults, runs in outcomes.groupby(outcomes["true"].ne("none").astype(int))
        ]
    return []


def _figures(runs: pd.DataFrame) -> Row:
    faulty = runs["true"] != "none"
    return {
        "files": len(runs),
        "errors": int(runs["error"].notna().sum()),
        "right": rate(runs["right"]),
        "explained": rate(runs.loc[faulty, "sure"]),
        "explained, false name": rate(runs["wrong"]),
        "false alarms": rate(runs["named"]),
        "hidden cause named": rate(runs["alike"]),
        "detectable causes named": share(int(runs["found"].sum()), int(runs["seen"].sum())),
        "distinct causes named": share(int(runs["found apart"].sum()), int(runs["apart"].sum())),
        "files with false names": rate(runs["false"] > 0),
        "structure named": rate(runs["structure named"]),
        "names": sum(map(len, runs["stated"])),
        "stated minus true": overstated(runs),
        **{f"{low:g} to {high:g}": binned(runs, low, high) for low, high in BINS},
        "median CPU s": f"{runs['seconds'].median():.1f}",
    }


def table(counted: pd.DataFrame) -> str:
    """The figures as Markdown."""
    rows = [
        list(counted.columns),
        ["---"] * counted.shape[1],
        *counted.astype(str).to_numpy().tolist(),
    ]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)
