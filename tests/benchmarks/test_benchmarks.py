"""The command of the benchmarks writes whole files."""

import json

import pytest

from aacmm_pin._support.compiled import NEVER, VARIABLE
from tests.benchmarks.__main__ import main


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
    assert "<!-- generated: code-age " in text
    assert all(text.count(f"| {row['what']} | {row['who']} |") == 1 for row in operation["rows"])
