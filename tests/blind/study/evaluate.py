"""Rates, curves and intervals from the table of runs; nothing here runs or draws anything."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize
from scipy.stats import binomtest, chi2, ncx2

from blind.study.judge import intervals, judge, statements

Row = dict[str, Any]
ALPHA = 0.01
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 1.0)
"""Of stated probabilities."""
LEVEL = 0.8
"""Power at which λ is compared."""


def rate(values: pd.Series) -> Row:
    """Share of true values with its Wilson 95 % interval; None for no values at all."""
    n, k = len(values), int(values.astype(bool).sum())
    if n == 0:
        return {"n": 0, "k": 0, "share": None, "low": None, "high": None}
    interval = binomtest(k, n).proportion_ci(0.95, method="wilson")
    return {"n": n, "k": k, "share": k / n, "low": float(interval.low), "high": float(interval.high)}


COUNTED = {
    "single": ("right", "right_or_alias", "listed", "alone", "cause_right", "silent", "verdict_unexplained"),
    "pair": ("all_named", "any_named", "right", "alone"),
    "nothing": ("silent", "noticed"),
    "outside": ("answer", "verdict_unexplained", "depends_right", "depends_all"),
}
"""Columns of :func:`judge` that are counted for each kind of experiment."""


def by_experiment(judged: pd.DataFrame) -> dict[str, Row]:
    """For each experiment its rates, and means of what has no rate."""
    out = {}
    for name, runs in judged.groupby("experiment", sort=False):
        kind = runs["kind"].iloc[0]
        asked = runs.loc[runs["oracle_right"].notna(), "oracle_right"]
        out[str(name)] = {
            "kind": kind,
            "runs": len(runs),
            "errors": int(runs["error"].notna().sum()),
            "rates": {"answer": rate(runs["answer"])} | {what: rate(runs[what]) for what in COUNTED[kind]},
            "with_false_findings": rate(runs["false_findings"] > 0),
            "oracle_right": rate(asked),
            "verdicts": {str(k): int(v) for k, v in runs["verdict"].value_counts().items()},
            "median_lambda": _median(runs["lambda"]),
            "median_seconds": _median(runs["seconds"]),
            "outliers_found": [int(runs["outliers_found"].sum()), int(runs["outliers"].sum())],
            "good_excluded": int(runs["good_excluded"].sum()),
            "by_cause": {str(c): rate(part["answer"]) for c, part in runs.groupby(_cause_or_kind(runs))},
        }
    return out


def _cause_or_kind(runs: pd.DataFrame) -> pd.Series:
    return runs["true_cause"].where(runs["true_kind"] == "", runs["true_cause"] + ":" + runs["true_kind"])


def _median(values: pd.Series) -> float | None:
    known = values.dropna().astype(float)
    return None if known.empty else float(known.median())


def confusion(judged: pd.DataFrame) -> pd.DataFrame:
    """Runs by true cause and strongest finding; the right cause at a wrong joint stands in a column of its own."""
    runs = judged[(judged["kind"] == "single") & judged["error"].isna()]
    misplaced = (runs["said_cause"] == runs["true_cause"]) & ~runs["right"].astype(bool)
    return pd.crosstab(runs["true_cause"], runs["said_cause"].mask(misplaced, "other joint"))


def oracle_power(lambda_: ArrayLike, columns: ArrayLike, alpha: float = ALPHA) -> np.ndarray:
    """P(χ²_q(λ) > χ²_{q, 1-α}) for each λ with its number q of columns."""
    q = np.asarray(columns, dtype=float)
    return np.asarray(ncx2.sf(chi2.isf(alpha, q), q, np.maximum(np.asarray(lambda_, dtype=float), 1e-12)))


def oracle_lambda(columns: ArrayLike, level: float = LEVEL, alpha: float = ALPHA) -> float:
    """λ at which the oracle's power, as a mean over the given numbers of columns, is ``level``."""
    q = np.asarray(columns, dtype=float)
    return float(brentq(lambda x: oracle_power(np.full(len(q), x), q, alpha).mean() - level, 1e-6, 1e4))


def logistic_lambda(lambda_: ArrayLike, true: ArrayLike, level: float = LEVEL) -> Row:
    """λ at which a logistic curve in ln λ, fitted to what was right, reaches ``level``; None outside the data."""
    x, y = np.log(np.maximum(np.asarray(lambda_, dtype=float), 1e-6)), np.asarray(true, dtype=float)
    if len(x) < 10 or y.min() == y.max():
        return {"lambda": None, "intercept": None, "slope": None, "n": len(x)}
    middle, width = x.mean(), max(x.std(), 1e-9)

    def loss(p: np.ndarray) -> float:
        t = p[0] + p[1] * (x - middle) / width
        return float(np.logaddexp(0.0, t).sum() - y @ t + 1e-3 * p @ p)  # the last term keeps a clean cut finite

    a, b = minimize(loss, np.array([0.0, 1.0])).x
    slope, intercept = b / width, a - b * middle / width
    at = (np.log(level / (1.0 - level)) - intercept) / slope if slope > 0.0 else np.inf
    inside = x.min() <= at <= x.max()
    return {"lambda": float(np.exp(at)) if inside else None, "intercept": intercept, "slope": slope, "n": len(x)}


