"""Notes and their sentences: each code has one, each sentence has a code, and all are short."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from inspect import getdoc
from typing import get_args

import pytest

from aacmm_pin._support.display import Note
from aacmm_pin.diagnosis import verdict
from aacmm_pin.diagnosis.verdict import Verdict
from aacmm_pin.report.messages import SENTENCES
from aacmm_pin.report.verdicts import VERDICTS, WORDS_OF_DOUBTS
from tests.test_rooms import MODULES

pytestmark = pytest.mark.fast

WORDS = 25
"""A sentence has no more."""


def strings(of_notes: bool) -> Iterator[str]:
    """All strings of the package but the table's; of the codes in ``Note("code", …)`` alone."""
    for module, path in MODULES.items():
        nodes = (
            []
            if module == "report.messages"
            else [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
        )
        if of_notes:
            calls = [
                node
                for node in nodes
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "Note"
            ]
            nodes = [call.args[0] for call in calls]
        yield from (
            node.value
            for node in nodes
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        )


def test_every_code_has_a_sentence_and_every_sentence_a_code():
    assert {*strings(of_notes=True)} <= {*SENTENCES} <= {*strings(of_notes=False)}


def test_every_verdict_and_doubt_has_a_sentence_and_a_row_of_the_pages():
    assert {*WORDS_OF_DOUBTS} == {*verdict.DOUBTS}
    assert {*VERDICTS} == {*get_args(Verdict)}
    rows = [getdoc(text.sentence).split("\n\n") for text in VERDICTS.values()]
    assert {len(row) for row in rows} == {2}


def test_sentences_are_short_and_ask_nothing():
    texts = [re.sub(r"\{[^}]*\}", "X", text) for text in SENTENCES.values()]
    each = [part for text in texts for part in re.split(r"[.;:] ", text)]
    assert [part for part in each if "?" in part or len(part.split()) > WORDS] == []


@pytest.mark.parametrize(
    ("note", "text"),
    [
        (Note("copies", {"rows": [3, 4, 5, 9]}), "3 to 5, 9"),
        (Note("few_postures", {"postures": 1, "records": 12}), "1 posture"),
        (Note("columns_unused", {"columns": ["a", "b", "c"]}), "a, b and c"),
        (Note("reference_noise_assumed", {"noise": 1.2e-5}), "0.012 mm"),
        (Note("readings_scatter", {"joint": 2, "scatter": 5.04e-5, "unit": "µrad"}), "50 µrad"),
        (
            Note("arm_degenerate").with_place("sphere 2").with_place("touches.csv"),
            "touches.csv: sphere 2: all postures",
        ),
    ],
)
def test_values_in_a_sentence(note, text):
    """Rows in runs, counts, lists, lengths in mm, angles in degrees, two digits, and the place in
    front.
    """
    assert text in str(note)
    assert repr(note) == repr(str(note))
