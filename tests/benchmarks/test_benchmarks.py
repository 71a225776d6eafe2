"""The command of the benchmarks writes whole files."""

import json

import pytest

from aacmm_pin._support.compiled import NEVER, VARIABLE
from tests.benchmarks import operations
from tests.benchmarks.__main__ import main
from tests.benchmarks.operations import OPERATIONS, TARGETS, Row


def test_cheapest_operation(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, NEVER)
    data, page = tmp_path / "speed.json", tmp_path / "speed.md"
    main(["--json", str(data), "--page", str(page), "--only", "sensitivities", "--quick"])
    report = json.loads(data.read_text())
    assert {"commit", "date", "machine", "command", "versions"} < set(report)
    (operation,) = report["operations"]
    ours, *others = operation["rows"]
    assert ours["who"] == "aacmm_pin"
    assert ours["ours_over_this"] == 1
    assert others[-1]["cpu_s"] > 0
    assert others[-1]["ours_over_this"] == pytest.approx(ours["cpu_s"] / others[-1]["cpu_s"])
    text = page.read_text()
    assert all(text.count(f"| {row['what']} | {row['who']} |") == 1 for row in operation["rows"])


def test_targets(monkeypatch):
    assert {operation for operation, *_ in TARGETS} <= set(OPERATIONS)
    monkeypatch.setattr(
        operations, "TARGETS", {("maps", "a map", "C"): 2.0, ("maps", "large", "us"): 1e9}
    )
    rows = [
        Row("a map", "C", 1.0, None, 2.5),
        Row("a map", "C", 1.0, None, 2.0),
        Row("large", "us", 1.0, 2 * 10**9),
    ]
    assert [row.judged("maps")["reached"] for row in rows] == [False, True, False]
    assert rows[0].judged("volumes")["reached"] is None
