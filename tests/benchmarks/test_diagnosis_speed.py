"""What a diagnosis costs beside the geometric calibration of the same file, and how much memory a long file takes.

Skipped by a plain ``pytest``; run by ``pytest tests/benchmarks --benchmark-only``. Times are of the processor.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import EncoderEccentricity
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements

NOISE = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
MOST_RATIO = {300: 8.0, 3000: 12.0}
LONG, MOST_BYTES = 12_000, 1e9


def measured(records: int) -> tuple[Arm, Measurements]:
    """Free points of SINO6 with an eccentric encoder."""
    arm = Arm.load("sino6")
    hidden = ErrorModel(arm, (EncoderEccentricity(joint=3, values=(1e-4, 0.0)),))
    return arm, simulate_measurements(hidden, "free", records, rng=np.random.default_rng(1))


@pytest.mark.parametrize("records", MOST_RATIO)
def test_diagnosis_beside_a_calibration(records: int, benchmark: BenchmarkFixture, say: Callable[[str], None]) -> None:
    arm, data = measured(records)
    seconds = []
    for work in (calibrate, diagnose):
        each = []
        for _ in range(3):
            start = time.process_time()
            work(arm, data, **NOISE, progress=False)
            each.append(time.process_time() - start)
        seconds.append(min(each))
    ratio = benchmark.extra_info["ratio"] = seconds[1] / seconds[0]
    benchmark.pedantic(lambda: diagnose(arm, data, **NOISE, progress=False), rounds=1)
    say(f"{records} records: calibration {seconds[0]:.2f} s, diagnosis {seconds[1]:.2f} s, ratio {ratio:.1f}")
    assert ratio <= MOST_RATIO[records]


def test_memory_of_a_long_file(benchmark: BenchmarkFixture, say: Callable[[str], None]) -> None:
    """The most that a process of its own has at once."""
    done = benchmark.pedantic(lambda: subprocess.run([sys.executable, __file__], capture_output=True, text=True), rounds=1)
    assert done.returncode == 0, done.stderr
    most = benchmark.extra_info["bytes"] = int(done.stdout)
    say(f"diagnosis of {LONG} records: {most / 1e6:.0f} MB at most")
    assert most <= MOST_BYTES


if __name__ == "__main__":
    diagnose(*measured(LONG), **NOISE, progress=False)
    print(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
