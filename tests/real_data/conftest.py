"""Measurements of real arms, which are no part of the project: they are read from the folder that a
variable names.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

VARIABLE = "AACMM_PIN_REAL_DATA"


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder with one subfolder an arm, each with a ``measurements.csv``."""
    name = os.environ.get(VARIABLE, "")
    if not name:
        pytest.skip(f"{VARIABLE} names no folder with measurements of real arms")
    folder = Path(name)
    if not folder.is_dir():
        pytest.fail(f"{VARIABLE} is {name!r}; expected a folder; here is {Path.cwd()}")
    return folder
