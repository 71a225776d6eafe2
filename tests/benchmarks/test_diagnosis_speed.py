"""How long ``diagnose`` computes, gain on held-out groups included, beside ``calibrate`` of the same file in the same run.

Skipped by a plain ``pytest``; run by ``pytest tests/benchmarks/test_diagnosis_speed.py --benchmark-only`` with
``OMP_NUM_THREADS=1``. Seconds are of computing (user and system), so that other work on the machine does not count. The
targets are reported; what is asserted is only that ``diagnose`` takes no more than so many times what ``calibrate`` takes:
seconds depend on the machine, their ratio hardly does.
"""

from __future__ import annotations

import cProfile
import pstats
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import aacmm_pin
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import Effect, EncoderEccentricity, JointCompliance
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.simulate import Plan, simulate_measurements

HIDDEN: list[Effect] = [EncoderEccentricity(joint=3, values=(6e-5, 8e-5)), JointCompliance(joint=2, values=(2e-5,))]
TARGETS = {300: 3.0, 12_000: 30.0}
"""Seconds of computing by number of records."""
MOST_RATIO = {300: 150.0, 12_000: 60.0}
"""No diagnosis may take longer than so many calibrations."""
TOP = 8
PACKAGE = Path(aacmm_pin.__file__).parent


def computing(work: Callable[[], object]) -> float:
    """Seconds of this process, all threads."""
    start = time.process_time()
    work()
    return time.process_time() - start


def where(work: Callable[[], object]) -> Counter[str]:
    """Seconds in each module of the package, or library, by ``cProfile``."""
    profile = cProfile.Profile()
    profile.runcall(work)
    modules: Counter[str] = Counter()
    for (file, _, _), (_, _, own, _, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        modules[_module(file)] += own
    return modules


def _module(file: str) -> str:
    path = Path(file)
    if path.is_relative_to(PACKAGE):
        return str(path.relative_to(PACKAGE))
    parts = path.parts
    return parts[parts.index("site-packages") + 1] if "site-packages" in parts else "python"


@pytest.mark.parametrize("plan", ["free", "seats"])
@pytest.mark.parametrize("records", list(TARGETS))
def test_diagnosis_with_held_out_groups(
    records: int, plan: Plan, benchmark: BenchmarkFixture, say: Callable[[str], None]
) -> None:
    arm = Arm.load("sino6")
    model = ErrorModel(arm).with_effects(*HIDDEN)
    measurements = simulate_measurements(model, plan, records, rng=np.random.default_rng(1))
    noise = {"encoder_noise": 8e-6, "reference_noise": 12e-6}
    reference = partial(calibrate, arm, measurements, **noise)
    work = partial(diagnose, arm, measurements, **noise)
    yardstick = min(computing(reference) for _ in range(3))
    diagnosed: list[Diagnosis] = []
    seconds = computing(lambda: diagnosed.append(benchmark.pedantic(work, rounds=1)))
    modules = where(work)
    ratio = seconds / yardstick
    benchmark.extra_info |= {"seconds": seconds, "ratio": ratio, "modules": dict(modules)}
    say(
        f"diagnosis of {records} records, plan {plan}: {seconds:.2f} s of computing, target {TARGETS[records]:g} s; "
        f"{ratio:.0f} times calibrate ({yardstick:.3f} s), at most {MOST_RATIO[records]:g}\n"
        + "\n".join(f"  {share / modules.total():6.1%}  {name}" for name, share in modules.most_common(TOP))
    )
    assert {f.label for f in diagnosed[0].findings} >= {effect.label for effect in HIDDEN}  # or it was quick for nothing
    assert diagnosed[0].held_out is not None
    assert ratio < MOST_RATIO[records]
