"""CSV is written as pandas writes it, cells of formulas quoted, and without pandas where the
columns are arrays.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd
import pytest

from aacmm_pin._support.text_escaping import csv_text

pytestmark = pytest.mark.fast

COLUMNS = {
    "whole": [1, 2, 3],
    "real": [1e-17, np.nan, -1 / 3],
    "text": ["a,b", 'q"\n', ""],
    "mixed": [1, "2", None],
    "yes": [True, False, True],
    "large": np.array([np.inf, -0.0, 1e300]),
}


def _by_pandas(frame: pd.DataFrame, quoting: Literal[0, 2]) -> str:
    text = frame.to_csv(index=False, lineterminator="\n", quoting=quoting)
    quote = '"' if quoting else ""  # they are text then
    return text.replace("True", f"{quote}true{quote}").replace("False", f"{quote}false{quote}")


def test_a_table_is_written_as_pandas_writes_it():
    """But for true and false, which are as they are in JSON."""
    frame = pd.DataFrame(COLUMNS)
    frame["count"] = pd.array([1, None, 3], dtype="Int64")
    frame["said"] = pd.array(["a", None, "b"], dtype="string")
    quotings: tuple[Literal[0, 2], ...] = (0, 2)
    for quoting in quotings:
        assert csv_text(frame, quoting) == _by_pandas(frame, quoting)
    assert csv_text(COLUMNS) == _by_pandas(pd.DataFrame(COLUMNS), 0)
    assert csv_text({"=head": ["=1+1", "-2", "@x"]}) == "'=head\n'=1+1\n-2\n'@x\n"
