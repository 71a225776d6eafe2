"""One run on a file of :mod:`blind.regimes`, and the counts over many: errors, sure wrong names, stated probabilities."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from blind.likeness import LEAST, Likeness
from blind.regimes import SIZES, RegimeFile, regime_file
from blind.study.evaluate import rate
from blind.study.judge import key_of

Row = dict[str, Any]


def truth_of(file: RegimeFile, said: Row | None) -> Row:
    """What was hidden; the aliases are those of the causes that were named."""
    likeness = Likeness(file) if file.hidden else None
    findings = (said or {}).get("findings", [])
    hidden = []
    for fault in file.hidden:
        assert likeness is not None
        seat = fault.parameters.get("seat")
        row: Row = {"cause": fault.cause, "joint": fault.joint, "parameters": dict(fault.parameters)}
        row |= {"key": fault.key if seat is None else f"{fault.cause}:{seat}", "size_um": fault.size_um}
        row |= {"lambda": likeness.visible(fault), "depends_on": [], "retained_fraction": None, "columns": None}
        cosines = {key_of(f): likeness.cosine(fault, f) for f in findings if key_of(f) != row["key"]}
        hidden.append(row | {"aliases": {key: c for key, c in cosines.items() if c > LEAST}, "cosines": cosines})
    return {"hidden": hidden, "outliers": list(file.outliers), "probabilities": None}


def excused(row: Row) -> set[str]:
    """Names that are right or nobody could tell from a hidden cause; a free curve is no better name for anything else."""
    hidden = row["truth"]["hidden"]
    alike = {key for h in hidden for key in h["aliases"] if not key.startswith("joint_error_curve")}
    return {h["key"] for h in hidden} | alike


def outcome(row: Row) -> Row:
    """What a run came to, in one flat row.

    ``sure`` is the verdict ``explained``; ``wrong`` a sure verdict with a name that is not excused; ``named`` that nothing
    was hidden and a cause was named; ``right`` that a hidden cause, or one alike, is named.
    """
    said, regime = row["said"] or {}, row["regime"]
    names = [key_of(f) for f in said.get("findings", [])]
    verdict, hidden, right = said.get("verdict"), row["truth"]["hidden"], excused(row)
    sure = verdict == "explained"
    return {
        "experiment": row["experiment"],
        "seed": row["seed"],
        "arm": regime["arm"],
        "evidence": regime["evidence"],
        "records": regime["records"],
        "error": row["error"],
        "verdict": verdict or "error",
        "true": " + ".join(h["key"] for h in hidden) or "none",
        "said": " + ".join(names) or "none",
        "sure": sure,
        "wrong": sure and not set(names) <= right,
        "right": bool(set(names) & right) if hidden else not names and verdict in ("no-discrepancy", "inconclusive"),
        "named": not hidden and bool(names) and verdict != "inconclusive",
        "probability": [f.get("probability") for f in said.get("findings", [])],
        "true_names": [name in {h["key"] for h in hidden} for name in names],
        "seconds": row["seconds"],
    }


def perform(arguments: Row, command: Callable[..., str], limit: AbstractContextManager[None]) -> Row:
    """The row of a seed and what else is given; ``command`` runs ``aacmm-pin``, ``limit`` bounds its time."""
    file = _drawn(arguments)
    row: Row = {"seed": arguments["seed"], "arguments": arguments, "regime": vars(file.regime)}
    row |= {"error": None, "said": None, "fresh": None}
    with TemporaryDirectory() as name:
        file.write(Path(name))
        start = time.process_time()
        try:
            with limit:
                row["said"] = json.loads(command("diagnose", *file.words(Path(name)), "--json", "-"))
        except Exception as error:  # whatever breaks inside is what the study is about
            row["error"] = str(error) or repr(error)
        row["seconds"] = round(time.process_time() - start, 3)
    return row | {"truth": truth_of(file, row["said"])}


def _drawn(arguments: Row) -> RegimeFile:
    """The file of a seed; of another far away where the arm finds too few postures at the seats that this one draws."""
    for tried in range(TRIES):
        try:
            return regime_file(**(arguments | {"seed": arguments["seed"] + tried * FAR_AWAY}))
        except ValueError:
            if tried == TRIES - 1:
                raise
    raise AssertionError


TRIES = 10
FAR_AWAY = 10_000_000


def count(rows: Sequence[Row]) -> tuple[list[Row], pd.DataFrame]:
    """Figures by number of records, the last over all; and the outcomes."""
    outcomes = pd.DataFrame([outcome(row) for row in rows])
    classes = [(f"{low} to {high}", low, high) for low, high in SIZES] + [("all", 0, SIZES[-1][1])]
    figures = []
    for name, low, high in classes:
        runs = outcomes[outcomes["records"].between(low, high)]
        if runs.empty:
            continue
        stated = [
            (p, t)
            for ps, ts in zip(runs["probability"], runs["true_names"], strict=True)
            for p, t in zip(ps, ts, strict=True)
        ]
        off = [p - t for p, t in stated if p is not None]
        nothing, something = runs[runs["true"] == "none"], runs[runs["true"] != "none"]
        figures.append(
            {
                "records": name,
                "files": len(runs),
                "errors": int(runs["error"].notna().sum()),
                "sure_and_wrong": rate(runs.loc[runs["sure"], "wrong"]),
                "named_where_nothing_is": rate(nothing["named"]),
                "right": rate(something["right"]),
                "sure": rate(something["sure"]),
                "statements": len(off),
                "mean_stated_minus_true": sum(off) / len(off) if off else None,
                "median_seconds": float(runs["seconds"].median()),
            }
        )
    return figures, outcomes
