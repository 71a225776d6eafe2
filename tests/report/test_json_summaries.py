"""JSON of accuracy and maps: keys of the contract, strict JSON, numbers that agree with where they
come from.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from aacmm_pin import (
    ConfigurationCircle,
    accuracy_volume,
    comprehensive_accuracy,
    configuration_circle,
)
from aacmm_pin.report.json_summaries import accuracy_summary

pytestmark = pytest.mark.fast

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3
UNREACHABLE = np.array([5.0, 5.0, 5.0])
OUTSIDE_LIMITS = np.array([0.01, 0.0, -0.22])


def summary(circle: ConfigurationCircle, **options: Any) -> dict[str, Any]:
    accuracy = accuracy_volume(circle.arm, circle.q[circle.within_limits], at=circle.at, **options)
    return accuracy_summary(circle, accuracy, 12)


def through_json(content: dict[str, Any]) -> Any:
    return json.loads(json.dumps(content, allow_nan=False))


def test_accuracy_numbers_agree_with_their_sources(circle, sino6):
    content = summary(circle)
    q = circle.q[circle.within_limits]
    assert content["configurations"] == len(q) < len(circle)
    volume = accuracy_volume(sino6, q, at="frame5").volume * 1e9
    assert (
        content["volume_mm3"]["min"] == content["best"]["volume_mm3"] == pytest.approx(volume.min())
    )
    assert (
        content["volume_mm3"]["max"]
        == content["worst"]["volume_mm3"]
        == pytest.approx(volume.max())
    )
    assert content["volume_mm3"]["median"] == pytest.approx(np.median(volume))
    assert content["volume_mm3"]["comprehensive"] == pytest.approx(
        comprehensive_accuracy(volume, q[:, 2], POINT)
    )
    again = accuracy_volume(sino6, np.radians([content["worst"]["theta_deg"]]), at="frame5")
    assert again.volume[0] * 1e9 == pytest.approx(content["worst"]["volume_mm3"], rel=1e-6)
    assert again.u[0] * 1e3 == pytest.approx(content["worst"]["u_mm"], rel=1e-6)
    shares = [row["share"] for row in content["budget"]]
    assert sum(shares) == pytest.approx(1.0)
    assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize(
    ("point", "said"),
    [(UNREACHABLE, "8660.25 mm from the shoulder"), (OUTSIDE_LIMITS, "within the joint")],
)
def test_nothing_to_judge_gives_nulls_and_a_reason(sino6, point, said):
    content = through_json(summary(configuration_circle(sino6, point, count=12)))
    assert content["configurations"] == 0
    assert said in content["reason"]
    assert set(content["volume_mm3"].values()) == {None}
    nothing = {"theta_deg": None, "swivel_deg": None, "volume_mm3": None, "u_mm": None}
    assert content["best"] == content["worst"] == content["smallest_u"] == nothing
    assert content["budget"] == []
