"""Loops for numba and the same in NumPy: to the last bit, by the size of the task, and with a
damaged cache.
"""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.compiled import ALWAYS, NEVER, VARIABLE, Loop
from aacmm_pin.accuracy import zonotope
from aacmm_pin.errors import UnknownNameError

pytestmark = pytest.mark.fast

LOOP = """
def add_one(values):
    for i in range(len(values)):
        values[i] += 1.0
"""


LARGE = 1000


@pytest.fixture
def kept(tmp_path, monkeypatch) -> Path:
    """A folder for what is compiled."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path / "kept"


def loaded(folder: Path) -> Loop:
    """As a new process would have it."""
    path = folder / "loop.py"
    if not path.exists():
        path.write_text(LOOP, encoding="utf-8")
    spec = spec_from_file_location("loop", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return Loop(module.add_one, "void(f8[::1])", least=LARGE)


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
    loop = loaded(tmp_path)
    assert loop.chosen(LARGE - 1) is None
    assert not kept.exists()
    values, add_one = np.zeros(LARGE), loop.chosen(LARGE)
    assert add_one is not None
    add_one(values)
    np.testing.assert_array_equal(values, 1.0)
    assert [*kept.rglob("*.nbi")]
    monkeypatch.setattr(numba, "njit", None)
    monkeypatch.setenv(VARIABLE, NEVER)
    assert loaded(tmp_path).chosen(LARGE) is None
    monkeypatch.setenv(VARIABLE, "yes")
    with pytest.raises(UnknownNameError, match=f"{VARIABLE}.*'yes'.*always, never"):
        loop.chosen(1)


def test_what_is_kept_may_be_damaged_or_have_no_folder(kept, tmp_path, monkeypatch):
    values = np.zeros(3)
    loaded(tmp_path).compiled(values)
    for file in kept.rglob("*.nb?"):
        file.write_bytes(file.read_bytes()[:100])  # as a full disk leaves it
    loaded(tmp_path).compiled(values)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "loop.py"))
    loaded(tmp_path).compiled(values)
    np.testing.assert_array_equal(values, 3.0)
