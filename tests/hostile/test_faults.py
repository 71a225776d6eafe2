"""A command that is stopped or cannot write leaves all as it was: a small part of ``python -m
tests.hostile``.
"""

from __future__ import annotations

import signal
import sys

import pytest

from tests.hostile.faults import SIMULATE, Place, refused, small_files, stopped

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked up in /proc")


@pytest.mark.long
def test_old_files_or_new_ones_and_no_mixture(tmp_path):
    place = Place.of(SIMULATE, tmp_path / "place")
    assert refused(place, small_files) == "refused"
    assert stopped(place, signal.SIGTERM, 0.9 * place.seconds, everyone=False) in ("old", "new")
    assert stopped(place, signal.SIGKILL, 0.9 * place.seconds, everyone=False) == "whole"
