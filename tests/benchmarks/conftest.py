"""What the benchmarks share: a line past the capture, and other packages in environments of their own."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    def print_past_the_capture(text: str) -> None:
        with capsys.disabled():
            print(f"\n{text}")

    return print_past_the_capture


@pytest.fixture
def peer(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """What the script of a package in ``peers/`` reports of a problem: arrays, and the nominal arm as URDF text.

    Skipped where ``AACMM_PIN_<PACKAGE>_PYTHON`` is not set or that interpreter cannot import the package.
    """

    def solve(package: str, urdf: str, *options: str, **arrays: NDArray[np.float64]) -> dict[str, Any]:
        variable = f"AACMM_PIN_{package.upper()}_PYTHON"
        if not (python := os.environ.get(variable)):
            pytest.skip(f"{variable} is not set, expected the interpreter of an environment with {package}")
        data, arm = tmp_path / "problem.npz", tmp_path / "arm.urdf"
        np.savez(data, **arrays)  # type: ignore[arg-type]
        arm.write_text(urdf, encoding="utf-8")
        script = Path(__file__).parent / "peers" / f"solve_with_{package}.py"
        command = [python, "-I", str(script), str(data), str(arm), *options]  # robotkinecal wants an absolute path
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
        if f"No module named '{package}'" in done.stderr:
            pytest.skip(f"{variable}={python} cannot import {package}")
        assert done.returncode == 0, done.stderr
        report: dict[str, Any] = json.loads(done.stdout)
        return report

    return solve


@pytest.fixture(scope="session")
def c_loop(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Callable[..., None]]:
    """A function of ``peers/kernels.c`` by its name: of whole numbers and arrays in C order. Skipped without a compiler."""
    if (compiler := shutil.which("cc")) is None:
        pytest.skip("no C compiler (cc)")
    source, library = Path(__file__).parent / "peers" / "kernels.c", tmp_path_factory.mktemp("c") / "kernels.so"
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True)
    functions = ctypes.CDLL(str(library))

    def function(name: str) -> Callable[..., None]:
        def call(*arguments: int | NDArray[np.float64]) -> None:
            assert all(a.flags.c_contiguous for a in arguments if isinstance(a, np.ndarray))
            functions[name](*(ctypes.c_long(a) if isinstance(a, int) else ctypes.c_void_p(a.ctypes.data) for a in arguments))

        return call

    return function
