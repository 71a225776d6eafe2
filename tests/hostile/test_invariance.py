"""What does not matter changes neither verdict nor names nor numbers; maps by one process and two:
tests/accuracy.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin.arm import Arm
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import ErrorModel, cause_of
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.again import again
from tests.few_causes import ECCENTRICITY_ALONE

RELATIVE = 2e-3
"""Of numbers that a search of many steps ended with; a log posterior itself is compared much closer
elsewhere.
"""
PROBABILITY = 1e-4
STATED = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5, "probe_noise": 1e-6}


def records(plan: str, seed: int = 5) -> Measurements:
    model = ErrorModel.load("sino6")
    model = model.with_effects(cause_of("encoder_eccentricity:3,amplitude_rad=4e-4", model))
    return simulate_measurements(model, plan, 60, rng=np.random.default_rng(seed), seats=6)


@pytest.fixture(scope="module")
def said() -> Callable[..., dict[str, Any]]:
    """What a diagnosis says, each file diagnosed once."""
    known: dict[tuple[int, str], dict[str, Any]] = {}
    asked: list[Measurements] = []  # kept, lest another file gets the id of one that is gone

    def of(data: Measurements, frame: str = "base") -> dict[str, Any]:
        key = (id(data), frame)
        if key not in known:
            asked.append(data)
            result = diagnose(Arm.load("sino6"), data, reference_frame=frame, **STATED)
            known[key] = result.summary()
        return known[key]

    return of


@pytest.fixture(scope="module")
def files() -> dict[str, Measurements]:
    return {plan: records(plan) for plan in ("free", "seats")}


def permuted(data: Measurements) -> Measurements:
    return data.take(np.random.default_rng(7).permutation(data.n))


def renamed(data: Measurements) -> Measurements:
    seat = data.conditions.seat
    other = np.array([f"{label[::-1]} 'ñ' $" for label in seat], dtype=object)
    return replace(data, conditions=replace(data.conditions, seat=other))


def with_names(found: dict[str, Any], old: Measurements, new: Measurements) -> dict[str, Any]:
    """What was said, with the seats' other names in labels of causes."""
    seats = zip(old.conditions.require("seat", ""), new.conditions.require("seat", ""), strict=True)
    text = json.dumps(found, ensure_ascii=False)
    for before, after in dict(seats).items():
        for start in ("seat_error:", '"seat": "'):
            text = text.replace(f'{start}{before}"', f'{start}{after}"')
    other: dict[str, Any] = json.loads(text)
    return other


def moved(data: Measurements) -> Measurements:
    turn = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    return replace(data, reference=data.reference @ turn.T + [1.0, -2.0, 0.5])


@ECCENTRICITY_ALONE
@pytest.mark.parametrize(
    ("plan", "frame", "change"),
    [
        again("free", "base", permuted),
        ("seats", "base", permuted),
        again("seats", "base", renamed),
        again("free", "external", moved),
    ],
)
def test_what_does_not_matter(files, said, plan, frame, change):
    data = files[plan]
    before, after = (said(each, frame) for each in (data, change(data)))
    if change is renamed:
        before = with_names(before, data, change(data))
    assert before["findings"], before["verdict"]
    assert before["held_out"], before["verdict"]
    assert list(differences(before, after)) == []


def differences(one: Any, other: Any, where: str = "") -> Iterator[str]:
    """Where two results differ: words at all, numbers by more than rounding."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        for key in one:
            yield from differences(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{where}[{k}]")
    elif isinstance(one, float) and isinstance(other, float):
        if not np.isclose(one, other, rtol=RELATIVE, atol=PROBABILITY * ("probability" in where)):
            yield f"{where}: {one!r}, {other!r}"
    elif one != other:
        yield f"{where}: {one!r}, {other!r}"
