"""What the commands write for fixed inputs stays as it is."""

from __future__ import annotations

import json

from tests.kept_numbers import FEW, KEPT, differences, numbers_of, of_results


def test_numbers_of_the_commands_stay():
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    assert differences(kept, of_results(numbers_of(FEW)), relative=1e-6) == []
