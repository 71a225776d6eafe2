"""What a study found: ``study.md``, ``study.json``, ``wrong.csv``, pictures, and a table at the shell."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

import aacmm_pin
from blind.study import figures, regimes
from blind.study.evaluate import confusion, evaluate

Row = dict[str, Any]
SHOWN = ["true", "true_kind", "said", "probability", "verdict", "said_depends_on", "lambda", "retained", "aliases"]

RIGHT = """Rates with their Wilson 95 % intervals. A right answer is: cause and joint of the hidden fault as the strongest
finding (single); both faults among the findings (pair); nothing said (nothing); the verdict `unexplained` with the covariate
named (outside). False findings are findings that are not hidden, wherever they stand."""
COLUMNS = """`strict`: right; `alias`: right, or a cause that no method could tell from it (cosine over 0.95; a curve, which
any encoder error looks like, is not excused); `listed`: strongest or among its stated aliases; `alone`: right and nothing
else; `oracle`: the likeliest cause of the oracle is the hidden one."""

REGIMES = """Files of many arms and kinds of evidence (`tests/blind/regimes.py`), by number of records. `sure and wrong`: of
the verdicts `explained`, those that name a cause that is neither hidden nor, by the cosine of the effects beside all that is
refitted (over 0.95), the same as a hidden one; an `inconclusive` verdict is an abstention. `hidden cause named`: one of the
hidden causes, or the same as one, is among the findings, whatever the verdict. `stated minus true`: mean of the stated
probabilities less the share of the names that are those of hidden causes: a probability is of this very name, so that one
which is only like a hidden cause does not count here."""


def version() -> str:
    """Of the package, with the commit where there is one."""
    command = ["git", "describe", "--always", "--dirty"]
    said = subprocess.run(command, cwd=Path(aacmm_pin.__file__).parent, capture_output=True, text=True, check=False)
    return f"{aacmm_pin.__version__} {said.stdout.strip()}".strip()


def report(rows: Sequence[Row], folder: Path, about: Row) -> None:
    """Writes all files into ``folder``; ``about``: date, command, version."""
    if of_regimes := [row for row in rows if row["kind"] == "regime"]:
        counted, outcomes = regimes.count(of_regimes)
        outcomes.to_csv(folder / "regimes.csv", index=False)
        (folder / "regimes.json").write_text(json.dumps({"about": about, "records": counted}, indent=1) + "\n")
        print(_markdown(regimes_table(counted)))
    if rows := [row for row in rows if row["kind"] != "regime"]:
        _report(rows, folder, about)


def tables(rows: Sequence[Row]) -> str:
    """The headline of each experiment, and the files of many arms by number of records, as Markdown."""
    of_regimes = [row for row in rows if row["kind"] == "regime"]
    parts = []
    if others := [row for row in rows if row["kind"] != "regime"]:
        shown = [
            "experiment",
            "runs",
            "right answer",
            "with false findings",
            "oracle",
            "verdicts",
            "good excluded",
            "errors",
        ]
        parts += [RIGHT, "", _markdown(_headline(evaluate(others)[0])[shown]), ""]
    if of_regimes:
        parts += [REGIMES, "", _markdown(regimes_table(regimes.count(of_regimes)[0])), ""]
    return "\n".join(parts)


def regimes_table(counted: Sequence[Row]) -> pd.DataFrame:
    """Of :func:`blind.study.regimes.count`, for people."""
    return pd.DataFrame(
        [
            {
                "records": c["records"],
                "files": c["files"],
                "errors": c["errors"],
                "sure and wrong": said(c["sure_and_wrong"]),
                "named where nothing is hidden": said(c["named_where_nothing_is"]),
                "hidden cause named": said(c["right"]),
                "explained": said(c["sure"]),
                "stated minus true": "" if c["mean_stated_minus_true"] is None else f"{c['mean_stated_minus_true']:+.3f}",
                "of statements": c["statements"],
                "median CPU s": f"{c['median_seconds']:.1f}",
            }
            for c in counted
        ]
    )


def _report(rows: Sequence[Row], folder: Path, about: Row) -> None:
    found, judged = evaluate(rows)
    seeds = {str(name): [int(runs.min()), int(runs.max())] for name, runs in judged.groupby("experiment")["seed"]}
    about = about | {"seeds": seeds}
    (folder / "study.json").write_text(json.dumps({"about": about, **found}, indent=1) + "\n", encoding="utf-8")
    judged.to_csv(folder / "judged.csv", index=False)
    wrong = judged.loc[~judged["answer"], ["experiment", "seed", "size", *SHOWN, "oracle_said", "error", "fresh_error"]]
    wrong.to_csv(folder / "wrong.csv", index=False)
    table = confusion(judged)
    (folder / "study.md").write_text(text(found, table, about), encoding="utf-8")
    figures.draw(found, judged, table, folder)
    shell(found, folder, len(wrong))


def text(found: Row, table: pd.DataFrame, about: Row) -> str:
    """The page."""
    parts = ["# Hidden faults: what was found", "", *(f"- {name}: {_plainly(value)}" for name, value in about.items()), ""]
    parts += [RIGHT, ""]
    parts += [_markdown(_headline(found)), "", "## Single faults", "", _markdown(_details(found, "single")), ""]
    parts += [COLUMNS, ""]
    parts += ["## Pairs", "", _markdown(_details(found, "pair")), "", "## Outside the library", ""]
    parts += [_markdown(_details(found, "outside")), "", "## By cause", "", _markdown(_by_cause(found)), ""]
    if not table.empty:
        parts += ["## Confusion", "", _markdown(table.reset_index()), ""]
    return "\n".join(parts + _power(found["power"]) + _stated(found)) + "\n"


def _headline(found: Row) -> pd.DataFrame:
    rows = []
    for name, e in found["experiments"].items():
        rows.append({"experiment": name, "runs": e["runs"], "right answer": said(e["rates"]["answer"])})
        rows[-1] |= {"with false findings": said(e["with_false_findings"]), "oracle": said(e["oracle_right"])}
        rows[-1] |= {"verdicts": _plainly(e["verdicts"]), "median λ": _number(e["median_lambda"])}
        bad, all_bad = e["outliers_found"]
        rows[-1] |= {"outliers found": f"{bad}/{all_bad}" if all_bad else "", "good excluded": e["good_excluded"]}
        rows[-1] |= {"CPU s": _number(e["median_seconds"]), "errors": e["errors"]}
    return pd.DataFrame(rows)


def _details(found: Row, kind: str) -> pd.DataFrame:
    names = {"right": "strict", "right_or_alias": "alias"}
    rows = []
    for name, e in found["experiments"].items():
        if e["kind"] == kind:
            rates = {names.get(what, what): said(r) for what, r in e["rates"].items() if what != "answer"}
            rows.append({"experiment": name, **rates, **({"oracle": said(e["oracle_right"])} if kind == "single" else {})})
    return pd.DataFrame(rows)


def _by_cause(found: Row) -> pd.DataFrame:
    """Right answers of every experiment, a column each."""
    shares = {name: {c: said(r, False) for c, r in e["by_cause"].items()} for name, e in found["experiments"].items()}
    wanted = [name for name, e in found["experiments"].items() if e["kind"] in ("single", "outside")]
    table = pd.DataFrame({name: shares[name] for name in wanted})
    return table.fillna("").rename_axis("cause").reset_index()


def _power(power: Row) -> list[str]:
    if not power["runs"]:
        return []
    rows = [
        {
            "λ": f"{b['low']:g} to {_number(b['high']) or '∞'}",
            "noticed": said(b["noticed"]),
            "oracle's test": f"{b['oracle_power']:.2f}",
            "named": said(b["right"]),
            "named or alias": said(b["right_or_alias"]),
            "oracle names": said(b["oracle_right"]),
            "oracle names or alias": said(b["oracle_right_or_alias"]),
        }
        for b in power["bins"]
    ]
    at = {name: _number(fit["lambda"]) or "outside the data" for name, fit in power["at_80"].items()}
    told = ", ".join(f"{name} {value}" for name, value in at.items())
    last = f"λ at 80 %: {told}; the oracle's test (α = {power['alpha']}) {power['oracle_lambda_at_80']:.1f}."
    return ["## Power", "", _markdown(pd.DataFrame(rows)), "", last, ""]


def _stated(found: Row) -> list[str]:
    parts = ["## Stated probabilities", ""]
    for name, r in found["probabilities"].items():
        if r["statements"]:
            bins = pd.DataFrame([{"stated": f"{b['stated']:.4f}", "true": said(b)} for b in r["bins"]])
            parts += [f"{name}: {r['statements']} statements, mean stated minus true {r['mean_stated_minus_true']:+.3f}, "
                      f"Brier score {r['brier']:.3f}", "", _markdown(bins), ""]  # fmt: skip
    c = found["coverage"]
    rows = [
        {"parameter": name, "held": said(r), "median z": f"{r['median_z']:.2f}", "rms z": f"{r['rms_z']:.2f}"}
        for name, r in c["by_parameter"].items()
    ]
    parts += [
        "## Stated uncertainties",
        "",
        f"value ± 1.96 u holds the truth: {said(c['all'])}",
        "",
        _markdown(pd.DataFrame(rows)),
    ]
    parts += ["", f"without a counterpart in the truth: {_plainly(c['without_truth']) or 'none'}", ""]
    g = found["gain"]
    if g["n"]:
        parts += [
            "## Stated gain and gain on fresh data",
            "",
            f"{g['n']} runs (and {g['refused']} whose fresh data a command refused): "
            f"stated minus fresh {g['mean_stated_minus_fresh']:+.3f} in the mean, "
            f"{g['median_absolute_difference']:.3f} apart in the median; within ±0.05: {said(g['within_0.05'])}; "
            f"fresh gain in the stated interval: {said(g['in_stated_interval'])}; "
            f"fresh RMS of the extended arm over the noise floor: {g['fresh_rms_over_noise']:.3f}",
            "",
        ]
    return [*parts, f"CPU time of a diagnosis: {_plainly(found['cpu_seconds'])} s"]


def said(r: Row, interval: bool = True) -> str:
    """``93/100 (0.86 to 0.97)``."""
    if not r["n"]:
        return ""
    return f"{r['k']}/{r['n']}" + (f" ({r['low']:.2f} to {r['high']:.2f})" if interval else "")


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _plainly(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_plainly(content)}" for name, content in value.items())
    if isinstance(value, list):
        return " to ".join(map(_plainly, value)) if len(value) == 2 else ", ".join(map(_plainly, value))
    return str(value)


def _markdown(table: pd.DataFrame) -> str:
    if table.empty:
        return "none"
    lines = [[str(name) for name in table.columns], ["---"] * len(table.columns)]
    lines += [["" if pd.isna(v) else str(v) for v in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def shell(found: Row, folder: Path, wrong: int) -> None:
    """The headline in colours, and where the rest is."""
    headline = _headline(found)[["experiment", "right answer", "with false findings", "CPU s", "errors"]]
    table = Table(*headline.columns, title="hidden faults")
    for row in headline.itertuples(index=False):
        table.add_row(*map(str, row))
    Console().print(table)
    print(f"{found['runs']} runs, {wrong} not answered right: {folder / 'wrong.csv'}; all figures: {folder / 'study.md'}")
