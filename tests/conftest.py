"""What the tests share: a seeded generator, the bundled arms, variants of them, and robots of
another package.
"""

from __future__ import annotations

import gc
import importlib.metadata
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import patch

os.environ["OMP_NUM_THREADS"] = (
    "1"  # before NumPy comes: each worker has one core, and matrices are small
)

import numpy as np
import pytest

from aacmm_pin.arm import Arm, ArmFile, load_arm_file
from aacmm_pin.effects import CAUSES
from tests.arm_files import PRISMATIC, RIGID
from tests.browser import Page

# Started in the background of a shell the tests would ignore interrupts, and so would what they
# start to interrupt it.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Looking for cycles after every few hundred objects takes a tenth of the time.
gc.set_threshold(20_000, 20, 50)

# bundled arm, convention, rows (from 1) that are made rigid, or (negative) prismatic
VARIANTS = [
    ("sino6", "standard-dh", ()),
    ("sino6", "modified-dh", ()),
    ("sino6", "standard-dh", (1, 4)),
    ("sino6", "standard-dh", (-3,)),
    ("sino6", "modified-dh", (-1, 5)),
    ("sino6", "modified-dh", (1, 4)),
    ("zero6", "standard-dh", ()),
    ("zero6", "modified-dh", ()),
]


@pytest.fixture(autouse=True)
def _nothing_of_other_tests() -> Iterator[None]:
    """Each test starts without pyplot figures and causes registered by others, whatever ran before
    it in this process.
    """
    _close_figures()
    with patch.dict(CAUSES):
        yield
    _close_figures()


def _close_figures() -> None:
    # Most tests draw nothing, and need not import it.
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    """A browser for the tests of one module; not for longer, for a page that moves keeps it
    busy.
    """
    with Page() as opened:
        yield opened


LONGEST = (
    "test_sound_verdicts",
    "test_blind_gate",
    "test_diagnosis_of_real_arms",
    "test_documented_code",
    "test_diagnosis",
    "test_demo",
    "test_diagnosis_report",
    "test_input_mistakes",
    "test_diagnosis_edges",
    "test_configurations",
    "test_guards",
    "test_cli",
    "test_real_arms",
    "test_names_paths_texts",
)
"""Files that take twenty seconds or more on a busy machine, the longest first."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files come first, lest one worker is busy with one at the end while the others
    have nothing to do.
    """
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(order)))


def pytest_collection_finish() -> None:
    """What has been imported stays, and need not be looked through for cycles again."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20190427)


@pytest.fixture(scope="session")
def sino6() -> Arm:
    return Arm.load("sino6")


@pytest.fixture(scope="session")
def zero6() -> Arm:
    return Arm.load("zero6")


@pytest.fixture(params=VARIANTS, ids=lambda v: "-".join(map(str, (*v[:2], *v[2]))))
def arm_file(request) -> ArmFile:
    """The bundled arms as they are, read in the other convention, with rows that do not move and
    with prismatic joints.
    """
    name, convention, other = request.param
    arm = load_arm_file(name)
    rows = []
    for number, row in enumerate(arm.joints, start=1):
        if number in other:
            row = row.model_copy(update=RIGID)
        if -number in other:
            row = row.model_copy(update=PRISMATIC)
        rows.append(row)
    return arm.model_copy(update={"convention": convention, "joints": rows})


@pytest.fixture(scope="session")
def robot_file() -> Callable[[str], Path]:
    """Path of a URDF of example-robot-data by its file name."""
    robots = importlib.metadata.distribution("example-robot-data")

    def find(name: str) -> Path:
        return next(
            Path(str(robots.locate_file(file))) for file in robots.files or [] if file.name == name
        )

    return find