def power(judged: pd.DataFrame) -> Row:
    """Noticed and named against λ, beside the oracle; single faults of which λ and columns are known."""
    runs = judged[(judged["kind"] == "single") & judged["error"].isna()].dropna(subset=["lambda", "columns"])
    if runs.empty:
        return {"runs": 0}
    edges = np.array([0.0, 3.0, 6.0, 10.0, 15.0, 22.0, 33.0, 50.0, 100.0, 300.0, 1000.0, np.inf])
    bins = []
    for low, high in pairwise(edges.tolist()):
        part = runs[(runs["lambda"] >= low) & (runs["lambda"] < high)]
        if len(part):
            asked = part.loc[part["oracle_right"].notna(), "oracle_right"]
            also = part.loc[part["oracle_right"].notna(), "oracle_right_or_alias"]
            expected = float(oracle_power(part["lambda"].to_numpy(float), part["columns"].to_numpy(float)).mean())
            rates = {what: rate(part[what]) for what in ("noticed", "right", "right_or_alias")}
            bins.append({"low": low, "high": None if np.isinf(high) else high, "lambda": float(part["lambda"].median())})
            bins[-1] |= rates | {"oracle_power": expected, "oracle_right": rate(asked), "oracle_right_or_alias": rate(also)}
    asked_all = runs[runs["oracle_right"].notna()]
    at = {what: logistic_lambda(runs["lambda"], runs[what]) for what in ("noticed", "right", "right_or_alias")}
    for what in ("oracle_right", "oracle_right_or_alias"):
        at[what] = logistic_lambda(asked_all["lambda"], asked_all[what].astype(bool))
    return {
        "runs": len(runs),
        "bins": bins,
        "at_80": at,
        "oracle_lambda_at_80": oracle_lambda(runs["columns"]),
        "alpha": ALPHA,
    }


def reliability(said: pd.DataFrame) -> Row:
    """Stated probabilities beside the share that is true."""
    if said.empty:
        return {"statements": 0}
    bins = []
    groups = pd.cut(said["probability"], list(BINS), include_lowest=True)
    for _, part in said.groupby(groups, observed=True):
        bins.append({"stated": float(part["probability"].mean()), **rate(part["true"])})
    off = said["probability"] - said["true"].astype(float)
    return {
        "statements": len(said),
        "bins": bins,
        "mean_stated_minus_true": float(off.mean()),
        "brier": float((off**2).mean()),
    }


def coverage(stated: pd.DataFrame) -> Row:
    """How often value ± 1.96 u holds the truth, by parameter; names without a counterpart apart."""
    if stated.empty:
        return {"all": rate(pd.Series(dtype=bool)), "by_parameter": {}, "without_truth": {}}
    known = stated[stated["z"].notna()]
    inside = known["z"].abs() <= 1.96
    by = {}
    for (cause, parameter), z in known["z"].groupby([known["cause"], known["parameter"]]):
        of_all = {"median_z": float(z.median()), "rms_z": float((z**2).mean() ** 0.5)}
        by[f"{cause}.{parameter}"] = rate(z.abs() <= 1.96) | of_all
    unknown = stated[stated["z"].isna()]
    names = (unknown["cause"] + "." + unknown["parameter"]).value_counts()
    return {"all": rate(inside), "by_parameter": by, "without_truth": {str(k): int(v) for k, v in names.items()}}


def gains(judged: pd.DataFrame) -> Row:
    """Gain as stated for held-out records beside that on fresh data."""
    runs = judged[judged["gain"].notna() & judged["gain_fresh"].notna()]
    refused = int(judged["fresh_error"].notna().sum())
    if runs.empty:
        return {"n": 0, "refused": refused}
    off = (runs["gain"] - runs["gain_fresh"]).astype(float)
    inside = (runs["gain_fresh"] >= runs["gain_low"]) & (runs["gain_fresh"] <= runs["gain_high"])
    return {
        "n": len(runs),
        "refused": refused,
        "mean_stated_minus_fresh": float(off.mean()),
        "median_absolute_difference": float(off.abs().median()),
        "within_0.05": rate(off.abs() <= 0.05),
        "in_stated_interval": rate(inside),
        "fresh_rms_over_noise": float((runs["fresh_rms_mm"] / runs["fresh_noise_mm"]).median()),
    }


def evaluate(rows: Sequence[Row]) -> tuple[Row, pd.DataFrame]:
    """All figures of the table, and the judged runs."""
    judged = pd.DataFrame([judge(row) for row in rows])
    inside = [row for row in rows if row["kind"] in ("single", "pair")]
    said = pd.DataFrame([s for row in inside for s in statements(row)])
    stated = pd.DataFrame([i for row in inside for i in intervals(row)])
    findings = said[said["what"] == "finding"] if len(said) else said
    figures = {
        "runs": len(rows),
        "experiments": by_experiment(judged),
        "power": power(judged),
        "probabilities": {"findings": reliability(findings), "findings_and_aliases": reliability(said)},
        "coverage": coverage(stated),
        "gain": gains(judged),
        "cpu_seconds": {"median": _median(judged["seconds"]), "longest": _longest(judged["seconds"])},
    }
    return figures, judged


def _longest(values: pd.Series) -> float | None:
    return None if values.dropna().empty else float(values.max())
