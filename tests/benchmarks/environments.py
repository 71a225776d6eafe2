"""Work outside this process: packages in environments of their own, children and their memory, and
the C compiler.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PEERS = Path(__file__).parent / "peers"
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC")


class MissingError(Exception):
    """What is beside this package cannot be had on this machine; says what and why."""


class Seconds(float):
    """CPU time that work elsewhere says it took [s]."""


def folder(package: str) -> Path:
    """Where the environment of a package is kept."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "aacmm_pin" / "peers" / package


def is_installed(package: str) -> bool:
    return (folder(package) / "installed").exists()


def install(package: str) -> None:
    """Make the environment of a package from PyPI, once.

    Raises:
        MissingError: it cannot be installed.
    """
    if is_installed(package):
        return
    python = folder(package) / "bin" / "python"
    for command in (
        [sys.executable, "-m", "venv", "--clear", str(folder(package))],
        [str(python), "-m", "pip", "install", "--quiet", package],
    ):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            last = (done.stderr or done.stdout).strip().splitlines()[-1:]
            raise MissingError(f"{package} cannot be installed: {' '.join(last)}")
    (folder(package) / "installed").touch()


def ask(
    package: str, script: str, urdf: str, *options: str, **arrays: NDArray[np.float64]
) -> dict[str, Any]:
    """What a script in ``peers/`` reports of a problem: arrays, and the nominal arm as URDF
    text.
    """
    with tempfile.TemporaryDirectory() as problem:
        data, arm = Path(problem) / "problem.npz", Path(problem) / "arm.urdf"
        np.savez(data, **arrays)  # type: ignore[arg-type]
        arm.write_text(urdf, encoding="utf-8")
        command = [folder(package) / "bin" / "python", "-I", PEERS / script, data, arm, *options]
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, capture_output=True, text=True, cwd=problem, env=environment)
    if done.returncode:
        raise RuntimeError(f"{script} with {package}: {done.stderr}")
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def child(*words: str) -> Seconds:
    """CPU time of ``python WORDS`` with all that it starts [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"python {' '.join(words)}: {done.stderr}")
    return Seconds(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def by_itself(before: str, code: str) -> tuple[float, int]:
    """CPU time of ``code`` in a Python process of its own, once ``before`` is done [s], and the
    most memory it had [byte].

    From /proc, for the maximum that ``getrusage`` reports holds that of the process that started it
    too.

    Raises:
        MissingError: no /proc on this system.
    """
    if not Path("/proc/self/status").exists():
        raise MissingError("no /proc here that tells the memory of a process")
    peak = "next(row.split()[1] for row in open('/proc/self/status') if row.startswith('VmHWM'))"
    text = (
        f"import time\n{before}\nstart = "
        f"time.process_time()\n{code}\nprint(time.process_time() - start, {peak})"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    seconds, kilobytes = done.stdout.split()[-2:]
    return float(seconds), 1024 * int(kilobytes)


class PlainC:
    """The loops of ``peers/kernels.c`` for an arm in standard DH, compiled on the spot.

    Raises:
        MissingError: no C compiler.
    """

    def __init__(self, rows: NDArray[np.float64]) -> None:
        self.rows = np.ascontiguousarray(rows)
        if (compiler := shutil.which("gcc") or shutil.which("cc")) is None:
            raise MissingError("no C compiler (gcc or cc)")
        with tempfile.TemporaryDirectory() as built:
            library = Path(built) / "kernels.so"
            source = PEERS / "kernels.c"
            subprocess.run(
                [compiler, *FLAGS, str(source), "-o", str(library), "-lm"],
                check=True,
            )
            self.library = ctypes.CDLL(str(library))

    def _call(self, name: str, *arguments: int | NDArray[np.float64]) -> None:
        function: Callable[..., Any] = self.library[name]
        function(
            *(
                ctypes.c_long(a) if isinstance(a, int) else ctypes.c_void_p(a.ctypes.data)
                for a in arguments
            )
        )

    def sensitivities(
        self, q: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (n, 3) [m] and sensitivity (n, 3, 4 rows)."""
        n, rows = len(q), len(self.rows)
        position, columns = np.empty((n, 3)), np.empty((n, 3, 4 * rows))
        self._call("sensitivities", n, rows, self.rows, np.ascontiguousarray(q), position, columns)
        return position, columns

    def volumes(self, generators: NDArray[np.float64]) -> NDArray[np.float64]:
        """Volumes (n,) [m³] of zonotopes."""
        volume = np.empty(len(generators))
        self._call(
            "volumes",
            len(generators),
            generators.shape[2],
            np.ascontiguousarray(generators),
            volume,
        )
        return volume
