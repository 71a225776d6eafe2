"""Pictures of a study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from blind.study.evaluate import oracle_power

Row = dict[str, Any]


def draw(found: Row, judged: pd.DataFrame, table: pd.DataFrame, folder: Path) -> None:
    """``confusion.png``, ``power.png``, ``reliability.png`` and ``gain.png``, each where the study has the runs for it."""
    if not table.empty:
        side = 0.42 * max(table.shape) + 3.0
        _save(folder / "confusion.png", (side, side), lambda axes: _confusion(axes, table))
    if found["power"]["runs"]:
        _save(folder / "power.png", (7.0, 4.8), lambda axes: _power(axes, found["power"], judged))
    if found["probabilities"]["findings"]["statements"]:
        _save(folder / "reliability.png", (5.2, 5.0), lambda axes: _reliability(axes, found["probabilities"]))
    if found["gain"]["n"]:
        _save(folder / "gain.png", (5.2, 5.0), lambda axes: _gain(axes, judged))


def _save(path: Path, size: tuple[float, float], fill: Any) -> None:
    figure = Figure(figsize=size, layout="constrained")
    fill(figure.add_subplot())
    figure.savefig(path, dpi=130)


def _confusion(axes: Axes, table: pd.DataFrame) -> None:
    table = table.reindex(columns=[*table.index, *sorted(set(table.columns) - set(table.index))], fill_value=0)
    share = table.div(table.sum(axis=1), axis=0).to_numpy()
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(table.shape[1]), list(table.columns), rotation=90)
    axes.set_yticks(range(table.shape[0]), list(table.index))
    for (i, j), n in np.ndenumerate(table.to_numpy()):
        if n:
            axes.text(j, i, str(n), ha="center", va="center", color="white" if share[i, j] > 0.5 else "black", fontsize=8)
    axes.set(xlabel="strongest finding", ylabel="hidden cause", title="single faults [runs]")


def _power(axes: Axes, power: Row, judged: pd.DataFrame) -> None:
    for what, label, marker in [
        ("noticed", "noticed", "o"),
        ("right", "cause and joint named", "s"),
        ("oracle_right", "named by the oracle", "^"),
    ]:
        bins = [b for b in power["bins"] if b[what]["n"]]
        x, y = np.array([b["lambda"] for b in bins]), np.array([b[what]["share"] for b in bins])
        low, high = (np.array([b[what][end] for b in bins]) for end in ("low", "high"))
        axes.errorbar(x, y, [np.maximum(y - low, 0), np.maximum(high - y, 0)], fmt=marker, capsize=2, label=label, alpha=0.8)
    x = np.geomspace(0.5, 1e4, 200)
    q = judged.loc[(judged["kind"] == "single") & judged["lambda"].notna(), "columns"].dropna().to_numpy(float)
    counts = np.unique(q, return_counts=True)
    mean = sum(n * oracle_power(x, np.full(len(x), c)) for c, n in zip(*counts, strict=True)) / len(q)
    axes.plot(x, mean, "k-", lw=1, label=f"oracle's test, α = {power['alpha']:g}")
    axes.set(xscale="log", xlabel="λ of the hidden fault [1]", ylabel="share of runs [1]", ylim=(-0.03, 1.03))
    axes.axhline(0.8, color="0.8", lw=0.8)
    axes.legend(loc="lower right", fontsize=8)


def _reliability(axes: Axes, probabilities: Row) -> None:
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for (name, r), marker in zip(probabilities.items(), ("o", "s"), strict=True):
        x, y = np.array([b["stated"] for b in r["bins"]]), np.array([b["share"] for b in r["bins"]])
        low, high = (np.array([b[end] for b in r["bins"]]) for end in ("low", "high"))
        axes.errorbar(
            x,
            y,
            [np.maximum(y - low, 0), np.maximum(high - y, 0)],
            fmt=marker,
            capsize=2,
            label=name.replace("_", " "),
            fillstyle="none",
        )
    axes.set(xlabel="stated probability [1]", ylabel="share that is true [1]", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
    axes.legend(fontsize=8)


def _gain(axes: Axes, judged: pd.DataFrame) -> None:
    runs = judged[judged["gain"].notna() & judged["gain_fresh"].notna()]
    span = [min(0.0, float(runs[["gain", "gain_fresh"]].min().min())), 1.0]
    axes.fill_between(span, [s - 0.05 for s in span], [s + 0.05 for s in span], color="0.92", label="± 0.05")
    axes.plot(span, span, color="0.7", lw=1)
    for name, part in runs.groupby("experiment"):
        axes.scatter(part["gain_fresh"], part["gain"], s=12, label=str(name), alpha=0.7)
    axes.set(xlabel="gain on fresh data [1]", ylabel="gain as stated, held-out records [1]")
    axes.legend(fontsize=8)
