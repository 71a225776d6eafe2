"""Loops for numba and their NumPy twins: to the last bit, by the size of the task, and with a
damaged cache.
"""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin._support.compiled import ALWAYS, LARGE_TASK, NEVER, VARIABLE, Twins
from aacmm_pin.accuracy import zonotope
from aacmm_pin.errors import UnknownNameError

pytestmark = pytest.mark.fast

LOOP = """
def add_one(values):
    for i in range(len(values)):
        values[i] += 1.0
"""


def add_one(values: Array) -> None:
    values += 1.0


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for what is compiled."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path / "kept"


def twins(folder: Path) -> Twins:
    """As a new process would have them."""
    path = folder / "loop.py"
    if not path.exists():
        path.write_text(LOOP, encoding="utf-8")
    spec = spec_from_file_location("loop", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return Twins(module.add_one, "void(f8[::1])", plain=add_one)


def of_both(monkeypatch: pytest.MonkeyPatch, work: Any) -> list[Array]:
    found = []
    for way in (NEVER, ALWAYS):
        monkeypatch.setenv(VARIABLE, way)
        found.append(np.concatenate([np.ravel(part) for part in work()]))
    return found


def test_volumes_of_zonotopes(rng, monkeypatch):
    for count in (0, 2, 3, 7, 24):
        for n in (0, 1, 2, 31, 33, zonotope.CHUNK + 1):
            g = rng.normal(size=(3, count, n)).transpose(2, 0, 1)
            g.flags.writeable = False
            plain, loop = of_both(
                monkeypatch,
                lambda g=g: (zonotope.volume(g), zonotope.volume(np.ascontiguousarray(g))),
            )
            np.testing.assert_array_equal(plain, loop)


def test_a_large_task_is_done_by_the_loop(kept, tmp_path, monkeypatch):
    both = twins(tmp_path)
    small, large = np.zeros(3), np.zeros(LARGE_TASK)
    both(small)
    assert not kept.exists()
    both(large)
    assert [*kept.rglob("*.nbi")]
    monkeypatch.setattr(numba, "njit", None)
    monkeypatch.setenv(VARIABLE, NEVER)
    twins(tmp_path)(large)
    np.testing.assert_array_equal((small[0], large[-1]), (1.0, 2.0))
    monkeypatch.setenv(VARIABLE, "yes")
    with pytest.raises(UnknownNameError, match=f"{VARIABLE}.*'yes'.*always, never"):
        both(small)


def test_what_is_kept_may_be_damaged_or_have_no_folder(kept, tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, ALWAYS)
    values = np.zeros(3)
    twins(tmp_path)(values)
    for file in kept.rglob("*.nb?"):
        file.write_bytes(file.read_bytes()[:100])  # as a full disk leaves it
    twins(tmp_path)(values)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "loop.py"))
    twins(tmp_path)(values)
    np.testing.assert_array_equal(values, 3.0)
