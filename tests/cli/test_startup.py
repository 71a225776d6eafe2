"""What is loaded with what: modules are counted and named, for seconds depend on the machine."""

from __future__ import annotations

import subprocess
import sys

import pytest
from shell import POINT

HEAVY = (
    "matplotlib",
    "jinja2",
    "xarray",
    "meshcat",
    "numba",
    "IPython",
    "scipy.stats",
    "scipy.optimize",
    "scipy.spatial",
)

HEAVY_BUT_LOOPS = tuple(name for name in HEAVY if name != "numba")
"""Of commands that follow curves of postures, in compiled loops."""


def loaded(code: str) -> set[str]:
    """Names of the modules that a new process has loaded after ``code``."""
    told = (
        "import atexit, sys\natexit.register(lambda: sys.stderr.write('\\n' + ' "
        f"'.join(sys.modules)))\n{code}"
    )
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    return set(done.stderr.splitlines()[-1].split())


def command(words: str) -> str:
    """The code that runs a command."""
    return f"from aacmm_pin.cli.root_command import app\napp({words.split()})"


@pytest.mark.parametrize(
    ("code", "most", "without"),
    [
        ("import aacmm_pin", 3, ("numpy", *HEAVY)),
        ("import aacmm_pin.diagnosis.diagnose", 123, HEAVY),
        (command("--help"), 12, ("numpy", "rich", "pandas", *HEAVY)),
        ("import aacmm_pin.accuracy.volume", 35, ("pandas", "scipy.special", "tqdm", *HEAVY)),
        (command(f"accuracy sino6 {POINT}"), 73, HEAVY_BUT_LOOPS),
        (command(f"configurations sino6 {POINT}"), 58, ("pandas", "rich", *HEAVY_BUT_LOOPS)),
    ],
)
def test_what_is_loaded(code, most, without):
    names = loaded(code)
    assert sum(name.split(".")[0] == "aacmm_pin" for name in names) <= most
    assert names.isdisjoint(without), names & {*without}
