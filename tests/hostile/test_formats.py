"""A file with mistakes gives a result or one of our errors, in bounded time: a small part of
``python -m tests.hostile``.
"""

from __future__ import annotations

import time

import pytest
from hypothesis import HealthCheck, given, settings

from aacmm_pin.errors import AacmmError
from tests.again import again
from tests.hostile.formats import FORMATS, mutated

LONGEST_LINE = 2000
"""Characters of one line of a message."""
LONGEST = 5.0
"""CPU time that a file of a few dozen lines may take [s]."""


@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)
def test_valid_files_are_read(kind, tmp_path):
    for content in kind.valid():
        (tmp_path / kind.name).write_bytes(content)
        kind.use(tmp_path / kind.name)


@pytest.mark.parametrize("files", [8, again(100)])
@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)
def test_a_mistake_gives_a_result_or_a_refusal(kind, files, tmp_path):
    @settings(
        max_examples=files,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=[*HealthCheck],
    )
    @given(mutated(kind.valid()))
    def used(content: bytes) -> None:
        (tmp_path / kind.name).write_bytes(content)
        began, said = time.process_time(), ""
        try:
            kind.use(tmp_path / kind.name)
        except AacmmError as error:
            said = str(error)
        assert max(map(len, said.splitlines()), default=0) < LONGEST_LINE, said
        assert time.process_time() - began < LONGEST

    used()
