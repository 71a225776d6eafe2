"""A blind plant fails its acceptance test, the command that this names finds the cause, the
extended arm passes the next.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from blind.acceptance import acceptance_csv
from blind.plant import draw
from tests.cli import shell

LIMITS = "--mpe E_Uni=0.06 --mpe SPAT.Max=0.04 --mpe P_Form.Sph.1x25=0.06"


def verdicts(judged: dict[str, Any]) -> dict[str, set[str]]:
    """The verdicts on each set of coordinates."""
    found: dict[str, set[str]] = {}
    for figure in judged["figures"]:
        if figure["mpe_mm"] is not None:
            found.setdefault(figure["coordinates"], set()).add(figure["verdict"])
    return found


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "cause", "joint"),
    [(1, "encoder_eccentricity", 3), (2, "joint_compliance", 2), (6, "joint_hysteresis", 2)],
)
def test_failed_arm_is_diagnosed_and_passes(tmp_path, seed, cause, joint):
    first, second, sound = (tmp_path / f"{name}.csv" for name in ("first check", "second", "sound"))
    for twin, target, index in ((False, first, 1), (False, second, 2), (True, sound, 1)):
        plant = draw(seed, cause, joint, twin=twin).plant
        machine = replace(plant.machine, values=0.1 * plant.machine.values)  # well calibrated
        target.write_text(acceptance_csv(replace(plant, machine=machine), index), encoding="utf-8")
    assert verdicts(shell.found("accept sino6", sound, LIMITS))["sino6"] == {"conformity"}
    out, said = shell.done("accept sino6", first, LIMITS, "--json -")
    assert "non-conformity" in verdicts(json.loads(out))["sino6"]
    advice = next(line for line in said.splitlines() if "aacmm-pin diagnose" in line)
    _, words = advice.split("aacmm-pin ")
    extended = tmp_path / "extended.toml"
    found = shell.found(words, "--encoder-noise 8e-6 --no-cross-validation --arm-out", extended)
    assert (found["verdict"], [(f["cause"], f["joint"]) for f in found["findings"]]) == (
        "explained",
        [(cause, joint)],
    )
    new = verdicts(shell.found("accept sino6", extended, second, LIMITS))
    assert "non-conformity" in new["sino6"]
    assert new[str(extended)] == {"conformity"}
